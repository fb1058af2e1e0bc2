"""`poses_bounds.npy` of LLFF: poses without a COLMAP model.

A row has 17 numbers: a 3 × 5 matrix, row after row, then the nearest and farthest depth. The matrix's first three
columns are the camera's axes in the world, in the order down, right, backwards. The fourth is the camera's place. The
fifth holds height, width and focal length, pixels. The rows go with the pictures, sorted by name.

So right, down, forwards (OpenCV's axes) are columns 1, 0 and minus 2, and the world-to-camera rotation has them as
rows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .colmap import Picture
from .errors import FileError
from .lens import Lens


def read(path: Path, names: list[str]) -> list[Picture]:
    """The pictures with their poses; `names` are the files of the picture folder."""
    try:
        rows = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise FileError(path, f"cannot be read: {error}") from None
    if rows.ndim != 2 or rows.shape[1] != 17 or not np.isfinite(rows.astype(np.float64)).all():
        raise FileError(path, f"an array of {rows.shape}; LLFF's has 17 numbers for each picture")
    if len(rows) != len(names):
        raise FileError(path, f"{len(rows)} poses, but {len(names)} pictures: which belongs to which is not known")
    return [_picture(path, name, row.reshape(-1)[:15].reshape(3, 5)) for name, row in zip(sorted(names), rows)]


def _picture(path: Path, name: str, matrix: np.ndarray) -> Picture:
    matrix = matrix.astype(np.float64)
    rotation = np.stack([matrix[:, 1], matrix[:, 0], -matrix[:, 2]])
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
        raise FileError(path, f"{name}: its axes are no right-handed frame (down, right, backwards)")
    height, width, focal = matrix[:, 4]
    if not (width >= 1 and height >= 1 and focal > 0):
        raise FileError(path, f"{name}: {width}×{height} pixels, focal length {focal}")
    lens = Lens("PINHOLE", round(width), round(height), focal, focal, width / 2, height / 2, ())
    return Picture(name, rotation, -rotation @ matrix[:, 3], lens)

"""COLMAP's sparse models: `cameras.bin`, `images.bin` and `points3D.bin`."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .cameras import rotation_of
from .errors import FileError
from .lens import MODELS, Lens


@dataclass(frozen=True)
class Picture:
    """World to camera, as in our camera file."""

    name: str
    rotation: np.ndarray
    translation: np.ndarray
    lens: Lens


@dataclass(frozen=True)
class Points:
    """count × 3 float64, count × 3 uint8."""

    positions: np.ndarray
    colours: np.ndarray


class _Reader:
    """Numbers of a file, one after another. A file that is cut short is an error that names it."""

    def __init__(self, path: Path) -> None:
        self.path, self.at = path, 0
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise FileError(path, f"cannot be read: {error}") from None

    def take(self, form: str) -> tuple:
        values = struct.Struct("<" + form)
        self._need(values.size)
        self.at += values.size
        return values.unpack_from(self.data, self.at - values.size)

    def skip(self, size: int) -> None:
        self._need(size)
        self.at += size

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise FileError(self.path, f"byte {self.at}: a name without an end")
        found = self.data[self.at : end]
        self.at = end + 1
        try:
            return found.decode("utf-8")
        except UnicodeDecodeError:
            raise FileError(self.path, f"byte {self.at}: a name that is not UTF-8") from None

    def _need(self, size: int) -> None:
        if self.at + size > len(self.data):
            raise FileError(self.path, f"byte {self.at}: the file ends here; {size} more bytes are due")


def read_cameras(path: Path) -> dict[int, Lens]:
    reader, lenses = _Reader(path), {}
    (count,) = reader.take("Q")
    for _ in range(count):
        number, model, width, height = reader.take("iiQQ")
        if model not in MODELS:
            raise FileError(path, f"camera {number}: model {model}; models 0 to {max(MODELS)} can be converted")
        parameters = reader.take(f"{MODELS[model][1]}d")
        lens = Lens.of(model, width, height, parameters)
        if not 0 < width <= 65535 or not 0 < height <= 65535 or not np.isfinite(parameters).all():
            raise FileError(path, f"camera {number}: {width}×{height} pixels, parameters {parameters}")
        if lens.fx <= 0 or lens.fy <= 0:
            raise FileError(path, f"camera {number}: focal lengths {lens.fx}, {lens.fy}")
        lenses[number] = lens
    return lenses


def read_pictures(path: Path, lenses: dict[int, Lens]) -> list[Picture]:
    """By name, which is the order of time in most data sets."""
    reader, found = _Reader(path), []
    (count,) = reader.take("Q")
    for _ in range(count):
        number, *pose = reader.take("i7d")
        (camera,) = reader.take("i")
        name = reader.text()
        (points,) = reader.take("Q")
        reader.skip(24 * points)
        if camera not in lenses:
            raise FileError(path, f"picture {number} ({name}): there is no camera {camera}")
        if not np.isfinite(pose).all() or not np.linalg.norm(pose[:4]) > 0:
            raise FileError(path, f"picture {number} ({name}): its pose is not one")
        found.append(Picture(name, rotation_of(np.array(pose[:4])), np.array(pose[4:]), lenses[camera]))
    if not found:
        raise FileError(path, "has no pictures")
    return sorted(found, key=lambda picture: picture.name)


def read_points(path: Path) -> Points:
    reader, positions, colours = _Reader(path), [], []
    (count,) = reader.take("Q")
    for _ in range(count):
        _, x, y, z, red, green, blue, _, track = reader.take("Q3d3BdQ")
        reader.skip(8 * track)
        positions.append((x, y, z))
        colours.append((red, green, blue))
    return Points(np.array(positions).reshape(-1, 3), np.array(colours, dtype=np.uint8).reshape(-1, 3))

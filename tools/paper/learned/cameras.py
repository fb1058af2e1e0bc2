"""The project's camera file: OpenCV world-to-camera poses, `cameras.json`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import ArgumentError, FileError

CONVENTION = (
    "OpenCV camera (x right, y down, z forward); world-to-camera: X_cam = R(q) X_world + t; q = w,x,y,z unit; "
    "pixel (0,0) covers [0,1)x[0,1)"
)


@dataclass(frozen=True)
class View:
    """One picture of a run. `rotation` (3 × 3) and `translation` (3) take the world to the camera."""

    file: str
    index: int
    split: str | None
    rotation: np.ndarray
    translation: np.ndarray
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def name(self) -> str:
        return Path(self.file).stem

    @property
    def quaternion(self) -> np.ndarray:
        return quaternion_of(self.rotation)

    @property
    def centre(self) -> np.ndarray:
        """Where the camera is, in the world."""
        return -self.rotation.T @ self.translation


@dataclass(frozen=True)
class CameraFile:
    path: Path
    width: int
    height: int
    views: list[View]

    def picture(self, view: View) -> Path:
        return self.path.parent / view.file


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """3 × 3 of (w, x, y, z); the length does not matter."""
    w, x, y, z = np.asarray(quaternion, dtype=np.float64) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """(w, x, y, z) of a rotation, w ≥ 0: the eigenvector of Bar-Itzhack's matrix, exact for every angle."""
    r = np.asarray(rotation, dtype=np.float64)
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    _, vectors = np.linalg.eigh(matrix)  # reads the lower triangle
    quaternion = vectors[[3, 0, 1, 2], 3]
    return -quaternion if quaternion[0] < 0 else quaternion


def read(path: Path, split: str | None = None) -> CameraFile:
    """Reads a camera file; the views in time order, those of `split` alone if it is given."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, f"cannot be read: {error}") from None
    except json.JSONDecodeError as error:
        raise FileError(path, f"not JSON: {error}") from None
    try:
        width, height = int(content["width"]), int(content["height"])
        views = [_view(image, content, index) for index, image in enumerate(content["images"])]
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(path, f"not a camera file: {type(error).__name__} {error}") from None
    if width < 1 or height < 1:
        raise FileError(path, f"pictures of {width}×{height} pixels")
    splits = sorted({view.split for view in views if view.split is not None})
    if split is not None:
        views = [view for view in views if view.split == split]
        if not views:
            raise ArgumentError(f"{path}: no picture in the split `{split}`; it has {', '.join(splits) or 'none'}")
    if not views:
        raise FileError(path, "has no pictures")
    return CameraFile(path, width, height, sorted(views, key=lambda view: view.index))


def _view(image: dict, content: dict, index: int) -> View:
    quaternion = np.array([float(value) for value in image["qvec"]])
    translation = np.array([float(value) for value in image["tvec"]])
    if quaternion.shape != (4,) or translation.shape != (3,):
        raise ValueError(f"pose of {image['file']}")
    if not (np.isfinite(quaternion).all() and np.isfinite(translation).all() and np.linalg.norm(quaternion) > 0):
        raise ValueError(f"pose of {image['file']}")
    lens = [float(image.get(key, content.get(key, "missing"))) for key in ("fx", "fy", "cx", "cy")]
    split = image.get("split")
    return View(str(image["file"]), int(image.get("index", index)), split, rotation_of(quaternion), translation, *lens)


def write(path: Path, width: int, height: int, views: list[View]) -> None:
    """Writes a camera file; every image has its own intrinsics, those of the first stand above, too."""
    first = views[0]
    content = {
        "width": width,
        "height": height,
        "convention": CONVENTION,
        **{key: getattr(first, key) for key in ("fx", "fy", "cx", "cy")},
        "images": [
            {
                "index": view.index,
                "file": view.file,
                **({"split": view.split} if view.split is not None else {}),
                "qvec": view.quaternion.tolist(),
                "tvec": view.translation.tolist(),
                **{key: getattr(view, key) for key in ("fx", "fy", "cx", "cy")},
            }
            for view in views
        ],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

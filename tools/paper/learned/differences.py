"""Difference pictures to train on: frames of the mapping run less renders of the prior near their poses.

Half of them are drawn at the frame's pose. The others are moved off a little, as a search leaves it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import pictures
from .cameras import CameraFile
from .errors import ArgumentError, FileError
from .renders import Pose, Renderer

# As a search leaves it: a few thousandths of the depth, a few tenths of a degree.
SHIFT_OF_DEPTH = 0.003
TURN_DEGREES = 0.2


def difference(frame: np.ndarray, render: np.ndarray) -> np.ndarray:
    """round((frame − render + 255) / 2), as the paper's I_diff; halves go up."""
    return ((frame.astype(np.int32) - render + 256) // 2).astype(np.uint8)


def restored(picture: np.ndarray, render: np.ndarray) -> np.ndarray:
    """The frame that a difference picture stands for."""
    return np.clip(2 * picture.astype(np.int32) - 255 + render, 0, 255).astype(np.uint8)


def write(run: CameraFile, renderer: Renderer, each: int, seed: int, out: Path) -> int:
    """Writes `each` difference pictures of every frame to the folder; how many there are."""
    if each < 1:
        raise ArgumentError("--each must be at least 1")
    random = np.random.default_rng(seed)
    depth = renderer.median_depth(run, run.views[0])
    places = []
    for view in run.views:
        places.append((view, Pose.of(view)))
        for _ in range(each - 1):
            shift = random.normal(0, SHIFT_OF_DEPTH * depth, 3)
            places.append((view, Pose.of(view).moved(shift, np.radians(random.normal(0, TURN_DEGREES, 3)))))
    for index, ((view, _), render) in enumerate(zip(places, renderer.colours(run, places))):
        frame = pictures.read_rgb(run.picture(view))
        if frame.shape != (run.height, run.width, 3):
            size = f"{frame.shape[1]}×{frame.shape[0]}"
            raise FileError(run.picture(view), f"{size}, the camera file says {run.width}×{run.height}")
        pictures.write_rgb(out / f"{view.name}-{index % each}.png", difference(frame, render))
    return len(places)

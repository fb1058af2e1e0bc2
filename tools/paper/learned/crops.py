"""Training crops: random squares of a run's pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from . import cameras, pictures
from .errors import ArgumentError, FileError

CROP = 128


def of_run(camera_file: Path, split: str | None) -> list[np.ndarray]:
    """All pictures of a split, in memory (a mapping run at the paper's size is some 15 MB)."""
    run = cameras.read(camera_file, split)
    return [_large_enough(run.picture(view)) for view in run.views]


def of_folder(folder: Path) -> list[np.ndarray]:
    """All PNG pictures of a folder."""
    files = sorted(folder.glob("*.png"))
    if not files:
        raise FileError(folder, "holds no PNG pictures")
    return [_large_enough(file) for file in files]


def _large_enough(path: Path) -> np.ndarray:
    pixels = pictures.read_rgb(path)
    if min(pixels.shape[:2]) < CROP:
        raise FileError(path, f"{pixels.shape[1]}×{pixels.shape[0]}: crops of {CROP}×{CROP} do not fit")
    return pixels


class Crops:
    """Draws batches; the same seed gives the same ones."""

    def __init__(self, sources: list[np.ndarray], batch: int, seed: int) -> None:
        if batch < 1:
            raise ArgumentError("--batch must be at least 1")
        self.sources, self.batch = sources, batch
        self.random = np.random.default_rng(seed)

    def draw(self) -> torch.Tensor:
        """batch × 3 × 128 × 128 in [0, 1]; half of them mirrored."""
        crops = []
        for _ in range(self.batch):
            pixels = self.sources[self.random.integers(len(self.sources))]
            top = self.random.integers(pixels.shape[0] - CROP + 1)
            left = self.random.integers(pixels.shape[1] - CROP + 1)
            crop = pixels[top : top + CROP, left : left + CROP]
            crops.append(crop[:, ::-1] if self.random.random() < 0.5 else crop)
        return torch.from_numpy(np.stack(crops)).permute(0, 3, 1, 2).float() / 255

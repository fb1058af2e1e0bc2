"""Pictures as an ideal pinhole would have taken them."""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image

from .lens import Lens


def pinhole(lens: Lens) -> Lens:
    """The pinhole of the same size whose picture has no empty corner: the lens's own focal lengths, or longer ones."""
    zoom = 1.0
    for _ in range(400):
        if not lens.distorted or _covered(lens, zoom):
            break
        zoom *= 1.005
    return Lens("PINHOLE", lens.width, lens.height, lens.fx * zoom, lens.fy * zoom, lens.cx, lens.cy, ())


def _covered(lens: Lens, zoom: float) -> bool:
    """Whether all of the picture's border has a place in the distorted one."""
    along = np.linspace(0, 1, 101)
    zero, one = np.zeros_like(along), np.ones_like(along)
    border = np.concatenate([np.stack(pair, -1) for pair in ((along, zero), (along, one), (zero, along), (one, along))])
    ideal = (border * [lens.width, lens.height] - [lens.cx, lens.cy]) / ([lens.fx * zoom, lens.fy * zoom])
    there = lens.project(ideal)
    return bool((there >= 0).all() and (there <= [lens.width, lens.height]).all())


def undistort(pixels: np.ndarray, lens: Lens, ideal: Lens) -> np.ndarray:
    """Bicubic; the lens and the pinhole are those of a picture of this size."""
    height, width = pixels.shape[:2]
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(columns - ideal.cx) / ideal.fx, (rows - ideal.cy) / ideal.fy], -1)
    # Edges of the outermost pixels are −1 and 1, so that pixel centres lie at +0.5, as in the camera file.
    grid = torch.from_numpy(lens.project(rays) / [width, height] * 2 - 1).float().unsqueeze(0)
    source = torch.from_numpy(pixels.astype(np.float32)).permute(2, 0, 1).unsqueeze(0)
    drawn = F.grid_sample(source, grid, mode="bicubic", padding_mode="border", align_corners=False)
    return drawn[0].clamp(0, 255).round().byte().permute(1, 2, 0).numpy()


def resize(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    if pixels.shape[:2] == (height, width):
        return pixels
    return np.asarray(Image.fromarray(pixels, "RGB").resize((width, height), Image.Resampling.LANCZOS))

"""Pictures on disk and as tensors: RGB, 8 bits, values in [0, 1]."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image, UnidentifiedImageError

from .errors import FileError

# The codecs halve the picture six times (four for the latents, two for the hyper-latents).
ALIGNMENT = 64


def read_rgb(path: Path) -> np.ndarray:
    """A picture as height × width × 3, uint8."""
    try:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("RGB"))
    except FileNotFoundError:
        raise FileError(path, "there is no such picture") from None
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise FileError(path, f"not a picture that can be read: {error}") from None


def write_rgb(path: Path, pixels: np.ndarray) -> None:
    """Writes height × width × 3 uint8 as PNG; makes the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels, "RGB").save(path)


def to_tensor(pixels: np.ndarray) -> torch.Tensor:
    """1 × 3 × height × width, float32 in [0, 1]."""
    return torch.from_numpy(np.array(pixels)).permute(2, 0, 1).unsqueeze(0).float() / 255


def to_pixels(tensor: torch.Tensor) -> np.ndarray:
    """The nearest 8-bit picture."""
    return (tensor[0].clamp(0, 1) * 255).round().byte().permute(1, 2, 0).contiguous().numpy()


def pad(tensor: torch.Tensor) -> torch.Tensor:
    """Repeats the last row and column up to a multiple of 64."""
    height, width = tensor.shape[-2:]
    return F.pad(tensor, (0, -width % ALIGNMENT, 0, -height % ALIGNMENT), mode="replicate")


def psnr(left: np.ndarray, right: np.ndarray) -> float:
    """PSNR over all pixels and channels, peak 255, dB."""
    error = np.mean((left.astype(np.float64) - right.astype(np.float64)) ** 2)
    return float("inf") if error == 0 else float(10 * np.log10(255**2 / error))

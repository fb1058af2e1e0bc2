"""One picture as bytes, and back from the bytes alone.

Bytes: width, height, length of the first string (16 bits each, little endian), then the two strings of the codec's
range coder, latents and hyper-latents.
"""

from __future__ import annotations

import struct

import numpy as np
import torch
from compressai.models import CompressionModel

from . import pictures
from .errors import ArgumentError, StreamError

HEADER = struct.Struct("<HHH")
# Of the hyper-latents: the padded picture, halved six times.
HYPER_STRIDE = 64


def encode(model: CompressionModel, pixels: np.ndarray) -> bytes:
    height, width = pixels.shape[:2]
    if not 0 < width < 2**16 or not 0 < height < 2**16:
        raise ArgumentError(f"a picture of {width}×{height} pixels")
    with torch.inference_mode():
        coded = model.compress(pictures.pad(pictures.to_tensor(pixels)))
    latents, hyper = coded["strings"][0][0], coded["strings"][1][0]
    if len(latents) >= 2**16:
        raise ArgumentError(f"{len(latents)} bytes in one string: the picture is too large for this stream")
    return HEADER.pack(width, height, len(latents)) + latents + hyper


def decode(model: CompressionModel, data: bytes) -> np.ndarray:
    if len(data) < HEADER.size:
        raise StreamError(f"{len(data)} bytes: the header takes {HEADER.size}")
    width, height, length = HEADER.unpack_from(data)
    latents, hyper = data[HEADER.size : HEADER.size + length], data[HEADER.size + length :]
    # The range coder reads 32-bit words, one at least.
    if (
        width == 0
        or height == 0
        or len(latents) != length
        or length < 4
        or len(hyper) < 4
        or length % 4
        or len(hyper) % 4
    ):
        raise StreamError(f"{len(data)} bytes, {length} of them for the latents of {width}×{height} pixels: cut short")
    shape = (-(-height // HYPER_STRIDE), -(-width // HYPER_STRIDE))
    with torch.inference_mode():
        decoded = model.decompress([[latents], [hyper]], shape)["x_hat"]
    return pictures.to_pixels(decoded[..., :height, :width])

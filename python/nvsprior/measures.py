"""How near pictures are to others, as our figures say it: docs/paper.md has the definitions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .errors import ArgumentError

_Picture = NDArray[np.uint8]
_Plane = NDArray[np.float64]

# Weights of red, green and blue in the luma, of MATLAB's rgb2gray.
_LUMA = np.array([0.298936, 0.587043, 0.114021])
# The window of SSIM has so many pixels along a side; its constants are squares, values of 0 to 255.
_SIDE = 11
_GAUSS = np.exp(-((np.arange(_SIDE) - _SIDE // 2) ** 2) / (2 * 1.5**2))
_C1, _C2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2


def _pairs(a: _Picture, b: _Picture) -> list[tuple[_Picture, _Picture]]:
    """The pictures, one by one."""
    for name, given in (("a", a), ("b", b)):
        if not isinstance(given, np.ndarray) or given.dtype != np.uint8:
            found = given.dtype if isinstance(given, np.ndarray) else type(given).__name__
            raise TypeError(f"{name}: an array of uint8 is due, not {found}")
        if given.ndim not in (3, 4) or given.shape[-1] != 3 or given.size == 0:
            due = "(height, width, 3) or (N, height, width, 3)"
            raise ArgumentError(f"{name}: an array of shape {given.shape}, but {due} is due")
    if a.shape != b.shape:
        raise ArgumentError(f"b: an array of shape {b.shape}, but {a.shape} is due")
    return list(zip(a.reshape(-1, *a.shape[-3:]), b.reshape(-1, *b.shape[-3:])))


def psnr(a: _Picture, b: _Picture) -> float:
    """PSNR of pictures against others, dB.

    ``a``, ``b``: uint8 arrays of one shape, (height, width, 3) or (N, height, width, 3), RGB. The squared error is the
    mean over pixels and channels. Returns float: of N pictures the mean of their dB; infinity if two are equal.
    """

    def one(a: _Picture, b: _Picture) -> float:
        mse = np.mean((a.astype(np.float64) - b) ** 2)
        with np.errstate(divide="ignore"):
            return float(10.0 * np.log10(255.0**2 / mse))

    return float(np.mean([one(*pair) for pair in _pairs(a, b)]))


def ssim(a: _Picture, b: _Picture) -> float:
    """SSIM of pictures' luma, as in Wang's ``ssim.m``; 1: they are equal.

    ``a``, ``b``: as for ``psnr``, with sides of 11 pixels or more. The window is a Gaussian of 11x11 pixels and
    deviation 1.5, K1 is 0.01, K2 0.03, and nothing is padded. Pictures whose shorter side has 384 pixels or more are
    reduced first. Returns float: of N pictures the mean.
    """
    pairs = _pairs(a, b)
    factor = max(1, int(min(a.shape[-3:-1]) / 256 + 0.5))
    if min(a.shape[-3:-1]) // factor < _SIDE:
        raise ArgumentError(f"a: pictures of {a.shape[-2]}x{a.shape[-3]} pixels, SSIM needs sides of {_SIDE}")
    return float(np.mean([_ssim(_luma(a, factor), _luma(b, factor)) for a, b in pairs]))


def _luma(picture: _Picture, factor: int) -> _Plane:
    plane: _Plane = picture @ _LUMA
    if factor == 1:
        return plane
    before = factor // 2
    padded = np.pad(plane, (before, factor - 1 - before), mode="reflect")
    reduced = _weighted(padded, np.ones(factor))[::factor, ::factor]
    return reduced[: plane.shape[0] // factor, : plane.shape[1] // factor]


def _weighted(plane: _Plane, window: _Plane) -> _Plane:
    """Weighted means of all windows that lie within a plane."""
    window = window / window.sum()
    for axis in (0, 1):
        plane = np.lib.stride_tricks.sliding_window_view(plane, len(window), axis=axis) @ window
    return plane


def _ssim(a: _Plane, b: _Plane) -> float:
    mean_a, mean_b = _weighted(a, _GAUSS), _weighted(b, _GAUSS)
    variance_a = _weighted(a * a, _GAUSS) - mean_a**2
    variance_b = _weighted(b * b, _GAUSS) - mean_b**2
    covariance = _weighted(a * b, _GAUSS) - mean_a * mean_b
    above = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    return float(np.mean(above / ((mean_a**2 + mean_b**2 + _C1) * (variance_a + variance_b + _C2))))

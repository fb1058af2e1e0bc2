"""PSNR and SSIM, against their definitions written out."""

from __future__ import annotations

import math

import numpy as np
import pytest

import nvsprior


def pictures(height: int, width: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    waves = 128 + 60 * np.sin(0.1 * x) * np.cos(0.17 * y)
    a = np.stack([waves, 0.8 * waves, 255 - waves], axis=-1)
    b = a + generator.normal(scale=12, size=a.shape)
    return tuple(np.clip(np.rint(value), 0, 255).astype(np.uint8) for value in (a, b))


def ssim_written_out(a: np.ndarray, b: np.ndarray) -> float:
    """Wang et al. 2004, window by window."""
    a, b = (0.298936 * p[..., 0] + 0.587043 * p[..., 1] + 0.114021 * p[..., 2] for p in (a, b))
    weights = np.array([[math.exp(-((i - 5) ** 2 + (j - 5) ** 2) / 4.5) for j in range(11)] for i in range(11)])
    weights /= weights.sum()
    scores = []
    for top in range(a.shape[0] - 10):
        for left in range(a.shape[1] - 10):
            p, q = (plane[top : top + 11, left : left + 11] for plane in (a, b))
            mp, mq = (weights * p).sum(), (weights * q).sum()
            vp, vq = (weights * (p - mp) ** 2).sum(), (weights * (q - mq) ** 2).sum()
            cov = (weights * (p - mp) * (q - mq)).sum()
            c1, c2 = 2.55**2, 7.65**2
            scores.append((2 * mp * mq + c1) * (2 * cov + c2) / ((mp**2 + mq**2 + c1) * (vp + vq + c2)))
    return float(np.mean(scores))


def test_psnr_is_the_mean_of_decibels():
    a = np.zeros((2, 4, 5, 3), np.uint8)
    b = a.copy()
    b[0] += 1
    b[1, 0, 0, 0] = 51
    each = [nvsprior.psnr(a[i], b[i]) for i in range(2)]
    assert each == [pytest.approx(48.1308, abs=1e-4), pytest.approx(10 * math.log10(65025 / (51**2 / 60)))]
    assert nvsprior.psnr(a, b) == pytest.approx(sum(each) / 2)
    assert nvsprior.psnr(a, a) == math.inf


def test_ssim_is_wangs():
    for seed, size in enumerate([(24, 31), (11, 40)]):
        a, b = pictures(*size, seed)
        assert nvsprior.ssim(a, b) == pytest.approx(ssim_written_out(a, b), abs=1e-9)
        assert nvsprior.ssim(a, a) == pytest.approx(1.0)
        both = nvsprior.ssim(np.stack([a, a]), np.stack([a, b]))
        assert both == pytest.approx((1 + nvsprior.ssim(a, b)) / 2)


def test_large_pictures_are_halved_first():
    """Means of 2x2 pixels: row 2i and the one above it; above row 0 lies row 1."""

    def halved(picture: np.ndarray) -> np.ndarray:
        plane = picture.astype(float)
        for axis in (0, 1):
            above = np.concatenate([plane.take([1], axis), plane.take(range(plane.shape[axis] - 1), axis)], axis)
            plane = ((plane + above) / 2).take(range(0, plane.shape[axis] - 1, 2), axis)
        return plane

    a, b = pictures(384, 391)
    assert nvsprior.ssim(a, b) == pytest.approx(ssim_written_out(halved(a), halved(b)), abs=1e-9)
    a, b = a[:383], b[:383]
    assert abs(nvsprior.ssim(a, b) - nvsprior.ssim(*pictures(384, 391))) > 1e-3, "one of 383 is not"


def test_layouts_do_not_matter():
    a, b = pictures(40, 50)
    for measure in (nvsprior.psnr, nvsprior.ssim):
        due = measure(a, b)
        assert measure(np.asfortranarray(a), b[::-1][::-1]) == pytest.approx(due, abs=1e-12)


@pytest.mark.parametrize("measure", [nvsprior.psnr, nvsprior.ssim])
def test_what_is_no_pair_is_refused(measure):
    a = np.zeros((20, 30, 3), np.uint8)
    with pytest.raises(TypeError, match="b: an array of uint8 is due, not float64"):
        measure(a, a / 255)
    with pytest.raises(nvsprior.ArgumentError, match=r"a: an array of shape \(20, 30\)"):
        measure(a[..., 0], a[..., 0])
    with pytest.raises(nvsprior.ArgumentError, match=r"b: an array of shape \(20, 29, 3\)"):
        measure(a, a[:, 1:])
    with pytest.raises(nvsprior.ArgumentError, match="sides of 11"):
        nvsprior.ssim(a[:10], a[:10])

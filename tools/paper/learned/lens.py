"""COLMAP's camera models: where a ray through the ideal pinhole lands in the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# COLMAP's number → name, count of parameters.
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
}
# Models whose first parameter is both focal lengths.
ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")


@dataclass(frozen=True)
class Lens:
    """`distortion` as COLMAP orders it, without focal lengths and principal point."""

    model: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]

    @classmethod
    def of(cls, number: int, width: int, height: int, parameters: tuple[float, ...]) -> Lens:
        name, _ = MODELS[number]
        if name in ONE_FOCAL_LENGTH:
            parameters = (parameters[0], *parameters)
        fx, fy, cx, cy, *distortion = parameters
        return cls(name, width, height, fx, fy, cx, cy, tuple(distortion))

    @property
    def distorted(self) -> bool:
        return self.model == "OPENCV_FISHEYE" or any(self.distortion)

    def scaled(self, width: int, height: int) -> Lens:
        """The same lens on a picture of another size."""
        x, y = width / self.width, height / self.height
        return Lens(self.model, width, height, self.fx * x, self.fy * y, self.cx * x, self.cy * y, self.distortion)

    def distort(self, points: np.ndarray) -> np.ndarray:
        """Ideal image plane (… × 2, z = 1) → where the lens puts it, still at z = 1."""
        x, y = points[..., 0], points[..., 1]
        r2 = x * x + y * y
        if self.model == "OPENCV_FISHEYE":
            radius = np.sqrt(r2)
            angle = np.arctan(radius)
            a2 = angle * angle
            k1, k2, k3, k4 = self.distortion
            bent = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
            factor = np.where(radius > 1e-9, bent / np.maximum(radius, 1e-9), 1.0)
            return points * factor[..., None]
        k1, k2, p1, p2, k3, k4, k5, k6 = self._coefficients()
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
            ],
            -1,
        )

    def project(self, points: np.ndarray) -> np.ndarray:
        """Ideal image plane → pixels."""
        return self.distort(points) * [self.fx, self.fy] + [self.cx, self.cy]

    def folds(self) -> bool:
        """Whether the lens's polynomial turns back before the picture's corner: it is then no lens."""
        corners = np.array([[0, 0], [self.width, 0], [0, self.height], [self.width, self.height]], dtype=float)
        far = np.linalg.norm((corners - [self.cx, self.cy]) / [self.fx, self.fy], axis=1).max()
        radii = np.linspace(0, far, 512)
        bent = self.distort(np.stack([radii, np.zeros_like(radii)], -1))[:, 0]
        reached = np.flatnonzero(bent >= far)
        return bool((np.diff(bent[: reached[0] + 1] if len(reached) else bent) <= 0).any())

    def _coefficients(self) -> tuple[float, ...]:
        """In OpenCV's order."""
        d = self.distortion
        if self.model in ("SIMPLE_PINHOLE", "PINHOLE"):
            return (0.0,) * 8
        if self.model in ("SIMPLE_RADIAL", "RADIAL"):
            return (*d, *(0.0,) * (2 - len(d)), *(0.0,) * 6)
        return (*d, *(0.0,) * (8 - len(d)))

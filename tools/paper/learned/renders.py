"""Renders of the prior, drawn by the Python package `nvsprior`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .cameras import CameraFile, View, quaternion_of
from .errors import PaperError

if TYPE_CHECKING:
    import nvsprior


@dataclass(frozen=True)
class Pose:
    """World to camera."""

    rotation: np.ndarray
    translation: np.ndarray

    @classmethod
    def of(cls, view: View) -> Pose:
        return cls(view.rotation, view.translation)

    def moved(self, shift: np.ndarray, turn: np.ndarray) -> Pose:
        """Moves the camera along its own axes, then turns it about them (radians)."""
        small = rotation_vector(turn)
        return Pose(small @ self.rotation, small @ (self.translation + shift))


def rotation_vector(turn: np.ndarray) -> np.ndarray:
    """3 × 3 of a turn about `turn` by its length, radians."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle > 0 else np.zeros(3)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * (skew @ skew)


class Renderer:
    """Draws a prior by the Python package `nvsprior`."""

    def __init__(self, prior: Path) -> None:
        try:
            import nvsprior
        except ImportError as error:
            raise PaperError(f"{error}: install the wheel that `make wheel` makes") from None
        self._package = nvsprior
        with self._failing(str(prior)):
            self._engine, self._prior = nvsprior.Engine(), nvsprior.Prior.open(prior)
        self._path = prior
        self._renderers: dict[tuple[float, ...], nvsprior.Renderer] = {}

    def colours(self, run: CameraFile, places: list[tuple[View, Pose]]) -> Iterator[np.ndarray]:
        """Each view's camera at the pose beside it, in order: height × width × 3 uint8."""
        for view, pose in places:
            with self._failing(view.file):
                yield self._of(run, view).render(self._pose(pose))

    def median_depth(self, run: CameraFile, view: View) -> float:
        """Median over the pixels that show something, at the view's own pose, in the prior's unit."""
        with self._failing(view.file):
            values = self._of(run, view).render_raw(self._pose(Pose.of(view)))
        seen = 1 - values[..., 4]
        shown = seen > 0.5
        if not shown.any():
            raise PaperError(f"{self._path}: shows nothing at the pose of {view.file}")
        return float(np.median(values[..., 3][shown] / seen[shown]))

    def _of(self, run: CameraFile, view: View) -> nvsprior.Renderer:
        lens = (view.fx, view.fy, view.cx, view.cy)
        if lens not in self._renderers:
            camera = self._package.Camera(run.width, run.height, *lens)
            self._renderers[lens] = self._package.Renderer(self._engine, self._prior, camera)
        return self._renderers[lens]

    def _pose(self, pose: Pose) -> nvsprior.Pose:
        return self._package.Pose(quaternion_of(pose.rotation), pose.translation)

    @contextmanager
    def _failing(self, what: str) -> Iterator[None]:
        try:
            yield
        except self._package.Error as error:
            raise PaperError(f"{what}: {error}") from None

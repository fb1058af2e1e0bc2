"""Renders of the prior, drawn by the `nvsprior` program."""

from __future__ import annotations

import os
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import pictures
from .cameras import CameraFile, View, quaternion_of
from .errors import ArgumentError, FileError, PaperError


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


@dataclass(frozen=True)
class Renderer:
    """The program and the prior. One process draws one picture; `jobs` run at a time."""

    program: Path
    prior: Path
    jobs: int = 2

    def check(self) -> None:
        if not self.prior.is_file():
            raise FileError(self.prior, "there is no such prior")
        if self.jobs < 1:
            raise ArgumentError("--jobs must be at least 1")

    def colours(self, run: CameraFile, view: View, poses: list[Pose]) -> list[np.ndarray]:
        """The view's camera at each pose: height × width × 3 uint8."""
        with tempfile.TemporaryDirectory() as folder:
            files = [Path(folder) / f"{number}.png" for number in range(len(poses))]
            with ThreadPoolExecutor(self.jobs) as pool:
                list(pool.map(lambda pair: self._draw(run, view, pair[0], "--out", pair[1]), zip(poses, files)))
            return [pictures.read_rgb(file) for file in files]

    def median_depth(self, run: CameraFile, view: View) -> float:
        """Median over the pixels that show something, at the view's own pose, in the prior's unit."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "raw.npy"
            self._draw(run, view, Pose.of(view), "--raw", file)
            values = np.load(file)
        seen = 1 - values[..., 4]
        shown = seen > 0.5
        if not shown.any():
            raise PaperError(f"{self.prior}: shows nothing at the pose of {view.file}")
        return float(np.median(values[..., 3][shown] / seen[shown]))

    def _draw(self, run: CameraFile, view: View, pose: Pose, kind: str, out: Path) -> None:
        numbers = ",".join(f"{value:.9g}" for value in [*quaternion_of(pose.rotation), *pose.translation])
        command = [self.program, "render", "--prior", self.prior, "--cameras", run.path, "--frame", view.file]
        command += [f"--pose={numbers}", kind, out]
        try:
            done = subprocess.run([str(part) for part in command], capture_output=True, text=True, env=os.environ)
        except OSError as error:
            raise FileError(self.program, f"cannot be run: {error}") from None
        if done.returncode != 0:
            raise PaperError(f"{self.program} render, {view.file}: {done.stderr.strip()}")

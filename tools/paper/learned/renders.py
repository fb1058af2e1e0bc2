"""Renders of the prior, drawn by the `nvsprior` program."""

from __future__ import annotations

import csv
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import pictures
from .cameras import CameraFile, View, quaternion_of
from .errors import FileError, PaperError


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
    """The program and the prior. One process draws all pictures of a camera."""

    program: Path
    prior: Path

    def check(self) -> None:
        if not self.prior.is_file():
            raise FileError(self.prior, "there is no such prior")

    def colours(self, run: CameraFile, places: list[tuple[View, Pose]]) -> Iterator[np.ndarray]:
        """Each view's camera at the pose beside it, in order: height × width × 3 uint8."""
        of_camera: dict[tuple[float, ...], list[int]] = {}
        for number, (view, _) in enumerate(places):
            of_camera.setdefault((view.fx, view.fy, view.cx, view.cy), []).append(number)
        with tempfile.TemporaryDirectory() as folder:
            for numbers in of_camera.values():
                poses = Path(folder) / "poses.csv"
                with poses.open("w", newline="", encoding="utf-8") as file:
                    table = csv.writer(file, lineterminator="\n")
                    table.writerow(["name", "qw", "qx", "qy", "qz", "tx", "ty", "tz"])
                    table.writerows([number, *_numbers(places[number][1])] for number in numbers)
                self._draw(run, places[numbers[0]][0], "--poses", poses, "--pictures", folder)
            for number in range(len(places)):
                yield pictures.read_rgb(Path(folder) / f"{number}.png")

    def median_depth(self, run: CameraFile, view: View) -> float:
        """Median over the pixels that show something, at the view's own pose, in the prior's unit."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "raw.npy"
            pose = ",".join(_numbers(Pose.of(view)))
            self._draw(run, view, f"--pose={pose}", "--raw", file)
            values = np.load(file)
        seen = 1 - values[..., 4]
        shown = seen > 0.5
        if not shown.any():
            raise PaperError(f"{self.prior}: shows nothing at the pose of {view.file}")
        return float(np.median(values[..., 3][shown] / seen[shown]))

    def _draw(self, run: CameraFile, view: View, *more: object) -> None:
        command = [self.program, "render", "--prior", self.prior, "--cameras", run.path, "--frame", view.file, *more]
        try:
            done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
        except OSError as error:
            raise FileError(self.program, f"cannot be run: {error}") from None
        if done.returncode != 0:
            raise PaperError(f"{self.program} render, {view.file}: {done.stderr.strip()}")


def _numbers(pose: Pose) -> list[str]:
    """qw, qx, qy, qz, tx, ty, tz."""
    return [f"{value:.9g}" for value in [*quaternion_of(pose.rotation), *pose.translation]]

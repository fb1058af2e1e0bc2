"""A small CNN that tells a camera's pose from its picture, in the place of the paper's PoseLSTM.

It is trained on renders of the prior alone, at random poses near the survey's. The survey's own frames are not used, so
that what it reaches on frames includes the step from renders to camera pictures.
"""

from __future__ import annotations

import csv
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F
from PIL import Image

from . import pictures
from .cameras import CameraFile, View, quaternion_of
from .errors import ArgumentError, FileError
from .renders import Pose, Renderer

WIDTH, HEIGHT = 160, 90
# How far random poses are from the survey's.
SHIFT_OF_DEPTH = 0.08
TURN_DEGREES = 3.0
# What counts as a start: within this of the pose of the camera file.
START_OF_DEPTH = 0.1
START_DEGREES = 5.0


@dataclass(frozen=True)
class Renders:
    """Renders at known poses: `pictures` is count × 90 × 160 × 3 uint8."""

    pictures: np.ndarray
    rotations: np.ndarray
    translations: np.ndarray
    depth: float


def random_poses(run: CameraFile, depth: float, count: int, random: np.random.Generator) -> list[tuple[View, Pose]]:
    """Places between two neighbours of the survey, moved and turned a little."""
    poses = []
    for _ in range(count):
        first = int(random.integers(len(run.views)))
        second = min(first + 1, len(run.views) - 1)
        left, right = Pose.of(run.views[first]), Pose.of(run.views[second])
        pose = between(left, right, random.random()) if near(left, right, depth) else left
        turn = np.radians(random.normal(0, TURN_DEGREES, 3))
        poses.append((run.views[first], pose.moved(random.normal(0, SHIFT_OF_DEPTH * depth, 3), turn)))
    return poses


def near(left: Pose, right: Pose, depth: float) -> bool:
    """Whether two neighbours belong to one sweep of the survey."""
    return distance(left, right) < 0.5 * depth and angle(left, right) < 30


def between(left: Pose, right: Pose, part: float) -> Pose:
    rotation = (1 - part) * left.rotation + part * right.rotation
    u, _, v = np.linalg.svd(rotation)
    rotation = u @ v
    centre = (1 - part) * centre_of(left) + part * centre_of(right)
    return Pose(rotation, -rotation @ centre)


def centre_of(pose: Pose) -> np.ndarray:
    return -pose.rotation.T @ pose.translation


def distance(left: Pose, right: Pose) -> float:
    return float(np.linalg.norm(centre_of(left) - centre_of(right)))


def angle(left: Pose, right: Pose) -> float:
    """Degrees."""
    cosine = (np.trace(left.rotation.T @ right.rotation) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def shrink(pixels: np.ndarray) -> np.ndarray:
    return np.asarray(Image.fromarray(pixels, "RGB").resize((WIDTH, HEIGHT), Image.Resampling.BOX))


def draw(run: CameraFile, renderer: Renderer, count: int, seed: int, cache: Path) -> Renders:
    """Renders at random poses; writes them to `cache`."""
    if count < 1:
        raise ArgumentError("--count must be at least 1")
    depth = renderer.median_depth(run, run.views[len(run.views) // 2])
    poses = random_poses(run, depth, count, np.random.default_rng(seed))
    drawn = [shrink(picture) for picture in renderer.colours(run, poses)]
    renders = Renders(
        np.stack(drawn), np.stack([p.rotation for _, p in poses]), np.stack([p.translation for _, p in poses]), depth
    )
    cache.parent.mkdir(parents=True, exist_ok=True)
    with cache.open("wb") as file:
        np.savez_compressed(file, **vars(renders))
    return renders


def read(cache: Path) -> Renders:
    try:
        with np.load(cache, allow_pickle=False) as file:
            renders = Renders(file["pictures"], file["rotations"], file["translations"], float(file["depth"]))
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise FileError(cache, f"not a file of renders: {error}") from None
    count = len(renders.pictures)
    if renders.pictures.shape != (count, HEIGHT, WIDTH, 3) or renders.rotations.shape != (count, 3, 3):
        raise FileError(cache, "not a file of renders: its arrays have other shapes")
    return renders


class PoseRegressor(nn.Module):
    """Six strided convolutions, then camera centre (3) and the first two rows of the rotation (6)."""

    def __init__(self) -> None:
        super().__init__()
        widths = [3, 32, 48, 64, 96, 128, 128]
        layers: list[nn.Module] = []
        for before, after in zip(widths, widths[1:]):
            layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.BatchNorm2d(after), nn.ReLU()]
        self.features = nn.Sequential(*layers)
        self.head = nn.Sequential(
            nn.Flatten(), nn.Linear(128 * 2 * 3, 256), nn.ReLU(), nn.Dropout(0.2), nn.Linear(256, 9)
        )

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Centres (in depths, from the survey's middle), rotations."""
        out = self.head(self.features(x))
        first = F.normalize(out[:, 3:6] + torch.tensor([1.0, 0, 0]), dim=1)
        second = out[:, 6:9] + torch.tensor([0, 1.0, 0])
        second = F.normalize(second - (first * second).sum(1, keepdim=True) * first, dim=1)
        return out[:, :3], torch.stack([first, second, torch.cross(first, second, dim=1)], 1)


@dataclass
class Trained:
    model: PoseRegressor
    middle: np.ndarray
    depth: float

    def pose(self, pixels: np.ndarray) -> Pose:
        self.model.eval()
        with torch.inference_mode():
            centre, rotation = self.model(_normal(pictures.to_tensor(shrink(pixels))))
        rotation = rotation[0].double().numpy()
        return Pose(rotation, -rotation @ (centre[0].double().numpy() * self.depth + self.middle))


def _normal(x: torch.Tensor) -> torch.Tensor:
    """Each picture with mean 0 and deviation 1: light differs from the survey's."""
    mean = x.mean((1, 2, 3), keepdim=True)
    return (x - mean) / x.std((1, 2, 3), keepdim=True).clamp_min(1e-3)


def _disturbed(x: torch.Tensor) -> torch.Tensor:
    """Other light, water and sensor noise."""
    gain = 1 + 0.15 * torch.randn(len(x), 3, 1, 1)
    x = x * gain + 0.05 * torch.randn(len(x), 3, 1, 1)
    return x + 0.04 * torch.rand(len(x), 1, 1, 1) * torch.randn_like(x)


def train(renders: Renders, steps: int, minutes: float | None, seed: int, curve: Path) -> Trained:
    """Trains on all but every tenth render; the curve says how far off those are."""
    if steps < 1:
        raise ArgumentError("--steps must be at least 1")
    torch.manual_seed(seed)
    centres = -np.einsum("nji,nj->ni", renders.rotations, renders.translations)
    held = np.arange(len(centres)) % 10 == 9
    trained = Trained(PoseRegressor(), centres[~held].mean(0), renders.depth)
    targets = torch.from_numpy((centres - trained.middle) / renders.depth).float()
    rotations = torch.from_numpy(renders.rotations).float()
    inputs = torch.from_numpy(renders.pictures).permute(0, 3, 1, 2).float() / 255
    chosen = torch.from_numpy(np.flatnonzero(~held))
    optimizer = torch.optim.AdamW(trained.model.parameters(), 1e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    began = time.monotonic()
    curve.parent.mkdir(parents=True, exist_ok=True)
    with curve.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["step", "loss", "held_out_depths", "held_out_degrees"])
        for step in range(1, steps + 1):
            trained.model.train()
            batch = chosen[torch.randint(len(chosen), (32,))]
            centre, rotation = trained.model(_normal(_disturbed(inputs[batch])))
            loss = F.smooth_l1_loss(centre, targets[batch], beta=0.05) + F.smooth_l1_loss(
                rotation, rotations[batch], beta=0.05
            )
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            out_of_time = minutes is not None and time.monotonic() - began > 60 * minutes
            if step % 100 == 0 or step == steps or out_of_time:
                errors = _held_out(trained, inputs[held], targets[held], renders.rotations[held])
                table.writerow([step, f"{loss.item():.5f}", *errors])
                file.flush()
                print(step, f"{loss.item():.5f}", *errors, flush=True)
            if out_of_time:
                break
    return trained


def _held_out(trained: Trained, inputs: torch.Tensor, targets: torch.Tensor, rotations: np.ndarray) -> list[str]:
    """Median errors on the renders that are not trained on: depths, degrees."""
    if not len(inputs):
        return ["", ""]
    trained.model.eval()
    with torch.inference_mode():
        centre, rotation = trained.model(_normal(inputs))
    cosines = (np.einsum("nij,nij->n", rotation.double().numpy(), rotations) - 1) / 2
    degrees = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return [f"{torch.linalg.norm(centre - targets, dim=1).median():.4f}", f"{np.median(degrees):.3f}"]


@dataclass(frozen=True)
class Start:
    """A frame's start, and how far it is from the camera file's pose."""

    name: str
    pose: Pose
    depths: float
    degrees: float

    @property
    def good(self) -> bool:
        return self.depths <= START_OF_DEPTH and self.degrees <= START_DEGREES


def starts(trained: Trained, run: CameraFile) -> list[Start]:
    found = []
    for view in run.views:
        pose = trained.pose(pictures.read_rgb(run.picture(view)))
        truth = Pose.of(view)
        found.append(Start(view.name, pose, distance(pose, truth) / trained.depth, angle(pose, truth)))
    return found


def write_starts(found: list[Start], out: Path) -> None:
    """World to camera, as in cameras.json."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["name", "qw", "qx", "qy", "qz", "tx", "ty", "tz"])
        for start in found:
            numbers = [*quaternion_of(start.pose.rotation), *start.pose.translation]
            table.writerow([start.name, *(f"{value:.9g}" for value in numbers)])

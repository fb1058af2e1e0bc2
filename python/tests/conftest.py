"""A prior of the repository, and frames that show something that it does not know."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import nvsprior

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 160, 96


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def engine() -> nvsprior.Engine:
    return nvsprior.Engine()


@pytest.fixture(scope="session")
def prior() -> nvsprior.Prior:
    return nvsprior.Prior.open(ROOT / "tools/basin/prior.nvsg")


@pytest.fixture(scope="session")
def camera() -> nvsprior.Camera:
    return nvsprior.Camera(WIDTH, HEIGHT, 137.2, 137.2, WIDTH / 2, HEIGHT / 2)


@pytest.fixture(scope="session")
def poses(prior: nvsprior.Prior) -> list[nvsprior.Pose]:
    start = prior.key_frames[10]
    end = start.stepped([0.2, 0.1, 0.0, 0.01, 0.0, 0.05])
    return [start.between(end, k / 8) for k in range(8)]


@pytest.fixture(scope="session")
def frames(engine, prior, camera, poses) -> list[np.ndarray]:
    """Read-only, as cameras' buffers may be."""
    renderer = nvsprior.Renderer(engine, prior, camera)
    frames = [renderer.render(pose) for pose in poses]
    for frame in frames:
        frame[40:60, 70:110] = (200, 40, 40)
        frame.flags.writeable = False
    return frames

"""Training a prior."""

from __future__ import annotations

import numpy as np
import pytest

import nvsprior


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return 10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2))


def test_a_prior_is_trained(engine, prior, camera, poses):
    renderer = nvsprior.Renderer(engine, prior, camera)
    views = [pose for pose in prior.key_frames[:24]]
    pictures = np.stack([renderer.render(pose) for pose in views])
    steps = []

    def progress(done: int, of: int) -> None:
        steps.append((done, of))

    options = {"splats": 2_000, "iterations": 150, "seed": 3}
    new = nvsprior.map(engine, pictures, camera, views, progress=progress, **options)
    assert steps[-1] == (150, 150) and all(a[0] < b[0] for a, b in zip(steps, steps[1:]))
    assert 0 < len(new) <= 2_000
    trained = nvsprior.Renderer(engine, new, camera)
    grey = np.full_like(pictures[0], int(pictures.mean()))
    better = [psnr(trained.render(v), p) - psnr(grey, p) for v, p in zip(views[:6], pictures)]
    assert np.mean(better) > 3, better
    again = nvsprior.map(engine, list(pictures), camera, views, **options)
    assert again.id == new.id, "the same input gives the same prior"
    assert 0 < len(new.key_frames) <= 24
    given = new.with_key_frames(views)
    assert len(given.key_frames) == 24 and given.id == new.id


def test_an_exception_ends_the_training(engine, camera, poses, frames):
    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        nvsprior.map(engine, frames, camera, poses, splats=500, iterations=100_000, progress=stop)


def test_wrong_trainings_are_refused(engine, camera, poses, frames):
    def refused(text: str, **changes) -> None:
        given = {"pictures": frames, "camera": camera, "poses": poses, **changes}
        with pytest.raises(nvsprior.ArgumentError, match=text):
            nvsprior.map(engine, **given)

    refused("poses: 7 for 8 pictures", poses=poses[:7])
    refused("no picture to train on", pictures=[], poses=[])
    refused("frame of 160×96", camera=camera.resized(80, 48))
    refused("ssim", ssim=2.0)
    refused("iterations", iterations=0)
    refused("sh-degree = 9", sh_degree=9)
    refused("masks: 1 for 8", masks=[None])
    refused("colours: 0 for 1 points", points=[[0, 0, 0]])
    refused(r"pictures\[1\]: ", pictures=[frames[0], frames[1][..., 0]], poses=poses[:2])

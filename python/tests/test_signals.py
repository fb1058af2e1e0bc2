"""Ctrl-C ends long calls, and leaves the objects usable."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest

import nvsprior


class Interrupted(Exception):
    """What the handler raises; KeyboardInterrupt would end pytest."""


@pytest.fixture
def alarm():
    """Has a signal come after some time. Tells when it came."""
    came = []

    def handler(number, frame):
        came.append(time.monotonic())
        raise Interrupted

    before = signal.signal(signal.SIGALRM, handler)

    def set_alarm(seconds: float) -> list[float]:
        signal.setitimer(signal.ITIMER_REAL, seconds)
        return came

    yield set_alarm
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


def ended(call, came) -> float:
    """Seconds from the signal to the end of the call."""
    with pytest.raises(Interrupted):
        call()
    assert len(came) == 1
    return time.monotonic() - came[0]


def test_a_search_from_nothing_ends(alarm, engine, prior, camera, poses, frames):
    due = nvsprior.Encoder(engine, prior, camera).encode(frames[0], poses[0])
    encoder = nvsprior.Encoder(engine, prior, camera, lost_renders=100_000)
    noise = np.random.default_rng(3).integers(0, 256, frames[0].shape).astype(np.uint8)
    since = time.monotonic()
    came = alarm(0.3)
    assert ended(lambda: encoder.encode(noise), came) < 0.2
    assert came[0] - since < 0.7, "the handler did not wait for the call's end"
    assert encoder.encode(frames[0], poses[0]).packet == due.packet, "a frame that was ended changes nothing"


def test_key_frames_ahead_end(alarm, engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    all_of_them = encoder.prepare(0)
    came = alarm(0.2)
    assert ended(lambda: encoder.prepare(100_000), came) < 0.2
    assert 0 < encoder.prepare(1) < all_of_them


def test_many_pictures_end(alarm, engine, prior, camera, poses):
    renderer = nvsprior.Renderer(engine, prior, camera)
    came = alarm(0.2)
    assert ended(lambda: renderer.render(poses * 10_000), came) < 0.5
    assert renderer.render(poses[0]).any()

"""Calls release the GIL; an object is for one thread at a time."""

from __future__ import annotations

import threading
import time

import pytest

import nvsprior


class Counter(threading.Thread):
    """Counts as long as it may, in Python."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.count, self.ends = 0, False

    def run(self) -> None:
        while not self.ends:
            self.count += 1


def test_other_threads_go_on(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    encoder.encode(frames[0], poses[0])
    counter = Counter()
    counter.start()
    time.sleep(0.01)
    before = counter.count
    start = time.perf_counter()
    encoder.encode(frames[1])
    seconds = time.perf_counter() - start
    counted = counter.count - before
    counter.ends = True
    counter.join()
    # With the GIL held it would count in a few turns of 5 ms at most. A turn is some ten thousand counts.
    assert counted > 200_000 * seconds, f"{counted} counts in {seconds:.3f} s"


def test_two_threads_on_one_object(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    encoder.encode(frames[0], poses[0])
    found, busy = [], []

    def encode() -> None:
        try:
            found.append(encoder.encode(frames[1]))
        except nvsprior.BusyError as error:
            busy.append(str(error))

    for _ in range(10):
        threads = [threading.Thread(target=encode) for _ in range(3)]
        [thread.start() for thread in threads]
        [thread.join(timeout=60) for thread in threads]
        assert not any(thread.is_alive() for thread in threads), "nobody waits for ever"
        if busy:
            break
    assert found and busy == ["another thread is inside a call on this object"] * len(busy)
    assert encoder.encode(frames[2]).certain, "it goes on"


def test_an_engine_is_shared(engine, prior, camera, poses, frames):
    packets = [None] * 3

    def encode(place: int) -> None:
        packets[place] = nvsprior.Encoder(engine, prior, camera).encode(frames[0], poses[0]).packet

    threads = [threading.Thread(target=encode, args=[place]) for place in range(3)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert packets[0] is not None and len(set(packets)) == 1


def test_a_prior_is_uploaded_once(prior, camera):
    engine = nvsprior.Engine()
    first = nvsprior.Decoder(engine, prior)
    once = engine.memory
    second = nvsprior.Decoder(engine, prior)
    assert engine.memory == once > 0
    del first, second
    assert engine.memory < once


@pytest.mark.parametrize("seconds", [0, -1, float("nan"), 1e300])
def test_a_watchdog_that_none_can_be(seconds):
    with pytest.raises(nvsprior.ArgumentError, match="watchdog"):
        nvsprior.Engine(watchdog=seconds)

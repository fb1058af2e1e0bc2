"""What belongs to a process is of no use in a child made by fork, and does no harm there."""

from __future__ import annotations

import gc
import multiprocessing
import re
import subprocess
import sys
import textwrap
import time

import pytest

import nvsprior

pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
TEXT = "made in another process.*Make it in the child.*spawn"


def in_child(work) -> object:
    """What a forked child makes; it may take a minute."""
    here, there = multiprocessing.get_context("fork").Pipe(False)
    child = multiprocessing.get_context("fork").Process(target=lambda: there.send(work()))
    child.start()
    answered = here.poll(60)
    answer = here.recv() if answered else None
    child.join(20)
    alive = child.is_alive()
    if alive:
        child.kill()
    assert answered and not alive and child.exitcode == 0, f"it hangs: {answered=} {alive=} {child.exitcode=}"
    return answer


def refused(*calls) -> list[str]:
    texts = []
    for call in calls:
        try:
            call()
            texts.append("no error")
        except nvsprior.ForkedError as error:
            texts.append(str(error))
    return texts


def test_a_child_is_told(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    packet = encoder.encode(frames[0], poses[0]).packet
    decoder, renderer = nvsprior.Decoder(engine, prior), nvsprior.Renderer(engine, prior, camera)
    topside, link = nvsprior.Topside(engine, prior, 64), nvsprior.VehicleLink(64, 8_000, 5.0)
    calls = [
        lambda: encoder.encode(frames[1]),
        lambda: encoder.set_mask(None),
        lambda: encoder.prepare(1),
        lambda: decoder.decode(packet),
        lambda: renderer.render(poses[0]),
        lambda: topside.picture(0.0),
        lambda: link.plan(0.0),
        lambda: engine.memory,
        lambda: engine.pipeline_cache(),
        lambda: nvsprior.Encoder(engine, prior, camera),
        lambda: nvsprior.map(engine, frames, camera, poses, splats=500, iterations=10),
    ]
    texts = in_child(lambda: refused(*calls))
    assert len(texts) == len(calls)
    for text in texts:
        assert re.search(TEXT, text), text
    assert "another process" in in_child(lambda: repr(engine))
    assert encoder.encode(frames[1]).certain, "the parent's goes on"
    assert issubclass(nvsprior.ForkedError, (nvsprior.StateError, RuntimeError))


def test_their_end_in_a_child_is_theirs_alone(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(nvsprior.Engine(), prior, camera)
    encoder.encode(frames[0], poses[0])
    made = nvsprior.map(engine, frames, camera, poses, splats=500, iterations=5)
    objects = [encoder, nvsprior.Decoder(engine, prior), nvsprior.Renderer(engine, made, camera), made]

    def end() -> int:
        nonlocal encoder, made
        since = time.monotonic()
        del encoder, made
        objects.clear()
        gc.collect()
        return time.monotonic() - since

    assert in_child(end) < 1.0
    assert encoder.encode(frames[1]).certain


def test_a_child_makes_its_own(prior, camera, poses, frames, engine):
    """A prior holds neither a device nor threads."""
    due = nvsprior.Encoder(engine, prior, camera).encode(frames[0], poses[0]).packet

    def packet() -> bytes:
        return nvsprior.Encoder(nvsprior.Engine(), prior, camera).encode(frames[0], poses[0]).packet

    assert in_child(packet) == due


def test_a_child_that_ends_as_programs_do(root):
    """By os.fork and the interpreter's whole end, exit handlers and all."""
    program = """
        import os, sys, nvsprior
        engine = nvsprior.Engine()
        prior = nvsprior.Prior.open(sys.argv[1])
        camera = nvsprior.Camera(64, 48, 60, 60, 32, 24)
        renderer = nvsprior.Renderer(engine, prior, camera)
        renderer.render(prior.key_frames[0])
        child = os.fork()
        if child == 0:
            try:
                renderer.render(prior.key_frames[0])
            except nvsprior.ForkedError:
                sys.exit(7)
            sys.exit(1)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        renderer.render(prior.key_frames[0])
    """
    command = [sys.executable, "-W", "ignore", "-c", textwrap.dedent(program), str(root / "tools/basin/prior.nvsg")]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=120, check=True)
    assert done.stdout == "7\n"

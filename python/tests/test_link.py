"""Packets over a lossy link."""

from __future__ import annotations

import math

import numpy as np
import pytest

import nvsprior

KEY = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f"
LINK = {"bit_rate": 8_000, "mtu": 64, "latency": 1.5, "delay": 0.2, "frame_rate": 5.0}


def shares_of(sender: nvsprior.Sender, now: float) -> list[bytes]:
    shares = []
    while (given := sender.next(now)) is not None:
        shares.append(given[1])
    return shares


def test_a_few_shares_yield_a_picture(engine, prior, camera, poses, frames):
    sender = nvsprior.Sender(**LINK, loss=0.3, expect_reports=True, user=2)
    collector = nvsprior.Collector(64)
    encoder = nvsprior.Encoder(engine, prior, camera, predict_poses=True)
    decoder = nvsprior.Decoder(engine, prior)

    def sent(now: float, frame: int) -> tuple[nvsprior.Encoded, nvsprior.Division, list[bytes]]:
        encoder.set_rate(steady_bytes=sender.plan(now))
        encoded = encoder.encode(frames[frame], poses[frame])
        division = sender.push(now, encoded.packet, b"hi")
        return encoded, division, shares_of(sender, now + 0.9)

    first, division, shares = sent(0.0, 0)
    assert len(shares) == division.shares > division.picture_shares
    assert all(len(share) == division.share_bytes for share in shares)
    arrived = [collector.push(0.5, share) for share in shares]
    assert "complete" in [collected.kind for collected in arrived] and arrived[-1].frame in (0, None)
    assert np.array_equal(decoder.decode(collector.packet(0).packet).picture, first.picture)

    second, division, shares = sent(1.0, 1)
    for share in reversed(shares[1:]):
        collector.push(1.5, share)
    assert collector.push(1.6, shares[1]).kind in ("duplicate", "surplus")
    packet = collector.newest()
    assert packet.frame == 1 and packet.user == b"hi" and packet.arrived == len(shares) - 1
    assert collector.missing(1) == ([] if packet.complete else [0])
    decoded = decoder.decode(packet.packet, start=True)
    assert decoded.pose == second.pose and second.packet.startswith(packet.packet)
    report = collector.report([1], decoder=decoder)
    processed = sender.process_report(1.8, report)
    assert (1, True) in processed.poses and processed.kept == ([1] if packet.complete else [])
    assert sender.statistics["packets"] == 2


def test_a_link_shows_frames(engine, prior, camera, poses, frames):
    clear = list(nvsprior.link(engine, prior, camera, frames, poses[0], fps=4.0))
    assert [shown.frame for shown in clear] == list(range(len(frames)))
    assert all(shown.own and shown.arrived == shown.sent > 0 for shown in clear)
    assert all(shown.psnr > 20 for shown in clear)
    lossy = list(nvsprior.link(engine, prior, camera, frames, poses[0], fps=4.0, loss=0.5, burst=3.0))
    again = list(nvsprior.link(engine, prior, camera, frames, poses[0], fps=4.0, loss=0.5, burst=3.0))
    assert [s.psnr for s in lossy if s.own] == [s.psnr for s in again if s.own], "runs of a seed are alike"
    assert any(not shown.own for shown in lossy)
    assert all(shown.picture is None or math.isfinite(shown.psnr) for shown in lossy)


def test_keys_keep_strangers_out(engine, prior, camera, poses, frames):
    def sent(keys):
        sender = nvsprior.Sender(**LINK, keys=keys)
        sender.plan(0.0)
        packet = nvsprior.Encoder(engine, prior, camera, bytes=150).encode(frames[0], poses[0]).packet
        sender.push(0.1, packet)
        return shares_of(sender, 5.0)

    keys = nvsprior.Keys(KEY, epoch=3)
    assert keys.ids == nvsprior.Keys.from_bytes([bytes(range(32))]).ids and KEY not in repr(keys)
    collector = nvsprior.Collector(64, keys=keys)
    ours = sent(keys)
    for share in ours:
        collector.push(0.5, share)
    assert collector.packet(0) is not None
    with pytest.raises(nvsprior.ReplayedError):
        collector.push(0.6, ours[0])
    for strangers in (None, nvsprior.Keys(KEY, epoch=4), nvsprior.Keys("f" * 64, epoch=3)):
        with pytest.raises(nvsprior.ForeignError):
            collector.push(0.6, sent(strangers)[0])
    assert collector.statistics["foreign"] == 3 and collector.statistics["replayed"] == 1


def test_wrong_links_are_refused():
    with pytest.raises(nvsprior.ArgumentError, match="MTU of 5"):
        nvsprior.Sender(**{**LINK, "mtu": 5})
    with pytest.raises(nvsprior.ArgumentError, match="a loss of 1.5"):
        nvsprior.Sender(**LINK, loss=1.5)
    with pytest.raises(nvsprior.ArgumentError, match="protection"):
        nvsprior.Sender(**LINK, protection="some")
    with pytest.raises(nvsprior.ArgumentError, match="packets of 0"):
        nvsprior.Collector(64, packets=0)
    with pytest.raises(nvsprior.ArgumentError, match="line 1"):
        nvsprior.Keys("secret")
    with pytest.raises(nvsprior.ArgumentError, match="a key has 32"):
        nvsprior.Keys.from_bytes([b"short"])
    with pytest.raises(nvsprior.ArgumentError, match="bit_rate"):
        nvsprior.Channel(bit_rate=0)
    with pytest.raises(nvsprior.StateError, match="no frame was planned"):
        nvsprior.Sender(**LINK).push(0.0, b"packet")
    with pytest.raises(nvsprior.ModemError):
        nvsprior.Collector(64).push(0.0, b"\0" * 20)


def test_a_channel_loses_as_many_as_it_says():
    channel = nvsprior.Channel(bit_rate=1e6, propagation=0.25, loss=0.2, burst=4.0, seed=7)
    arrivals = [channel.send(float(k), 10) for k in range(20_000)]
    assert 3_600 < sum(arrival is None for arrival in arrivals) < 4_400
    came = next((k, arrival) for k, arrival in enumerate(arrivals) if arrival is not None)
    assert came[1] == pytest.approx(came[0] + 80 / 1e6 + 0.25)

"""Both ends of a lossy link."""

from __future__ import annotations

import math

import numpy as np
import pytest

import nvsprior

KEY = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f"
LINK = {"mtu": 64, "bit_rate": 8_000, "frame_rate": 5.0, "delay": 0.2}


def frames_of(link: nvsprior.VehicleLink, now: float) -> list[bytes]:
    frames = []
    while (frame := link.transmit(now)) is not None:
        frames.append(frame)
    return frames


def both_ends(engine, prior, camera, *, loss=0.0, keys=None):
    link = nvsprior.VehicleLink(**LINK, loss=loss, user_bytes=2, keys=keys)
    vehicle = nvsprior.Vehicle(nvsprior.Encoder(engine, prior, camera, predict_poses=True), link)
    topside = nvsprior.Topside(engine, prior, 64, report_every=0.0, keys=keys)
    return vehicle, topside


def test_frames_become_pictures_and_reports_make_poses_short(engine, prior, camera, poses, frames):
    def run(reports: bool) -> list[nvsprior.Encoded]:
        vehicle, topside = both_ends(engine, prior, camera)
        topside.set_region((0.0, 0.0, 0.5, 1.0))
        sent = []
        for turn, frame in enumerate(frames):
            now = 0.2 * turn
            encoded = vehicle.frame(now, frame, poses[0] if turn == 0 else None, user=b"hi")
            if encoded is None:
                continue
            for share in frames_of(vehicle.link, now + 0.19):
                topside.receive(now + 0.19, share)
            time, decoded = topside.picture(now + 0.19)
            assert decoded.frame == encoded.frame and np.array_equal(decoded.picture, encoded.picture)
            packet = topside.packet(encoded.frame)
            assert packet.complete and packet.user == b"hi" and packet.packet == encoded.packet
            sent.append(encoded)
            report = topside.report(now + 0.19)
            if reports:
                vehicle.link.receive(now + 0.19, report)
        events = []
        while (event := vehicle.link.event()) is not None:
            events.append(event)
        assert (("topside heard", None) in events) == reports
        assert any(name == "region" for name, _ in events) == reports
        return sent

    without, reported = run(False), run(True)
    poses_without, poses_with = ([e.latent_bytes for e in run_[3:]] for run_ in (without, reported))
    print("bytes of poses:", poses_without, "with reports:", poses_with)
    assert sum(poses_with) < sum(poses_without) - len(poses_with)


def test_a_few_modem_frames_yield_a_picture(engine, prior, camera, poses, frames):
    vehicle, topside = both_ends(engine, prior, camera, loss=0.3)
    encoded = vehicle.frame(0.0, frames[0], poses[0], user=b"hi")
    shares = frames_of(vehicle.link, 1.4)
    for share in reversed(shares[1:]):
        topside.receive(1.5, share)
    _, decoded = topside.picture(1.5)
    assert decoded.pose == encoded.pose and encoded.packet.startswith(topside.packet(0).packet)
    assert topside.refusal is None and topside.camera == camera
    assert vehicle.link.statistics["packets"] == 1 and topside.statistics["accepted"] > 0


def test_packets_go_from_end_to_end(engine, prior, camera, poses, frames):
    vehicle, _ = both_ends(engine, prior, camera)
    link = nvsprior.TopsideLink(64, playout="in order", latency=0.5, frame_rate=5.0, report_every=0.0)
    decoder = nvsprior.Decoder(engine, prior)
    came = []
    for turn, frame in enumerate(frames[:4]):
        now = 0.2 * turn
        encoded = vehicle.frame(now, frame, poses[0] if turn == 0 else None, user=b"hi")
        for share in frames_of(vehicle.link, now + 0.19):
            link.receive(now + 0.19, share)
        while (given := link.next_packet(now + 0.19)) is not None:
            time, received = given
            assert received.packet == encoded.packet and received.user == b"hi"
            came.append((received.frame, time))
            assert decoder.decode(received.packet, start=True).pose == encoded.pose
        vehicle.link.receive(now + 0.19, link.report(now + 0.19, decoder=decoder))
    assert [frame for frame, _ in came] == [0, 1, 2, 3]
    assert came[3][1] - came[0][1] == pytest.approx(0.6, abs=0.05)
    assert encoded.latent_bytes < 15


def test_ends_go_on_after_a_restart(engine, prior, camera, poses, frames):
    vehicle, topside = both_ends(engine, prior, camera)
    vehicle.frame(0.0, frames[0], poses[0], user=b"hi")
    for share in frames_of(vehicle.link, 1.0):
        topside.receive(1.0, share)
    assert topside.picture(1.0) is not None
    link = nvsprior.VehicleLink(**LINK, state=vehicle.link.state())
    assert link.next_frame > vehicle.link.next_frame
    again = nvsprior.Topside(engine, prior, 64, state=topside.state())
    assert again.camera == camera
    with pytest.raises(nvsprior.ArgumentError, match="a state of 3 bytes"):
        nvsprior.VehicleLink(**LINK, state=b"abc")


def test_packets_become_modem_frames_and_back(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera, bytes=150)
    packets = [encoder.encode(frame, poses[0] if k == 0 else None).packet for k, frame in enumerate(frames[:3])]
    shares = [share for packet in packets for share in nvsprior.split(packet, 40)]
    assert all(len(share) <= 40 for share in shares)
    joined = nvsprior.join([b"junk", *reversed(shares)], 40)
    assert [received.packet for received in joined] == packets
    assert all(received.complete for received in joined)
    assert nvsprior.join(shares[:-1], 40)[-1].complete is False
    with pytest.raises(nvsprior.ArgumentError, match="MTU of 5"):
        nvsprior.split(packets[0], 5)


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
        vehicle, _ = both_ends(engine, prior, camera, keys=keys)
        vehicle.frame(0.0, frames[0], poses[0], user=b"hi")
        return frames_of(vehicle.link, 5.0)

    keys = nvsprior.Keys(KEY, epoch=3)
    assert keys.ids == nvsprior.Keys.from_bytes([bytes(range(32))]).ids and KEY not in repr(keys)
    _, topside = both_ends(engine, prior, camera, keys=keys)
    ours = sent(keys)
    for share in ours:
        topside.receive(0.5, share)
    assert topside.packet(0) is not None
    with pytest.raises(nvsprior.ReplayedError):
        topside.receive(0.6, ours[0])
    for strangers in (None, nvsprior.Keys(KEY, epoch=4), nvsprior.Keys("f" * 64, epoch=3)):
        with pytest.raises(nvsprior.ForeignError):
            topside.receive(0.6, sent(strangers)[0])
    assert topside.statistics["foreign"] == 3 and topside.statistics["replayed"] == 1


def test_wrong_links_are_refused(engine, prior):
    for wrong, text in [
        ({"mtu": 5}, "MTU of 5"),
        ({"loss": 1.5}, "a loss of 1.5"),
        ({"protection": "some"}, "protection"),
        ({"bit_rate": "fast"}, "bit_rate"),
        ({"bit_rate": 0.0}, "bit_rate"),
        ({"latency": 0.1}, "latency, delay"),
    ]:
        with pytest.raises(nvsprior.ArgumentError, match=text):
            nvsprior.VehicleLink(**{**LINK, **wrong})
    with pytest.raises(nvsprior.ArgumentError, match="packets of 0"):
        nvsprior.Topside(engine, prior, 64, packets=0)
    with pytest.raises(nvsprior.ArgumentError, match="playout"):
        nvsprior.Topside(engine, prior, 64, playout="some")
    with pytest.raises(nvsprior.ArgumentError, match="line 1"):
        nvsprior.Keys("secret")
    with pytest.raises(nvsprior.ArgumentError, match="a key has 32"):
        nvsprior.Keys.from_bytes([b"short"])
    with pytest.raises(nvsprior.ArgumentError, match="bit_rate"):
        nvsprior.Channel(bit_rate=0)
    with pytest.raises(nvsprior.StateError, match="no frame was planned"):
        nvsprior.VehicleLink(**LINK).push(0.0, b"packet")
    with pytest.raises(nvsprior.ModemError):
        nvsprior.VehicleLink(**LINK).receive(0.0, b"\0" * 20)
    with pytest.raises(nvsprior.ModemError):
        nvsprior.Topside(engine, prior, 64).receive(0.0, b"\0" * 20)


def test_a_channel_loses_as_many_as_it_says():
    channel = nvsprior.Channel(bit_rate=1e6, propagation=0.25, loss=0.2, burst=4.0, seed=7)
    arrivals = [channel.send(float(k), 10) for k in range(20_000)]
    assert 3_600 < sum(arrival is None for arrival in arrivals) < 4_400
    came = next((k, arrival) for k, arrival in enumerate(arrivals) if arrival is not None)
    assert came[1] == pytest.approx(came[0] + 80 / 1e6 + 0.25)

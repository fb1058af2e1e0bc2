"""A vehicle, a simulated acoustic channel and a topside, in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ._nvsprior import Camera, Channel, Collector, Decoder, Encoder, Engine, Hint, Keys, Pose, Prior, Sender

Picture = NDArray[np.uint8]

# Seconds after its display for which a packet is kept.
_KEPT = 1.0
# The collector holds 64 packets: one is stale before as many frames have gone by.
_STALE = 60.0


@dataclass(frozen=True)
class Shown:
    """What the pilot sees of a camera frame."""

    frame: int
    """Its number."""
    picture: Picture | None
    """uint8, shape (height, width, 3), RGB; None: nothing has come yet."""
    own: bool
    """The picture is of this frame; else it is that of an earlier one."""
    sent: int
    """Bytes of the frame's packet; 0: the frame was left out."""
    arrived: int
    """Bytes of it that came in time."""
    psnr: float
    """PSNR of the picture against the frame, dB; NaN without a picture."""


def _psnr(a: Picture, b: Picture) -> float:
    mse = float(np.mean((a.astype(np.float64) - b) ** 2))
    return math.inf if mse == 0.0 else 10.0 * math.log10(255.0**2 / mse)


def link(
    engine: Engine,
    prior: Prior,
    camera: Camera,
    frames: Sequence[Picture],
    hint: Pose | Hint | None = None,
    *,
    bit_rate: float = 5_000.0,
    mtu: int = 64,
    fps: float = 15.0,
    latency: float = 1.5,
    coding: float = 0.1,
    propagation: float = 0.1,
    overhead: int = 0,
    loss: float = 0.0,
    burst: float = 1.0,
    spread: float | None = None,
    max_shares: int = 16,
    min_bytes: int = 40,
    seed: int = 1,
    keys: Keys | None = None,
) -> Iterator[Shown]:
    """Sends frames over a simulated acoustic link without a return channel, and yields what the pilot sees of each.

    ``frames``: uint8, shape (height, width, 3), RGB, ``fps`` per second. ``hint``: about where the camera stands in the
    first one. ``bit_rate``: bit/s. ``mtu``, ``overhead``: bytes of a modem frame, and what it costs beside them.
    ``latency``: seconds from exposure to display, ``coding`` of them for search, coding and decoding, ``propagation``
    on the way, and ``spread`` from a packet's first modem frame to its last; None: half of what is left, 0 without
    loss. ``loss``, ``burst``: the chance that a modem frame is lost, and how many are in a row. The same arguments give
    the same result. ``nvsprior link`` also knows reports and video coders.
    """
    delay = coding + propagation
    if spread is None:
        spread = 0.5 * max(latency - delay, 0.0) if loss > 0.0 else 0.0
    encoder = Encoder(engine, prior, camera)
    decoder = Decoder(engine, prior)
    decoder.add_camera(camera)
    sender = Sender(
        bit_rate=bit_rate,
        mtu=mtu,
        overhead=overhead,
        latency=latency,
        delay=delay,
        spread=spread,
        frame_rate=fps,
        min_bytes=min_bytes,
        max_shares=max_shares,
        loss=loss,
        burst=burst,
        keys=keys,
    )
    channel = Channel(
        bit_rate=bit_rate, overhead=overhead, propagation=propagation, loss=loss, burst=burst, seed=seed
    )
    age = min(latency + _KEPT, _STALE / fps)
    collector = Collector(mtu, shares=max_shares, packets=64, age=age, keys=keys)
    return _run(encoder, sender, channel, collector, decoder, frames, hint, fps, latency, coding)


def _run(
    encoder: Encoder,
    sender: Sender,
    channel: Channel,
    collector: Collector,
    decoder: Decoder,
    frames: Sequence[Picture],
    hint: Pose | Hint | None,
    fps: float,
    latency: float,
    coding: float,
) -> Iterator[Shown]:
    arrivals: list[tuple[float, bytes]] = []
    sent: dict[int, int] = {}
    picture: Picture | None = None
    ahead = math.ceil(latency * fps)
    for turn in range(len(frames) + ahead):
        now = turn / fps
        if turn < len(frames):
            budget = sender.plan(now)
            if budget is None:
                encoder.skip(1)
            else:
                encoder.set_rate(steady_bytes=budget)
                encoded = encoder.encode(frames[turn], hint, time=now).packet
                hint = None
                sender.push(now + coding, encoded)
                sent[turn] = len(encoded)
        until = (turn + 1) / fps
        while (due := sender.due) is not None and due < until:
            given = sender.next(due)
            if given is None:
                break
            arrival = channel.send(due, len(given[1]))
            if arrival is not None:
                arrivals.append((arrival, given[1]))
        shown = turn - ahead
        if shown < 0:
            continue
        # A frame is shown `latency` after its exposure.
        arrivals.sort(key=lambda one: one[0])
        display = shown / fps + latency
        while arrivals and arrivals[0][0] <= display:
            collector.push(*arrivals.pop(0))
        packet = collector.packet(shown) if shown in sent else None
        if packet is not None:
            picture = decoder.decode(packet.packet, start=True).picture
        yield Shown(
            frame=shown,
            picture=picture,
            own=packet is not None,
            sent=sent.get(shown, 0),
            arrived=0 if packet is None else len(packet.packet),
            psnr=math.nan if picture is None else _psnr(picture, frames[shown]),
        )

"""The vehicle's end of a link, and a simulated link: a vehicle, an acoustic channel and a topside, in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._nvsprior import (
    Camera,
    Channel,
    Encoded,
    Encoder,
    Engine,
    Hint,
    Keys,
    Pose,
    Prior,
    Topside,
    VehicleLink,
)
from .measures import psnr

Picture = NDArray[np.uint8]

# Seconds after its display for which a packet is kept.
_KEPT = 1.0
# The topside holds 64 packets: one is stale before as many frames have gone by.
_STALE = 60.0


class Vehicle:
    """The vehicle's end of a link: an encoder, and all that sends its packets.

    Give ``frame`` the camera's frames, and ``link.receive`` what the modem received. Whenever the modem is free, send
    what ``link.transmit`` gives. ``encoder``: it begins with the frame ``link.next_frame``; give it
    ``predict_poses=True`` if the topside sends reports.
    """

    def __init__(self, encoder: Encoder, link: VehicleLink) -> None:
        self.encoder = encoder
        self.link = link
        self._next = link.next_frame

    def frame(
        self,
        now: float,
        picture: Picture,
        hint: Pose | Hint | ArrayLike | None = None,
        *,
        exposed: float | None = None,
        ready: Callable[[], float] | None = None,
        user: bytes = b"",
    ) -> Encoded | None:
        """Takes a camera frame: all of them count. Returns Encoded; None: it is left out, as the link has no bytes.

        ``exposed``: when, seconds; None: now. ``ready``: tells the time once it is coded; None: it is ``now``.
        ``user``: user bytes that travel with it.
        """
        planned = self.link.plan(now, exposed)
        if planned is None:
            return None
        number, room = planned
        self.link.instruct(self.encoder)
        self.encoder.skip((number - self._next) % 2**32)
        self._next = number
        self.encoder.set_rate(steady_bytes=room)
        try:
            encoded = self.encoder.encode(picture, hint, time=now if exposed is None else exposed)
        except BaseException:
            self.link.drop_plan()
            raise
        self._next = (number + 1) % 2**32
        self.link.push(now if ready is None else ready(), encoded.packet, user)
        return encoded


@dataclass(frozen=True)
class Shown:
    """What the pilot sees of a camera frame."""

    frame: int
    """Its number."""
    picture: Picture | None
    """uint8, shape (height, width, 3), RGB; None: nothing has come yet."""
    own: bool
    """The picture is of this frame; else it is the prior, between frames that came, or that of an earlier one."""
    sent: int
    """Bytes of the frame's packet; 0: the frame was left out."""
    arrived: int
    """Bytes of it that came in time."""
    psnr: float
    """PSNR of the picture against the frame, dB; NaN without a picture."""


def link(
    engine: Engine,
    prior: Prior,
    camera: Camera,
    frames: Sequence[Picture],
    hint: Pose | Hint | ArrayLike | None = None,
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
    max_shares: int | None = None,
    min_bytes: int = 40,
    seed: int = 1,
    keys: Keys | None = None,
) -> Iterator[Shown]:
    """Sends frames over a simulated acoustic link without a return channel. Returns what the pilot sees of each.

    ``frames``: uint8, shape (height, width, 3), RGB, ``fps`` per second. ``hint``: about where the camera stands in the
    first one. ``bit_rate``: bit/s. ``mtu``, ``overhead``: bytes of a modem frame, and what it costs beside them.
    ``latency``: seconds from exposure to display, ``coding`` of them for search, coding and decoding, ``propagation``
    on the way, and ``spread`` from a packet's first modem frame to its last; None: a quarter of what is left, 0 without
    loss. ``loss``, ``burst``: the chance that a modem frame is lost, and how many are in a row. The same arguments give
    the same result. ``nvsprior link`` also knows reports, and ``nvsprior-lab link`` video coders.
    """
    delay = coding + propagation
    link = VehicleLink(
        mtu,
        bit_rate,
        fps,
        overhead=overhead,
        latency=latency,
        delay=delay,
        spread=spread,
        min_bytes=min_bytes,
        max_shares=max_shares,
        loss=loss,
        burst=burst,
        expect_reports=False,
        keys=keys,
    )
    vehicle = Vehicle(Encoder(engine, prior, camera), link)
    channel = Channel(
        bit_rate=bit_rate, overhead=overhead, propagation=propagation, loss=loss, burst=burst, seed=seed
    )
    age = min(latency + _KEPT, _STALE / fps)
    topside = Topside(
        engine,
        prior,
        mtu,
        playout="on demand",
        max_shares=max_shares,
        age=age,
        report_every=None,
        keys=keys,
    )
    topside.add_camera(camera)
    return _run(vehicle, channel, topside, frames, hint, fps, latency, coding)


def _run(
    vehicle: Vehicle,
    channel: Channel,
    topside: Topside,
    frames: Sequence[Picture],
    hint: Pose | Hint | ArrayLike | None,
    fps: float,
    latency: float,
    coding: float,
) -> Iterator[Shown]:
    arrivals: list[tuple[float, bytes]] = []
    sent: dict[int, int] = {}
    ahead = math.ceil(latency * fps)
    for turn in range(len(frames) + ahead):
        now = turn / fps
        if turn < len(frames):
            encoded = vehicle.frame(now, frames[turn], hint, ready=lambda: now + coding)
            if encoded is not None:
                hint = None
                sent[turn] = len(encoded.packet)
        until = (turn + 1) / fps
        while (due := vehicle.link.due) is not None and due < until:
            given = vehicle.link.transmit(due)
            if given is None:
                break
            arrival = channel.send(due, len(given))
            if arrival is not None:
                arrivals.append((arrival, given))
        shown = turn - ahead
        if shown < 0:
            continue
        # A frame is shown `latency` after its exposure.
        arrivals.sort(key=lambda one: one[0])
        display = shown / fps + latency
        while arrivals and arrivals[0][0] <= display:
            topside.receive(*arrivals.pop(0))
        packet = topside.packet(shown)
        kind, picture = topside.show(shown)
        yield Shown(
            frame=shown,
            picture=picture,
            own=kind == "own",
            sent=sent.get(shown, 0),
            arrived=0 if packet is None else len(packet.packet),
            psnr=math.nan if picture is None else psnr(picture, frames[shown]),
        )

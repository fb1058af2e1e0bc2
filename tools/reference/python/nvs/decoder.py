"""The topside: packets in, pictures out. docs/format/packet.md, "Order of checks"."""

from dataclasses import dataclass, field

import numpy as np

from .bits import Refused, crc32
from .packet import (BOUNDS, CODED, INTER, SESSION, SMALL, STREAM, UNCERTAIN, Camera, Held, near, read_latent,
                     read_render, read_residual, read_session)
from .prior import TABLES, Tables
from .render import Scene, render
from .stream import References, warp
from .truth import TruthDecoder
from .wavelet import ROTATION, Frame


@dataclass
class Decoded:
    frame: int
    picture: np.ndarray
    damage: str = None
    uncertain: bool = False
    known: list = None
    portable: bool = True
    same_render: bool = None
    kept: bool = False
    reference: int = None
    truth: tuple = None
    step: int = None


@dataclass
class View:
    """What one camera's packets take."""
    camera: Camera
    references: References = field(default_factory=References)
    truth: TruthDecoder = None


class Decoder:
    """`is_start`: packets may be cut, and what there is of them is undamaged."""

    def __init__(self, prior, is_start=False):
        self.prior, self.is_start = prior, is_start
        self.cameras, self.view, self.last, self.held = [], None, None, Held()
        # A packet was about another prior: see docs/format/packet.md.
        self.estranged = False
        self.scene = Scene(prior)
        own = [Tables((TABLES / f"{name}.nvt").read_bytes()) for name in ("generic", "small_blocks", "stream")]
        if prior.tables and prior.tables.data != own[0].data:
            own[:2] = [prior.tables] * 2
        self.tables = own

    def add_camera(self, camera):
        if camera not in self.cameras:
            self.cameras = self.cameras[-255:] + [camera]

    def camera_of(self, tag):
        return next((c for c in reversed(self.cameras) if c.session(self.prior.id) & 0xFFFF == tag), None)

    def _read(self, data):
        try:
            return read_latent(data, self.held)
        except Refused as refused:
            self.held.refuse(data, refused.args[0])
            raise

    def _estrange(self):
        self.estranged, self.held = True, Held()

    def _learn(self, packet):
        """Takes the session part. Why it could not be used, if it is damaged."""
        damage = None
        if packet.flags & SESSION:
            try:
                prior, camera = read_session(packet)
            except Refused as refused:
                damage = refused.args[0]
            else:
                if prior != self.prior.id:
                    self._estrange()
                    raise Refused("prior")
                self.estranged = False
                self.add_camera(camera)
        if self.estranged:
            raise Refused("estranged")
        return damage

    def decode(self, data):
        packet = self._read(data)
        session_damage = self._learn(packet)
        frame = near(packet.frame, 1 << 16, self.last)
        camera = self.camera_of(packet.tag)
        if camera is None:
            raise Refused("session-unknown")
        if self.view is None or self.view.camera != camera:
            self.view = View(camera, truth=TruthDecoder(camera.width, camera.height))
        drawn, depths, placement = render(self.scene, camera.tuple(), packet.pose)
        decoded = Decoded(frame, drawn, uncertain=packet.confidence == UNCERTAIN, portable=packet.portable)
        bound = BOUNDS[packet.confidence]
        decoded.known = bound and [bound * self.prior.unit, bound]
        check = read_render(packet)
        decoded.same_render = None if check is None else check == crc32(drawn.tobytes())
        residual = read_residual(packet)
        used = self._add(decoded, packet, residual, drawn, depths, placement)
        decoded.damage = decoded.damage or session_damage
        if residual.reference and (residual.error is None or self._is_start(packet, residual)):
            decoded.reference = (frame - residual.reference[0]) % (1 << 32)
        if decoded.same_render is not False:
            self._truth(decoded, packet, residual, used, drawn)
        self.last = frame
        if packet.portable and decoded.same_render is False:
            self._estrange()
        else:
            self.held.hold(frame, packet.pose, camera.session(self.prior.id))
        return decoded

    def _is_start(self, packet, residual):
        """Only the end of the residual is missing."""
        return self.is_start and residual.error == "check" and packet.kind >= CODED

    def _add(self, decoded, packet, residual, drawn, depths, placement):
        """Adds a residual. Whether it, or its start, was used."""
        decoded.damage = residual.error
        is_start, portable = residual.error is not None, packet.portable
        if packet.kind < CODED or is_start and not self._is_start(packet, residual):
            return False
        earlier = None
        if residual.reference:
            if not portable:
                decoded.damage = "other-render"
                return False
            kept = self.view.references.find(residual.reference, decoded.frame, self.view.camera)
            if kept is None:
                decoded.damage = "reference-missing"
                return False
            earlier = warp(kept, self.view.camera, placement, depths, ROTATION), kept
        coding = Frame(drawn, self.tables, earlier)
        difference = coding.decode(residual.payload, is_start, packet.flags & SMALL, portable)
        if isinstance(difference, str):
            decoded.damage = difference
            return False
        if difference is not None:
            decoded.picture = np.clip(drawn.astype(np.int64) + difference, 0, 255).astype(np.uint8)
            decoded.step = coding.step
        if packet.kind in (STREAM, INTER) and not is_start and portable:
            self.view.references.keep(decoded.frame, self.view.camera, placement, decoded.picture, drawn)
            decoded.kept = True
        return True

    def _truth(self, decoded, packet, residual, used, drawn):
        is_start = residual.error is not None
        if residual.truth is None or not used and (is_start or packet.kind >= CODED):
            return
        start = (drawn, decoded.picture) if is_start else None
        decoded.truth = self.view.truth.levels(decoded.frame, residual.truth, start)

"""The topside: packets in, pictures out. docs/format/packet.md, "Order of checks"."""

from dataclasses import dataclass, field

import numpy as np

from .bits import Refused, crc16, crc32, le
from .packet import Camera, Held, near, read_camera, read_latent, read_residual
from .prior import TABLES, Tables
from .render import Scene, render
from .stream import References, warp
from .truth import TruthDecoder
from .update import States, Update
from .wavelet import ROTATION, Frame


@dataclass
class Decoded:
    frame: int
    picture: np.ndarray
    damage: str = None
    uncertain: bool = False
    portable: bool = True
    same_render: bool = None
    kept: bool = False
    reference: int = None
    missing_update: int = None
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
        self.states, self.scenes = States(prior.id), {}
        own = [Tables((TABLES / f"{name}.nvt").read_bytes()) for name in ("generic", "small_blocks", "stream")]
        if prior.tables and prior.tables.data != own[0].data:
            own[:2] = [prior.tables] * 2
        self.tables = own

    def add_camera(self, camera):
        if camera not in self.cameras:
            self.cameras = self.cameras[-255:] + [camera]

    def add_update(self, data):
        return self.states.add(Update(data))

    def camera_of(self, latent):
        return next((c for c in reversed(self.cameras) if self.states.of(latent, c)), None)

    def _read(self, data):
        try:
            return read_latent(data, self.held)
        except Refused as refused:
            self.held.refuse(data, refused.args[0])
            raise

    def decode(self, data):
        packet = self._read(data)
        latent, rest = packet.latent, packet.rest
        if latent.full and latent.update is None and latent.state != self.prior.id:
            raise Refused("prior")
        camera_damage = None
        if packet.has_camera:
            try:
                self.add_camera(read_camera(packet))
            except Refused as refused:
                camera_damage = refused.args[0]
            rest = rest[18:]
        frame = near(latent.frame, latent.modulus, self.last)
        self.states.note(latent)
        camera, learnt, missing = self.camera_of(latent), None, None
        if camera:
            learnt = self.states.of(latent, camera)
        elif latent.update is not None:
            missing, learnt = latent.update, self.states.held[-1]
            camera = self._guess(latent)
            if camera is None:
                raise Refused("update-missing")
        else:
            raise Refused("camera-unknown" if latent.full else "session-unknown")
        if self.view is None or self.view.camera != camera:
            self.view = View(camera, truth=TruthDecoder(camera.width, camera.height))
        drawn, depths, placement = render(self._scene(learnt), camera.tuple(), latent.pose)
        decoded = Decoded(frame, drawn, uncertain=latent.uncertain, portable=latent.portable, missing_update=missing)
        if packet.has_render:
            check = self._render_check(packet, rest)
            decoded.same_render = None if check is None else check == crc32(drawn.tobytes())
            rest = rest[6:]
        residual = read_residual(packet, rest)
        used = False
        if missing is not None:
            decoded.damage = "update-missing"
        else:
            used = self._add(decoded, latent, residual, drawn, depths, placement)
            decoded.damage = decoded.damage or camera_damage
        if residual.is_stream and residual.reference and (residual.error is None or self.is_start):
            decoded.reference = (frame - residual.reference[0]) % (1 << 24)
        if missing is None and decoded.same_render is not False:
            self._truth(decoded, residual, used, drawn)
        self.last = frame
        self._hold(frame, latent)
        return decoded

    def _guess(self, latent):
        if latent.full:
            fits = (c for c in reversed(self.cameras) if c.tag == latent.tag and c.size == latent.size)
            for camera in fits:
                return camera
        return self.view.camera if self.view else self.cameras[-1] if self.cameras else None

    def _scene(self, learnt):
        if learnt.state not in self.scenes:
            self.scenes[learnt.state] = Scene(self.prior, learnt if learnt.number else None)
        return self.scenes[learnt.state]

    @staticmethod
    def _render_check(packet, rest):
        part = rest[:6]
        if len(part) < 6 or crc16(packet.bytes, part[:4]) != le(part[4:]):
            return None
        return le(part[:4])

    def _add(self, decoded, latent, residual, drawn, depths, placement):
        """Adds a residual. Whether it, or its start, was used."""
        decoded.damage = residual.error
        is_start = residual.error is not None
        if residual.payload is None or residual.coder is None or is_start and not self.is_start:
            return False
        if residual.coder in ("vp8", "webp"):
            decoded.damage = "coder-missing"
            return False
        earlier = None
        if residual.is_stream and residual.reference:
            if not latent.portable:
                decoded.damage = "other-render"
                return False
            kept = self.view.references.find(residual.reference, decoded.frame, self.view.camera)
            if kept is None:
                decoded.damage = "reference-missing"
                return False
            earlier = warp(kept, self.view.camera, placement, depths, ROTATION), kept
        coding = Frame(drawn, self.tables, earlier)
        difference = coding.decode(residual.payload, is_start, residual.small, latent.portable)
        if isinstance(difference, str):
            decoded.damage = difference
            return False
        if difference is not None:
            decoded.picture = np.clip(drawn.astype(np.int64) + difference, 0, 255).astype(np.uint8)
            decoded.step = coding.step
        if residual.is_stream and not is_start and latent.portable:
            self.view.references.keep(decoded.frame, self.view.camera, placement, decoded.picture, drawn)
            decoded.kept = True
        return True

    def _truth(self, decoded, residual, used, drawn):
        if residual.truth is None:
            return
        truth, is_start = self.view.truth, residual.error is not None
        if is_start and not (used and self.is_start):
            return
        if not is_start and residual.coder and not used:
            return
        start = (drawn, decoded.picture) if is_start else None
        decoded.truth = truth.levels(decoded.frame, residual.truth, start)

    def _hold(self, frame, latent):
        camera = self.camera_of(latent)
        learnt = camera and self.states.of(latent, camera)
        if not learnt:
            return
        has = latent.update is not None
        check = crc32(learnt.state, camera.size, camera.numbers, bytes([latent.portable, has, latent.update or 0]))
        self.held.hold(frame, latent, check)

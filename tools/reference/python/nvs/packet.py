"""Packets: docs/format/packet.md."""

import math
import struct
from dataclasses import dataclass

from .bits import Refused, crc16, crc32, fold, le, u32

SHORT, COMPACT, PREDICTED, LATER = 0b00000, 0b00111, 0b11001, 0b11110
SMALL, TRUTH, SESSION, RENDER, NOT_PORTABLE = (1 << bit for bit in range(5))
UNCERTAIN, BOUNDS = 1, (None, None, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1)
NONE, OMITTED, ALL_SEEN, CODED, STREAM, INTER = range(6)
SESSION_LEN, RENDER_LEN = 25, 6
UNIT = math.isqrt(2 * 131071**2)


@dataclass
class Pose:
    centre: list
    largest: int
    small: list

    def short(self):
        """On the short grid: centre, largest, small; or None."""
        if any(c % 32 for c in self.centre) or any(k % 8 for k in self.small):
            return None
        centre = [c // 32 for c in self.centre]
        within = all(-32768 <= c <= 32767 for c in centre)
        return (centre, self.largest, [k // 8 for k in self.small]) if within else None


def compact(centre, largest, small):
    scale = 131071 * math.sqrt(2)
    if largest > 3 or not 1 - sum((k / scale) ** 2 for k in small) > 0:
        raise Refused("pose")
    return Pose(centre, largest, small)


def pose_of_short(centre, largest, small):
    if not (all(-32768 <= c <= 32767 for c in centre) and all(-16384 <= k <= 16383 for k in small)):
        raise Refused("pose")
    return compact([32 * c for c in centre], largest, [8 * k for k in small])


def read_pose(data):
    if len(data) == 12:
        word = le(data[6:12])
        small = [(word >> shift & 0x7FFF) - 16384 for shift in (30, 15, 0)]
        return pose_of_short(list(struct.unpack("<3h", data[:6])), word >> 45, small)
    word = le(data[9:16])
    centre = [(le(data[i:i + 3]) ^ 0x800000) - 0x800000 for i in (0, 3, 6)]
    return compact(centre, word >> 54, [(word >> shift & 0x3FFFF) - 131072 for shift in (36, 18, 0)])


@dataclass
class Camera:
    width: int
    height: int
    numbers: bytes

    def session(self, prior):
        """The session check; its low 16 bits are the tag."""
        return crc32(prior, u32(self.width - 1 | self.height - 1 << 12)[:3], self.numbers)

    def tuple(self):
        return (self.width, self.height, *struct.unpack("<4f", self.numbers))


@dataclass
class Packet:
    """What the latent part says. `bytes`: these; `rest`: all behind them."""
    kind: int
    flags: int
    frame: int
    bytes: bytes
    rest: bytes
    tag: int = None
    pose: Pose = None

    @property
    def portable(self):
        return not self.flags & NOT_PORTABLE

    @property
    def confidence(self):
        return self.flags >> 5

    def part(self, wanted):
        """The bytes of a part behind the latent part, as many as there are."""
        at = 0
        for flag, length in ((SESSION, SESSION_LEN), (RENDER, RENDER_LEN)):
            if wanted == flag:
                return self.rest[at:at + length] if self.flags & flag else None
            at += length if self.flags & flag else 0
        return self.rest[at:]


def near(number, modulus, last):
    if last is None:
        return number
    ahead = (number - last) % modulus
    return (last + ahead - (modulus if ahead > modulus // 2 else 0)) % (1 << 32)


def layout(data):
    """The packet without pose, its length, and what a predicted pose states; no check is tested."""
    if len(data) < 2:
        raise Refused("too-short")
    word = data[0] & 31
    if word not in (SHORT, COMPACT, PREDICTED):
        later = word == LATER and len(data) >= 18 and crc16(data[:16]) == le(data[16:18])
        raise Refused("version" if later else "check")
    if len(data) < 4:
        raise Refused("too-short")
    stated = Stated(data) if word == PREDICTED else None
    length = stated.end + 2 if stated else 20 if word == SHORT else 24
    if len(data) < length:
        raise Refused("too-short")
    return Packet(data[0] >> 5, data[1], le(data[2:4]), data[:length], data[length:]), stated


def seal(packet, context=b""):
    if crc16(context, packet.bytes[:-2]) != le(packet.bytes[-2:]):
        raise Refused("check")


def read_latent(data, held):
    packet, stated = layout(data)
    if stated:
        return held.read(packet, stated)
    seal(packet)
    packet.tag, packet.pose = le(data[4:6]), read_pose(packet.bytes[6:-2])
    return packet


class BitReader:
    """The bits of a predicted pose."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def bit(self):
        if self.at >= 112:
            raise Refused("pose")
        if self.at // 8 >= len(self.data):
            raise Refused("too-short")
        bit = self.data[self.at // 8] >> 7 - self.at % 8 & 1
        self.at += 1
        return bit

    def take(self, count):
        value = 0
        for _ in range(count):
            value = value << 1 | self.bit()
        return value

    def number(self, parameter):
        ones = 0
        while self.bit():
            ones += 1
        return fold(ones << parameter | self.take(parameter))


class Stated:
    """A predicted pose, as the packet states it."""

    def __init__(self, data):
        reader = BitReader(data[4:])
        self.distance, self.base = reader.take(6) + 1, reader.take(3)
        scales = [reader.take(3), reader.take(3)]
        self.offsets = [reader.number(scales[i // 3] + 2) for i in range(6)]
        if reader.take(-reader.at % 8):
            raise Refused("check")
        self.end = 4 + reader.at // 8


def rounded(value, by):
    return (2 * value + by) // (2 * by)


def quaternion(pose):
    _, at, small = pose
    small = [8 * k for k in small]
    whole = math.isqrt(max(0, 2 * 131071**2 - sum(k * k for k in small)))
    return small[:at] + [whole] + small[at:]


def predict(distance, reference, base, before):
    if before is None:
        return reference
    limit = lambda v, most: min(max(v, -most - 1), most)
    centre = [limit(r + rounded((r - b) * distance, base), 32767) for r, b in zip(reference[0], before[0])]
    now, then = quaternion(reference), quaternion(before)
    sign = -1 if sum(a * b for a, b in zip(now, then)) < 0 else 1
    turned = [a * base + (a - sign * b) * distance for a, b in zip(now, then)]
    length, at = math.isqrt(sum(v * v for v in turned)), reference[1]
    if turned[at] <= 0 or length == 0:
        raise Refused("pose")
    others = [v for i, v in enumerate(turned) if i != at]
    return centre, at, [limit(rounded(v * UNIT, length * 8), 16383) for v in others]


class Held:
    """The poses of the last 128 frames."""

    def __init__(self):
        self.slots, self.last = {}, None

    def get(self, frame):
        held = self.slots.get(frame % 128)
        return held if held and (held["frame"] - frame) % (1 << 16) == 0 else None

    def hold(self, frame, pose, session):
        pose = pose.short()
        if pose is None:
            return self.forget(frame)
        self.slots[frame % 128] = {"frame": frame, "pose": pose, "session": session}
        if self.last is None or not 1 <= (self.last - frame) % (1 << 32) < 128:
            self.last = frame

    def forget(self, frame):
        if self.get(frame):
            del self.slots[frame % 128]

    def read(self, packet, stated):
        frame = near(packet.frame, 1 << 16, self.last)
        reference = self.get(frame - stated.distance)
        before = self.get(reference["frame"] - stated.base) if reference and stated.base else None
        sound = reference and (not stated.base or before and before["session"] == reference["session"]
                               and before["pose"][1] == reference["pose"][1])
        if not sound:
            raise Refused("pose-not-held")
        context = [u32(reference["session"])]
        for held in (reference, before):
            if held:
                centre, largest, small = held["pose"]
                context.append(struct.pack("<6iB", *centre, *small, largest))
        seal(packet, u32(crc32(*context)))
        start = predict(stated.distance, reference["pose"], stated.base, before and before["pose"])
        packet.pose = pose_of_short([a + b for a, b in zip(start[0], stated.offsets)], start[1],
                                    [a + b for a, b in zip(start[2], stated.offsets[3:])])
        packet.tag = reference["session"] & 0xFFFF
        return packet

    def refuse(self, data, name):
        """What a refused packet with a predicted pose takes along."""
        try:
            packet, stated = layout(data)
        except Refused:
            return
        if not stated:
            return
        frame = near(packet.frame, 1 << 16, self.last)
        self.forget(frame)
        if name == "check":
            self.forget(frame - stated.distance)
            self.forget(frame - stated.distance - stated.base)


def is_whole(part):
    return len(part) == SESSION_LEN and crc16(part[:-2]) == le(part[-2:])


def read_session(packet):
    """The prior's id and the camera."""
    part = packet.part(SESSION)
    if len(part) < SESSION_LEN:
        raise Refused("too-short")
    if not is_whole(part):
        raise Refused("check")
    if crc32(part[:-2]) & 0xFFFF != packet.tag:
        raise Refused("session-tag")
    size, (fx, fy, cx, cy) = le(part[4:7]), struct.unpack("<4f", part[7:-2])
    if not (all(map(math.isfinite, (fx, fy, cx, cy))) and fx > 0 and fy > 0):
        raise Refused("session")
    return part[:4], Camera((size & 0xFFF) + 1, (size >> 12) + 1, part[7:-2])


def read_render(packet):
    """The check of the render; None: there is none, or it is damaged."""
    part = packet.part(RENDER) or b""
    is_right = len(part) == RENDER_LEN and crc16(packet.bytes, part[:4]) == le(part[4:])
    return le(part[:4]) if is_right else None


@dataclass
class Residual:
    """What the residual part holds. `error`: why not all of it can be used; a payload may then be a start."""
    truth: bytes = None
    reference: tuple = None
    payload: bytes = None
    error: str = None
    end: int = 0


def read_residual(packet):
    """The residual part. `end`: bytes up to its end, without padding."""
    kind, flags, rest = packet.kind, packet.flags, packet.part(None)
    if kind > INTER or kind < CODED and flags & SMALL or kind == ALL_SEEN and flags & TRUTH:
        return Residual(error="coder")
    if kind < CODED and not flags & TRUTH:
        return Residual(truth=b"\0" if kind == ALL_SEEN else None)
    if len(rest) < (5 if kind == INTER else 2):
        return Residual(error="too-short")
    found, at = Residual(), 2
    if kind == INTER:
        if rest[2] == 0:
            return Residual(error="reference")
        found.reference, at = (rest[2], le(rest[3:5])), 5
    if flags & TRUTH:
        end = map_end(rest[at:])
        if end is None:
            found.error = "truth"
            return found
        found.truth, at = rest[at:at + end], at + end
    found.payload = rest[at:].rstrip(b"\0")
    found.end = at + len(found.payload)
    if crc16(u32(crc32(packet.bytes)), rest[2:found.end]) != le(rest[:2]):
        found.error = "check"
    return found


def map_end(content):
    """Where a truth map ends: docs/format/packet.md."""
    if not content:
        return None
    if not content[0] & 3:
        return 1
    if len(content) < 2:
        return None
    length, at = content[1] & 15, 2
    if length == 15:
        for place in range(3):
            if at >= len(content):
                return None
            length += (content[at] & 127) << 7 * place
            at += 1
            if content[at - 1] < 128:
                break
    return at + length if length <= 1 << 20 and at + length <= len(content) else None


@dataclass
class Extent:
    """What the start of a packet says by itself. `whole`: bytes up to the packet's end, if all of it is there."""
    frame: int
    valid: int
    whole: int


def extent(start):
    packet, stated = layout(start)
    if not stated:
        packet = read_latent(start, None)
    valid = head = len(packet.bytes)
    for flag, right in ((SESSION, is_whole), (RENDER, lambda _: read_render(packet) is not None)):
        part = packet.part(flag)
        if part is not None:
            valid += len(part) if valid == head and right(part) else 0
            head += SESSION_LEN if flag == SESSION else RENDER_LEN
    whole = None
    if valid == head:
        residual = read_residual(packet)
        whole = None if residual.error else head + residual.end
    return Extent(packet.frame, whole or valid, whole)

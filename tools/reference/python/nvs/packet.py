"""Packets: docs/format/packet.md."""

import math
import struct
from dataclasses import dataclass, field

from .bits import Refused, crc8, crc16, crc32, fold, le, u16, u32

FULL, SHORT, LEARNT, NOT_PORTABLE = {1, 2, 8, 11}, {4, 7, 13, 14}, {8, 11, 13, 14}, {2, 7, 11, 14}
PREDICTED_CODES = {0, 1, 4, 5, 6, 7, 12, 13, 14}
UNIT = math.isqrt(2 * 131071**2)


@dataclass
class Pose:
    kind: str
    centre: list = None
    largest: int = 0
    small: list = None
    translation: tuple = None
    quaternion: tuple = None

    def short(self):
        """On the short grid: centre, largest, small; or None."""
        if self.kind != "compact" or any(c % 32 for c in self.centre) or any(k % 8 for k in self.small):
            return None
        centre = [c // 32 for c in self.centre]
        within = all(-32768 <= c <= 32767 for c in centre)
        return (centre, self.largest, [k // 8 for k in self.small]) if within else None


def compact(centre, largest, small):
    scale = 131071 * math.sqrt(2)
    if largest > 3 or not 1 - sum((k / scale) ** 2 for k in small) > 0:
        raise Refused("pose")
    return Pose("compact", centre, largest, small)


def pose_of_short(centre, largest, small):
    if not (all(-32768 <= c <= 32767 for c in centre) and all(-16384 <= k <= 16383 for k in small)):
        raise Refused("pose")
    return compact([32 * c for c in centre], largest, [8 * k for k in small])


def read_pose(data, kind):
    if kind == "paper":
        numbers = struct.unpack("<7f", data)
        if not all(map(math.isfinite, numbers)) or not math.sqrt(sum(v * v for v in numbers[3:])) > 1e-6:
            raise Refused("pose")
        return Pose("paper", translation=numbers[:3], quaternion=numbers[3:])
    if kind == "short":
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

    @property
    def size(self):
        return le3(self.width - 1 | self.height - 1 << 12)

    @property
    def tag(self):
        return crc16(self.size, self.numbers) & 0xFF

    def session_tag(self, state):
        return crc16(state, self.size, self.numbers) & 0xFF

    def tuple(self):
        return (self.width, self.height, *struct.unpack("<4f", self.numbers))


def le3(value):
    return u32(value)[:3]


@dataclass
class Latent:
    frame: int
    modulus: int
    portable: bool
    update: int = None
    state: bytes = None
    size: bytes = None
    tag: int = 0
    pose: Pose = None
    uncertain: bool = False
    full: bool = True


@dataclass
class Packet:
    latent: Latent
    form: str
    code: int
    bytes: bytes
    rest: bytes
    has_camera: bool = False
    has_render: bool = False
    base: dict = field(default_factory=dict)


def near(number, modulus, last):
    if last is None:
        return number
    ahead = (number - last) % modulus
    return (last + ahead - (modulus if ahead > modulus // 2 else 0)) % (1 << 24)


def read_latent(data, held):
    """The latent part of any form."""
    if data and data[0] >> 4 == 8:
        return held.read(data)
    if data and data[0] >> 4 != 0xB:
        raise Refused("magic")
    if len(data) < 19:
        raise Refused("too-short")
    version, flags = data[0] & 15, data[1]
    profile = flags & 3
    if version in FULL:
        if len(data) < 31:
            raise Refused("too-short")
        if profile not in (1, 2):
            raise Refused("profile")
        length = 31 if profile == 1 else 43
    elif version in SHORT:
        if profile not in (0, 3):
            raise Refused("profile")
        if flags & 8:
            raise Refused("short-camera")
        length = 20 if version in LEARNT else 19
    else:
        later = any(len(data) >= n and crc16(data[:n - 2]) == le(data[n - 2:n]) for n in (19, 20, 31, 43))
        raise Refused("version" if later else "check")
    if len(data) < length:
        raise Refused("too-short")
    part = data[:length]
    if crc16(part[:-2]) != le(part[-2:]):
        raise Refused("check")
    latent = Latent(le(part[2:4]), 1 << 16, version not in NOT_PORTABLE, uncertain=bool(flags & 4))
    at = 4
    if version in LEARNT:
        latent.update, at = part[4], 5
    if version in FULL:
        if version not in LEARNT:
            latent.frame, latent.modulus = le(part[2:5]), 1 << 24
        latent.state, latent.size = part[5:9], part[9:12]
        latent.pose = read_pose(part[12:-3], "compact" if profile == 1 else "paper")
        latent.tag = part[-3]
        code = flags >> 4 & 7
    else:
        latent.full, latent.tag = False, part[at]
        latent.pose = read_pose(part[at + 1:-2], "short")
        code = flags >> 4 & 7 | (8 if profile == 0 else 0)
    form = "full" if version in FULL else "short"
    return Packet(latent, form, code, part, data[length:], bool(flags & 8), bool(flags & 0x80))


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

    def hold(self, frame, latent, check):
        pose = latent.pose.short()
        if pose is None:
            return self.forget(frame)
        self.slots[frame % 128] = {"frame": frame, "pose": pose, "latent": latent, "check": check}
        if self.last is None or not 1 <= (self.last - frame) % (1 << 32) < 128:
            self.last = frame

    def forget(self, frame):
        if self.get(frame):
            del self.slots[frame % 128]

    def stated(self, data):
        if len(data) < 2:
            raise Refused("too-short")
        if data[0] & 15 not in PREDICTED_CODES:
            raise Refused("magic")
        reader = BitReader(data[2:])
        distance, base = reader.take(6) + 1, reader.take(3)
        scales = [reader.take(3), reader.take(3)]
        offsets = [reader.number(scales[i // 3] + 2) for i in range(6)]
        end = 2 + (reader.at + 7) // 8
        if reader.take(-reader.at % 8):
            raise Refused("check")
        if len(data) < end + 2:
            raise Refused("too-short")
        return data[1] & 127, distance, base, offsets, end

    def read(self, data):
        number, distance, base, offsets, end = self.stated(data)
        frame = near(number, 128, self.last)
        reference = self.get(frame - distance)
        before = self.get(reference["frame"] - base) if reference and base else None
        sound = reference and (not base or before and before["check"] == reference["check"]
                               and before["pose"][1] == reference["pose"][1])
        if not sound:
            raise Refused("pose-not-held")
        context = [u16(frame), u32(reference["check"])]
        for held in (reference, before):
            if held:
                centre, largest, small = held["pose"]
                context.append(struct.pack("<6iB", *centre, *small, largest))
        if crc16(u32(crc32(*context)), data[:1], data[2:end]) != le(data[end:end + 2]):
            raise Refused("check")
        start = predict(distance, reference["pose"], base, before and before["pose"])
        pose = pose_of_short([a + b for a, b in zip(start[0], offsets)], start[1],
                             [a + b for a, b in zip(start[2], offsets[3:])])
        of = reference["latent"]
        latent = Latent(frame, 1 << 24 if of.full and of.update is None else 1 << 16, of.portable, of.update, of.state,
                        of.size, of.tag, pose, False, of.full)
        return Packet(latent, "predicted", data[0] & 15, data[:end + 2], data[end + 2:])

    def refuse(self, data, name):
        """What a refused packet in the predicted form takes along."""
        if not data or data[0] >> 4 != 8:
            return
        try:
            number, distance, base, _, _ = self.stated(data)
        except Refused:
            return
        frame = near(number, 128, self.last)
        self.forget(frame)
        if name == "check":
            self.forget(frame - distance)
            self.forget(frame - distance - base)


def read_camera(packet):
    part = packet.rest[:18]
    if len(part) < 18:
        raise Refused("too-short")
    check = crc16(packet.latent.size, part[:16])
    if check != le(part[16:]):
        raise Refused("check")
    if check & 0xFF != packet.latent.tag:
        raise Refused("camera-tag")
    size = le(packet.latent.size)
    camera = Camera((size & 0xFFF) + 1, (size >> 12) + 1, part[:16])
    fx, fy, cx, cy = struct.unpack("<4f", part[:16])
    if not (all(map(math.isfinite, (fx, fy, cx, cy))) and fx > 0 and fy > 0):
        raise Refused("camera")
    return camera


@dataclass
class Residual:
    """What follows the head. `error`: why not all of it can be used; `start`: it is the start of a payload."""
    truth: bytes = None
    reference: tuple = None
    is_stream: bool = False
    small: bool = False
    coder: str = None
    payload: bytes = None
    error: str = None


def read_residual(packet, rest):
    """The residual part. If it is damaged, `error` says so, and a payload is its start if only its end is missing."""
    code = packet.code
    if code in (0, 1):
        return Residual()
    if code == 7:
        return Residual(truth=b"\0")
    coders = {2: "vp8", 3: "webp", 4: "wavelet", 5: "stream", 6: "truth"}
    small, kind = code > 7, coders.get(code & 7 if code > 7 else code)
    if kind is None or small and kind not in ("wavelet", "stream", "truth"):
        return Residual(error="coder")
    content, error = read_content(packet, rest)
    found = Residual(small=small, error=error)
    if content is None:
        return found
    if kind == "truth":
        end = map_end(content)
        if end is None:
            return Residual(error=error or "truth")
        found.truth, content = content[:end], content[end:]
        kind = (None, None, "wavelet", "stream")[found.truth[0] & 3]
    if kind == "stream":
        found.is_stream = True
        long = 1 if content[:1] == b"\0" else 3
        if len(content) < long:
            found.error, found.is_stream = error or "reference", False
            return found
        found.reference = (content[0], le(content[1:3])) if long == 3 else None
        kind, content = "wavelet", content[long:]
    found.coder, found.payload = kind, content if kind else None
    return found


def read_content(packet, rest):
    """The content of the part, and the error. None: not even its start is there."""
    if packet.form == "predicted":
        if not packet.bytes[1] & 0x80:
            return rest, "too-short"
        if not rest:
            return None, "too-short"
        key = u32(crc32(packet.bytes[:1], packet.bytes[2:]))
        return (rest[:-1], None) if crc8(key, rest[:-1]) == rest[-1] else (None, "check")
    length, field_len = 0, 0
    while True:
        if field_len == 4:
            return None, "length"
        if field_len >= len(rest):
            return None, "too-short"
        byte = rest[field_len]
        length |= (byte & 127) << 7 * field_len
        field_len += 1
        if byte < 128:
            break
    end, size = field_len + length, 4 if packet.form == "full" else 2
    if len(rest) < end + size:
        return rest[field_len:min(end, len(rest))], "too-short"
    part = rest[:end]
    if packet.form == "full":
        check = u32(crc32(packet.bytes, part))
    else:
        check = u16(crc16(u32(crc32(packet.bytes)), part))
    return (part[field_len:], None) if check == rest[end:end + size] else (None, "check")


def map_end(content):
    """Where a truth map ends: docs/format/truth.md."""
    if not content:
        return None
    if not content[0] & 12:
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

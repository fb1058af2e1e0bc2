"""Priors: docs/format/prior.md."""

import lzma
import re
import struct
from pathlib import Path

import numpy as np

from .bits import Refused, blake3, crc32, fold, le

F32 = np.float32
TABLES = Path(__file__).resolve().parents[4] / "src/coder_tables"
SHAPES = [
    ("magnitude_1", (33, 32)), ("magnitude_class", (14, 32)), ("magnitude_bias_1", (32,)), ("magnitude_2", (32, 16)),
    ("magnitude_bias_2", (16,)), ("magnitude_3", (16, 4)), ("magnitude_bias_3", (4,)), ("quiet_1", (15, 12)),
    ("quiet_class", (14, 12)), ("quiet_bias_1", (12,)), ("quiet_2", (12,)), ("quiet_bias_2", ()), ("sign_1", (17, 16)),
    ("sign_class", (14, 16)), ("sign_bias_1", (16,)), ("sign_2", (16,)), ("sign_bias_2", ()),
]


class Tables:
    """Coder tables."""

    def __init__(self, data):
        if data[:4] != b"NVT1" or len(data) != 6135:
            raise Refused("content")
        self.data, at = data, 4
        for name, shape in SHAPES:
            count = int(np.prod(shape))
            setattr(self, name, np.frombuffer(data, "<i2", count, at).reshape(shape).astype(np.int64))
            at += 2 * count
        self.offsets = np.frombuffer(data, "i1", 63, at).reshape(3, 7, 3).astype(np.int64)


class Prior:
    """Splats and what goes with them."""

    def __init__(self, arrays, options, tables=None, key_frames=0, frame=None, origin=None, near_by_size=False):
        """`frame`: the stated centre and spread, of a blocked prior. `origin`: what positions count from, if not zero.
        `near_by_size`: no near plane is stated."""
        self.origin = origin
        self.positions, self.log_scales, self.rotations, self.logits, self.sh = arrays
        self.tables, self.key_frames, self.frame = tables, key_frames, frame
        self._drop()
        self._frame()
        if near_by_size and self.spread < F32(0.5):
            near = max(self.spread * F32(1 / 16), np.finfo(F32).tiny)
            options = (min(options[0], near), *options[1:])
        self.options = options
        self.near, self.alpha_max, self.antialiased, self.background, self.trained_focal = options
        self.id = self._identity()

    def _drop(self):
        self.log_scales = np.where(np.isneginf(self.log_scales), F32(-40), self.log_scales).astype(F32)
        infinite = np.isinf(self.logits)
        self.logits = np.where(infinite, np.copysign(F32(20), self.logits), self.logits).astype(F32)
        length = np.sqrt((self.rotations.astype(np.float64) ** 2).sum(1))
        flat = [a.reshape(len(a), -1) for a in (self.positions, self.log_scales, self.rotations, self.logits, self.sh)]
        good = np.all([np.isfinite(a).all(1) for a in flat], 0) & (length >= 1e-6)
        good &= (np.abs(self.log_scales) <= 40).all(1) & (np.abs(flat[4]) <= 1e6).all(1)
        for name in ("positions", "log_scales", "rotations", "logits", "sh"):
            setattr(self, name, getattr(self, name)[good])

    def _identity(self):
        """BLAKE3 of the parts that change the picture: each its name, its length and its content."""
        near, alpha_max, antialiased, background, focal = self.options
        arrays = (self.positions, self.log_scales, self.rotations, self.logits, self.sh)
        options = struct.pack("<6fB", near, alpha_max, *background, focal or 0, antialiased)
        parts = [("options", options)]
        if self.frame:
            parts.append(("frame", struct.pack("<4f", *self.frame[0], self.frame[1])))
        if self.tables:
            parts.append(("tables", self.tables.data))
        if self.origin is not None:
            parts.append(("origin", struct.pack("<3d", *self.origin)))
        splats = struct.pack("<II", round(self.sh.shape[1] ** 0.5) - 1, len(self.logits))
        parts.append(("splats", splats + b"".join(array.astype("<f4").tobytes() for array in arrays)))
        named = (name.encode().ljust(8, b"\0") + struct.pack("<Q", len(content)) + content for name, content in parts)
        return blake3(b"nvsprior prior 1" + b"".join(named))[:4]

    def _frame(self):
        if self.frame:
            self.centre, self.spread = self.frame
            self.unit = _unit(self.spread, self.centre.astype(np.float64))
            return
        positions = self.positions.astype(np.float64)
        middle = (len(positions) - 1) // 2
        centre = np.sort(positions, 0)[middle]
        off = np.abs(positions - centre)
        most = float(np.finfo(F32).max)
        spreads = [F32(min(v, most)) for v in (np.sort(off, 0)[middle].max(), off.max(), 1.0)]
        self.spread = next(s for s in spreads if s > 0)
        self.centre = centre.astype(F32)
        self.unit = _unit(self.spread, centre)

    @property
    def name(self):
        return f"{le(self.id):08x}"


def _far_origin(positions):
    """The point that positions of a foreign file should count from; None: zero."""
    middle = (len(positions) - 1) // 2
    centre = np.sort(positions, 0)[middle]
    off = np.abs(positions - centre)
    spread = next(s for s in (np.sort(off, 0)[middle].max(), np.nanmax(off), 1.0) if s > 0)
    whole = np.trunc(centre + np.copysign(0.5, centre))
    is_far = np.isfinite(centre).all() and np.abs(centre).max() > 64 * spread
    return whole if is_far and whole.any() else None


def _unit(spread, centre):
    return max(float(spread), float(np.abs(centre).max()) * 2.0**-23)


def _is_mip(comment):
    """Whether another program says that the scene was trained anti-aliased."""
    words = re.split("[ \t:=]+", comment.strip().lower())
    return words in (["splatrendermode", "mip"], ["splatrendermode", "antialiased"], ["antialiased", "1"],
                     ["antialiased", "true"])


def options_of(comments):
    """Render options of a PLY file's comments; how many key frames; what positions count from, if that is stated;
    whether no near plane is stated."""
    near, alpha_max, background = F32(0.2), F32(0.99), [F32(0)] * 3
    antialiased = any(map(_is_mip, comments))
    by_size = not any("nerfstudio" in comment.lower() for comment in comments)
    if not by_size:
        near = F32(0.01)
    key_frames, focal, origin = 0, None, None
    for comment in comments:
        match comment.split():
            case ["nvsprior", "near", v]:
                near, by_size = F32(v), False
            case ["nvsprior", "alpha_max", v]:
                alpha_max = F32(v)
            case ["nvsprior", "antialiased", "0" | "1" as v]:
                antialiased = v == "1"
            case ["nvsprior", "trained_focal", v]:
                focal = F32(v)
            case ["nvsprior", "background", r, g, b]:
                background = [F32(r), F32(g), F32(b)]
            case ["nvsprior", "key_frame", *_]:
                key_frames += 1
            case ["nvsprior", "origin", x, y, z]:
                origin = np.array([float(x), float(y), float(z)])
            case ["nvsprior", "white_balance" | "clahe", *_]:
                pass
            case ["nvsprior", *_]:
                raise Refused("content")
    if focal is not None and not 1 <= focal <= 1e6:
        raise Refused("content")
    return (near, alpha_max, antialiased, background, focal), key_frames, origin, by_size


KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
         "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
         "float32": "f4", "float64": "f8"}


def read_ply(data):
    data = data.removeprefix(b"\xef\xbb\xbf")
    end = data.index(b"end_header\n") + 11
    lines = data[:end].decode("utf-8", "replace").splitlines()
    order, elements, comments = "<", [], []
    for line in lines[1:]:
        match line.split():
            case ["format", kind, _]:
                order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
            case ["comment", *_]:
                comments.append(line.split(" ", 1)[1])
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", kind, name]:
                elements[-1][2].append((name, (order or "<") + KINDS[kind]))
    rows, at = None, end
    words = data[end:].split() if not order else []
    for name, count, fields in elements:
        kind = np.dtype(fields)
        if order:
            table = np.frombuffer(data, kind, count, at)
            at += kind.itemsize * count
        else:
            taken, words = words[:count * len(fields)], words[count * len(fields):]
            starts = range(0, len(taken), len(fields))
            table = np.array([tuple(map(float, taken[i:i + len(fields)])) for i in starts], kind)
        if name == "vertex":
            rows = table
            break
    column = lambda *names: np.stack([rows[n].astype(F32) for n in names], 1)
    rest = sum(name.startswith("f_rest_") for name in rows.dtype.names)
    sh = np.empty((len(rows), rest // 3 + 1, 3), F32)
    names = rows.dtype.names
    if "f_dc_0" in names:
        sh[:, 0] = column("f_dc_0", "f_dc_1", "f_dc_2")
    else:
        largest = 255 if rows.dtype["red"] == np.uint8 else 1
        rgb = column("red", "green", "blue").astype(np.float64)
        sh[:, 0] = (rgb / largest - 0.5) / 0.28209479177387814
    for k in range(rest // 3):
        sh[:, k + 1] = column(*(f"f_rest_{c * (rest // 3) + k}" for c in range(3)))
    scales = column(*(name for name in ("scale_0", "scale_1", "scale_2") if name in names))
    if scales.shape[1] == 2:
        scales = np.concatenate([scales, np.full((len(rows), 1), F32(-40))], 1)
    logits = rows["opacity"].astype(F32)
    if "filter_3D" in names:
        scales, logits = _smoothed(scales, logits, rows["filter_3D"].astype(F32))
    options, key_frames, origin, by_size = options_of(comments)
    positions = column("x", "y", "z")
    if origin is None:
        exact = np.stack([rows[name].astype(np.float64) for name in "xyz"], 1)
        origin = _far_origin(exact)
        positions = positions if origin is None else (exact - origin).astype(F32)
    elif not origin.any():
        origin = None
    arrays = (positions, scales, column("rot_0", "rot_1", "rot_2", "rot_3"), logits, sh)
    return Prior(arrays, options, None, key_frames, None, origin, by_size)


def _smoothed(scales, logits, filters):
    """Mip-Splatting's filter merged into scales and opacities."""
    variances, added = np.exp(2 * scales.astype(np.float64)), filters.astype(np.float64)[:, None] ** 2
    kept = np.prod(variances / (variances + added), 1)
    opacity = np.sqrt(kept) / (1 + np.exp(-logits.astype(np.float64)))
    return (0.5 * np.log(variances + added)).astype(F32), np.log(opacity / (1 - opacity)).astype(F32)


KNOWN = dict.fromkeys(["options", "frame", "tables", "origin", "splats", "exact", "blocks"], 3)
KNOWN |= dict.fromkeys(["keys", "treated", "lens", "filter", "doubt", "trials", "record"], 0)


def _container(data, magic):
    """Head and parts of a file: degree, identity, number of splats, end of the parts, their contents by name."""
    if data[:4] != magic:
        raise Refused("magic")
    if len(data) < 28:
        raise Refused("truncated")
    if data[4] != 1:
        raise Refused("version")
    if crc32(data[:24]) != le(data[24:28]):
        raise Refused("damaged")
    degree, count, identity, splats, end = struct.unpack_from("<BH4sIQ", data, 5)
    if degree > 3 or splats == 0 or end < 28:
        raise Refused("content")
    if end > len(data):
        raise Refused("truncated")
    at, parts = 28, {}
    for _ in range(count):
        if at + 21 > end:
            raise Refused("truncated")
        name, flags, length, check = struct.unpack_from("<8sBQI", data, at)
        letters = name.rstrip(b"\0")
        if not letters or any(not 97 <= byte <= 122 for byte in letters):
            raise Refused("content")
        content = data[at + 21:at + 21 + length]
        if at + 21 + length > end:
            raise Refused("truncated")
        if crc32(data[at:at + 17] + content) != check:
            raise Refused("damaged")
        name = letters.decode()
        if flags != KNOWN.get(name, flags) or flags not in (0, 2, 3) or name in parts:
            raise Refused("content")
        if name not in KNOWN and flags & 2:
            raise Refused("unknown-part")
        parts[name] = content
        at += 21 + length
    if at != end:
        raise Refused("content")
    return degree, identity, splats, end, parts


def _needed(parts, name, size=None):
    if name not in parts:
        raise Refused("content")
    if size is not None and len(parts[name]) != size:
        raise Refused("content" if len(parts[name]) > size else "truncated")
    return parts[name]


def _options(parts):
    near, alpha_max, *background, focal = (F32(v) for v in struct.unpack("<6f", _needed(parts, "options", 25)[:24]))
    antialiased = parts["options"][24]
    sound = np.isfinite(near) and near > 0 and 0 < alpha_max < 1 and all(0 <= v <= 1 for v in background)
    if not sound or antialiased > 1 or not (focal == 0 or 1 <= focal <= 1e6):
        raise Refused("content")
    return near, alpha_max, bool(antialiased), background, focal if focal != 0 else None


def _besides(parts):
    """The coder tables, the number of key frames, the coordinate frame and the origin, if they are stated."""
    keys, frame, origin = 0, None, None
    if "keys" in parts:
        part = parts["keys"]
        keys = le(part[:4])
        if not 1 <= keys <= 65536:
            raise Refused("content")
        bounds = struct.unpack_from("<6f", part, 4)
        if not all(np.isfinite(bounds)) or any(a > b for a, b in zip(bounds[:3], bounds[3:])):
            raise Refused("content")
        _needed(parts, "keys", 28 + 10 * keys)
    if "frame" in parts:
        *centre, spread = (F32(v) for v in struct.unpack("<4f", _needed(parts, "frame", 16)))
        if not np.isfinite([*centre, spread]).all() or not spread > 0:
            raise Refused("content")
        frame = (np.array(centre, F32), spread)
    if "origin" in parts:
        origin = np.array(struct.unpack("<3d", _needed(parts, "origin", 24)))
        if not np.isfinite(origin).all() or not origin.any():
            raise Refused("content")
    return Tables(parts["tables"]) if "tables" in parts else None, keys, frame, origin


def _checked(prior, identity):
    if prior.id != identity:
        raise Refused("identity")
    return prior


def read_compact(data):
    """A compact prior, .nvsg."""
    degree, identity, count, end, parts = _container(data, b"nvsg")
    if end != len(data):
        raise Refused("content")
    options, besides = _options(parts), _besides(parts)
    arrays = _exact(parts["exact"], count, degree) if "exact" in parts else None
    arrays = arrays or _coded(_needed(parts, "splats"), count, degree)
    return _checked(Prior(arrays, options, *besides), identity)


def _exact(content, count, degree):
    """Splats as they are."""
    columns = 11 + 3 * (degree + 1) ** 2
    planes = _planes(content, count, 4 * columns).reshape(columns, 4, count)
    numbers = np.ascontiguousarray(planes.transpose(2, 0, 1)).view("<f4")[:, :, 0].astype(F32)
    sh = numbers[:, 11:].reshape(count, (degree + 1) ** 2, 3)
    return numbers[:, :3], numbers[:, 3:6], numbers[:, 6:10], numbers[:, 10], sh


def _coded(content, count, degree):
    """Splats in steps."""
    if len(content) < 40:
        raise Refused("truncated")
    origin = np.array(struct.unpack_from("<3f", content, 0), np.float64)
    exponent = struct.unpack_from("<i", content, 12)[0]
    steps = struct.unpack_from("<6f", content, 16)
    sound = bool(np.isfinite(origin).all()) and -149 <= exponent <= 127
    sound &= all(s >= 1e-6 and s <= (0.125 if i == 2 else 1) for i, s in enumerate(np.array(steps)))
    if not sound:
        raise Refused("content")
    ranks, numbers = _numbers(content[40:], count, 7 + 3 * (degree + 1) ** 2)
    code = np.array([[sum((rank >> 3 * place + 2 - axis & 1) << place for place in range(30)) - (1 << 29)
                      for axis in range(3)] for rank in ranks], np.int64)
    size = np.abs(code)
    octave = np.maximum((size >> 20) - 1, 0)
    offset = (size - (octave << 20)) * 2.0**octave.astype(np.float64) * 2.0**exponent
    with np.errstate(over="ignore"):
        positions = (origin + np.copysign(offset, code)).astype(F32)
    wide = lambda i, step: (numbers[i].astype(np.float64) * float(F32(step))).astype(F32)
    xyz = np.stack([numbers[3 + i].astype(np.float64) * float(F32(steps[2])) for i in range(3)], 1)
    w = np.sqrt(np.maximum(1 - xyz[:, 0] * xyz[:, 0] - xyz[:, 1] * xyz[:, 1] - xyz[:, 2] * xyz[:, 2], 0))
    sh = np.empty((count, (degree + 1) ** 2, 3), F32)
    for k in range((degree + 1) ** 2):
        green, red, blue = numbers[7 + 3 * k:10 + 3 * k]
        for c, value in enumerate((green + red, green, green + blue)):
            sh[:, k, c] = (value.astype(np.float64) * float(F32(steps[4 if k == 0 else 5]))).astype(F32)
    scales = np.stack([wide(i, steps[1]) for i in range(3)], 1)
    return positions, scales, np.column_stack([w, xyz]).astype(F32), wide(6, steps[3]), sh


def read_blocked(data):
    """A blocked prior, .nvsb."""
    degree, identity, splats, at, parts = _container(data, b"nvsb")
    options, (tables, keys, frame, origin) = _options(parts), _besides(parts)
    blocks = _needed(parts, "blocks")
    if len(blocks) < 5:
        raise Refused("truncated")
    radius, clamped = F32(struct.unpack_from("<f", blocks)[0]), blocks[4]
    entries = [struct.unpack_from("<III7f", blocks, i) for i in range(5, len(blocks) - 39, 40)]
    if not entries or (len(blocks) - 5) % 40 or not 0 <= radius < np.inf or clamped > 1:
        raise Refused("content")
    sides = [entry[3:] for entry in entries]
    if not np.isfinite(sides).all() or any(s[i] > s[3 + i] for s in sides for i in range(3)):
        raise Refused("content")
    if any(not 1 <= entry[2] <= min(entry[0], 16384) or entry[9] <= 0 for entry in entries):
        raise Refused("content")
    size = at + sum(entry[0] for entry in entries)
    if size > len(data):
        raise Refused("truncated")
    if size < len(data) or sum(entry[2] for entry in entries) != splats or not frame:
        raise Refused("content")
    pieces = []
    for length, check, count, *floats in entries:
        if crc32(data[at:at + length]) != check:
            raise Refused("damaged")
        piece = _coded(data[at:at + length], count, degree)
        _check_block(piece, np.array(floats, F32), options, clamped, (frame[0], radius))
        pieces.append(piece)
        at += length
    arrays = tuple(np.concatenate(columns) for columns in zip(*pieces))
    return _checked(Prior(arrays, options, tables, keys, frame, origin), identity)


def _check_block(piece, floats, options, clamped, place):
    """Refuses a block that is not what the head says."""
    positions, log_scales, _, logits, _ = piece
    (centre, radius), longest = place, float(floats[6])
    same = bool(((positions >= floats[:3]) & (positions <= floats[3:6])).all())
    same &= bool(np.exp(log_scales.astype(np.float64)).max() <= longest)
    away = np.sqrt(((positions.astype(np.float64) - centre.astype(np.float64)) ** 2).sum(1))
    same &= bool((away <= radius).all())
    opacity = (1 / (1 + np.exp(-logits.astype(np.float64)))).astype(F32)
    same &= bool(clamped) or bool((opacity <= F32(options[1] * (F32(1) - F32(1e-5)))).all())
    if not same:
        raise Refused("content")


def _planes(stream, count, planes):
    """Byte planes of so many splats, packed."""
    size = count * planes
    if count > len(stream):
        raise Refused("truncated")
    filters = [{"id": lzma.FILTER_LZMA1, "dict_size": min(max(size, 4096), 1 << 26), "lc": 0, "lp": 0, "pb": 0}]
    try:
        unpacked = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=filters).decompress(stream, size)
    except lzma.LZMAError:
        raise Refused("content") from None
    if len(unpacked) < size:
        raise Refused("content")
    return np.frombuffer(unpacked, np.uint8).reshape(planes, count)


def _numbers(stream, count, columns):
    """Ranks on the Morton curve, and columns of numbers."""
    planes = _planes(stream, count, 12 + 4 * columns)
    rank, ranks = 0, []
    for splat in range(count):
        rank += le(planes[:12, splat].tobytes())
        ranks.append(rank)
    numbers = []
    for column in planes[12:].reshape(columns, 4, count):
        value = sum(column[i].astype(np.int64) << 8 * i for i in range(4))
        numbers.append(np.array(fold(value), np.int64).astype(np.int32))
    return ranks, numbers


def read_prior(data):
    if data[:3] == b"ply":
        return read_ply(data)
    if data[:4] == b"nvsb":
        return read_blocked(data)
    return read_compact(data)


def open_prior(path):
    return read_prior(Path(path).read_bytes())

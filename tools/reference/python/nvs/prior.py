"""Priors: docs/format/prior.md."""

import lzma
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

    def __init__(self, arrays, options, tables=None, key_frames=0, frame=None):
        """`frame`: the stated centre and spread, of a blocked prior."""
        self.positions, self.log_scales, self.rotations, self.logits, self.sh = arrays
        self.near, self.alpha_max, self.antialiased, self.background, self.trained_focal = options
        self.tables, self.key_frames, self.frame = tables, key_frames, frame
        self._drop()
        self.id = self._identity()
        self._frame()

    def _drop(self):
        infinite = np.isinf(self.logits)
        self.logits = np.where(infinite, np.copysign(F32(20), self.logits), self.logits).astype(F32)
        length = np.sqrt((self.rotations.astype(np.float64) ** 2).sum(1))
        flat = [a.reshape(len(a), -1) for a in (self.positions, self.log_scales, self.rotations, self.logits, self.sh)]
        good = np.all([np.isfinite(a).all(1) for a in flat], 0) & (length >= 1e-6)
        good &= (np.abs(self.log_scales) <= 40).all(1) & (np.abs(flat[4]) <= 1e6).all(1)
        for name in ("positions", "log_scales", "rotations", "logits", "sh"):
            setattr(self, name, getattr(self, name)[good])

    def _identity(self):
        parts = [b"nvsprior prior 1", struct.pack("<ffB3f", self.near, self.alpha_max, self.antialiased,
                                                  *self.background)]
        parts.append(struct.pack("<IQ", round(self.sh.shape[1] ** 0.5) - 1, len(self.logits)))
        for array in (self.positions, self.log_scales, self.rotations, self.logits, self.sh):
            parts.append(array.astype("<f4").tobytes())
        if self.tables:
            parts.append(self.tables.data)
        if self.trained_focal is not None:
            parts.append(b"focal" + struct.pack("<f", self.trained_focal))
        if self.frame:
            parts.append(b"frame" + struct.pack("<4f", *self.frame[0], self.frame[1]))
        return blake3(b"".join(parts))[:4]

    def _frame(self):
        if self.frame:
            self.centre, spread = self.frame
            self.step = _step(spread, self.centre.astype(np.float64))
            return
        positions = self.positions.astype(np.float64)
        middle = (len(positions) - 1) // 2
        centre = np.sort(positions, 0)[middle]
        off = np.abs(positions - centre)
        most = float(np.finfo(F32).max)
        spreads = [F32(min(v, most)) for v in (np.sort(off, 0)[middle].max(), off.max(), 1.0)]
        spread = next(s for s in spreads if s > 0)
        self.centre = centre.astype(F32)
        self.step = _step(spread, centre)

    @property
    def name(self):
        return f"{le(self.id):08x}"


def _step(spread, centre):
    return max(float(spread), float(np.abs(centre).max()) * 2.0**-23) / 131072


def options_of(comments):
    """Render options of a PLY file's comments."""
    near, alpha_max, antialiased, background = F32(0.2), F32(0.99), False, [F32(0)] * 3
    if any("nerfstudio" in comment.lower() for comment in comments):
        near = F32(0.01)
    key_frames, focal = 0, None
    for comment in comments:
        match comment.split():
            case ["nvsprior", "near", v]:
                near = F32(v)
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
            case ["nvsprior", "white_balance" | "clahe", *_]:
                pass
            case ["nvsprior", *_]:
                raise Refused("content")
    if focal is not None and not 1 <= focal <= 1e6:
        raise Refused("content")
    return (near, alpha_max, antialiased, background, focal), key_frames


KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
         "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
         "float32": "f4", "float64": "f8"}


def read_ply(data):
    end = data.index(b"end_header\n") + 11
    lines = data[:end].decode().splitlines()
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
    sh[:, 0] = column("f_dc_0", "f_dc_1", "f_dc_2")
    for k in range(rest // 3):
        sh[:, k + 1] = column(*(f"f_rest_{c * (rest // 3) + k}" for c in range(3)))
    arrays = (column("x", "y", "z"), column("scale_0", "scale_1", "scale_2"),
              column("rot_0", "rot_1", "rot_2", "rot_3"), rows["opacity"].astype(F32), sh)
    options, key_frames = options_of(comments)
    return Prior(arrays, options, None, key_frames)


def read_compact(data):
    """A compact prior, .nvsg."""
    if data[:4] != b"nvsg":
        raise Refused("magic")
    if len(data) < 80:
        raise Refused("truncated")
    if crc32(data[:-4]) != le(data[-4:]):
        raise Refused("damaged")
    body = data[:-4]
    if body[4] != 1:
        raise Refused("version")
    degree, drawn, parts, count = body[5], body[6], body[7], le(body[8:12])
    if degree > 3 or drawn > 3 or parts > 7 or count == 0:
        raise Refused("content")
    origin = np.array(struct.unpack_from("<3f", body, 36), np.float64)
    exponent = struct.unpack_from("<i", body, 48)[0]
    steps = struct.unpack_from("<6f", body, 52)
    sound = bool(np.isfinite(origin).all()) and -149 <= exponent <= 127
    sound &= all(s >= 1e-6 and s <= (0.125 if i == 2 else 1) for i, s in enumerate(np.array(steps)))
    if not sound:
        raise Refused("content")
    at, focal = _focal(body, 76, drawn)
    options = _options(body, 16, drawn, focal)
    at, key_frames, tables = _besides(body, at, parts)
    if count > len(body) - at:
        raise Refused("truncated")
    columns = 7 + 3 * (degree + 1) ** 2
    ranks, numbers = _planes(body[at:], count, columns)
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
    arrays = (positions, np.stack([wide(i, steps[1]) for i in range(3)], 1), np.column_stack([w, xyz]).astype(F32),
              wide(6, steps[3]), sh)
    prior = Prior(arrays, options, tables, key_frames)
    if prior.id != body[12:16]:
        raise Refused("identity")
    return prior


def _focal(body, at, drawn):
    """The trained focal length, and where what follows begins."""
    if not drawn & 2:
        return at, None
    if len(body) < at + 4:
        raise Refused("truncated")
    return at + 4, F32(struct.unpack_from("<f", body, at)[0])


def _options(body, at, drawn, focal):
    near, alpha_max, *background = (F32(v) for v in struct.unpack_from("<5f", body, at))
    sound = np.isfinite(near) and near > 0 and 0 < alpha_max < 1 and all(0 <= v <= 1 for v in background)
    if not sound or (focal is not None and not 1 <= focal <= 1e6):
        raise Refused("content")
    return near, alpha_max, bool(drawn & 1), background, focal


def _besides(body, at, parts):
    """Preprocessing, key frames and coder tables. Returns where what follows begins."""
    key_frames, tables = 0, None
    if parts & 4:
        at += 6
    if parts & 1:
        key_frames = le(body[at:at + 4])
        size = 28 + 10 * key_frames
        if not 1 <= key_frames <= 65536:
            raise Refused("content")
        if at + size > len(body):
            raise Refused("truncated")
        bounds = struct.unpack_from("<6f", body, at + 4)
        if not all(np.isfinite(bounds)) or any(a > b for a, b in zip(bounds[:3], bounds[3:])):
            raise Refused("content")
        at += size
    if parts & 2:
        size = le(body[at:at + 4])
        tables = Tables(body[at + 4:at + 4 + size])
        at += 4 + size
    return at, key_frames, tables


def read_blocked(data):
    """A blocked prior, .nvsb."""
    if len(data) < 12:
        raise Refused("truncated")
    if data[4] != 1:
        raise Refused("version")
    size = le(data[8:12])
    if size < 68 + 36 + 4:
        raise Refused("content")
    if size > len(data):
        raise Refused("truncated")
    head, check = data[:size - 4], data[size - 4:size]
    if crc32(head) != le(check):
        raise Refused("damaged")
    degree, drawn, parts = head[5:8]
    splats, blocks = struct.unpack_from("<QI", head, 16)
    if degree > 3 or drawn > 3 or parts > 15 or not 1 <= blocks <= (len(head) - 68) // 36:
        raise Refused("content")
    *centre, spread, radius = (F32(v) for v in struct.unpack_from("<5f", head, 48))
    if not np.isfinite([*centre, spread, radius]).all() or not spread > 0 or radius < 0:
        raise Refused("content")
    entries = [struct.unpack_from("<II7f", head, 68 + 36 * i) for i in range(blocks)]
    at, focal = _focal(head, 68 + 36 * blocks, drawn)
    options = _options(head, 28, drawn, focal)
    at, key_frames, tables = _besides(head, at, parts & 7)
    if at != len(head) or sum(entry[1] for entry in entries) != splats:
        raise Refused("content")
    pieces, at = [], size
    for entry in entries:
        if at + entry[0] > len(data):
            raise Refused("truncated")
        block = read_compact(data[at:at + entry[0]])
        at += entry[0]
        _check_block(block, entry, (degree, options, parts & 8), (centre, radius))
        pieces.append((block.positions, block.log_scales, block.rotations, block.logits, block.sh))
    arrays = tuple(np.concatenate(columns) for columns in zip(*pieces))
    prior = Prior(arrays, options, tables, key_frames, (np.array(centre, F32), spread))
    if prior.id != head[12:16]:
        raise Refused("identity")
    return prior


def _check_block(block, entry, head, place):
    """Refuses a block that is not what the head says."""
    _, count, *floats = entry
    least, greatest, longest = np.array(floats[:3], F32), np.array(floats[3:6], F32), floats[6]
    degree, options, clamped = head
    centre, radius = place
    own = (block.near, block.alpha_max, block.antialiased, block.background, block.trained_focal)
    same = 1 <= count <= 16384 and len(block.logits) == count and own == options
    same &= block.sh.shape[1] == (degree + 1) ** 2
    same &= bool(((block.positions >= least) & (block.positions <= greatest)).all())
    same &= bool(np.exp(block.log_scales.astype(np.float64)).max() <= longest)
    away = np.sqrt(((block.positions.astype(np.float64) - np.array(centre, np.float64)) ** 2).sum(1))
    same &= bool((away <= radius).all())
    opacity = (1 / (1 + np.exp(-block.logits.astype(np.float64)))).astype(F32)
    same &= bool(clamped) or bool((opacity <= F32(options[1] * (F32(1) - F32(1e-5)))).all())
    if not same:
        raise Refused("content")


def _planes(stream, count, columns):
    """The coded part: ranks on the Morton curve, and columns of numbers."""
    size = count * (12 + 4 * columns)
    filters = [{"id": lzma.FILTER_LZMA1, "dict_size": min(max(size, 4096), 1 << 26), "lc": 0, "lp": 0, "pb": 0}]
    try:
        planes = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=filters).decompress(stream, size)
    except lzma.LZMAError:
        raise Refused("content") from None
    if len(planes) < size:
        raise Refused("content")
    planes = np.frombuffer(planes, np.uint8).reshape(-1, count)
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
    prior = read_prior(Path(path).read_bytes())
    beside = Path(f"{path}.tables")
    if beside.exists():
        prior.tables = Tables(beside.read_bytes())
        prior.id = prior._identity()
    return prior

"""The wavelet coder: docs/format/residual.md."""

import numpy as np

from .adaptive_numbers import Signed
from .bits import RangeDecoder, Unknown, exp
from .stream import FACTORS, sample

I32 = np.int32
ROTATION = np.array([[9242, 10501, 8529], [12798, -3439, -9634], [4384, -12097, 10143]], np.int64)
STEPS = [(1, -6497), (0, -217), (1, 3616), (0, 1817)]
LOW = [1.0, 1.4023539774466387, 2.031210719969995, 2.9031283200460702, 4.119200831698161, 5.831665695446394,
       8.251169343340031]
HIGH = [1.0, 0.8871680082860638, 1.209840245245823, 1.7742467732906078, 2.5522923585085646, 3.62842205147875,
        5.139482376291558]
EIGHTHS = [65536, 71468, 77936, 84990, 92682, 101070, 110218, 120194]
F = np.array([0, 1, 3, 4, 6, 7, 8, 10, 11, 12, 13, 15, 16, 17, 18, 19, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32,
              34, 35, 35, 36, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47, 47, 48, 49, 50, 51, 52, 52, 53, 54, 55, 56,
              56, 57, 58, 59, 60, 60, 61, 62, 63, 63])
CHANCES = [int(min(max(65536 / (1 + exp(-logit / 256)), 2), 65534)) for logit in range(-3072, 3073)]
BESIDE = [(-2, -1), (2, -1), (-2, -2), (-1, -2), (1, -2), (2, -2), (-3, 0), (0, -3)]
NEXT = [(-1, 0), (0, -1), (-1, -1), (1, -1), (-2, 0), (0, -2)]
GAINS = {1: ((32768, 2), (40000, 2)), 2: ((32768, 2), (40000, 2)), 3: ((16384, 2), (16384, 1)),
         4: ((8192, 1), (8192, 0)), 5: ((2048, 0), (8192, 0)), 6: ((2048, 0), (8192, 0))}


def to_planes(values):
    """Planes of (h, w, 3) whole numbers."""
    sums = np.einsum("pc,hwc->phw", ROTATION, values.astype(np.int64))
    return (sums + 128 >> 8).astype(I32)


def to_colours(planes):
    sums = np.einsum("pc,phw->hwc", ROTATION, planes.astype(np.int64))
    return np.clip(sums + (1 << 19) >> 20, -1024, 1024)


def scaled(v, factor):
    return v * I32(factor) + I32(2048) >> I32(12)


def lift(lines, factors, sign):
    """Lifting steps along the last axis of two or more values, in place."""
    n = lines.shape[-1]
    at = np.arange(n)
    before, after = np.where(at == 0, 1, at - 1), np.where(at == n - 1, n - 2, at + 1)
    for parity, factor in factors:
        i = at[parity::2]
        lines[..., i] += scaled(lines[..., before[i]] + lines[..., after[i]], sign * factor)


def forward(plane, width, height):
    part = plane[:height, :width]
    for lines in (part, part.T):
        if lines.shape[-1] > 1:
            work = lines.copy()
            lift(work, STEPS, 1)
            half = (lines.shape[-1] + 1) // 2
            lines[..., :half], lines[..., half:] = scaled(work[..., ::2], 3330), work[..., 1::2]


def inverse(plane, width, height):
    part = plane[:height, :width]
    for lines in (part.T, part):
        if lines.shape[-1] > 1:
            work, half = lines.copy(), (lines.shape[-1] + 1) // 2
            work[..., ::2], work[..., 1::2] = scaled(lines[..., :half], 5039), lines[..., half:]
            lift(work, STEPS[::-1], -1)
            lines[...] = work


def ilog(v):
    e = np.floor(np.log2(v)).astype(np.int64)
    e = e - (np.int64(1) << e > v) + (np.int64(2) << e <= v) - 6
    return 64 * e + F[(v >> e) & 63]


def count(n):
    n = np.minimum(np.abs(n), 1 << 20)
    return np.where(n == 0, 0, ilog(np.maximum(1 + n, 1) << 6))


def size(v):
    return ilog(64 + 4 * np.minimum(np.abs(v), 1 << 26))


def bound(v):
    return np.clip(v, -1000, 1000)


def lim(v, n):
    return np.clip(v, -64 * n, 64 * n)


def tenth(v):
    return np.sign(v) * (np.abs(v) // 10)


def in_steps(v, factor):
    return np.clip(v.astype(np.int64) * factor >> 16, -(1 << 26), 1 << 26)


COUNTS = [int(count(np.array([n]))[0]) for n in range(9000)]


class Geometry:
    def __init__(self, width, height):
        self.sizes = [(width, height)]
        while len(self.sizes) <= 6 and max(self.sizes[-1]) > 5:
            w, h = self.sizes[-1]
            self.sizes.append(((w + 1) // 2, (h + 1) // 2))
        self.levels = len(self.sizes) - 1
        self.columns, self.rows = self.sizes[-1]

    def band(self, level, orientation):
        w, h = self.sizes[level]
        x, y = (w if orientation & 1 else 0), (h if orientation & 2 else 0)
        above = self.sizes[max(level - 1, 0)]
        return Band(level, orientation, x, y, above[0] - w if orientation & 1 else w,
                    above[1] - h if orientation & 2 else h)

    def bands(self):
        yield self.band(self.levels, 0)
        for level in range(self.levels, 0, -1):
            for orientation in (1, 2, 3):
                yield self.band(level, orientation)


class Band:
    def __init__(self, level, orientation, x, y, width, height):
        self.level, self.orientation, self.width, self.height = level, orientation, width, height
        self.place = (slice(y, y + height), slice(x, x + width))
        self.rank = level if orientation else 0
        self.norm = (HIGH if orientation & 1 else LOW)[level] * (HIGH if orientation & 2 else LOW)[level]

    def block(self, shift, columns, rows):
        """Of each coefficient the row and the column of its block."""
        y = np.minimum(np.arange(self.height) >> shift, rows - 1)
        x = np.minimum(np.arange(self.width) >> shift, columns - 1)
        return np.ix_(y, x)


def transformed(planes, geometry):
    """Transforms planes in place; returns the low bands by level."""
    low = [[None] for _ in planes]
    for p, plane in enumerate(planes):
        for level in range(geometry.levels):
            forward(plane, *geometry.sizes[level])
            w, h = geometry.sizes[level + 1]
            low[p].append(plane[:h, :w].copy())
    return low


def mean_around(plane):
    wide = np.pad(np.abs(plane), 1)
    h, w = plane.shape
    return sum(wide[y:y + h, x:x + w] for y in range(3) for x in range(3)) // I32(9)


def read_blocks(decoder, geometry):
    ones, every, blocks = 1, 2, []
    for _ in range(geometry.columns * geometry.rows):
        blocks.append(decoder.bit(65536 * ones // every))
        ones, every = ones + blocks[-1], every + 1
    return np.array(blocks, bool).reshape(geometry.rows, geometry.columns)


class BlockChances:
    """The chance that a block is of a kind, by those left and above."""

    def __init__(self):
        self.chances = [[1, 8], [2, 4], [7, 8]]

    def bit(self, decoder, kinds, x, y):
        left, above = kinds[y, x - 1] if x else None, kinds[y - 1, x] if y else None
        beside = [int(v) for v in (left, above) if v is not None]
        return adaptive_bit(decoder, self.chances[sum(beside) * (2 // len(beside))] if beside else self.chances[0])


def adaptive_bit(decoder, chance):
    """`chance`: ones, and all, so far."""
    bit = decoder.bit(min(max(65536 * chance[0] // chance[1], 512), 65024))
    chance[0], chance[1] = chance[0] + bit, chance[1] + 1
    return bit


class DisplacedBlocks:
    """docs/format/residual.md, "Displaced blocks"."""

    def __init__(self, width, height, decoder):
        self.width, self.height = width, height
        self.size = columns, rows = max(width // 16, 1), max(height // 16, 1)
        self.is_displaced, self.is_none = np.zeros((rows, columns), bool), np.zeros((rows, columns), bool)
        self.by, self.of_difference, last, difference = {}, {}, (0, 0), [1, 2]
        displaced, none, apart = BlockChances(), BlockChances(), [Signed(4), Signed(4)]
        for y in range(rows):
            for x in range(columns):
                if displaced.bit(decoder, self.is_displaced, x, y):
                    guess = self._guess(x, y, last)
                    last = tuple(min(max(g + a.read(decoder), -1023), 1023) for g, a in zip(guess, apart))
                    self.is_displaced[y, x], self.by[x, y] = True, last
                    self.of_difference[x, y] = adaptive_bit(decoder, difference)
                else:
                    self.is_none[y, x] = none.bit(decoder, self.is_none, x, y)

    def _guess(self, x, y, last):
        near = [self.by[at] for at in ((x - 1, y), (x, y - 1), (x + 1, y - 1)) if at in self.by]
        if len(near) == 3:
            return [sorted(v)[1] for v in zip(*near)]
        return near[0] if near else last

    def compose(self, warped, kept, render):
        """What the frame is predicted from."""
        total = np.zeros(warped.shape, np.int64)
        here = render.astype(np.int64) - 128 << 6
        for y in range(self.size[1]):
            for x in range(self.size[0]):
                if self.is_none[y, x]:
                    continue
                columns, across = self._weights(x, self.size[0], self.width)
                rows, down = self._weights(y, self.size[1], self.height)
                place = np.ix_(rows, columns)
                if (x, y) in self.by:
                    right, below = self.by[x, y]
                    c, r = np.meshgrid(columns + (right >> 2), rows + (below >> 2))
                    picture = kept["difference" if self.of_difference[x, y] else "shown"]
                    value = sample(picture, c, 16 * (right & 3), r, 16 * (below & 3))
                    if not self.of_difference[x, y]:
                        value = value - here[place]
                    value = np.einsum("pc,hwc->phw", ROTATION, value) + 8192 >> 14
                else:
                    value = warped[:, rows[:, None], columns]
                total[:, rows[:, None], columns] += down[:, None] * across * value
        return (total + 128 >> 8).astype(I32)

    @staticmethod
    def _weights(at, count, side):
        """Places along an axis where a block counts, and its weights."""
        start, end = 16 * at, side if at + 1 == count else 16 * at + 16
        places = np.arange(max(start - 4, 0), end if end == side else end + 4)
        table = np.array([1, 3, 5, 7, 9, 11, 13, 15, 16])
        left = table[np.clip(places - start + 4, 0, 8)] if start else 16
        right = table[np.clip(end - 1 - places + 4, 0, 8)] if end < side else 16
        return places, np.broadcast_to(np.minimum(left, right), places.shape)


class Frame:
    """A payload on its way to a difference."""

    def __init__(self, render, tables, earlier):
        """`tables`: for intra frames, for those with small or displaced blocks, for inter frames."""
        self.render = render
        self.geometry = Geometry(render.shape[1], render.shape[0])
        self.is_inter, self.displaced = earlier is not None, None
        self.all_tables, self.earlier = tables, earlier

    def decode(self, payload, cut, small_blocks, portable):
        """The difference of a payload, (h, w, 3); None: it adds nothing. A text: what is wrong with it."""
        self.decoder = decoder = RangeDecoder(payload, cut)
        try:
            if not self._header(small_blocks):
                return None if cut else "payload"
            if (not self.blind or self.is_inter) and not portable:
                return "other-render"
            if self.was_cut:
                decoder.cut()
            self.prediction = self._inter() if self.is_inter else None
        except Unknown:
            return None
        self.sees_prediction = self.is_inter and self.displaced is None
        self.tables = self.all_tables[2 if self.sees_prediction else int(small_blocks)]
        self._prepare()
        self._run()
        planes = self.decoded
        if not self.all_predicted:
            left = (self.bands_of_render * (16 - self.weights) >> 4).astype(I32)
            for p, plane in enumerate(left):
                for level in range(self.geometry.levels, 0, -1):
                    inverse(plane, *self.geometry.sizes[level - 1])
                planes[p] -= plane
        if self.prediction is not None:
            planes = planes + self.picture
        return to_colours(planes)

    def _header(self, small_blocks):
        """False: it has displaced blocks, and no reference."""
        decoder, geometry = self.decoder, self.geometry
        self.was_cut, self.blind, low_plain = decoder.bit(16384), decoder.bit(2048), decoder.bit(2048)
        self.step = decoder.plain(6)
        self.finest = [decoder.plain(3) for _ in range(3)]
        h, w = self.render.shape[:2]
        self.weights = np.full((h, w), 16, np.int64)
        if small_blocks and decoder.bit(1024):
            if not self.is_inter:
                return False
            self.displaced = DisplacedBlocks(w, h, decoder)
            small_blocks = decoder.plain(1)
        self.all_predicted = not low_plain and not small_blocks
        if small_blocks:
            self._small_blocks()
        self.weights[geometry.band(geometry.levels, 0).place] = 0 if low_plain else 16
        known = (self.weights == 16) | (not small_blocks)
        if self.displaced:
            for band in geometry.bands():
                if band.level <= 4:
                    is_displaced = self.displaced.is_displaced[band.block(4 - band.level, *self.displaced.size)]
                    known[band.place] &= ~is_displaced
        self.known = known & (not self.blind)
        return True

    def _small_blocks(self):
        decoder, geometry = self.decoder, self.geometry
        level = min(3 + decoder.plain(1), geometry.levels)
        columns, rows = geometry.sizes[level]
        chances, plain = BlockChances(), np.zeros((rows, columns), int)
        for y in range(rows):
            for x in range(columns):
                plain[y, x] = chances.bit(decoder, plain, x, y)
        d = 1 - plain
        wide = np.pad(d, 1, mode="edge")
        around = wide[1:-1, :-2] + wide[1:-1, 2:] + wide[:-2, 1:-1] + wide[2:, 1:-1]
        fine = (28 * d + around) // 2
        for band in geometry.bands():
            if band.rank == 0:
                continue
            if band.level <= level:
                self.weights[band.place] = fine[band.block(level - band.level, columns, rows)]
                continue
            k, part = band.level - level, self.weights[band.place]
            span = lambda at, of: slice(min(at << k, of - 1), min((at + 1) << k, of))
            for y in range(band.height):
                for x in range(band.width):
                    some = d[span(y, rows), span(x, columns)]
                    part[y, x] = (16 * some.sum() + some.size // 2) // some.size

    def _inter(self):
        """docs/format/residual.md, "Prediction"."""
        decoder, geometry = self.decoder, self.geometry
        age, low_plain = decoder.plain(3), decoder.bit(4096)
        blocks = np.ones((geometry.rows, geometry.columns), bool)
        if decoder.bit(8192):
            blocks = read_blocks(decoder, geometry)
        planes = self.earlier[0].copy()
        if self.displaced:
            planes = self.displaced.compose(*self.earlier, self.render)
        transformed(planes, geometry)
        for p in range(3):
            for band in geometry.bands():
                part = planes[p][band.place]
                part[...] = part * I32(FACTORS[age][p][band.rank]) + I32(128) >> I32(8)
                if band.rank == 0:
                    part *= 1 - low_plain
                else:
                    part *= blocks[band.block(geometry.levels - band.level, *geometry.sizes[-1])]
        self.picture = planes.copy()
        for plane in self.picture:
            for level in range(geometry.levels, 0, -1):
                inverse(plane, *geometry.sizes[level - 1])
        self.prediction_energy = np.stack([mean_around(plane) for plane in planes])
        return planes

    def _prepare(self):
        self.bands_of_render = to_planes(self.render.astype(np.int64) - 128)
        self.low = transformed(self.bands_of_render, self.geometry)
        self.energy = np.stack([mean_around(plane) for plane in self.bands_of_render])
        self.value = (EIGHTHS[self.step % 8] << self.step // 8) / 32768
        h, w = self.render.shape[:2]
        self.decoded = np.zeros((3, h, w), I32)
        self.coefficients = {}

    def per_unit(self, norm):
        return int(norm / self.value * 65536 + 0.5)

    def _run(self):
        geometry = self.geometry
        self.ended, gains = False, (0, 0)
        low = geometry.band(geometry.levels, 0)
        self._code(low)
        self._dequantise(low, (0, 0))
        for level in range(geometry.levels, 0, -1):
            if level < geometry.levels:
                self._join(level + 1, gains)
            self._look(level)
            for orientation in (1, 2, 3):
                self._code(geometry.band(level, orientation))
            gains = self._gains(level)
        if geometry.levels:
            self._join(1, gains)

    def _look(self, level):
        w, h = self.geometry.sizes[level]
        render, decoded = self.low[0][level].astype(np.int64), self.decoded[0, :h, :w].astype(np.int64)
        light, by = decoded << 8, np.maximum(render + 14912, 768)
        self.light = np.clip(np.sign(light) * (np.abs(light) // by), -1024, 1024)
        factor = self.per_unit(float(1 << level))
        self.coarser = [np.pad(in_steps(plane[:h, :w], factor), 1, mode="edge") for plane in self.decoded]

    def _join(self, level, gains):
        for orientation in (1, 2, 3):
            self._dequantise(self.geometry.band(level, orientation), gains)
        for plane in self.decoded:
            inverse(plane, *self.geometry.sizes[level - 1])

    def _values(self, plane, band):
        key = plane, band.level, band.orientation
        if key not in self.coefficients:
            self.coefficients[key] = np.zeros((band.height, band.width), np.int64)
        return self.coefficients[key]

    def _guesses(self, plane, band):
        """Of a band of details: own and guess, of the render and of its energy; in steps."""
        factor = self.per_unit(band.norm)
        light = self.light[:band.height, :band.width]
        own = in_steps(self.bands_of_render[plane][band.place], factor)
        energy = in_steps(self.energy[plane][band.place], factor)
        return own, own * light >> 8, energy, energy * light >> 8

    def _dequantise(self, band, gains):
        units = int(self.value / band.norm * (1 << 22) + 0.5)
        for plane in range(3):
            values = self._values(plane, band)
            magnitude = np.abs(values)
            offset = self.tables.offsets[plane, band.rank][np.clip(magnitude, 1, 3) - 1]
            lifted = ((magnitude << 8) - offset) * units >> 24
            lifted = np.where(values == 0, 0, np.sign(values) * lifted)
            if plane == 0 and gains != (0, 0):
                own, guess, _, _ = self._guesses(0, band)
                r = lambda v: np.clip(v, -16384, 16384)
                total = 8 * gains[0] * r(guess) + gains[1] * r(own)
                t = np.clip(np.sign(total) * (np.abs(total) // 64), -32, 32)
                lifted = np.where((values == 0) & self.known[band.place], t * units >> 22, lifted)
            self.decoded[plane][band.place] = lifted.astype(I32)

    def _gains(self, level):
        if self.ended or self.blind:
            return 0, 0
        try:
            return tuple(self._gain(*how) for how in GAINS[level])
        except Unknown:
            self.ended = True
            return 0, 0

    def _gain(self, chance, places):
        decoder = self.decoder
        if not decoder.bit(chance):
            return 0
        negative, more = decoder.bit(16384), 0
        while more < 12 >> places and decoder.bit(32768):
            more += 1
        gain = min((more << places | decoder.plain(places)) + 1, 12)
        return -gain if negative else gain

    def _code(self, band):
        for plane in range(3):
            if band.level >= self.finest[plane] and not self.ended:
                try:
                    Coding(self, band, plane).run()
                except Unknown:
                    self.ended = True


class Coding:
    """The coefficients of a band of a plane."""

    def __init__(self, frame, band, plane):
        self.frame, self.band, self.plane, self.t = frame, band, plane, frame.tables
        self.values = frame._values(plane, band)
        h, w = band.height, band.width
        # Two margins: contexts look three places far.
        self.wide = [[0] * (w + 6) for _ in range(h + 6)]
        self.loud = [bytearray(w + 6) for _ in range(h + 6)]
        self.beside = np.zeros((h, w, 11), np.int64)
        self.signs = np.zeros((h, w, 17), np.int64)
        self.pictures = np.zeros((h, w, 15), np.int64)
        if h and w:
            self._relatives()
            self._pictures()
        t, classes = self.t, [band.rank, 7 + band.orientation, 11 + plane]
        self.bias = [bias + t_class[classes].sum(0) << 6 for bias, t_class in (
            (t.magnitude_bias_1, t.magnitude_class), (t.quiet_bias_1, t.quiet_class), (t.sign_bias_1, t.sign_class))]
        quiet = np.clip(self.bias[1] + self.pictures @ t.quiet_1 >> 11, 0, 1900) @ t.quiet_2 + (t.quiet_bias_2 << 6)
        self.quiet = np.clip(quiet >> 9, -3072, 3072).tolist()
        self.is_loud_beside = self.beside.any(2).tolist()

    def _crop(self, array, by):
        """Values of another band at (x / by, y / by); beyond it 0."""
        h, w = self.band.height, self.band.width
        y, x = np.arange(h) // by, np.arange(w) // by
        wide = np.pad(array, ((0, max(0, y[-1] + 1 - array.shape[0])), (0, max(0, x[-1] + 1 - array.shape[1]))))
        return wide[np.ix_(y, x)]

    def _relatives(self):
        frame, band, plane = self.frame, self.band, self.plane
        level, orientation, levels = band.level, band.orientation, frame.geometry.levels
        signed = lambda v: lim(v << 6, 2)
        of = lambda p, l, o: frame._values(p, frame.geometry.band(l, o))

        def around(values):
            wide = np.pad(np.abs(values), 2)
            h, w = values.shape
            total = sum(wide[y:y + h + 2, x:x + w + 2] for y in range(3) for x in range(3)) - wide[1:-1, 1:-1]
            return total[1:, 1:]

        def tell(at, values, by):
            own = self._crop(values, by)
            # One place beyond the band may still have neighbours in it.
            self.beside[:, :, at] = count(own)
            self.beside[:, :, at + 1] = bound(count(self._crop(around(values), by)))
            return own

        if orientation and level + 1 <= levels:
            self.signs[:, :, 4] = signed(tell(0, of(plane, level + 1, orientation), 2))
        if orientation and level + 2 <= levels:
            self.beside[:, :, 2] = count(self._crop(of(plane, level + 2, orientation), 4))
        for i in (1, 2):
            if orientation > i:
                self.signs[:, :, 4 + i] = signed(tell(1 + 2 * i, of(plane, level, i), 1))
        for i in (0, 1):
            if plane > i:
                self.signs[:, :, 7 + i] = signed(tell(7 + 2 * i, of(i, level, orientation), 1))

    def _pictures(self):
        frame, band, plane, out, signs = self.frame, self.band, self.plane, self.pictures, self.signs
        h, w = band.height, band.width
        if frame.sees_prediction:
            factor = frame.per_unit(band.norm)
            ahead = in_steps(frame.prediction[plane][band.place], factor)
            out[:, :, 0] = bound(size(ahead))
            out[:, :, 1] = bound(size(in_steps(frame.prediction_energy[plane][band.place], factor)))
            signs[:, :, 8] = lim(ahead, 3)
        else:
            out[:, :, 0] = ((2 * np.arange(h) + 1) * 32 // h - 32)[:, None]
            out[:, :, 1] = ((2 * np.arange(w) + 1) * 32 // w - 32)[None]
        out[:, :, 2] = 8 * (frame.step - 40)
        if band.level == 0:
            return
        known = frame.known[band.place]
        out[:, :, 3] = 64 * known
        out[:, :, 4] = known * bound(frame.low[0][band.level][:h, :w].astype(np.int64) >> 7)
        if band.rank == 0:
            return
        own, guess, energy, energy_guess = frame._guesses(plane, band)
        for at, value in enumerate((guess, energy_guess, tenth(own), tenth(energy))):
            out[:, :, 5 + at] = known * bound(size(value))
        signs[:, :, 9], signs[:, :, 10] = known * lim(guess, 2), known * lim(tenth(own), 2)
        a = frame.coarser[plane]
        at = lambda dy, dx: a[dy:dy + h, dx:dx + w]
        nw, n, ne, west, c, east = at(0, 0), at(0, 1), at(0, 2), at(1, 0), at(1, 1), at(1, 2)
        sw, south, se = at(2, 0), at(2, 1), at(2, 2)
        shapes = (west + east - 2 * c, n + south - 2 * c, east - west, south - n, c >> band.level, se + nw - ne - sw)
        for i, shape in enumerate(shapes):
            out[:, :, 9 + i], signs[:, :, 11 + i] = bound(size(shape)), lim(shape, 3)

    def run(self):
        bit, wide, loud = self.frame.decoder.bit, self.wide, self.loud
        for y in range(self.band.height):
            for x in range(self.band.width):
                logits = None
                if loud[y + 3][x + 3] or self.is_loud_beside[y][x]:
                    logits = self._logits(x, y)
                if not bit(CHANCES[(logits[0] if logits else self.quiet[y][x]) + 3072]):
                    continue
                value = self._value(x, y, logits)
                self.values[y, x] = wide[y + 3][x + 3] = value
                for dx, dy in NEXT + BESIDE:
                    loud[y + 3 - dy][x + 3 - dx] = 1

    def _value(self, x, y, logits):
        decoder = self.frame.decoder
        logits = logits or self._logits(x, y)
        magnitude = 1
        while magnitude < 24 and decoder.bit(CHANCES[logits[min(magnitude, 3)] + 3072]):
            magnitude += 1
        if magnitude == 24:
            digits = 0
            while digits < 14 and decoder.bit(32768):
                digits += 1
            magnitude = 23 + (1 << digits | decoder.plain(digits))
        negative = decoder.bit(CHANCES[self._sign(x, y) + 3072])
        magnitude = min(magnitude, 8191)
        return -magnitude if negative else magnitude

    def _near(self, x, y, places):
        return [self.wide[y + 3 + dy][x + 3 + dx] for dx, dy in places]

    def _logits(self, x, y):
        t = self.t
        near = [COUNTS[abs(v)] for v in self._near(x, y, NEXT)]
        beyond = sum(map(abs, self._near(x, y, BESIDE)))
        near.append(min(int(count(np.array([beyond]))[0]), 1000))
        inputs = np.concatenate([near, self.beside[y, x], self.pictures[y, x]])
        first = np.clip(self.bias[0] + inputs @ t.magnitude_1 >> 11, 0, 1900)
        second = np.clip(first @ t.magnitude_2 + (t.magnitude_bias_2 << 6) >> 11, 0, 1900)
        return np.clip(second @ t.magnitude_3 + (t.magnitude_bias_3 << 6) >> 9, -3072, 3072).tolist()

    def _sign(self, x, y):
        t, inputs = self.t, self.signs[y, x].copy()
        inputs[:4] = [min(max(64 * v, -128), 128) for v in self._near(x, y, NEXT[:4])]
        first = np.clip(self.bias[2] + inputs @ t.sign_1 >> 11, 0, 1900)
        return int(np.clip(first @ t.sign_2 + (t.sign_bias_2 << 6) >> 9, -3072, 3072))

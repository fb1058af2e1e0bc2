"""Updates of a prior: docs/format/update.md."""

import struct

import numpy as np

from .bits import Recorder, Refused, blake3, crc32, fold, le


class Chance:
    def __init__(self, one=32768, seen=1):
        self.one, self.seen = one, seen

    def bit(self, coder):
        bit = coder.bit(self.one)
        step = 2 * ((65536 if bit else 0) - self.one)
        by = 2 * self.seen + 4
        self.one = min(max(self.one + (step // by if step >= 0 else -(-step // by)), 300), 65236)
        self.seen = min(self.seen + 1, 120)
        return bit


class Magnitude:
    def __init__(self):
        self.more, self.second = [Chance() for _ in range(33)], [Chance() for _ in range(33)]

    def read(self, coder):
        digits = 0
        while digits < 32 and self.more[digits].bit(coder):
            digits += 1
        value = 1
        for place in range(digits - 1, -1, -1):
            value = 2 * value + (self.second[digits].bit(coder) if place == digits - 1 else coder.plain(1))
        return value - 1


def i32(value):
    return (value + (1 << 31)) % (1 << 32) - (1 << 31)


def small(values):
    if any(not -128 <= v <= 127 for v in values):
        raise Refused("content")
    return list(values)


class Size:
    def __init__(self, usual):
        self.more, self.beyond = [Chance(65536 * usual // (usual + 1), 4) for _ in range(16)], Magnitude()

    def read(self, coder, negative):
        value = 0
        while value < 16 and self.more[value].bit(coder):
            value += 1
        if value == 16:
            value += self.beyond.read(coder)
        return i32(-(value + 1) if negative else value + 1)


class Signed:
    def __init__(self, usual):
        self.zero, self.size = Chance(65536 // (2 * usual + 1), 4), Size(usual)

    def read(self, coder):
        return 0 if self.zero.bit(coder) else self.size.read(coder, coder.plain(1))


class Field:
    def __init__(self):
        self.zero, self.negative = [Chance(seen=2) for _ in range(3)], [Chance(seen=2) for _ in range(3)]
        self.size = Size(1)

    def read(self, coder, count):
        values, moved, sign = [], 0, 0
        for _ in range(count):
            if self.zero[moved].bit(coder):
                values.append(0)
                continue
            negative = self.negative[sign].bit(coder)
            moved, sign = moved + 1, 1 + negative
            values.append(self.size.read(coder, negative))
        return values


def tree(coder, count):
    """Positions of the new splats."""
    numbers = Magnitude()
    least = [i32(fold(numbers.read(coder))) for _ in range(3)]
    numbers = Magnitude()
    size = [numbers.read(coder) for _ in range(3)]
    found = []

    def cell(low, place, n):
        if n == 0:
            return
        while place >= 0:
            axis, half = 2 - place % 3, 1 << place // 3
            upper = list(low)
            upper[axis] += half
            place -= 1
            if upper[axis] > size[axis]:
                continue
            a = float(min(size[axis] - upper[axis] + 1, half))
            k = above(a / (a + float(half)), n)
            cell(low, place, n - k)
            return cell(upper, place, k)
        found.extend([low] * n)

    def above(share, n):
        up, down = 3 * share, 3 * (1 - share)
        weight, total, sums = 1.0, 0.0, [0.0]
        for k in range(n + 1):
            total += weight
            sums.append(total)
            with np.errstate(all="ignore"):
                weight *= float(np.float64((n - k) * (k + up)) / np.float64((k + 1.0) * (n - k - 1.0 + down)))
        lo, hi = 0, n
        while lo < hi:
            m = (lo + hi) // 2
            one = (sums[hi + 1] - sums[m + 1]) / (sums[hi + 1] - sums[lo]) * 65536
            if coder.bit(int(min(max(one, 64.0), 65472.0))):
                lo = m + 1
            else:
                hi = m
        return lo

    cell([0, 0, 0], 95, count)
    found_ends = [(min(v), max(v)) for v in zip(*found)] or [(0, 0)] * 3
    if [(0, side) for side in size] != found_ends or not count and any(least):
        raise Refused("content")
    return [[i32(a + b) for a, b in zip(least, place)] for place in found]


def mean(values, none):
    if not values:
        return none
    return [(2 * sum(v) + len(v)) // (2 * len(v)) for v in zip(*values)]


def wanted(colours, colour):
    """Which colour an encoder chooses."""
    off = [sum(abs(a - b) for a, b in zip(mean(known, None), colour)) for known in colours]
    nearest = off.index(min(off)) if off else 0
    return nearest if off and (len(off) == 4 or off[nearest] <= 10) else len(off)


def looks(coder, positions):
    sizes, turns = [Signed(3), Signed(2)], [Signed(3), Signed(1)]
    opacities, fresh, off = Signed(2), [Signed(5) for _ in range(3)], [Signed(2), Signed(1), Signed(1)]
    beyond = [[Chance(seen=0) for _ in range(4)] for _ in range(4)]
    scales, colours, last, splats = [], [], 0, []
    for position in positions:
        m = mean(scales, [-12])[0]
        a = m + sizes[0].read(coder)
        b = (m + a) // 2 + sizes[1].read(coder)
        c = (m + a + b + 1) // 3 + sizes[1].read(coder)
        scale = [a, b, c]
        scales += [[a], [b], [c]]
        turn = [0, 0, 0]
        if not a == b == c:
            idle = next((i for i in range(3) if scale[(i + 1) % 3] == scale[(i + 2) % 3]), None)
            turn = [turns[i == idle].read(coder) for i in range(3)]
        opacity = 2 + opacities.read(coder)
        choice, most = 0, min(len(colours), 3)
        while choice < most and beyond[last][choice].bit(coder):
            choice += 1
        is_new = choice == len(colours)
        base = mean(colours[0] if is_new and colours else colours[choice] if not is_new else [], [0, 0, 0])
        colour = [v + model.read(coder) for v, model in zip(base, fresh if is_new else off)]
        if choice != wanted(colours, colour):
            raise Refused("content")
        if is_new:
            colours.append([])
        colours[choice].append(colour)
        last = choice
        g, red, blue = colour
        splats.append([position, small(scale), small(turn), small([opacity])[0], small([g + red, g, g + blue])])
    return splats


class Update:
    """An update as it travels."""

    def __init__(self, data):
        if data[:4] != b"nvsu":
            raise Refused("magic")
        if len(data) < 19:
            raise Refused("truncated")
        if crc32(data[:-4]) != le(data[-4:]):
            raise Refused("damaged")
        if data[4] != 1:
            raise Refused("version")
        self.prior, self.number, self.before = data[5:9], le(data[9:11]), data[11:15]
        coder = Recorder(data[15:-4])
        self._read(coder)
        self._check()
        if not coder.is_as_written():
            raise Refused("content")
        self.state = blake3(self._content())[:4]

    def _read(self, coder):
        self.origin = [coder.plain(32) for _ in range(3)]
        self.exponent = (coder.plain(7) - 40 + 128) % 256 - 128
        first, length = coder.plain(24), Magnitude().read(coder)
        if length >= 1 << 24:
            raise Refused("content")
        self.frames = [first, (first + length) % (1 << 24)]
        counts = []
        for most in (4096, 4096, 4096, 256):
            counts.append(Magnitude().read(coder))
            if counts[-1] > most:
                raise Refused("content")
        self.splats = looks(coder, tree(coder, counts[0]))
        gaps, due, self.removed = Magnitude(), 0, []
        for _ in range(counts[1]):
            self.removed.append(self._ordinal(due + gaps.read(coder)))
            due = self.removed[-1] + 1
        gaps, due, self.changed = Magnitude(), 0, []
        fields = [Field() for _ in range(5)]
        for _ in range(counts[2]):
            ordinal = self._ordinal(due + gaps.read(coder))
            due = ordinal + 1
            values = [field.read(coder, 1 if i == 3 else 3) for i, field in enumerate(fields)]
            self.changed.append([ordinal, values[0], *(small(v) for v in values[1:])])
        places, sizes, last, self.fades = Magnitude(), Magnitude(), [0, 0, 0], []
        for _ in range(counts[3]):
            low, high = [], []
            for axis in range(3):
                low.append(i32(last[axis] + fold(places.read(coder))))
                high.append(i32(low[axis] + sizes.read(coder)))
            self.fades.append([low, high, coder.plain(8)])
            last = low

    @staticmethod
    def _ordinal(value):
        if value >= 4096:
            raise Refused("content")
        return value

    def _check(self):
        origin = struct.unpack("<3f", struct.pack("<3I", *self.origin))
        bad = self.number == 0 or self.number == 1 and self.before != self.prior
        bad |= not np.isfinite(origin).all() or not -40 <= self.exponent <= 40
        bad |= any(not sound(splat) for splat in self.splats)
        ordinals = [change[0] for change in self.changed]
        bad |= bool(set(ordinals) & set(self.removed))
        bad |= any(not any(map(any, change[1:])) for change in self.changed)
        bad |= any(a > b for low, high, _ in self.fades for a, b in zip(low, high))
        if bad:
            raise Refused("content")
        self.grid = origin, 2.0**self.exponent

    def _content(self):
        splat = lambda s: struct.pack("<3i10b", *s[0], *s[1], *s[2], s[3], *s[4])
        counts = map(len, (self.splats, self.removed, self.changed, self.fades))
        return b"".join([
            self.before, self.prior, struct.pack("<H3Ib2I4I", self.number, *self.origin, self.exponent, *self.frames,
                                                 *counts),
            *map(splat, self.splats), struct.pack(f"<{len(self.removed)}H", *self.removed),
            *(struct.pack("<H", c[0]) + splat([*c[1:4], c[4][0], c[5]]) for c in self.changed),
            *(struct.pack("<6iB", *low, *high, factor) for low, high, factor in self.fades),
        ])


def sound(splat):
    return all(abs(v) <= 12 for v in splat[2]) and -5 <= splat[3] <= 8


class Learnt:
    """What a chain of updates adds up to."""

    def __init__(self, prior_id):
        self.prior, self.state, self.number, self.splats, self.fades = prior_id, prior_id, 0, [], []

    def added(self, update):
        if update.prior != self.prior:
            raise Refused("prior")
        if update.number != self.number + 1 or update.before != self.state:
            raise Refused("not-next")
        after = Learnt(self.prior)
        after.state, after.number = update.state, update.number
        splats = [list(splat) for splat in self.splats]
        for ordinal, *by in update.changed:
            if ordinal >= len(splats):
                raise Refused("content")
            own, (position, scale, turn, opacity, colour) = splats[ordinal], by
            add = lambda a, b: small([x + y for x, y in zip(a, b)])
            changed = [[x + y for x, y in zip(own[0], position)], add(own[1], scale), add(own[2], turn),
                       own[3] + opacity[0], add(own[4], colour), own[5]]
            if not sound(changed) or any(v != i32(v) for v in changed[0]):
                raise Refused("content")
            splats[ordinal] = changed
        if update.removed and update.removed[-1] >= len(splats):
            raise Refused("content")
        after.splats = [s for i, s in enumerate(splats) if i not in set(update.removed)]
        after.splats += [[*splat, update.grid] for splat in update.splats]
        after.fades = self.fades + [(update.grid, *fade) for fade in update.fades]
        if len(after.splats) > 4096 or len(after.fades) > 256:
            raise Refused("content")
        return after

    def fade(self, position):
        """What the opacity of one of the prior's splats is multiplied by."""
        by = np.float32(1)
        for (origin, step), low, high, factor in self.fades:
            inside = all(o + a * 8 * step <= float(p) < o + (b + 1) * 8 * step
                         for o, a, b, p in zip(origin, low, high, position))
            if inside:
                by = by * (np.float32(factor) / np.float32(255))
        return by

    def arrays(self, coefficients):
        f32 = np.float32
        columns = [[], [], [], [], []]
        for position, scale, turn, opacity, colour, (origin, step) in self.splats:
            square = sum(v * v for v in turn)
            long = np.sqrt(float(max(square, 144)))
            q = [f32(np.sqrt(float(max(144 - square, 0))) / long), *(f32(v / long) for v in turn)]
            sh = np.zeros((coefficients, 3), f32)
            sh[0] = [f32(v) * f32(0.12) for v in colour]
            row = ([f32(o + p * step) for o, p in zip(origin, position)], [f32(v) * f32(0.25) for v in scale], q,
                   f32(opacity) * f32(0.8), sh)
            for column, value in zip(columns, row):
                column.append(value)
        return [np.array(column, f32) for column in columns]


class States:
    """The states that a topside holds."""

    def __init__(self, prior_id):
        self.held, self.chain, self.named = [Learnt(prior_id)], [], None

    def add(self, update):
        """Returns the number of the newest update."""
        known = [learnt.state for learnt in self.held]
        base = max((i for i, state in enumerate(known) if state == update.before), default=None)
        if update.prior == self.held[0].prior and update.state in self.chain:
            return self.held[-1].number
        learnt = self.held[-1 if base is None else base]
        if base is None and update.before in self.chain:
            self.held, self.chain = self.held[:1], []
        after = learnt.added(update)
        stands_on = self.chain.index(update.before) + 1 if update.before in self.chain else 0
        gone, self.chain = self.chain[stands_on:], self.chain[:stands_on]
        if self.named and self.named[1] in gone:
            self.named = None
        self.held = self.held[:(base or 0) + 1]
        if len(self.held) > 8:
            del self.held[1]
        self.held.append(after)
        self.chain.append(after.state)
        return after.number

    def note(self, latent):
        if latent.update is not None and latent.full:
            self.named = latent.update, latent.state

    def of(self, latent, camera):
        """The state that a packet is about, if its camera is this one."""
        for learnt in reversed(self.held):
            number = learnt.number % 256 if learnt.number else None
            if latent.update != number:
                continue
            if latent.full:
                fits = latent.state == learnt.state and latent.tag == camera.tag and latent.size == camera.size
            else:
                other = self.named and self.named[0] == number and self.named[1] != learnt.state
                fits = not other and latent.tag == camera.session_tag(learnt.state)
            if fits:
                return learnt
        return None

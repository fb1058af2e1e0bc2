"""Whole numbers by adaptive chances: docs/format/residual.md, "Adaptive numbers"."""


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

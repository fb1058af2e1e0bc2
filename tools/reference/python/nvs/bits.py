"""Checks, the range coder, BLAKE3, exp and PNG: docs/format.md, "Conventions"."""

import struct
import zlib


class Refused(Exception):
    """What a decoder must refuse; args[0] is its name in the document."""


class Unknown(Exception):
    """A bit that the bytes at hand do not tell."""


def crc16(*parts):
    """CRC-16/IBM-3740."""
    crc = 0xFFFF
    for byte in b"".join(parts):
        crc ^= byte << 8
        for _ in range(8):
            crc = crc << 1 ^ (0x11021 if crc & 0x8000 else 0)
    return crc & 0xFFFF


def crc32(*parts):
    return zlib.crc32(b"".join(parts))


def le(data):
    return int.from_bytes(data, "little")


def u32(value):
    return struct.pack("<I", value & 0xFFFFFFFF)


def fold(value):
    """The number that 0, 1, 2, 3, ... stands for: 0, -1, 1, -2, ..."""
    return value >> 1 ^ -(value & 1)


EVEN = 1 << 15


class RangeDecoder:
    """docs/format/residual.md, "Range coder". `cut`: what follows the bytes is not known."""

    def __init__(self, data, cut=False):
        self.data, self.at, self.beyond, self.is_cut = data, 0, 0, cut
        self.low, self.high, self.x, self.most = 0, 0xFFFFFFFF, 0, 0
        for _ in range(4):
            self._next()

    def _next(self):
        if self.at < len(self.data):
            least = most = self.data[self.at]
            self.at += 1
        else:
            self.beyond = min(self.beyond + 1, 4)
            least, most = 0, 255 if self.is_cut else 0
        self.x = (self.x << 8 | least) & 0xFFFFFFFF
        self.most = (self.most << 8 | most) & 0xFFFFFFFF

    def cut(self):
        self.is_cut = True
        self.most = self.x | (1 << 8 * self.beyond) - 1

    def bit(self, one):
        split = self.low + ((self.high - self.low) * one >> 16)
        bit = self.x <= split
        if bit != (self.most <= split):
            raise Unknown
        if bit:
            self.high = split
        else:
            self.low = split + 1
        while not (self.low ^ self.high) >> 24:
            self.low = self.low << 8 & 0xFFFFFFFF
            self.high = self.high << 8 & 0xFFFFFFFF | 0xFF
            self._next()
        return int(bit)

    def plain(self, count):
        value = 0
        for _ in range(count):
            value = value << 1 | self.bit(EVEN)
        return value


def exp(x):
    """docs/format/render.md, "Exponential"."""
    size = abs(x)
    high = le(struct.pack("<d", size)) >> 32
    k, hi, lo = 0, x, 0.0
    if high > 0x3FD62E42:
        if high >= 0x3FF0A2B2:
            k = int(1.44269504088896338700 * x + (-0.5 if x < 0 else 0.5))
        else:
            k = -1 if x < 0 else 1
        hi, lo = x - k * 6.93147180369123816490e-01, k * 1.90821492927058770002e-10
        x = hi - lo
    elif high <= 0x3E300000:
        return 1.0 + x
    xx = x * x
    p = 4.13813679705723846039e-08
    for term in (-1.65339022054652515390e-06, 6.61375632143793436117e-05, -2.77777777770155933842e-03,
                 1.66666666666666019037e-01):
        p = term + xx * p
    c = x - xx * p
    y = 1.0 + (x * c / (2.0 - c) - lo + hi)
    return y * 2.0**k


IV = (0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A, 0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19)
ORDER = (2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8)
ROUND = ((0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
         (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14))


def _compress(chain, block, counter, length, flags):
    words = list(struct.unpack("<16I", block.ljust(64, b"\0")))
    v = [*chain, *IV[:4], counter & 0xFFFFFFFF, counter >> 32, length, flags]
    for _ in range(7):
        for i, (a, b, c, d) in enumerate(ROUND):
            for word, (p, q) in zip(words[2 * i:2 * i + 2], ((16, 12), (8, 7))):
                v[a] = v[a] + v[b] + word & 0xFFFFFFFF
                x = v[d] ^ v[a]
                v[d] = (x >> p | x << 32 - p) & 0xFFFFFFFF
                v[c] = v[c] + v[d] & 0xFFFFFFFF
                x = v[b] ^ v[c]
                v[b] = (x >> q | x << 32 - q) & 0xFFFFFFFF
        words = [words[i] for i in ORDER]
    return [v[i] ^ v[i + 8] for i in range(8)]


def blake3(data, key=None):
    """The first 32 bytes of BLAKE3; in keyed mode if there is a key of 32 bytes."""
    start, mode = (struct.unpack("<8I", key), 16) if key else (IV, 0)

    def chunk(part, counter, root):
        chain, blocks = list(start), [part[i:i + 64] for i in range(0, len(part), 64)] or [b""]
        for i, block in enumerate(blocks):
            last = i + 1 == len(blocks)
            flags = (i == 0) | 2 * last | 8 * (last and root) | mode
            chain = _compress(chain, block, counter, len(block), flags)
        return chain

    def tree(part, counter, root):
        if len(part) <= 1024:
            return chunk(part, counter, root)
        left = 1 << ((len(part) - 1) // 1024).bit_length() - 1
        halves = tree(part[:1024 * left], counter, False) + tree(part[1024 * left:], counter + left, False)
        return _compress(start, struct.pack("<16I", *halves), 0, 64, 4 | 8 * root | mode)

    return struct.pack("<8I", *tree(data, 0, True))


def png(width, height, rgb):
    """A PNG file of 8-bit RGB."""
    def part(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + rgb[3 * width * y:3 * width * (y + 1)] for y in range(height))
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", zlib.compress(rows)) + part(b"IEND", b"")

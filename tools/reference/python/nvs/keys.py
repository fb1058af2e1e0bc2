"""Numbers and tags of what is keyed: docs/format/modem.md."""

import struct

from .bits import Refused, blake3, le

FRAME, REPORT, PACKET = range(3)


def read_keys(text):
    """The keys of a key file."""
    lines = [line.strip() for line in text.splitlines()]
    return [bytes.fromhex(line) for line in lines if line and not line.startswith("#")]


class Verifier:
    """Takes each thing that one of some keys has made, once."""

    def __init__(self, keys, kind, tag=4, epoch=0):
        self.keys, self.kind, self.tag, self.epoch = keys, kind, tag, epoch
        self.taken = {}

    def verify(self, data):
        """The content, without number and tag."""
        return self.read(data, self.taken)[2]

    def read(self, data, taken):
        """Key, number and content; `taken`: by key and stream the greatest number and all that were taken."""
        if len(data) < 2 + self.tag:
            raise Refused("foreign")
        stream, low = le(data[:2]) >> 14, le(data[:2]) & 0x3FFF
        tag, content = data[2:2 + self.tag], data[2 + self.tag:]
        covered = content.rstrip(b"\0") if self.kind in (FRAME, REPORT) else content
        for key in self.keys:
            greatest, all_taken = taken.get((key, stream), (None, set()))
            if greatest is None:
                tries = [low + 16384 * k for k in range(64)]
            else:
                oldest = max(greatest - 63, 0)
                first = oldest + (low - oldest) % 16384
                tries = [first + 16384 * k for k in (0, 1, 2, 3, -1, -2, -3, -4)]
            for number in tries:
                if number < 0:
                    continue
                prefix = b"nvsk" + struct.pack("<4B2Q", self.kind, stream, self.tag, 0, self.epoch, number)
                if blake3(prefix + covered, key)[:self.tag] != tag:
                    continue
                if number in all_taken or greatest is not None and number + 64 <= greatest:
                    raise Refused("replayed")
                taken[key, stream] = max(number, -1 if greatest is None else greatest), all_taken | {number}
                return key, number, content
        raise Refused("foreign")


class Files:
    """As Verifier, of packets in files, which may come in any order."""

    def __init__(self, verifier):
        self.verifier, self.numbers = verifier, set()

    def verify(self, data):
        key, number, content = self.verifier.read(data, {})
        if (key, number) in self.numbers:
            raise Refused("replayed")
        self.numbers.add((key, number))
        return content

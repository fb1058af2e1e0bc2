"""Modem frames: docs/format/modem.md."""

from .bits import Refused, crc16, crc32, le, u32
from .packet import PREDICTED, extent, near

EXP, LOG = [0] * 510, [0] * 256
_v = 1
for _i in range(255):
    EXP[_i] = EXP[_i + 255] = _v
    LOG[_v] = _i
    _v = _v << 1 ^ (0x11D if _v & 0x80 else 0)


def mul(a, b):
    return EXP[LOG[a] + LOG[b]] if a and b else 0


def chunk(known, index):
    """The chunk of an index, from as many known ones as the threshold: {index: bytes}."""
    if index in known:
        return known[index]
    out = bytearray(len(next(iter(known.values()))))
    for i, data in known.items():
        weight = 0
        for j in known:
            if j != i:
                weight += LOG[index ^ j] - LOG[i ^ j]
        weight = EXP[weight % 255]
        for at, byte in enumerate(data):
            out[at] ^= mul(weight, byte)
    return bytes(out)


class Reader:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        if self.at + count > len(self.data):
            raise Refused("cut")
        self.at += count
        return self.data[self.at - count:self.at]

    def byte(self):
        return self.take(1)[0]

    def number(self):
        value = 0
        for place in range(3):
            byte = self.byte()
            value |= (byte & 127) << 7 * place
            if byte < 128:
                return value
        raise Refused("cut")


def restore(data, number, last):
    """The packet of which these bytes have travelled. `number`: low bits of its frame number, if frames state them."""
    is_predicted = data[:1] and data[0] & 31 == PREDICTED
    if len(data) < (2 if number is not None else 3):
        return b""
    if number is None:
        high = [near(data[2], 256, last) >> 8 & 255] if is_predicted else []
        return data[:3] + bytes(high) + data[3:]
    low = near(number, 256, last) if is_predicted else number
    return data[:2] + low.to_bytes(4, "little")[:2 if is_predicted else 1] + data[2:]


class Plain:
    """An unprotected packet. `tag`: small shares have none."""

    def __init__(self, number, tag=None, binding=None, own=0):
        self.number, self.tag, self.binding, self.own = number, tag, binding, own
        self.data, self.count, self.vouched = {}, None, tag is None
        self.frame, self.bytes, self.complete, self.user = None, b"", False, None

    def add(self, index, is_last, data, last):
        self.data[index] = data
        if is_last:
            self.count = index + 1
        self.settle(last)

    def settle(self, last):
        """Judges what is there without a gap."""
        so_far, index = b"", 0
        while index in self.data and index != self.count:
            so_far, index = so_far + self.data[index], index + 1
        is_all = index == self.count
        data = restore(so_far, None if self.tag is None else self.number, last)
        try:
            found = extent(data)
        except Refused:
            found = None
        whole = found and found.whole
        self.complete = bool(is_all and whole)
        if is_all and not whole:
            self.data, self.vouched = {0: self.data[0]}, False
            self.count = None if self.count == 1 else self.count
        self.frame, self.bytes = None, b""
        if found:
            self.frame = near(found.frame, 1 << 16, last)
            self.bytes = data[:whole] if self.complete else data if self.vouched else data[:self.own]


class Collector:
    """Packets of the modem frames of some streams, in any order."""

    def __init__(self, mtu, streams, room):
        self.mtu, self.streams, self.room = mtu, streams, room
        self.plain, self.waiting, self.shares, self.last = {}, [], {}, {}

    def push(self, frame):
        frame = frame[:self.mtu]
        if not frame:
            raise Refused("cut")
        kind = frame[0] >> 6
        if self.mtu < 16:
            self._small(frame)
        elif kind == 1:
            self._share(frame)
        elif kind == 2:
            self._start(frame)
        elif kind == 3:
            self._continuation(frame)
        else:
            raise Refused("not-a-frame")

    def packets(self, stream, frame):
        """The bytes of a packet, whether it is complete, and user bytes; or None."""
        for packet in self.plain.values():
            if stream == 0 and packet.frame == frame and packet.bytes:
                return packet.bytes, packet.complete, None
        for (of, _), packet in self.shares.items():
            if of == stream and packet.get("frame") == frame:
                return packet["bytes"], packet["complete"], packet["user"]
        return None

    def _note(self, packet):
        if packet.bytes:
            self.last[0] = packet.frame

    # Unprotected.

    def _small(self, frame):
        first, data = frame[0], frame[1:]
        if first < 128:
            raise Refused("not-a-frame")
        number, is_last, index = first >> 4 & 7, first >> 3 & 1, first & 7
        if not is_last and len(frame) < self.mtu:
            raise Refused("cut")
        if index >= self.room:
            raise Refused("no-room")
        packet = self.plain.setdefault(number, Plain(number))
        if index not in packet.data:
            packet.add(index, is_last, data, self.last.get(0))
            self._note(packet)

    def _start(self, frame):
        if len(frame) < 2:
            raise Refused("cut")
        if frame[0] & 31:
            raise Refused("not-a-frame")
        is_last, number, data, own = frame[0] >> 5 & 1, frame[1], frame[2:], 0
        if not is_last and len(frame) < self.mtu:
            raise Refused("cut")
        last = self.last.get(0)
        try:
            own = extent(restore(data, number, last)).valid
        except Refused as refused:
            if refused.args[0] != "too-short" or is_last:
                raise
        binding = u32(crc32(frame[:2], data.rstrip(b"\0")))
        old = self.plain.get(number)
        if old and old.binding == binding:
            return
        packet = self.plain[number] = Plain(number, number % 4, binding, own)
        packet.add(0, is_last, data, last)
        self._note(packet)
        for later in list(self.waiting):
            if self._offer(packet, later):
                self.waiting.remove(later)

    def _continuation(self, frame):
        if len(frame) < 4:
            raise Refused("cut")
        index, is_last = (frame[0] & 7) << 8 | frame[1], frame[0] >> 3 & 1
        if index == 0:
            raise Refused("not-a-frame")
        if not is_last and len(frame) < self.mtu:
            raise Refused("cut")
        if index >= self.room:
            raise Refused("no-room")
        if not any(self._offer(packet, frame) for packet in self.plain.values()):
            self.waiting.append(frame)

    def _offer(self, packet, frame):
        index, is_last, data = (frame[0] & 7) << 8 | frame[1], frame[0] >> 3 & 1, frame[4:]
        if packet.tag != frame[0] >> 4 & 3:
            return False
        if crc16(packet.binding, frame[:2], data.rstrip(b"\0")) != le(frame[2:4]):
            return False
        if index not in packet.data:
            packet.vouched = True
            packet.add(index, is_last, data, self.last.get(0))
            self._note(packet)
        return True

    # Protected.

    def _share(self, frame):
        reader = Reader(frame)
        first, second, third = reader.take(3)
        stream, number = first >> 4 & 3, (first & 15) << 4 | second >> 4
        if second & 8:
            index, count = third, reader.byte() + 1
        else:
            index, count = third >> 4, (third & 15) + 1
        own, others = reader.number(), reader.number()
        head = reader.at
        check = le(reader.take(2))
        data = reader.take(own + others)
        if crc16(frame[:head], data) != check:
            raise Refused("check")
        threshold = (second & 7) + 1
        if index >= count or threshold > count or own == 0:
            raise Refused("not-a-frame")
        if count > self.room:
            raise Refused("no-room")
        if stream >= self.streams:
            raise Refused("stream")
        key, form = (stream, number), (count, threshold, own, others)
        packet = self.shares.setdefault(key, {"form": form, "data": {}, "complete": False, "bytes": b""})
        if packet["form"] != form:
            raise Refused("other-share")
        packet["data"].setdefault(index, data)
        if not packet["complete"]:
            try:
                self._solve(packet, stream, number)
            except Refused:
                del self.shares[key]

    def _solve(self, packet, stream, number):
        """Raises Refused if it is none that a sender writes."""
        count, threshold, own, others = packet["form"]
        layers, at, whole, is_cut, begin = [(threshold, own)], 0, b"", False, None
        known = sorted(packet["data"])
        for k in range(8):
            if k == len(layers):
                break
            m, size = layers[k]
            if len(known) < m:
                break
            chunks = {i: packet["data"][i][at:at + size] for i in known[:m]}
            whole += b"".join(chunk(chunks, i) for i in range(m))
            at += size
            if k == 0:
                reader = Reader(whole)
                flags = reader.byte()
                if flags >> 5:
                    raise Refused("damaged")
                is_cut = flags >> 4
                for _ in range(flags & 7):
                    layer = reader.number(), reader.number()
                    if not layers[-1][0] < layer[0] <= count or layer[1] == 0:
                        raise Refused("damaged")
                    layers.append(layer)
                if sum(size for _, size in layers) != own + others:
                    raise Refused("damaged")
                packet["user"] = reader.take(reader.byte()) if flags & 8 else None
                begin = reader.at
        if begin is None:
            return
        data = restore(whole[begin:], number, self.last.get(stream))
        found, is_all = extent(data), len(known) >= layers[-1][0]
        packet["complete"] = is_all and found.whole is not None
        if is_all and found.whole is None and not is_cut:
            raise Refused("damaged")
        packet["frame"] = self.last[stream] = near(found.frame, 1 << 16, self.last.get(stream))
        packet["bytes"] = data[:found.whole] if packet["complete"] else data


def read_report(data):
    """A report as a dictionary, as the vectors' manifest has it."""
    reader = Reader(data)
    mark = reader.byte()
    if mark & 0xCC != 4:
        raise Refused("not-a-frame")
    newest, counts = le(reader.take(2)), reader.byte()
    reported, pose_bytes = counts & 63, (counts >> 6) + 1 if mark & 2 else 0
    if counts >> 6 and not pose_bytes:
        raise Refused("not-a-frame")
    states = reader.take(reported)
    if reported > 32:
        raise Refused("not-a-frame")
    packets = []
    for i, state in enumerate(states):
        sent, shares = 0, []
        if state & 3 == 1:
            sent = reader.byte() + 1
            bits = reader.take((sent + 7) // 8)
            shares = [k for k in range(sent) if bits[k // 8] >> k % 8 & 1]
        packets.append([(newest - i) % 65536, state & 3, state >> 2, sent, shares])
    held = le(reader.take(pose_bytes))
    user = reader.take(reader.byte()) if mark & 1 else None
    end = reader.at
    if le(reader.take(2)) != crc16(data[:end]):
        raise Refused("check")
    poses = [(newest - k) % 65536 for k in range(8 * pose_bytes) if held >> k & 1]
    return {"stream": mark >> 4 & 3, "newest": newest, "packets": packets,
            "user": None if user is None else user.hex(), "poses": poses, "told": 8 * pose_bytes}

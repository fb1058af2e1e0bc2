"""Modem frames: docs/format/modem.md."""

from .bits import Refused, crc8, crc16, crc32, le, u32
from .packet import Held, near, read_camera, read_content, read_latent

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


def extent(start):
    """What the start of a packet in the full or short form says: frame, modulus, latent, head and total length."""
    packet = None
    try:
        packet = read_latent(start, Held())
    except Refused as refused:
        if refused.args[0] != "too-short" or len(start) < 31:
            raise
        return le(start[2:5]) if start[0] & 15 < 8 else le(start[2:4]), 1 << 24, 43, 43, None
    head = len(packet.bytes) + 18 * packet.has_camera + 6 * packet.has_render
    total = head
    if packet.code not in (0, 1, 7):
        total, length = None, 0
        for i, byte in enumerate(start[head:head + 4]):
            length |= (byte & 127) << 7 * i
            if byte < 128:
                total = head + i + 1 + length + (4 if packet.form == "full" else 2)
                break
        else:
            if len(start) >= head + 4:
                raise Refused("length")
    return packet.latent.frame, packet.latent.modulus, len(packet.bytes), head, total


def valid_len(start):
    """Bytes that the packet's own checks vouch for."""
    try:
        packet = read_latent(start, Held())
    except Refused:
        return 0
    valid = len(packet.bytes)
    if packet.has_camera:
        try:
            read_camera(packet)
        except Refused:
            return valid
        valid += 18
    if packet.has_render:
        part = start[valid:valid + 6]
        if len(part) < 6 or crc16(packet.bytes, part[:4]) != le(part[4:]):
            return valid
        valid += 6
    if packet.code not in (0, 1, 7):
        content, error = read_content(packet, start[valid:])
        if error is None:
            valid = extent(start)[4]
    return valid


class Collector:
    """Packets of the modem frames of some streams, in any order."""

    def __init__(self, mtu, streams, room):
        self.mtu, self.streams, self.room = mtu, streams, room
        self.plain, self.waiting, self.shares, self.last = {}, [], {}, {}
        self.updates, self.due, self.done = {}, 1, set()

    def push(self, frame):
        """Returns the updates that are whole now."""
        frame = frame[:self.mtu]
        if not frame:
            raise Refused("cut")
        kind = frame[0] >> 6
        if kind == 1:
            self._share(frame)
        elif kind == 2:
            self._start(frame)
        elif kind == 3:
            self._continuation(frame)
        elif frame[0] & 0xCF == 8:
            return self._piece(frame)
        else:
            raise Refused("not-a-frame")
        return []

    def packets(self, stream, frame):
        """The bytes of a packet, whether it is complete, and user bytes; or None."""
        for packet in [p for p in self.plain.values() if stream == 0] + [p for (s, _), p in self.shares.items()
                                                                          if s == stream]:
            if packet.get("frame") == frame and packet.get("bytes"):
                return packet["bytes"], packet["complete"], packet.get("user")
        return None

    # Unprotected.

    def _start(self, frame):
        if frame[0] >> 4 == 8:
            raise Refused("not-a-frame")
        try:
            number, modulus, latent, head, total = extent(frame)
        except Refused as refused:
            raise Refused("not-a-frame" if refused.args[0] == "magic" else refused.args[0]) from None
        number = near(number, modulus, self.last.get(0))
        needed = min(self.mtu, total or self.mtu)
        if len(frame) < needed:
            raise Refused("cut")
        first = frame[:needed]
        old = self.plain.get(number)
        if old and old["first"] == first:
            return
        self.plain[number] = {"frame": number, "first": first, "total": total, "data": {}, "vouched": False,
                              "complete": False, "bytes": b""}
        self._settle(self.plain[number])
        self._adopt()

    def _continuation(self, frame):
        if len(frame) < 4:
            raise Refused("cut")
        index = (frame[0] & 15) << 8 | frame[1]
        if index == 0:
            raise Refused("not-a-frame")
        if len(frame) < 5:
            raise Refused("cut")
        if index >= self.room:
            raise Refused("no-room")
        self.waiting.append(frame)
        self._adopt()

    def _adopt(self):
        again = True
        while again:
            again = False
            for frame in list(self.waiting):
                if any(self._offer(packet, frame) for packet in self.plain.values()):
                    self.waiting.remove(frame)
                    again = True

    def _offer(self, packet, frame):
        index, tag = (frame[0] & 15) << 8 | frame[1], frame[0] >> 4 & 3
        if packet["frame"] % 4 != tag or index in packet["data"]:
            return packet["frame"] % 4 == tag and packet["data"][index] == frame[4:4 + len(packet["data"][index])]
        full, data, total = self.mtu - 4, frame[4:], packet["total"]
        if total is None:
            if any(i not in packet["data"] for i in range(1, index)):
                return False
            so_far = packet["first"] + b"".join(packet["data"][i] for i in range(1, index)) + data
            try:
                total = extent(so_far)[4]
            except Refused:
                return False
        begin = self.mtu + (index - 1) * full
        due = max(min(full, (total if total is not None else begin + full) - begin), 0)
        data = data[:due]
        if due == 0 or len(data) < due:
            return False
        if crc16(u32(crc32(packet["first"])), frame[:2], data) != le(frame[2:4]):
            return False
        packet["total"], packet["data"][index], packet["vouched"] = total, data, True
        self._settle(packet)
        return True

    def _settle(self, packet):
        data, index = packet["first"], 1
        while index in packet["data"]:
            data += packet["data"][index]
            index += 1
        total = packet["total"]
        if total is not None and len(data) >= total:
            packet["complete"] = valid_len(data[:total]) == total
            packet["vouched"] = packet["complete"]
            if not packet["complete"]:
                packet["data"], data = {}, packet["first"]
        packet["bytes"] = data if packet["vouched"] else data[:valid_len(packet["first"])]
        if packet["bytes"]:
            self.last[0] = packet["frame"]

    # Protected.

    def _share(self, frame):
        reader = Reader(frame)
        first, second, third = reader.take(3)
        stream, number = first >> 4 & 3, (first & 15) << 3 | second >> 5
        if second & 16:
            index, count = third, reader.byte() + 1
        else:
            index, count = third >> 4, (third & 15) + 1
        own, others = reader.number(), reader.number()
        head = reader.at
        check = le(reader.take(2))
        data = reader.take(own + others)
        if crc16(frame[:head], data) != check:
            raise Refused("check")
        threshold = (second & 15) + 1
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
        layers, at, whole, end, begin = [(threshold, own)], 0, b"", None, None
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
                end = flags >> 4
                if end not in (0, 1, 2):
                    raise Refused("damaged")
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
        is_all, data = len(known) >= layers[-1][0], whole[begin:]
        if data[:1] and data[0] >> 4 == 8:
            self._predicted(packet, data, number, is_all, end)
            return
        if end:
            raise Refused("damaged")
        frame, modulus, _, _, total = extent(data)
        frame = near(frame, modulus, self.last.get(stream))
        if frame % 128 != number:
            raise Refused("damaged")
        if total is not None and len(data) >= total:
            data, packet["complete"] = data[:total], True
            if valid_len(data) != total:
                raise Refused("damaged")
        packet["frame"], packet["bytes"] = frame, data
        self.last[stream] = frame

    def _predicted(self, packet, data, number, is_all, end):
        data = data[:1] + bytes([number]) + data[1:]
        _, _, _, _, bits = Held().stated(data)
        latent, total = bits + 2, None
        is_open = data[0] & 15 not in (0, 1, 7)
        if not is_open:
            if end:
                raise Refused("damaged")
            total = latent
        elif is_all and end == 0:
            total = len(data)
        elif is_all and end == 1:
            total = len(data) - data[-1]
            if data[-1] == 0 or total <= latent:
                raise Refused("damaged")
        if total is not None:
            data = data[:1] + bytes([number | 128]) + data[2:total]
            if is_open:
                key = u32(crc32(data[:1], data[2:latent]))
                if crc8(key, data[latent:-1]) != data[-1]:
                    raise Refused("damaged")
            packet["complete"] = True
        stream = 0
        frame = near(number, 128, self.last.get(stream))
        packet["frame"], packet["bytes"] = frame, data
        self.last[stream] = frame

    # Pieces of updates.

    def _piece(self, frame):
        reader = Reader(frame)
        head = reader.take(6)
        size = reader.number()
        end = reader.at
        check, data = le(reader.take(2)), reader.take(size)
        if crc16(frame[:end], data) != check:
            raise Refused("check")
        sources = head[4] + 1
        if sources > 224 or size == 0:
            raise Refused("not-a-frame")
        key = bytes(head[1:5]) + bytes([size & 255])
        pieces = self.updates.setdefault(key, {})
        pieces.setdefault(head[5], data)
        if len(pieces) < sources or key in self.done:
            return []
        known = dict(sorted(pieces.items())[:sources])
        whole = b"".join(chunk(known, i) for i in range(sources))
        reader = Reader(whole)
        update = reader.take(reader.number())
        sound = not any(whole[reader.at:]) and len(update) > 13 and crc32(update[:-4]) == le(update[-4:])
        if not sound or update[9] != head[1] or update[-4:-2] != head[2:4]:
            del self.updates[key]
            return []
        self.done.add(key)
        return [update]


def read_report(data):
    """A report as a dictionary, as the vectors' manifest has it."""
    reader = Reader(data)
    mark = reader.byte()
    if mark & 0xCC != 4:
        raise Refused("not-a-frame")
    newest, reported = le(reader.take(2)), reader.byte()
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
    if mark & 2:
        first = reader.byte()
        if first & 0x78 or first & 7 > 4:
            raise Refused("not-a-frame")
        reader.take(3 * (first & 7) + (4 if first & 128 else 0))
    user = reader.take(reader.byte()) if mark & 1 else None
    end = reader.at
    if le(reader.take(2)) != crc16(data[:end]):
        raise Refused("check")
    after, poses = data[reader.at:reader.at + 6], []
    if len(after) == 6 and crc16(data[:reader.at], after[:4]) == le(after[4:]):
        poses = [(newest - k) % 65536 for k in range(32) if le(after[:4]) >> k & 1]
    return {"stream": mark >> 4 & 3, "newest": newest, "packets": packets,
            "user": None if user is None else user.hex(), "poses": poses}

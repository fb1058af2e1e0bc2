#!/usr/bin/env python3
"""Checks this decoder against the vectors of tests/vectors. Usage: conformance.py [NAME...] [--verbose] [--unpack DIR]

--unpack: writes the records as files, DIR/NAME/0000.nvsp and so on, for programs that read such.
"""

import argparse
import hashlib
import json
import struct
import sys
import traceback
from pathlib import Path

from nvs.bits import Refused
from nvs.decoder import Decoder
from nvs.keys import FRAME, PACKET, REPORT, Files, Verifier
from nvs.modem import Collector, read_report
from nvs.packet import Camera
from nvs.prior import open_prior, read_prior

VECTORS = Path(__file__).resolve().parents[3] / "tests/vectors"


def md5(data):
    return hashlib.md5(data).hexdigest()


def records_of(data):
    while data:
        size = int.from_bytes(data[:4], "little")
        yield data[4:4 + size]
        data = data[4 + size:]


def told(decoded):
    """What the manifest says of a frame."""
    value = {"frame": decoded.frame, "md5": md5(decoded.picture.tobytes())}
    for name in ("damage", "same_render", "reference", "known"):
        if getattr(decoded, name) is not None:
            value[name] = getattr(decoded, name)
    for name in ("uncertain", "kept"):
        if getattr(decoded, name):
            value[name] = True
    if not decoded.portable:
        value["portable"] = False
    if decoded.truth:
        levels, threshold = decoded.truth
        value["truth"] = {"threshold": float(threshold), "levels": "".join(map(str, levels.flat))}
    return value


class Run:
    def __init__(self, vector):
        self.vector, self.pictures = vector, []

    def content(self, kind):
        """What takes number and tag off a record, if there are keys."""
        if "keys" not in self.vector:
            return lambda record: record
        keys = [bytes.fromhex(key) for key in self.vector["keys"]]
        verifier = Verifier(keys, kind, self.vector["tag"], int(self.vector["epoch"]))
        return Files(verifier).verify if kind == PACKET else verifier.verify

    def decoder(self, is_start):
        decoder = Decoder(open_prior(VECTORS / self.vector["prior"]), is_start)
        for width, height, *numbers in self.vector.get("cameras", []):
            decoder.add_camera(Camera(width, height, struct.pack("<4f", *numbers)))
        return decoder

    def decode(self, decoder, record, content=bytes):
        try:
            record = content(record)
            decoded = decoder.decode(record)
        except Refused as refused:
            return {"refused": refused.args[0]}
        self.pictures.append(decoded.picture.tobytes())
        return told(decoded)

    def link(self, records):
        vector = self.vector
        tag = 2 + vector["tag"] if "keys" in vector else 0
        collector, decoder = Collector(vector["mtu"] - tag, vector["streams"], vector["room"]), self.decoder(True)
        content, said, packets = self.content(FRAME), [], []
        for record in records:
            try:
                collector.push(content(record[:vector["mtu"]]))
                said.append({})
            except Refused as refused:
                said.append({"refused": refused.args[0]})
        for stream in range(vector["streams"]):
            for frame in range(12):
                found = collector.packets(stream, frame)
                if found:
                    data, complete, user = found
                    packets.append({"stream": stream, "frame": frame, "bytes": md5(data), "complete": complete,
                                    "user": None if user is None else user.hex(),
                                    "picture": self.decode(decoder, data)})
        return said, packets

    def outcome(self, records):
        kind = self.vector["kind"]
        if kind in ("packets", "starts"):
            decoder = self.decoder(kind == "starts")
            content = self.content(PACKET)
            return [self.decode(decoder, record, content) for record in records], None
        if kind == "link":
            return self.link(records)
        if kind == "reports":
            content = self.content(REPORT)
            return [simple(lambda record: read_report(content(record)), record) for record in records], None
        return [simple(told_prior, record) for record in records], None


def simple(read, record):
    try:
        return read(record)
    except Refused as refused:
        return {"refused": refused.args[0]}


def told_prior(record):
    prior = read_prior(record)
    tables = md5(prior.tables.data) if prior.tables else None
    return {"id": prior.name, "splats": len(prior.logits), "key_frames": prior.key_frames, "tables": tables}


def faults(vector, records):
    """What differs from the manifest."""
    run = Run(vector)
    found, packets = run.outcome(records)
    for place, (own, due) in enumerate(zip(found, vector["records"], strict=True)):
        if own != due:
            yield f"record {place}: {own}, due {due}"
    for own, due in zip(packets or [], vector.get("packets", [])):
        if own != due:
            yield f"packet: {own}, due {due}"
    if len(packets or []) != len(vector.get("packets", [])):
        yield f"{len(packets)} packets, due {len(vector['packets'])}"
    if md5(b"".join(run.pictures)) != vector["result"]:
        yield "pictures differ"


def unpack(vector, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for place, record in enumerate(records_of((VECTORS / vector["input_file"]).read_bytes())):
        (folder / f"{place:04}.nvsp").write_bytes(record)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--unpack", type=Path)
    args = parser.parse_args()
    suite = json.loads((VECTORS / "nvsprior.json").read_text())
    passed = failed = 0
    for vector in suite["test_vectors"]:
        if args.names and vector["name"] not in args.names:
            continue
        if args.unpack:
            unpack(vector, args.unpack / vector["name"])
            continue
        data = (VECTORS / vector["input_file"]).read_bytes()
        assert md5(data) == vector["source_checksum"], vector["name"]
        try:
            wrong = list(faults(vector, list(records_of(data))))
        except Exception:  # noqa: BLE001: a decoder must not fall over
            wrong = [traceback.format_exc()]
        passed, failed = passed + (not wrong), failed + bool(wrong)
        for line in wrong if args.verbose else wrong[:2]:
            print(f"{vector['name']}: {line}")
    if args.unpack:
        return 0
    print(f"{passed} of {passed + failed} vectors passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

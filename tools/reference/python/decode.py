#!/usr/bin/env python3
"""Decodes packets as `nvsprior decode` does. Usage: decode.py PRIOR PACKETS --frames DIR [--joined] [--key FILE]

PRIOR: .ply, .nvsg or .nvsb. PACKETS: a folder of NAME.nvsp.
--joined: packets may be cut, but are undamaged. --key, --epoch and --tag: as those of `nvsprior encode`.
"""

import argparse
import sys
from pathlib import Path

from nvs.bits import Refused, png
from nvs.decoder import Decoder
from nvs.keys import PACKET, Files, Verifier, read_keys
from nvs.prior import open_prior


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("prior")
    parser.add_argument("packets", type=Path)
    parser.add_argument("--frames", type=Path, required=True)
    parser.add_argument("--joined", action="store_true")
    parser.add_argument("--key", type=Path)
    parser.add_argument("--epoch", type=int, default=0)
    parser.add_argument("--tag", type=int, default=4)
    args = parser.parse_args()
    content = bytes
    if args.key:
        keys = read_keys(args.key.read_text())
        content = Files(Verifier(keys, PACKET, args.tag, args.epoch)).verify
    decoder = Decoder(open_prior(args.prior), args.joined)
    args.frames.mkdir(parents=True, exist_ok=True)
    paths = sorted(args.packets.glob("*.nvsp"))
    failed = 0
    for path in paths:
        try:
            decoded = decoder.decode(content(path.read_bytes()))
        except Refused as refused:
            print(f"{path}: refused: {refused}", file=sys.stderr)
            failed += 1
        else:
            if decoded.damage:
                print(f"{path}: {decoded.damage}", file=sys.stderr)
            height, width, _ = decoded.picture.shape
            (args.frames / f"{path.stem}.png").write_bytes(png(width, height, decoded.picture.tobytes()))
    print(f"{len(paths) - failed} of {len(paths)} packets decoded")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

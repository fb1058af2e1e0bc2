#!/usr/bin/env python3
"""Decodes packets as `nvsprior decode` does. Usage: decode.py PRIOR PACKETS --frames DIR [--joined]

PRIOR: .ply or .nvsg, with PRIOR.tables beside it if there is one. PACKETS: a folder of NAME.nvsp, and NAME.nvsu or
dive updates beside them. --joined: packets may be cut, but are undamaged.
"""

import argparse
import sys
from pathlib import Path

from nvs.bits import Refused, png
from nvs.decoder import Decoder
from nvs.prior import open_prior


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("prior")
    parser.add_argument("packets", type=Path)
    parser.add_argument("--frames", type=Path, required=True)
    parser.add_argument("--joined", action="store_true")
    args = parser.parse_args()
    decoder = Decoder(open_prior(args.prior), args.joined)
    args.frames.mkdir(parents=True, exist_ok=True)
    paths = sorted(args.packets.glob("*.nvsp"))
    failed = 0
    for path in paths:
        try:
            decoded = decoder.decode(path.read_bytes())
        except Refused as refused:
            print(f"{path}: refused: {refused}", file=sys.stderr)
            failed += 1
        else:
            if decoded.damage:
                print(f"{path}: {decoded.damage}", file=sys.stderr)
            height, width, _ = decoded.picture.shape
            (args.frames / f"{path.stem}.png").write_bytes(png(width, height, decoded.picture.tobytes()))
        if path.with_suffix(".nvsu").exists():
            decoder.add_update(path.with_suffix(".nvsu").read_bytes())
    print(f"{len(paths) - failed} of {len(paths)} packets decoded")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

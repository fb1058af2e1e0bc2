"""Times of encoding through Python beside those of the program, on the demo's frames: `make demo` draws them.

    python times.py demo-out PROGRAM

Both encode the same frames with the same options, in turn. The program tells its times in its summary.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
from PIL import Image

import nvsprior

ROUNDS = 5


def of_program(program: str, demo: Path, folder: Path) -> tuple[list[float], list[bytes]]:
    """Milliseconds and packet of each frame."""
    summary = folder / "summary.json"
    run = ["encode", "--prior", demo / "prior.ply", "--cameras", demo / "T1/cameras.json"]
    subprocess.run([program, *run, "--packets", folder, "--summary", summary], check=True, capture_output=True)
    packets = [path.read_bytes() for path in sorted(folder.rglob("*.nvsp"))]
    return [frame["milliseconds"] for frame in json.loads(summary.read_text())["frames"]], packets


class Times:
    """Of each frame, milliseconds: in a call of `encode`, within the library, in a call of `decode`."""

    def __init__(self, engine: nvsprior.Engine, prior: nvsprior.Prior, demo: Path) -> None:
        run = json.loads((demo / "T1/cameras.json").read_text())
        camera = nvsprior.Camera(*(run[key] for key in ("width", "height", "fx", "fy", "cx", "cy")))
        encoder, decoder = nvsprior.Encoder(engine, prior, camera), nvsprior.Decoder(engine, prior)
        shown = np.zeros((camera.height, camera.width, 3), np.uint8)
        self.packets: list[bytes] = []
        self.encode: list[float] = []
        self.library: list[float] = []
        self.decode: list[float] = []
        for image in run["images"]:
            frame = np.array(Image.open(demo / "T1" / image["file"]).convert("RGB"))
            pose = nvsprior.Pose(image["qvec"], image["tvec"])
            start = time.perf_counter()
            encoded = encoder.encode(frame, pose if not self.packets else None, time=image["time"])
            middle = time.perf_counter()
            decoder.decode(encoded.packet, out=shown)
            self.decode.append(1e3 * (time.perf_counter() - middle))
            self.encode.append(1e3 * (middle - start))
            self.library.append(encoded.refine_milliseconds + encoded.code_milliseconds)
            self.packets.append(encoded.packet)


def main() -> None:
    demo, program = Path(sys.argv[1]), sys.argv[2]
    engine, prior = nvsprior.Engine(), nvsprior.Prior.open(demo / "prior.ply")
    ours, theirs = [], []
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            milliseconds, packets = of_program(program, demo, Path(folder))
        theirs += milliseconds
        ours.append(Times(engine, prior, demo))
        if packets != ours[-1].packets:
            sys.exit("the packets differ")
    print(f"{engine.device}, medians of {ROUNDS} rounds of {len(ours[0].packets)} frames, equal packets; milliseconds:")
    print(f"  nvsprior encode           {median(theirs):8.2f}")
    print(f"  Encoder.encode            {median(t for times in ours for t in times.encode):8.2f}")
    print(f"    of it in the library    {median(t for times in ours for t in times.library):8.2f}")
    layer = [a - b for times in ours for a, b in zip(times.encode, times.library)]
    print(f"    of it around it         {median(layer):8.2f}")
    print(f"  Decoder.decode            {median(t for times in ours for t in times.decode):8.2f}")


if __name__ == "__main__":
    main()

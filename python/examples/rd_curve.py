"""Draws PSNR over bytes per frame, for the demo's frames: `make demo` draws them.

    pip install nvsprior-*.whl pillow matplotlib
    python rd_curve.py demo-out

Without matplotlib it prints the table alone. The cells (# %%) also run one by one, in an editor that knows them.
"""

# %% The demo's frames, with their camera and poses
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import nvsprior

demo = Path(sys.argv[1] if len(sys.argv) > 1 else "demo-out")
BYTES = (40, 60, 100, 150, 250, 400, 700, 1200)


def read_run(name: str) -> tuple[nvsprior.Camera, list[np.ndarray], list[nvsprior.Pose]]:
    """A run's camera, its frames (uint8, height x width x 3) and their poses."""
    run = json.loads((demo / name / "cameras.json").read_text())
    camera = nvsprior.Camera(*(run[key] for key in ("width", "height", "fx", "fy", "cx", "cy")))
    images = run["images"]
    frames = [np.array(Image.open(demo / name / image["file"]).convert("RGB")) for image in images]
    return camera, frames, [nvsprior.Pose(image["qvec"], image["tvec"]) for image in images]


# %% A device, and the prior that vehicle and topside hold
engine = nvsprior.Engine()
prior = nvsprior.Prior.open(demo / "prior.ply")
print(f"{engine.device}: {len(prior)} splats")


# %% Each rate: encode all frames, decode their packets, compare
def measure(name: str, budget: int) -> tuple[float, float, float]:
    """Means over a run's frames: bytes, PSNR of what the topside shows, PSNR of the prior's render alone."""
    camera, frames, poses = read_run(name)
    encoder = nvsprior.Encoder(engine, prior, camera)
    decoder = nvsprior.Decoder(engine, prior)
    rows = []
    for frame, pose in zip(frames, poses):
        # A packet that tells the camera takes some bytes more: here each frame's picture gets as many.
        encoder.set_rate(steady_bytes=budget)
        encoded = encoder.encode(frame, hint=pose)
        decoded = decoder.decode(encoded.packet)
        assert np.array_equal(decoded.picture, encoded.picture)
        rows.append((min(len(encoded.packet), budget), encoded.psnr, encoded.render_psnr))
    size, psnr, render = np.mean(rows, axis=0)
    return float(size), float(psnr), float(render)


runs = {"T1": "the scene as mapped", "T2": "a new object and a safety line"}
curves = {name: np.array([measure(name, budget) for budget in BYTES]) for name in runs}
print("run  bytes/frame  PSNR, dB  render alone, dB")
for name, curve in curves.items():
    for size, psnr, render in curve:
        print(f"{name:3}  {size:11.1f}  {psnr:8.2f}  {render:16.2f}")

# %% The curve
try:
    from matplotlib import pyplot
except ImportError:
    sys.exit(0)

figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
for name, curve in curves.items():
    axes.semilogx(curve[:, 0], curve[:, 1], marker="o", label=f"{name}: {runs[name]}")
axes.set(xlabel="bytes per frame", ylabel="PSNR, dB")
axes.grid(True, which="both", alpha=0.3)
axes.legend()
figure.savefig("rd_curve.png", dpi=120)
print("rd_curve.png")

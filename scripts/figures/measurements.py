"""What is measured for the documents, and by which commands.

Each measurement has the commands, the priors that it is of, and what it reads from the folder OUT that they leave. Of
its values, `exact` are those that every device must give again: bytes, PSNR, counts. All others depend on the machine.
`quick` ones take minutes. `needs` are measurements whose folders the commands read: MAPPED stands for that of
`mapping`.
"""
import dataclasses
from typing import Callable

import readers

NVSPRIOR = "target/release/nvsprior"
LAB = "target/release/nvsprior-lab"
DEMO_PRIOR = "tools/basin/prior.nvsg"
REEF = "--cameras REEF/cameras.json --split test_block"


@dataclasses.dataclass
class Measurement:
    name: str
    priors: list[str]
    commands: list[str]
    read: Callable
    exact: Callable
    quick: bool = False
    needs: tuple[str, ...] = ()


def draw(run, frames, more=""):
    return f"{NVSPRIOR} demo --run {run} --draw-only --frames {frames} {more}--out OUT"


def drawn(run):
    return f"--prior {DEMO_PRIOR} --cameras OUT/{run}/cameras.json"


def demo_bench(run):
    return [draw(run, 24), f"{LAB} bench {drawn(run)} --bfgs-frames 0 --configurations 0 --report OUT/bench"]


# Versions of the coders that others wrote: those of the ffmpeg, cjxl and djxl in PATH.
CODERS = ("ffmpeg -version | head -n 1 > OUT/coders.txt; cjxl --version 2>&1 | head -n 1 >> OUT/coders.txt; "
          "for c in libx264 libx265 libaom-av1 libsvtav1 libvvenc; do ffmpeg -v error -encoders | grep -ow $c "
          "| head -n 1 >> OUT/coders.txt; done; true")


def codecs(name, priors, inputs, commands=(), needs=()):
    """The wavelet coder beside others, on the difference pictures of a run."""
    return Measurement(f"codecs-{name}", priors, [
        *commands, CODERS,
        f"{LAB} codecs --differences {inputs} --report OUT/codecs",
    ], readers.codecs, readers.exact_of_codecs, needs=needs)


MODES = {
    "intra": "",
    "chain": "--mode stream",
    "layers": "--mode layers:0",
    "keys": "--mode keys:0",
}


def at_levels(name, inputs, levels=(31, 32, 33), more=""):
    """Encodes at several PSNRs: OUT/NAME-LEVEL.json."""
    return (f"for psnr in {' '.join(map(str, levels))}; do {NVSPRIOR} encode {inputs} {more} --psnr $psnr --packets "
            f"OUT/packets --overwrite --summary OUT/{name}-$psnr.json; done")


def modes(run, inputs, names=("intra", "chain", "layers")):
    return [at_levels(f"{run}-{name}", inputs, more=f"--no-truth {MODES[name]}") for name in names]


LINK = f"{NVSPRIOR} link --prior MAPPED/prior.nvsg {REEF} --threshold 1e-2 --seconds 8 --bit-rate 20000"
LOSSES = "--loss 0,0.05,0.2,0.4"


def poses(run, inputs):
    return [f"{LAB} link {inputs} --return-delay 0.3 --report OUT/poses-{run}-{name} {option}"
            for name, option in (("stated", "--state-poses"), ("predicted", ""))]


ALL = [
    Measurement("demo", ["demo"], ["target/release/nvsprior-demo --bfgs-frames 5 --out OUT"], readers.rows_of_demo,
                readers.exact_of_demo, quick=True),
    Measurement("reef", ["reef"], [
        f"{LAB} bench --prior REEF/prior.ply {REEF} --report OUT/bench",
        f"{NVSPRIOR} encode --prior REEF/prior.ply {REEF} --quality 10 --packets OUT/packets --overwrite "
        "--summary OUT/wavelet.json",
        f"{LAB} paper encode --prior REEF/prior.ply {REEF} --quality 10 --optimizer gauss-newton --packets OUT/webp "
        "--overwrite --summary OUT/webp.json",
    ], readers.reef, readers.exact_of_reef),
    *[Measurement(run.lower(), ["demo"], demo_bench(run), readers.bench, readers.exact_of_bench)
      for run in ("T1", "T2")],
    Measurement("ablation", ["demo"], [
        draw("T1", 8),
        f"{LAB} ablation {drawn('T1')} --trials 24 --adam-trials 0 "
        "--report OUT/ablation",
    ], readers.ablation, readers.exact_of_ablation),
    Measurement("stability", [], [f"{LAB} stability --report OUT"], readers.stability,
                readers.exact_of_stability),
    Measurement("mapping", ["reef"], [
        f"{NVSPRIOR} map --cameras REEF/cameras.json --split train --points REEF/points.ply --out OUT/prior.nvsg "
        "--report OUT/map",
        at_levels("mapped", f"--prior OUT/prior.nvsg {REEF} --threshold 1e-2", more="--no-truth"),
        at_levels("given", f"--prior REEF/prior.ply {REEF}", more="--no-truth"),
    ], readers.mapping, readers.exact_of_mapping),
    Measurement("streams", ["demo", "reef"], [
        *modes("reef", f"--prior REEF/prior.ply {REEF}", names=MODES),
        *modes("mapped", f"--prior MAPPED/prior.nvsg {REEF} --threshold 1e-2"),
        *[command for run in ("T2", "T4") for command in (draw(run, 12), *modes(run, drawn(run)))],
    ], readers.streams, readers.exact_of_streams, needs=("mapping",)),
    codecs("reef", ["reef"], f"--prior REEF/prior.ply {REEF}"),
    codecs("mapped", ["reef"], f"--prior MAPPED/prior.nvsg {REEF} --threshold 1e-2", needs=("mapping",)),
    *[codecs(run.lower(), ["demo"], f"--starts camera-file {drawn(run)}", [draw(run, frames)])
      for run, frames in (("T1", 12), ("T2", 12), ("T4", 4))],
    Measurement("sizes", ["demo"], [
        draw("T1", 8, "--width 1280 "),
        f"{LAB} sizes {drawn('T1')} --trained-focal 228.5037 --report OUT/sizes",
    ], readers.sizes, readers.exact_of_sizes),
    Measurement("stages", ["demo"], [
        draw("T1", 6, "--width 1280 "),
        *[f"{LAB} bench {drawn('T1')} --trained-focal 228.5037 --width {width} --trials 1 --bfgs-frames 0 "
          f"--configurations 0 --report OUT/{width}" for width in readers.WIDTHS],
    ], readers.stages, readers.exact_of_stages),
    Measurement("sites", ["demo"], [f"{LAB} site --parts 6 --report OUT"], readers.sites,
                readers.exact_of_sites),
    Measurement("link", ["demo", "reef"], [
        *[f"{LINK} --mtu {mtu} {LOSSES} --burst {burst} --report OUT/loss-{mtu}-{burst}"
          for mtu in (64, 256) for burst in (1, 4)],
        *[f"{LINK} --mtu 64 --loss 0,0.05,0.2 --mode {structure}:{every} "
          f"--report OUT/{structure}" for structure, every in (("keys", 8), ("layers", 16), ("chain", 16))],
        *poses("reef", f"--prior REEF/prior.ply {REEF} --threshold 1e-2 --bit-rate 20000 --seconds 8"),
        *[command for run in ("T1", "T2")
          for command in (draw(run, 60), *poses(run, f"{drawn(run)} --fps 3 --bit-rate 4000"))],
    ], readers.link, readers.exact_of_link, needs=("mapping",)),
]

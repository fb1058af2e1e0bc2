#!/usr/bin/env python3
"""Holds what the program says of its poses to account: docs/poses.md.
Usage: calibration.py OUT [--frames N] [--only PART]

Draws dives that no constant was chosen on, and runs `nvsprior-lab poses` on them, on the reef and on White Point
(mapped first), if there are such data, and on T7 of the tower by five mapping runs. Fails if a dive of 200 frames or
more breaks the promise."""
import argparse
import json
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAMS = ROOT / "target/release"
DATA = ROOT.parent / "shared/data"
PRIOR = ROOT / "tools/basin/prior.nvsg"
# Dives and their numbers. Constants were chosen on the first dives.
DIVES = [("T1", 2), ("T1", 3), ("T2", 2), ("T2", 3), ("T4", 2), ("T4", 3)]
CONDITIONS = "dark,low-contrast,snow,object"
LEAST = 200
WITHIN_2, WITHIN_4, MOST = 0.90, 0.99, 4.0


def run(*arguments, program="nvsprior"):
    print("+", program, *arguments, flush=True)
    subprocess.run([PROGRAMS / program, *map(str, arguments)], check=True)


def lab(*arguments):
    run(*arguments, program="nvsprior-lab")


def bench(name, out, *arguments, conditions="plain"):
    """The figures of each condition."""
    lab("poses", "--conditions", conditions, "--report", out / name, *arguments)
    return [(name, summary) for summary in json.loads((out / name / "poses.json").read_text())]


def drawn(out, frames):
    for name, number in DIVES:
        folder = out / f"{name}-{number}"
        if not folder.exists():
            lab("draw", "--run", name, "--dive", number, "--frames", frames, "--rate", 3, "--out", folder)
        cameras = folder / name / "cameras.json"
        run_of = ("--prior", PRIOR, "--cameras", cameras)
        yield from bench(f"poses-{name}-{number}", out, *run_of)
        yield from bench(f"changed-{name}-{number}", out, *run_of, conditions=CONDITIONS)


def real(out):
    reef, point = DATA / "reef", DATA / "whitepoint"
    near = ("--threshold", "1e-2", "--starts", "camera-file")
    if reef.exists():
        for split in ("test", "test_block"):
            yield from bench(f"poses-reef-{split}", out, "--prior", reef / "prior.ply",
                             "--cameras", reef / "cameras.json", "--split", split, *near)
    if point.exists():
        prior, cameras = out / "whitepoint.nvsg", point / "cameras.json"
        if not prior.exists():
            run("map", "--cameras", cameras, "--split", "train", "--points", point / "points.ply", "--splats", 20000,
                "--iterations", 3000, "--out", prior)
        for split in ("test", "test_block"):
            yield from bench(f"poses-whitepoint-{split}", out, "--prior", prior, "--cameras", cameras,
                             "--split", split, *near)


# The tower's mapping runs, as course and lens; and what its dives are flown with beside the mapping run's camera.
TOWERS = [("approach", 33), ("arcs", 33), ("both", 33), ("approach", 80), ("both", 80)]
VEHICLES = {"": (), "camera-2": ("--camera", 2), "left-lamp": ("--lamps", "left")}


def tower(out, frames):
    for course, lens in TOWERS:
        folder = out / f"tower-{course}-{lens}"
        prior, report, seen = folder / "prior.nvsg", folder / "report", ("--lens", lens)
        if not prior.exists():
            lab("draw", "--site", "tower", "--mapping-run", "--course", course, *seen, "--out", folder)
            run("map", "--cameras", folder / "M4/cameras.json", "--splats", 10000, "--iterations", 1500,
                "--out", prior, "--report", report)
        expected = json.loads((report / "report.json").read_text())["expected_pose_error"]
        print(f"T7, {course}, {lens} degrees: expected {expected}", flush=True)
        for vehicle, options in VEHICLES.items():
            dive = out / f"T7-{lens}{vehicle and '-' + vehicle}"
            if not dive.exists():
                lab("draw", "--run", "T7", "--frames", frames // 5, *seen, *options, "--out", dive)
            yield from bench(f"{dive.name} {course}", out, "--prior", prior, "--cameras", dive / "T7/cameras.json")


def faults(summary):
    """What breaks the promise, of a long dive as it is."""
    for axis in summary["axes"]:
        ratio = axis["deviation"] / axis["error"] if axis["deviation"] else 0
        if axis["within_2"] < WITHIN_2 or axis["within_4"] < WITHIN_4 or not 0 < ratio <= MOST:
            yield axis["name"]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--only", choices=["drawn", "real", "tower"])
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    parts = {"drawn": drawn(given.out, given.frames), "real": real(given.out), "tower": tower(given.out, given.frames)}
    rows = [row for name, rows in parts.items() if given.only in (None, name) for row in rows]
    print(f"\n{'dive':28} {'condition':14} {'certain':>9} {'known':>6} {'wrong':>6} {'off by':>15} {'dB':>5} "
          f"{'bytes at 31 dB':>14}  faults")
    total = wrong = broken = 0
    for name, summary in rows:
        held = summary["condition"] == "plain" and summary["certain"] >= LEAST
        bad = list(faults(summary)) if held else []
        total += summary["known"]
        wrong += summary["known_and_wrong"]
        broken += bool(bad)
        certain = f"{summary['certain']}/{summary['frames']}"
        print(f"{name:28} {summary['condition']:14} {certain:>9} {summary['known']:6} "
              f"{summary['known_and_wrong']:6} {summary['position_error']:7.3f} "
              f"{summary['rotation_error_degrees']:6.2f}° {summary['render_psnr']:5.1f} {summary['bytes'][1]:14.0f}  "
              f"{', '.join(bad)}")
    print(f"position known in {total} frames, of which {wrong} are off by more than {MOST:.0f} times what is stated")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""The paper's learned baselines for `nvsprior-lab paper bench`: README.md tells how they go together."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

warnings.filterwarnings("ignore", category=FutureWarning)

from learned.errors import ArgumentError, PaperError  # noqa: E402


def main(arguments: list[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    try:
        options.command(options)
    except PaperError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(description=__doc__)
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    _train(commands.add_parser("train", help="train a codec on a mapping run's pictures"))
    _differences(commands.add_parser("differences", help="make difference pictures to train on"))
    _run(commands.add_parser("run", help="code the frames of `nvsprior-lab paper bench`"))
    _starts(commands.add_parser("starts", help="train a pose regressor, and write starts for a run's frames"))
    _convert(commands.add_parser("convert", help="convert a COLMAP or LLFF data set to our camera file"))
    _plot(commands.add_parser("plot", help="draw training curves"))
    return top


def _train(options: argparse.ArgumentParser) -> None:
    options.add_argument("--method", required=True, help="mean-scale-hyperprior or mlic++")
    source = options.add_mutually_exclusive_group(required=True)
    source.add_argument("--cameras", type=Path, help="camera file of the mapping run")
    source.add_argument("--pictures", type=Path, help="folder of PNG pictures, such as `differences` writes")
    options.add_argument("--split", help="only this split of the camera file")
    options.add_argument("--of", default="frames", help="what the pictures are: frames (default) or differences")
    options.add_argument("--lambda", dest="rate_lambda", type=float, required=True, help="weight of the distortion")
    options.add_argument("--steps", type=int, default=10000, help="steps of 4 crops of 128 × 128 (default 10000)")
    options.add_argument("--minutes", type=float, help="end after this time; the learning rate falls in time for it")
    options.add_argument("--batch", type=int, default=4)
    options.add_argument("--learning-rate", type=float, default=2e-4)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--float32", action="store_true", help="no bfloat16 in the transforms")
    options.add_argument("--from", dest="start", type=Path, help="weights to start from (default: random ones)")
    options.add_argument("--out", type=Path, required=True, help="weights file to write")
    options.add_argument("--curve", type=Path, required=True, help="CSV of the training curve to write")
    options.set_defaults(command=train)


def train(options: argparse.Namespace) -> None:
    from learned import crops, training

    if options.cameras:
        sources = crops.of_run(options.cameras, options.split)
    else:
        sources = crops.of_folder(options.pictures)
    plan = training.Plan(
        options.method,
        options.of,
        options.rate_lambda,
        options.steps,
        options.seed,
        options.batch,
        options.learning_rate,
        options.minutes,
        not options.float32,
        options.start,
    )
    done = training.train(plan, sources, options.out, options.curve)
    print(f"{options.out}: {done.steps} steps in all")


def _renderer(options: argparse.ArgumentParser) -> None:
    options.add_argument("--prior", type=Path, required=True)
    options.add_argument("--cameras", type=Path, required=True, help="camera file of the mapping run")
    options.add_argument("--split", help="only this split of the camera file")
    options.add_argument("--seed", type=int, default=1)


def _differences(options: argparse.ArgumentParser) -> None:
    _renderer(options)
    options.add_argument("--each", type=int, default=2, help="pictures of each frame (default 2)")
    options.add_argument("--out", type=Path, required=True, help="folder to write")
    options.set_defaults(command=write_differences)


def write_differences(options: argparse.Namespace) -> None:
    from learned import cameras, differences, renders

    renderer = renders.Renderer(options.prior)
    run = cameras.read(options.cameras, options.split)
    count = differences.write(run, renderer, options.each, options.seed, options.out)
    print(f"{options.out}: {count} difference pictures")


def _run(options: argparse.ArgumentParser) -> None:
    options.add_argument("--exchange", type=Path, required=True, help="DIR/exchange of `paper bench --report DIR`")
    options.add_argument("--weights", type=Path, required=True, nargs="+", help="weights files of `train`")
    options.add_argument("--out", type=Path, required=True, help="folder for `paper bench --learned`")
    options.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    from learned import exchange

    frames = exchange.read(options.exchange)
    print("set,method,frames,bytes,psnr,encode_ms,decode_ms")
    for weights_file in options.weights:
        row = exchange.run(frames, weights_file, options.out)
        print(
            f"{row['set']},{row['method']},{row['frames']},{row['bytes']:.1f},{row['psnr']:.2f},"
            f"{row['encode_ms']:.1f},{row['decode_ms']:.1f}",
            flush=True,
        )


def _starts(options: argparse.ArgumentParser) -> None:
    _renderer(options)
    options.add_argument("--count", type=int, default=1000, help="renders to train on (default 1000)")
    options.add_argument(
        "--renders", type=Path, required=True, help="file (.npz) of the renders; drawn if it is missing"
    )
    options.add_argument("--steps", type=int, default=3000, help="steps of 32 renders (default 3000)")
    options.add_argument("--minutes", type=float, help="end the training after this time")
    options.add_argument(
        "--frames", type=Path, nargs="+", help="camera files of the frames to start (default: --cameras)"
    )
    options.add_argument("--frames-split", help="only this split of them")
    options.add_argument("--curve", type=Path, required=True, help="CSV of the training curve to write")
    options.add_argument(
        "--out", type=Path, nargs="+", required=True, help="CSV for `paper bench --starts`, one for each of --frames"
    )
    options.set_defaults(command=starts)


def starts(options: argparse.Namespace) -> None:
    from learned import cameras, regressor, renders

    files = options.frames or [options.cameras]
    if len(files) != len(options.out):
        raise ArgumentError(f"{len(files)} camera files of frames, but {len(options.out)} files for --out")
    survey = cameras.read(options.cameras, options.split)
    runs = [cameras.read(file, options.frames_split) for file in files]
    if options.renders.exists():
        drawn = regressor.read(options.renders)
    else:
        renderer = renders.Renderer(options.prior)
        drawn = regressor.draw(survey, renderer, options.count, options.seed, options.renders)
    trained = regressor.train(drawn, options.steps, options.minutes, options.seed, options.curve)
    limits = f"{regressor.START_OF_DEPTH} of the median depth and {regressor.START_DEGREES} degrees"
    for run, out in zip(runs, options.out):
        found = regressor.starts(trained, run)
        regressor.write_starts(found, out)
        for start in found:
            print(f"{start.name}: {start.depths:.3f} of the depth, {start.degrees:.2f} degrees")
        good = sum(start.good for start in found)
        print(f"{out}: {good} of {len(found)} frames start within {limits}")


def _convert(options: argparse.ArgumentParser) -> None:
    options.add_argument(
        "data_set", type=Path, help="folder with images_wb/ or images/, and sparse/0/ or poses_bounds.npy"
    )
    options.add_argument("--out", type=Path, required=True, help="folder to write")
    options.add_argument("--width", type=int, default=320, help="pictures wider than this are reduced (default 320)")
    options.add_argument("--images", help="folder of the pictures (default: images_wb, else images)")
    options.set_defaults(command=convert)


def convert(options: argparse.Namespace) -> None:
    from learned import convert as converter

    done = converter.convert(options.data_set, options.out, options.width, options.images)
    for name in done.left_out:
        print(f"warning: {name} is in the model, but there is no such picture", file=sys.stderr)
    points = "no points (the poses are LLFF's)" if done.points is None else f"{done.points} points"
    print(f"{done.cameras}: {done.pictures} pictures, {points}")


def _plot(options: argparse.ArgumentParser) -> None:
    options.add_argument("curves", type=Path, nargs="+", help="CSV files of `train`")
    options.add_argument("--out", type=Path, required=True, help="PNG to write")
    options.set_defaults(command=plot)


def plot(options: argparse.Namespace) -> None:
    from learned import plot as plots

    plots.plot(options.curves, options.out)
    print(options.out)


if __name__ == "__main__":
    sys.exit(main())

"""The folder that `nvsprior-lab paper bench` writes for the learned codecs, and the one that it reads again."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from . import differences, pictures, stream, weights
from .errors import FileError, PaperError


@dataclass(frozen=True)
class Exchange:
    path: Path
    set: str
    width: int
    height: int
    frames: list[str]

    def picture(self, kind: str, name: str) -> np.ndarray:
        """A picture of `frames`, `renders` or `differences`."""
        path = self.path / kind / f"{name}.png"
        pixels = pictures.read_rgb(path)
        if pixels.shape != (self.height, self.width, 3):
            raise FileError(path, f"{pixels.shape[1]}×{pixels.shape[0]}, the manifest says {self.width}×{self.height}")
        return pixels


def read(path: Path) -> Exchange:
    manifest = path / "manifest.json"
    try:
        content = json.loads(manifest.read_text(encoding="utf-8"))
        frames = [str(name) for name in content["frames"]]
        exchange = Exchange(path, str(content["set"]), int(content["width"]), int(content["height"]), frames)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise FileError(manifest, f"cannot be read: {error}; `nvsprior-lab paper bench` writes it") from None
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(manifest, f"not a manifest: {type(error).__name__} {error}") from None
    if not frames:
        raise FileError(manifest, "names no frames")
    for name in frames:
        if Path(name).name != name or name in ("", ".", ".."):
            raise FileError(manifest, f"`{name}` is not the name of a frame")
    return exchange


def run(exchange: Exchange, weights_file: Path, out: Path) -> dict:
    """Codes every frame with one model; its row, with the PSNR of the restored frames.

    The decoder is another model object, read from the file again, and it sees nothing but the bytes.
    """
    encoder, training = weights.load(weights_file)
    decoder, _ = weights.load(weights_file)
    folder = out / method_folder(training)
    rows, fidelity = [], []
    _warm_up(exchange, training, encoder, decoder)
    for name in exchange.frames:
        pixels = exchange.picture(training.of, name)
        data, encode_ms = _timed(stream.encode, encoder, pixels)
        decoded, decode_ms = _timed(stream.decode, decoder, data)
        pictures.write_rgb(folder / "pictures" / f"{name}.png", decoded)
        rows.append((name, len(data), f"{encode_ms:.2f}", f"{decode_ms:.2f}"))
        fidelity.append(_fidelity(exchange, training, name, decoded))
    _write(folder, training, encoder, weights_file, rows)
    sizes, encode_times, decode_times = ([float(row[column]) for row in rows] for column in (1, 2, 3))
    return {
        "method": folder.name,
        "set": exchange.set,
        "frames": len(rows),
        "bytes": np.mean(sizes),
        "psnr": np.mean(fidelity),
        "encode_ms": np.mean(encode_times),
        "decode_ms": np.mean(decode_times),
    }


def method_name(training: weights.Training) -> str:
    return training.method + ("-differences" if training.of == "differences" else "")


def method_folder(training: weights.Training) -> str:
    return f"{method_name(training)}@{training.rate_lambda:g}"


def _warm_up(exchange: Exchange, training: weights.Training, encoder, decoder) -> None:
    """The first picture through PyTorch takes longer: it does not count."""
    stream.decode(decoder, stream.encode(encoder, exchange.picture(training.of, exchange.frames[0])))


def _timed(work: Callable, *arguments: object) -> tuple:
    began = time.perf_counter()
    result = work(*arguments)
    return result, 1000 * (time.perf_counter() - began)


def _fidelity(exchange: Exchange, training: weights.Training, name: str, decoded: np.ndarray) -> float:
    frame = exchange.picture("frames", name)
    if training.of == "differences":
        decoded = differences.restored(decoded, exchange.picture("renders", name))
    return pictures.psnr(frame, decoded)


def _write(folder: Path, training: weights.Training, model: torch.nn.Module, weights_file: Path, rows: list) -> None:
    description = {
        "method": method_name(training),
        "lambda": training.rate_lambda,
        "parameters": weights.parameters(model),
        "seed": training.seed,
        "steps": training.steps,
        "of": training.of,
        "weights": weights.digest(weights_file),
        "stages": training.stages,
    }
    try:
        (folder / "method.json").write_text(json.dumps(description, indent=1) + "\n", encoding="utf-8")
        with (folder / "frames.csv").open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(["name", "bytes", "encode_ms", "decode_ms"])
            table.writerows(rows)
    except OSError as error:
        raise PaperError(f"{folder}: cannot be written: {error}") from None

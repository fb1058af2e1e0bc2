"""Weights files: a model's parameters, and how they came about."""

from __future__ import annotations

import hashlib
import os
import pickle
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from compressai.models import CompressionModel

from . import mean_scale, mlic
from .errors import ArgumentError, FileError

METHODS = {
    mean_scale.METHOD: (mean_scale.MeanScale, mean_scale.DEFAULTS),
    mlic.METHOD: (mlic.MlicPlusPlus, mlic.DEFAULTS),
}
SUBJECTS = ("frames", "differences")


@dataclass(frozen=True)
class Training:
    """How a model was trained. `steps` counts all steps since the random start, `stages` lists them."""

    method: str
    of: str
    rate_lambda: float
    seed: int
    steps: int
    size: dict[str, int]
    stages: list[dict]


def build(method: str, size: dict[str, int] | None = None) -> CompressionModel:
    """A model with random weights."""
    if method not in METHODS:
        raise ArgumentError(f"--method {method}: there are {', '.join(METHODS)}")
    model, defaults = METHODS[method]
    return model(**(size or defaults))


def save(path: Path, model: CompressionModel, training: Training) -> None:
    """Writes weights and coder tables. A cut run leaves the file from before, not half a file."""
    model.update(force=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(path.suffix + ".partial")
    torch.save({"training": asdict(training), "state": model.state_dict()}, partial)
    os.replace(partial, path)


def load(path: Path) -> tuple[CompressionModel, Training]:
    """A fresh model of the file, ready to code."""
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        training = Training(**content["training"])
        model = build(training.method, training.size)
        model.load_state_dict(content["state"])
    except FileNotFoundError:
        raise FileError(path, "there is no such weights file; `train` makes one") from None
    except (OSError, RuntimeError, KeyError, TypeError, EOFError, pickle.UnpicklingError) as error:
        raise FileError(path, f"not a weights file of these tools: {str(error).splitlines()[0]}") from None
    model.eval()
    return model, training


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def parameters(model: CompressionModel) -> int:
    return sum(values.numel() for values in model.parameters())

"""Training of a codec: rate + λ · 255² · MSE, as CompressAI (and the paper) count it."""

from __future__ import annotations

import csv
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from . import weights
from .crops import CROP, Crops
from .errors import ArgumentError

SAVE_EVERY = 250
REPORT_EVERY = 50
WARM_UP = 100


@dataclass(frozen=True)
class Plan:
    """What is trained, and for how long. After `minutes`, the run ends where it is."""

    method: str
    of: str
    rate_lambda: float
    steps: int
    seed: int
    batch: int
    learning_rate: float
    minutes: float | None
    half: bool
    start: Path | None

    def check(self) -> None:
        if self.of not in weights.SUBJECTS:
            raise ArgumentError(f"--of {self.of}: there are {', '.join(weights.SUBJECTS)}")
        if self.steps < 1 or not self.rate_lambda > 0 or not self.learning_rate > 0:
            raise ArgumentError("--steps, --lambda and --learning-rate must be above 0")
        if self.minutes is not None and not self.minutes > 0:
            raise ArgumentError("--minutes must be above 0")


def train(plan: Plan, sources: list[np.ndarray], out: Path, curve: Path) -> weights.Training:
    """Trains, writes the weights every few hundred steps and a line of the curve every 50."""
    plan.check()
    torch.manual_seed(plan.seed)
    model, size, earlier = _start(plan)
    model = model.to(memory_format=_layout(plan)).train()
    optimizer, quantiles = _optimizers(model, plan.learning_rate)
    crops = Crops(sources, plan.batch, plan.seed)
    curve.parent.mkdir(parents=True, exist_ok=True)
    with curve.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["step", "seconds", "bits_per_pixel", "psnr", "loss"])
        began, sums = time.monotonic(), np.zeros(3)
        step = 0
        while step < plan.steps:
            passed = _passed(plan, step, began)
            if passed >= 1:
                break
            for group in optimizer.param_groups:
                group["lr"] = plan.learning_rate * _rate(step, passed)
            sums += _step(model, crops.draw(), plan, optimizer, quantiles)
            step += 1
            if step % REPORT_EVERY == 0:
                bits, mse, loss = sums / REPORT_EVERY
                row = [
                    step,
                    f"{time.monotonic() - began:.0f}",
                    f"{bits:.4f}",
                    f"{-10 * math.log10(mse):.3f}",
                    f"{loss:.4f}",
                ]
                table.writerow(row)
                file.flush()
                print(*row, flush=True)
                sums = np.zeros(3)
            if step % SAVE_EVERY == 0:
                weights.save(out, model, _so_far(plan, size, earlier, step))
    done = _so_far(plan, size, earlier, step)
    weights.save(out, model, done)
    return done


def _start(plan: Plan) -> tuple[torch.nn.Module, dict[str, int], list[dict]]:
    if plan.start is None:
        return weights.build(plan.method), dict(weights.METHODS[plan.method][1]), []
    model, training = weights.load(plan.start)
    if training.method != plan.method:
        raise ArgumentError(f"--from {plan.start}: weights of {training.method}, not of {plan.method}")
    return model, training.size, training.stages


def _layout(plan: Plan) -> torch.memory_format:
    """Channels last is faster in bfloat16. In float32, PyTorch 2.15 crashes in the gradient of a 1 × 1 convolution with
    stride 2 and 3 channels."""
    return torch.channels_last if plan.half else torch.contiguous_format


def _optimizers(model: torch.nn.Module, rate: float) -> tuple[torch.optim.Optimizer, torch.optim.Optimizer]:
    main = [values for name, values in model.named_parameters() if not name.endswith(".quantiles")]
    quantiles = [values for name, values in model.named_parameters() if name.endswith(".quantiles")]
    return torch.optim.Adam(main, rate, fused=True), torch.optim.Adam(quantiles, 1e-3)


def _passed(plan: Plan, step: int, began: float) -> float:
    """Which part of the run is over: by steps, or by the clock if that is further."""
    by_clock = 0 if plan.minutes is None else (time.monotonic() - began) / (60 * plan.minutes)
    return max(step / plan.steps, by_clock)


def _rate(step: int, passed: float) -> float:
    """A short warm-up, then a cosine down to a hundredth."""
    return min(1, (step + 1) / WARM_UP) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * passed)))


def _step(model, x: torch.Tensor, plan: Plan, optimizer, quantiles) -> np.ndarray:
    """One step; bits per pixel, MSE and loss."""
    x = x.to(memory_format=_layout(plan))
    x_hat, bits = model.training_pass(x, plan.half)
    mse = torch.mean((x_hat - x) ** 2)
    rate = bits / (x.shape[0] * CROP * CROP)
    loss = rate + plan.rate_lambda * 255**2 * mse
    optimizer.zero_grad()
    quantiles.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(optimizer.param_groups[0]["params"], 1.0)
    optimizer.step()
    model.aux_loss().backward()
    quantiles.step()
    return np.array([rate.item(), mse.item(), loss.item()])


def _so_far(plan: Plan, size: dict[str, int], earlier: list[dict], steps: int) -> weights.Training:
    stage = {
        "of": plan.of,
        "lambda": plan.rate_lambda,
        "steps": steps,
        "seed": plan.seed,
        "batch": plan.batch,
        "learning_rate": plan.learning_rate,
    }
    stages = [*earlier, stage]
    return weights.Training(
        plan.method, plan.of, plan.rate_lambda, plan.seed, sum(s["steps"] for s in stages), size, stages
    )

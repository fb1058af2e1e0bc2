"""Training curves as a picture."""

from __future__ import annotations

import csv
from pathlib import Path

from .errors import FileError


def plot(curves: list[Path], out: Path) -> None:
    """One line for each curve: PSNR and bits per pixel of the crops, over the stage's steps."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (fidelity, rate) = pyplot.subplots(1, 2, figsize=(12, 5))
    for curve in curves:
        rows = _read(curve)
        steps = [float(row["step"]) for row in rows]
        fidelity.plot(steps, [float(row["psnr"]) for row in rows], label=curve.stem)
        rate.plot(steps, [float(row["bits_per_pixel"]) for row in rows], label=curve.stem)
    fidelity.set(xlabel="step of the stage", ylabel="PSNR of the training crops, dB")
    rate.set(xlabel="step of the stage", ylabel="bits per pixel")
    fidelity.legend(fontsize=7)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.tight_layout()
    figure.savefig(out, dpi=80)


def _read(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, f"cannot be read: {error}") from None
    if not rows or not {"step", "psnr", "bits_per_pixel"} <= set(rows[0]):
        raise FileError(path, "not a curve of `train`")
    return rows

"""The notebook of docs/, and the example of a coder of one's own."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")


def test_the_notebook_runs(root, monkeypatch):
    matplotlib.use("Agg")
    monkeypatch.chdir(root / "docs")
    notebook = json.loads((root / "docs/python.ipynb").read_text())
    assert len(notebook["cells"]) == 10 and not any(cell.get("outputs") for cell in notebook["cells"])
    since, names = time.monotonic(), {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "python.ipynb", "exec"), names)
    assert time.monotonic() - since < 60
    ours, jpeg = (np.array(names["curves"][name]) for name in ("ours", "jpeg"))
    assert (np.diff(ours, axis=0) > 0).all() and (np.diff(jpeg, axis=0) > 0).all(), "finer ones take more bytes"
    at = np.interp(ours[1, 1], jpeg[:, 1], jpeg[:, 0])
    assert ours[1, 0] < at / 2, "at the same PSNR"


def test_the_example_writes_what_the_laboratory_reads(root, tmp_path):
    exchange = tmp_path / "exchange"
    (exchange / "frames").mkdir(parents=True)
    generator = np.random.default_rng(5)
    for name in ("0", "b_1"):
        picture = np.kron(generator.integers(0, 256, (9, 16, 3)), np.ones((10, 10, 1))).astype(np.uint8)
        Image.fromarray(picture).save(exchange / "frames" / f"{name}.png")
    (exchange / "manifest.json").write_text(json.dumps({"frames": ["0", "b_1"]}))
    script = root / "tools/paper/examples/own_coder.py"
    subprocess.run([sys.executable, script, exchange, tmp_path / "out"], check=True)
    folders = sorted(Path(tmp_path / "out").iterdir())
    assert len(folders) == 5
    before = 0.0
    for folder in folders:
        about = json.loads((folder / "method.json").read_text())
        assert about["of"] == "frames" and about["setting"].startswith("quality ")
        with (folder / "frames.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert [row["name"] for row in rows] == ["0", "b_1"]
        assert list(rows[0]) == ["name", "bytes", "encode_ms", "decode_ms"]
        assert float(rows[0]["bytes"]) > before
        before = float(rows[0]["bytes"])
        assert Image.open(folder / "pictures/b_1.png").size == (160, 90)

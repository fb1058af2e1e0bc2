"""The codecs: real bit streams, decoded from the bytes alone; training; what a cut stream gives."""

from __future__ import annotations

import json
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from learned import crops, differences, exchange, mlic, pictures, stream, training, weights  # noqa: E402
from learned.errors import ArgumentError, FileError, StreamError  # noqa: E402

SMALL = {mlic.METHOD: {"n": 16, "m": 32, "slices": 4}, "mean-scale-hyperprior": {"n": 16, "m": 24}}


def scene(width: int, height: int) -> np.ndarray:
    """A smooth picture with some detail."""
    rows, columns = np.mgrid[:height, :width]
    waves = [np.sin(columns / (7 + 5 * c)) + np.cos(rows / (9 + 3 * c)) for c in range(3)]
    return (127 + 60 * np.stack(waves, -1)).clip(0, 255).astype(np.uint8)


def lively(method: str) -> torch.nn.Module:
    """Random weights, scaled so that latents are not all zero."""
    torch.manual_seed(2)
    model = weights.build(method, SMALL[method]).eval()
    with torch.no_grad():
        for values in model.g_a[-1].parameters():
            values.mul_(40)
    model.update(force=True)
    return model


def save(model: torch.nn.Module, method: str, path: Path) -> None:
    weights.save(path, model, weights.Training(method, "frames", 0.05, 1, 0, SMALL[method], []))


class Codecs(unittest.TestCase):
    def setUp(self) -> None:
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)

    def test_mlic_decodes_the_encoders_latents_exactly(self) -> None:
        model = lively(mlic.METHOD)
        save(model, mlic.METHOD, self.folder / "w.pt")
        decoder, _ = weights.load(self.folder / "w.pt")
        x = pictures.pad(pictures.to_tensor(scene(320, 180)))
        with torch.inference_mode():
            strings, shape, latents = model.latents(x)
            decoded = decoder.decode_latents(strings, shape)
        self.assertGreater(latents.abs().max().item(), 3)
        self.assertTrue(torch.equal(latents, decoded))

    def test_mlic_predicts_anchors_from_nothing_that_comes_later(self) -> None:
        """The first pass must not see the second one's elements, nor later slices."""
        model = lively(mlic.METHOD)
        torch.manual_seed(4)
        hyper = torch.randn(1, 32, 8, 8)
        given: list[tuple] = []

        def run(values: torch.Tensor) -> None:
            given.clear()

            def coder(index, means, scales, mask):
                given.append((means.clone(), scales.clone()))
                return values[:, index * 8 : index * 8 + 8] * mask

            with torch.inference_mode():
                model._passes(hyper, coder)

        values = torch.randn(1, 32, 8, 8)
        run(values)
        before = [pair for pair in given]
        changed = values.clone()
        changed[:, 8:16] += 5 * mlic.checkerboard(values, False)
        run(changed)
        # Passes 0 to 3: slice 0, slice 1. What is predicted up to the changed pass is as it was; later passes see it.
        for earlier, later in zip(before[:4], given[:4]):
            self.assertTrue(all(torch.equal(a, b) for a, b in zip(earlier, later)))
        self.assertFalse(torch.equal(before[4][0], given[4][0]))

    def test_streams_decode_from_the_bytes_alone(self) -> None:
        for method in weights.METHODS:
            with self.subTest(method=method):
                model = lively(method)
                save(model, method, self.folder / "w.pt")
                decoder, _ = weights.load(self.folder / "w.pt")
                for width, height in ((320, 180), (64, 64), (70, 129)):
                    pixels = scene(width, height)
                    data = stream.encode(model, pixels)
                    self.assertEqual(stream.decode(decoder, data).shape, pixels.shape)
                    np.testing.assert_array_equal(stream.decode(decoder, data), stream.decode(model, data))

    def test_a_cut_stream_is_an_error(self) -> None:
        model = lively(mlic.METHOD)
        data = stream.encode(model, scene(64, 64))
        for size in (0, 5, 6, 9):
            with self.assertRaises(StreamError):
                stream.decode(model, data[:size])

    def test_training_lowers_the_loss_and_tells_how(self) -> None:
        for method in weights.METHODS:
            with self.subTest(method=method):
                out, curve = self.folder / f"{method}.pt", self.folder / f"{method}.csv"
                plan = training.Plan(method, "frames", 0.05, 100, 3, 1, 1e-3, None, False, None)
                defaults = weights.METHODS[method]
                weights.METHODS[method] = (defaults[0], SMALL[method])
                self.addCleanup(weights.METHODS.__setitem__, method, defaults)
                training.train(plan, [scene(160, 160)], out, curve)
                rows = [line.split(",") for line in curve.read_text().split()[1:]]
                self.assertLess(float(rows[-1][-1]), float(rows[0][-1]))
                _, described = weights.load(out)
                self.assertEqual((described.steps, described.seed, described.of), (100, 3, "frames"))

    def test_errors_name_the_file(self) -> None:
        broken = self.folder / "broken.pt"
        broken.write_bytes(b"not weights")
        for path in (broken, self.folder / "none.pt"):
            with self.assertRaisesRegex(FileError, path.name):
                weights.load(path)
        pictures.write_rgb(self.folder / "small.png", scene(100, 100))
        with self.assertRaisesRegex(FileError, "small.png.*do not fit"):
            crops.of_folder(self.folder)
        with self.assertRaisesRegex(ArgumentError, "--of"):
            training.Plan("mlic++", "films", 0.1, 1, 1, 1, 1e-3, None, False, None).check()


class Differences(unittest.TestCase):
    def test_a_difference_gives_the_frame_again_within_one_level(self) -> None:
        random = np.random.default_rng(1)
        frame, render = random.integers(0, 256, (2, 40, 50, 3), dtype=np.uint8)
        again = differences.restored(differences.difference(frame, render), render)
        self.assertLessEqual(np.abs(again.astype(int) - frame).max(), 1)
        np.testing.assert_array_equal(differences.difference(frame, frame), 128)


class Exchanging(unittest.TestCase):
    def setUp(self) -> None:
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)

    def write(self, frames: list[str]) -> Path:
        path = self.folder / "exchange"
        frame, render = scene(96, 70), scene(96, 70) // 2
        for name in frames:
            pictures.write_rgb(path / "frames" / f"{name}.png", frame)
            pictures.write_rgb(path / "renders" / f"{name}.png", render)
            pictures.write_rgb(path / "differences" / f"{name}.png", differences.difference(frame, render))
        (path / "manifest.json").write_text(json.dumps({"set": "s", "width": 96, "height": 70, "frames": frames}))
        return path

    def test_a_run_writes_what_the_bench_reads(self) -> None:
        read = exchange.read(self.write(["0001", "0002"]))
        model = lively(mlic.METHOD)
        for of, name in (("frames", "mlic++@0.05"), ("differences", "mlic++-differences@0.05")):
            file = self.folder / f"{of}.pt"
            weights.save(file, model, weights.Training(mlic.METHOD, of, 0.05, 1, 7, SMALL[mlic.METHOD], []))
            row = exchange.run(read, file, self.folder / "learned")
            folder = self.folder / "learned" / name
            described = json.loads((folder / "method.json").read_text())
            self.assertEqual((described["method"], described["of"], described["steps"]), (name.split("@")[0], of, 7))
            self.assertEqual(described["weights"], weights.digest(file))
            lines = (folder / "frames.csv").read_text().split()
            self.assertEqual(lines[0], "name,bytes,encode_ms,decode_ms")
            sizes = [int(line.split(",")[1]) for line in lines[1:]]
            expected = len(stream.encode(model, read.picture(of, "0001")))
            self.assertEqual(sizes, [expected, expected])
            self.assertEqual(row["bytes"], expected)
            self.assertEqual(pictures.read_rgb(folder / "pictures" / "0002.png").shape, (70, 96, 3))

    def test_a_manifest_cannot_name_files_elsewhere(self) -> None:
        path = self.write(["0001"])
        (path / "manifest.json").write_text(json.dumps({"set": "s", "width": 96, "height": 70, "frames": ["../x"]}))
        with self.assertRaisesRegex(FileError, "manifest.json"):
            exchange.read(path)

    def test_a_picture_of_another_size_is_named(self) -> None:
        path = self.write(["0001"])
        pictures.write_rgb(path / "frames" / "0001.png", scene(64, 64))
        with self.assertRaisesRegex(FileError, "0001.png"):
            exchange.read(path).picture("frames", "0001")


if __name__ == "__main__":
    unittest.main()

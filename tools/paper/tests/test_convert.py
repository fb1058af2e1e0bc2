"""The converter: a data set with known poses, through COLMAP's files and LLFF's, and back."""

from __future__ import annotations

import json
import struct
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from learned import cameras, convert, lens, pictures  # noqa: E402
from learned.errors import ArgumentError, FileError  # noqa: E402

WIDTH, HEIGHT = 640, 360
RADIAL = (500.0, 322.0, 178.0, 0.12, 0.03)


def poses(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    random = np.random.default_rng(3)
    found = []
    for index in range(count):
        quaternion = np.array([1, *random.normal(0, 0.1, 3)])
        found.append((quaternion / np.linalg.norm(quaternion), np.array([0.3 * index, 0.1, 4.0])))
    return found


def write_colmap(folder: Path, model: int, parameters: tuple[float, ...], count: int, points: np.ndarray) -> None:
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    (sparse / "cameras.bin").write_bytes(
        struct.pack("<QiiQQ", 1, 7, model, WIDTH, HEIGHT) + struct.pack(f"<{len(parameters)}d", *parameters)
    )
    images = struct.pack("<Q", count)
    for index, (quaternion, translation) in enumerate(poses(count)):
        images += struct.pack("<i7di", index + 1, *quaternion, *translation, 7) + f"{index:03}.JPG\0".encode()
        images += struct.pack("<Qddq", 1, 1.5, 2.5, -1)
    (sparse / "images.bin").write_bytes(images)
    rows = struct.pack("<Q", len(points))
    for index, point in enumerate(points):
        rows += struct.pack("<Q3d3BdQii", index, *point, 10, 20, 30, 0.5, 1, 1, 0)
    (sparse / "points3D.bin").write_bytes(rows)


def write_pictures(folder: Path, count: int, drawn: np.ndarray) -> None:
    for index in range(count):
        pictures.write_rgb(folder / f"{index:03}.png", drawn)


class Converting(unittest.TestCase):
    def setUp(self) -> None:
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.source, self.out = Path(scratch.name) / "set", Path(scratch.name) / "out"
        self.points = np.random.default_rng(5).uniform([-1, -0.6, -0.5], [1, 0.6, 0.5], (40, 3))

    def projected(self, view: cameras.View) -> np.ndarray:
        seen = self.points @ view.rotation.T + view.translation
        return seen[:, :2] / seen[:, 2:] * [view.fx, view.fy] + [view.cx, view.cy]

    def test_a_pinhole_model_projects_points_to_the_same_pixels(self) -> None:
        write_colmap(self.source, 1, (500.0, 510.0, 322.0, 178.0), 10, self.points)
        write_pictures(self.source / "images_wb", 10, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        done = convert.convert(self.source, self.out, 320, None)
        self.assertEqual((done.pictures, done.points, done.left_out), (10, 40, []))
        run = cameras.read(self.out / "cameras.json")
        self.assertEqual((run.width, run.height), (320, 180))
        self.assertEqual([view.index for view in run.views if view.split == "test"], [0, 8])
        self.assertEqual(sum(view.split == "train" for view in run.views), 8)
        for view, (quaternion, translation) in zip(run.views, poses(10)):
            seen = self.points @ cameras.rotation_of(quaternion).T + translation
            expected = (seen[:, :2] / seen[:, 2:] * [500, 510] + [322, 178]) / 2
            np.testing.assert_allclose(self.projected(view), expected, atol=1e-9)
            self.assertEqual(pictures.read_rgb(run.picture(view)).shape, (180, 320, 3))

    def test_an_undistorted_picture_has_its_marks_where_the_pinhole_puts_them(self) -> None:
        """Marks are drawn where the distorting lens sees each point; after it, the pinhole must find them."""
        for model, parameters in [
            (3, RADIAL),
            (4, (500.0, 505.0, 322.0, 178.0, -0.08, 0.01, 0.002, -0.001)),
            (5, (500.0, 505.0, 322.0, 178.0, -0.02, 0.003, 0.0, 0.0)),
        ]:
            with self.subTest(model=lens.MODELS[model][0]), tempfile.TemporaryDirectory() as scratch:
                source, out = Path(scratch) / "set", Path(scratch) / "out"
                write_colmap(source, model, parameters, 1, self.points)
                optics = lens.Lens.of(model, WIDTH, HEIGHT, parameters)
                grid = np.array([[x, y] for x in (-0.4, -0.2, 0, 0.2, 0.4) for y in (-0.2, 0, 0.2)])
                rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
                drawn = np.zeros((HEIGHT, WIDTH))
                for x, y in optics.project(grid):
                    drawn += 250 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 3**2))
                write_pictures(source / "images", 1, np.repeat(drawn.clip(0, 255).astype(np.uint8)[..., None], 3, 2))
                convert.convert(source, out, WIDTH, None)
                view = cameras.read(out / "cameras.json").views[0]
                picture = pictures.read_rgb(out / view.file)[..., 0].astype(float)
                for x, y in grid * [view.fx, view.fy] + [view.cx, view.cy]:
                    near = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 9**2)) > 0.3
                    weight = np.where(near, picture, 0)
                    found = [(weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()]
                    np.testing.assert_allclose(found, [x, y], atol=0.25)

    def test_no_border_of_an_undistorted_picture_is_empty(self) -> None:
        for distortion in ((0.12, 0.03), (-0.2, 0.02)):
            write = self.source / f"{distortion[0]}"
            write_colmap(write, 3, (*RADIAL[:3], *distortion), 1, self.points)
            write_pictures(write / "images", 1, np.full((HEIGHT, WIDTH, 3), 200, np.uint8))
            convert.convert(write, self.out, WIDTH, None)
            view = cameras.read(self.out / "cameras.json").views[0]
            optics = lens.Lens.of(3, WIDTH, HEIGHT, (*RADIAL[:3], *distortion))
            corners = (np.array([[0, 0], [WIDTH, 0], [0, HEIGHT], [WIDTH, HEIGHT]]) - [view.cx, view.cy]) / [
                view.fx,
                view.fy,
            ]
            there = optics.project(corners)
            self.assertTrue((there >= -1e-9).all() and (there <= np.array([WIDTH, HEIGHT]) + 1e-9).all())

    def test_llff_poses_alone_give_the_same_poses(self) -> None:
        rows = []
        for quaternion, translation in poses(9):
            rotation = cameras.rotation_of(quaternion).T
            right, down, forwards = rotation.T
            matrix = np.stack([down, right, -forwards, -rotation @ translation, [HEIGHT, WIDTH, 480.0]], 1)
            rows.append([*matrix.reshape(-1), 1.0, 9.0])
        self.source.mkdir()
        np.save(self.source / "poses_bounds.npy", np.array(rows))
        write_pictures(self.source / "images_wb", 9, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        done = convert.convert(self.source, self.out, 320, None)
        self.assertIsNone(done.points)
        self.assertFalse((self.out / "points.ply").exists())
        for view, (quaternion, translation) in zip(cameras.read(done.cameras).views, poses(9)):
            seen = self.points @ cameras.rotation_of(quaternion).T + translation
            expected = seen[:, :2] / seen[:, 2:] * 240 + [160, 90]
            np.testing.assert_allclose(self.projected(view), expected, atol=1e-9)

    def test_points_are_written_with_their_colours(self) -> None:
        write_colmap(self.source, 1, (500.0, 510.0, 322.0, 178.0), 1, self.points)
        write_pictures(self.source / "images", 1, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        convert.convert(self.source, self.out, 320, None)
        header, body = (self.out / "points.ply").read_bytes().split(b"end_header\n", 1)
        self.assertIn(b"element vertex 40", header)
        rows = np.frombuffer(body, dtype=[("position", "<f4", 3), ("colour", "u1", 3)])
        np.testing.assert_allclose(rows["position"], self.points, atol=1e-6)
        self.assertEqual(rows["colour"][7].tolist(), [10, 20, 30])

    def test_errors_name_the_file(self) -> None:
        with self.assertRaisesRegex(FileError, "has no folder images_wb or images"):
            self.source.mkdir()
            convert.convert(self.source, self.out, 320, None)
        write_pictures(self.source / "images", 2, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        with self.assertRaisesRegex(FileError, "neither sparse/0/cameras.bin nor poses_bounds.npy"):
            convert.convert(self.source, self.out, 320, None)
        write_colmap(self.source, 1, (500.0, 510.0, 322.0, 178.0), 2, self.points)
        with self.assertRaisesRegex(ArgumentError, "overwrite"):
            convert.convert(self.source, self.source, 320, None)
        for name in ("cameras.bin", "images.bin", "points3D.bin"):
            file = self.source / "sparse" / "0" / name
            whole = file.read_bytes()
            for size in (0, 7, 20, len(whole) - 1):
                file.write_bytes(whole[:size])
                with self.assertRaisesRegex(FileError, name):
                    convert.convert(self.source, self.out, 320, None)
            file.write_bytes(whole)
        self.assertFalse(self.out.exists())

    def test_a_lens_that_folds_is_refused(self) -> None:
        write_colmap(self.source, 3, (200.0, 320.0, 180.0, -0.9, 0.0), 1, self.points)
        write_pictures(self.source / "images", 1, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        with self.assertRaisesRegex(FileError, "folds over"):
            convert.convert(self.source, self.out, 320, None)

    def test_a_picture_without_a_file_is_left_out_and_named(self) -> None:
        write_colmap(self.source, 1, (500.0, 510.0, 322.0, 178.0), 3, self.points)
        write_pictures(self.source / "images", 2, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        self.assertEqual(convert.convert(self.source, self.out, 320, None).left_out, ["002.JPG"])

    def test_a_camera_file_is_the_same_after_writing(self) -> None:
        write_colmap(self.source, 1, (500.0, 510.0, 322.0, 178.0), 3, self.points)
        write_pictures(self.source / "images", 3, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        done = convert.convert(self.source, self.out, 320, None)
        run = cameras.read(done.cameras)
        cameras.write(self.out / "again.json", run.width, run.height, run.views)
        first, again = (json.loads(path.read_text()) for path in (done.cameras, self.out / "again.json"))
        for left, right in zip(first["images"], again["images"]):
            np.testing.assert_allclose(left["qvec"], right["qvec"], atol=1e-12)
            self.assertEqual(left["tvec"], right["tvec"])


if __name__ == "__main__":
    unittest.main()

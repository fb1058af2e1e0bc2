"""The pose regressor: its poses, its file of renders, what it learns, the starts that it writes."""

from __future__ import annotations

import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from learned import cameras, pictures, regressor, renders  # noqa: E402
from learned.errors import FileError  # noqa: E402


def patch(pose: renders.Pose) -> np.ndarray:
    """A bright patch where the pose's camera sees the world's origin, on a gradient."""
    x, y, z = pose.translation
    rows, columns = np.mgrid[: regressor.HEIGHT, : regressor.WIDTH]
    centre = (columns - 80 - 120 * x / z) ** 2 + (rows - 45 - 120 * y / z) ** 2
    grey = 40 + rows / 2 + 160 * np.exp(-centre / (2 * (40 / z) ** 2))
    return np.repeat(grey.astype(np.uint8)[..., None], 3, 2)


def run(folder: Path, count: int) -> cameras.CameraFile:
    views = [
        cameras.View(f"{i:03}.png", i, "s", np.eye(3), np.array([0.3 * i - 0.6, 0.2, 4.0]), 240.0, 240.0, 160.0, 90.0)
        for i in range(count)
    ]
    for view in views:
        pictures.write_rgb(folder / view.file, patch(renders.Pose.of(view)))
    cameras.write(folder / "cameras.json", 320, 180, views)
    return cameras.read(folder / "cameras.json")


class Regressing(unittest.TestCase):
    def setUp(self) -> None:
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)
        self.survey = run(self.folder, 5)

    def test_rotations_come_back_from_quaternions(self) -> None:
        random = np.random.default_rng(1)
        for _ in range(50):
            rotation = renders.rotation_vector(random.normal(0, 2, 3))
            np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
            np.testing.assert_allclose(cameras.rotation_of(cameras.quaternion_of(rotation)), rotation, atol=1e-12)

    def test_random_poses_stay_near_the_survey(self) -> None:
        poses = regressor.random_poses(self.survey, 4.0, 300, np.random.default_rng(1))
        survey = [renders.Pose.of(view) for view in self.survey.views]
        away = [min(regressor.distance(pose, place) for place in survey) for _, pose in poses]
        self.assertLess(np.median(away), 0.2 * 4)
        self.assertGreater(np.median(away), 0.02 * 4)

    def test_it_learns_poses_of_renders_and_starts_frames(self) -> None:
        poses = regressor.random_poses(self.survey, 4.0, 120, np.random.default_rng(1))
        drawn = regressor.Renders(
            np.stack([patch(pose) for _, pose in poses]),
            np.stack([p.rotation for _, p in poses]),
            np.stack([p.translation for _, p in poses]),
            4.0,
        )
        untrained = regressor.train(drawn, 1, None, 1, self.folder / "none.csv")
        trained = regressor.train(drawn, 120, None, 1, self.folder / "curve.csv")
        found = regressor.starts(trained, self.survey)
        before = regressor.starts(untrained, self.survey)
        self.assertLess(sum(start.depths for start in found), 0.5 * sum(start.depths for start in before))
        regressor.write_starts(found, self.folder / "starts.csv")
        lines = (self.folder / "starts.csv").read_text().split()
        self.assertEqual(lines[0], "name,qw,qx,qy,qz,tx,ty,tz")
        name, *numbers = lines[3].split(",")
        self.assertEqual(name, "002")
        rotation = cameras.rotation_of(np.array([float(value) for value in numbers[:4]]))
        centre = -rotation.T @ np.array([float(value) for value in numbers[4:]])
        np.testing.assert_allclose(centre, regressor.centre_of(found[2].pose), atol=1e-6)

    def test_a_broken_file_of_renders_is_named(self) -> None:
        (self.folder / "renders.npz").write_bytes(b"nothing")
        with self.assertRaisesRegex(FileError, "renders.npz"):
            regressor.read(self.folder / "renders.npz")

    def test_rotations_of_the_network_are_rotations(self) -> None:
        torch.manual_seed(1)
        _, rotation = regressor.PoseRegressor().eval()(torch.randn(4, 3, regressor.HEIGHT, regressor.WIDTH))
        product = rotation @ rotation.transpose(1, 2)
        self.assertTrue(torch.allclose(product, torch.eye(3).expand(4, 3, 3), atol=1e-5))
        self.assertTrue(torch.allclose(torch.linalg.det(rotation), torch.ones(4), atol=1e-5))


if __name__ == "__main__":
    unittest.main()

"""Renders of the prior, by the package `nvsprior`."""

from __future__ import annotations

import dataclasses
import sys
import unittest
from pathlib import Path

import numpy as np

import nvsprior

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from learned import cameras, renders  # noqa: E402
from learned.errors import PaperError  # noqa: E402

PRIOR = Path(__file__).resolve().parents[3] / "tools/basin/prior.nvsg"


def run() -> cameras.CameraFile:
    """Views at three of the prior's key frames."""
    poses = nvsprior.Prior.open(PRIOR).key_frames[:3]
    views = [
        cameras.View(f"{i}.png", i, None, pose.matrix()[:3, :3], pose.translation, 140.0, 140.0, 80.0, 45.0)
        for i, pose in enumerate(poses)
    ]
    return cameras.CameraFile(Path("cameras.json"), 160, 90, views)


class Rendering(unittest.TestCase):
    def test_each_view_is_drawn_by_its_camera_at_its_pose(self) -> None:
        survey = run()
        first, second = survey.views[:2]
        narrow = dataclasses.replace(second, fx=2 * second.fx)
        places = [(view, renders.Pose.of(view)) for view in (first, narrow, second)]
        drawn = list(renders.Renderer(PRIOR).colours(survey, places))
        engine, prior = nvsprior.Engine(), nvsprior.Prior.open(PRIOR)
        for (view, _), picture in zip(places, drawn):
            camera = nvsprior.Camera(160, 90, view.fx, view.fy, view.cx, view.cy)
            pose = nvsprior.Pose(view.quaternion, view.translation)
            np.testing.assert_array_equal(picture, nvsprior.Renderer(engine, prior, camera).render(pose))
        self.assertFalse(np.array_equal(drawn[1], drawn[2]))

    def test_the_depth_is_that_of_what_is_shown(self) -> None:
        survey = run()
        depth = renders.Renderer(PRIOR).median_depth(survey, survey.views[0])
        positions = depth * survey.views[0].rotation[2] + survey.views[0].centre
        self.assertGreater(depth, 0.5)
        self.assertLess(np.linalg.norm(positions), 20)
        away = dataclasses.replace(survey.views[0], translation=np.array([0, 0, -1e4]))
        with self.assertRaisesRegex(PaperError, "prior.nvsg: shows nothing at the pose of 0.png"):
            renders.Renderer(PRIOR).median_depth(survey, away)

    def test_a_failure_is_named(self) -> None:
        with self.assertRaisesRegex(PaperError, "nowhere.ply"):
            renders.Renderer(Path("nowhere.ply"))
        survey = run()
        broken = dataclasses.replace(survey.views[0], fx=-1.0)
        with self.assertRaisesRegex(PaperError, "0.png: camera fx = -1"):
            list(renders.Renderer(PRIOR).colours(survey, [(broken, renders.Pose.of(broken))]))


if __name__ == "__main__":
    unittest.main()

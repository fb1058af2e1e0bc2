"""What is expected of objects in Python: they are pickled, copied, compared, hashed, and made of arrays."""

from __future__ import annotations

import copy
import multiprocessing
import pickle

import numpy as np
import pytest

import nvsprior


def again(value):
    """All ways that a value comes back."""
    ways = [pickle.loads(pickle.dumps(value, protocol)) for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)]
    return [*ways, copy.copy(value), copy.deepcopy(value)]


def values() -> list:
    generator = np.random.default_rng(7)
    rows = generator.normal(size=(6, 6))
    poses = [nvsprior.Pose(generator.normal(size=4), generator.normal(size=3)) for _ in range(200)]
    poses += [nvsprior.Pose.from_matrix(pose.matrix()) for pose in poses] + [nvsprior.Pose()]
    for _ in range(300):  # Each step rounds.
        poses.append(poses[-1].stepped(0.1 * generator.normal(size=6)))
    hints = [
        nvsprior.Hint(poses[0]),
        nvsprior.Hint(poses[1], covariance=rows @ rows.T, age=0.25),
        nvsprior.Hint(poses[2], deviation=[0.1, np.inf, 0.3, 0.01, 0.02, np.inf]),
    ]
    return [nvsprior.Camera(320, 180, 274.4, 274.1, 160.3, 90), *poses, *hints]


def test_values_come_back_to_the_last_bit():
    for value in values():
        for other in again(value):
            assert other == value and hash(other) == hash(value) and type(other) is type(value)
    pose = values()[1]
    assert eval(repr(pose), {"Pose": nvsprior.Pose}) == pose


def test_values_are_keys():
    found = {value: place for place, value in enumerate(values())}
    assert len(found) > len(values()) / 2, "some matrices give the same pose again"
    all_of_them = values()
    for value in values():
        assert all_of_them[found[value]] == value
    zero, negative = (nvsprior.Pose(translation=[sign * 0.0, 1, 2]) for sign in (1, -1))
    assert zero == negative and hash(zero) == hash(negative)
    zero, negative = (nvsprior.Camera(8, 8, 9, 9, sign * 0.0, 4) for sign in (1, -1))
    assert zero == negative and hash(zero) == hash(negative)
    pose = nvsprior.Pose()
    assert nvsprior.Hint(pose) != nvsprior.Hint(pose, age=1.0) != pose
    assert nvsprior.Hint(pose) != nvsprior.Hint(pose, deviation=[0.1] * 6)
    assert nvsprior.Hint(pose).covariance is None
    assert np.allclose(nvsprior.Hint(pose, deviation=[0.1] * 6).covariance, 0.01 * np.eye(6))


def same(a: object, b: object) -> bool:
    names = [name for name in dir(a) if not name.startswith("_")]
    for name in names:
        one, other = getattr(a, name), getattr(b, name)
        if isinstance(one, np.ndarray):
            if one.dtype != other.dtype or not np.array_equal(one, other):
                return False
        elif isinstance(one, Exception):
            if type(one) is not type(other) or str(one) != str(other):
                return False
        elif one != other:
            return False
    return len(names) > 5 and type(a) is type(b)


def test_what_calls_give_is_pickled_and_copied(engine, prior, camera, poses, frames):
    encoded = nvsprior.Encoder(engine, prior, camera).encode(frames[0], poses[0])
    decoder = nvsprior.Decoder(engine, prior)
    damaged = bytearray(encoded.packet)
    damaged[-1] ^= 1
    [received] = nvsprior.join(nvsprior.split(encoded.packet, 64), 64)
    for value in (encoded, decoder.decode(encoded.packet), decoder.decode(damaged), received):
        for other in again(value):
            assert same(other, value), repr(value)
    assert isinstance(decoder.decode(damaged).damage, nvsprior.ResidualError)
    with pytest.raises(TypeError, match="packet is missing"):
        nvsprior.Encoded()


def decoded_in_worker(path: str, packet: bytes) -> nvsprior.Decoded:
    return nvsprior.Decoder(nvsprior.Engine(), nvsprior.Prior.open(path)).decode(packet)


def test_spawned_workers_get_and_give_them(engine, prior, camera, poses, frames, root):
    encoded = nvsprior.Encoder(engine, prior, camera).encode(frames[0], poses[0])
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        [decoded] = pool.starmap(decoded_in_worker, [(str(root / "tools/basin/prior.nvsg"), encoded.packet)])
    assert np.array_equal(decoded.picture, encoded.picture) and decoded.pose == encoded.pose


def test_bytes_come_in_any_object_that_has_them(engine, prior, camera, poses, frames):
    packet = nvsprior.Encoder(engine, prior, camera).encode(frames[0], poses[0]).packet
    array = np.frombuffer(packet, np.uint8)
    gaps = np.repeat(array, 2)[::2]
    due = nvsprior.Decoder(engine, prior).decode(packet).picture
    for given in (bytearray(packet), memoryview(packet), memoryview(bytes(2) + packet)[2:], array, gaps):
        decoder = nvsprior.Decoder(engine, prior)
        assert np.array_equal(decoder.decode(given).picture, due)
        assert decoder.pose_of(given) == decoder.pose_of(packet)
        assert nvsprior.split(given, 64) == nvsprior.split(packet, 64)
    for wrong in ("text", [1, 2], 7, np.zeros(9), None):
        with pytest.raises(TypeError, match="an object with bytes .* is due, not"):
            decoder.decode(wrong)


def test_a_pose_may_be_a_matrix(engine, prior, camera, poses, frames):
    renderer = nvsprior.Renderer(engine, prior, camera)
    matrix, pose = poses[0].matrix(), nvsprior.Pose.from_matrix(poses[0].matrix())
    due = renderer.render(pose)
    for given in (matrix, matrix[:3], matrix.tolist(), np.asfortranarray(matrix)):
        assert np.array_equal(renderer.render(given), due)
    assert np.array_equal(renderer.render_raw(matrix), renderer.render_raw(pose))
    packets = [nvsprior.Encoder(engine, prior, camera).encode(frames[0], hint).packet for hint in (pose, matrix)]
    assert packets[0] == packets[1]
    assert nvsprior.Hint(matrix) == nvsprior.Hint(pose)
    decoder = nvsprior.Decoder(engine, prior)
    decoder.decode(packets[0])
    assert np.array_equal(decoder.draw(matrix), decoder.draw(pose))
    assert prior.with_key_frames(np.stack([matrix] * 3)).key_frames == [pose] * 3
    for wrong in (2 * matrix, matrix[::-1], np.full((4, 4), np.nan), np.eye(3)):
        for call in (lambda: renderer.render(wrong), lambda: nvsprior.Hint(wrong), lambda: decoder.draw(wrong)):
            with pytest.raises(nvsprior.ArgumentError, match="^pose: "):
                call()
    with pytest.raises(TypeError, match="pose: a Pose or a 4x4 array, world to camera, is due, not str"):
        renderer.render_raw("north")
    with pytest.raises(TypeError, match="hint: a Pose, a Hint or a 4x4 array, world to camera, is due, not list"):
        nvsprior.Encoder(engine, prior, camera).encode(frames[0], [0.0] * 7)


def test_many_poses_are_drawn_at_once(engine, prior, camera, poses):
    renderer = nvsprior.Renderer(engine, prior, camera)
    due = np.stack([renderer.render(nvsprior.Pose.from_matrix(pose.matrix())) for pose in poses[:3]])
    matrices = np.stack([pose.matrix() for pose in poses[:3]])
    again = [nvsprior.Pose.from_matrix(matrix) for matrix in matrices]
    for given in (matrices, list(matrices), np.asfortranarray(matrices), again, matrices[:, :3]):
        assert np.array_equal(renderer.render(given), due)
    out = np.zeros((6, *due.shape[1:]), np.uint8)[::2]
    assert renderer.render(matrices, out=out) is out and np.array_equal(out, due)
    assert renderer.render([]).shape == (0, 96, 160, 3)
    with pytest.raises(nvsprior.ArgumentError, match=r"poses\[1\]: no rigid motion"):
        renderer.render(matrices * np.array([1, 2, 1]).reshape(3, 1, 1))
    with pytest.raises(nvsprior.ArgumentError, match="out: "):
        renderer.render(matrices, out=out[:2])


def test_the_error_has_its_derivatives(engine, prior, camera, poses, frames):
    renderer = nvsprior.Renderer(engine, prior, camera)
    frame = renderer.render(poses[0])
    pose = poses[0].stepped([0.002, -0.001, 0.001, 0.0005, 0.001, -0.001])
    mse, gradient, second = renderer.derivatives(frame, pose)
    assert gradient.shape == (6,) and second.shape == (6, 6) and np.allclose(second, second.T)
    assert mse == pytest.approx(np.mean((renderer.render(pose) / 255.0 - frame / 255.0) ** 2), rel=0.05)
    for axis in range(6):
        step = 1e-3 * np.eye(6)[axis]
        ahead, behind = (renderer.derivatives(frame, pose.stepped(sign * step))[0] for sign in (1, -1))
        assert gradient[axis] == pytest.approx((ahead - behind) / 2e-3, rel=0.1, abs=0.02 * abs(gradient).max())
    newton = pose.stepped(-np.linalg.solve(second, gradient))
    assert renderer.derivatives(frame, newton)[0] < mse / 4
    with pytest.raises(nvsprior.ArgumentError, match="frame of 80×96"):
        renderer.derivatives(frame[:, :80], pose)
    assert np.array_equal(renderer.render(poses[0]), frame), "it goes on"


def test_a_prior_is_made_of_arrays(engine, prior, camera, poses, root, tmp_path):
    raw = prior.arrays(raw=True)
    count = len(prior)
    assert {name: array.shape for name, array in raw.items()} == {
        "means": (count, 3),
        "scales": (count, 3),
        "quats": (count, 4),
        "opacities": (count,),
        "sh": (count, raw["sh"].shape[1], 3),
    }
    back = nvsprior.Prior.from_arrays(**raw, raw=True, like=prior)
    assert back.id == prior.id and back.key_frames == prior.key_frames
    fortran = {name: np.asfortranarray(array.astype(np.float64)) for name, array in raw.items()}
    assert nvsprior.Prior.from_arrays(**fortran, raw=True, like=prior).id == prior.id
    prior.save(tmp_path / "copy.ply")
    copy = nvsprior.Prior.open(tmp_path / "copy.ply")
    assert nvsprior.Prior.from_arrays(**copy.arrays(raw=True), raw=True, like=copy).id == copy.id
    active = prior.arrays()
    assert np.allclose(active["scales"], np.exp(raw["scales"]), rtol=1e-5)
    assert np.allclose(active["opacities"], 1 / (1 + np.exp(-raw["opacities"])), atol=1e-6)
    assert np.allclose(np.linalg.norm(active["quats"], axis=1), 1, atol=1e-6)
    near = nvsprior.Prior.from_arrays(**active, like=prior)
    pictures = [nvsprior.Renderer(engine, p, camera).render(poses[0]) for p in (prior, near)]
    assert nvsprior.psnr(*pictures) > 50
    part = {name: array[:100] for name, array in raw.items()}
    assert len(nvsprior.Prior.from_arrays(**part, raw=True)) == 100


def test_wrong_arrays_of_a_prior_are_named():
    good = {"means": np.zeros((2, 3)), "scales": np.ones((2, 3)), "quats": np.ones((2, 4))}
    good |= {"opacities": np.full(2, 0.5), "sh": np.zeros((2, 4, 3))}
    assert len(nvsprior.Prior.from_arrays(**good)) == 2
    for name, array in [
        ("means", np.zeros((2, 4))),
        ("scales", np.ones((3, 3))),
        ("quats", np.ones((2, 3))),
        ("opacities", np.ones((2, 1))),
        ("sh", np.zeros((2, 5, 3))),
        ("sh", np.zeros((2, 12))),
    ]:
        with pytest.raises(nvsprior.ArgumentError, match=f"^{name}: an array of shape"):
            nvsprior.Prior.from_arrays(**{**good, name: array})
    with pytest.raises(TypeError, match="means: rows of 3 numbers"):
        nvsprior.Prior.from_arrays(**{**good, "means": "none"})
    with pytest.warns(UserWarning, match="1 splat"):
        good["scales"] = np.array([[1, 1, 1], [1, -1, 1]])
        assert len(nvsprior.Prior.from_arrays(**good)) == 1


PLACE = np.array([512_345.25, 5_932_101.5, -37.125])


def test_a_scene_far_from_the_origin_keeps_its_digits(engine, prior, camera):
    near = prior.arrays()
    far = nvsprior.Prior.from_arrays(**{**near, "means": near["means"].astype(np.float64) + PLACE})
    assert np.abs(np.array(far.origin) - PLACE).max() < 100 and prior.origin == (0, 0, 0)
    means = far.arrays()["means"].astype(np.float64) + far.origin
    assert np.abs(means - PLACE - near["means"]).max() < 1e-5
    raw = far.arrays(raw=True)
    assert nvsprior.Prior.from_arrays(**raw, raw=True, like=far).id == far.id
    pose = prior.key_frames[0]
    there = nvsprior.Pose(pose.rotation, pose.translation - pose.matrix()[:3, :3] @ PLACE)
    same = nvsprior.Prior.from_arrays(**near)
    pictures = [
        nvsprior.Renderer(engine, scene, camera).render(at) for scene, at in [(same, pose), (far, there)]
    ]
    assert nvsprior.psnr(*pictures) > 50
    with_keys = far.with_key_frames([there])
    assert np.abs(with_keys.key_frames[0].centre - there.centre).max() < 1e-6
    frame = pictures[0]
    encoded = nvsprior.Encoder(engine, far, camera).encode(frame, there)
    assert encoded.certain and np.abs(encoded.pose.centre - there.centre).max() < 0.1
    decoded = nvsprior.Decoder(engine, far).decode(encoded.packet)
    assert np.abs(decoded.pose.centre - encoded.pose.centre).max() < 1e-6

"""Poses, cameras, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import nvsprior


def test_poses_and_matrices():
    pose = nvsprior.Pose((0.9, 0.1, -0.3, 0.2), [1, 2, 3])
    matrix = pose.matrix()
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3))
    for given in (matrix, matrix[:3], matrix.tolist(), matrix.astype(np.float32)):
        again = nvsprior.Pose.from_matrix(given)
        assert np.allclose(again.matrix(), matrix, atol=1e-6)
    assert np.allclose(pose.centre, -matrix[:3, :3].T @ [1, 2, 3])
    assert np.allclose(pose.inverse().matrix() @ matrix, np.eye(4))
    step = np.array([0.1, 0, -0.2, 0.02, 0.01, -0.03])
    stepped = pose.stepped(step)
    assert np.allclose(pose.between(stepped, 0.5).matrix(), pose.stepped(step / 2).matrix())
    assert nvsprior.Pose() == nvsprior.Pose.from_matrix(np.eye(4)) != pose


@pytest.mark.parametrize(
    "matrix", [2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.eye(3), np.full((3, 4), np.nan), np.eye(4)[::-1]]
)
def test_what_is_no_pose_is_refused(matrix):
    with pytest.raises(nvsprior.ArgumentError, match="^matrix: "):
        nvsprior.Pose.from_matrix(matrix)


def test_wrong_numbers_are_named(camera):
    with pytest.raises(nvsprior.ArgumentError, match="rotation: .*zero"):
        nvsprior.Pose((0, 0, 0, 0))
    with pytest.raises(ValueError, match="translation: .*finite"):
        nvsprior.Pose(translation=[0, np.inf, 0])
    with pytest.raises(TypeError, match="rotation"):
        nvsprior.Pose("north")
    with pytest.raises(nvsprior.CameraError, match="fx = -1"):
        nvsprior.Camera(320, 180, -1, 274, 160, 90)
    with pytest.raises(nvsprior.CameraError, match="9000"):
        camera.resized(9000, 10)
    pose = nvsprior.Pose()
    with pytest.raises(nvsprior.ArgumentError, match="covariance"):
        nvsprior.Hint(pose, covariance=-np.eye(6))
    with pytest.raises(nvsprior.ArgumentError, match="age: NaN"):
        nvsprior.Hint(pose, age=np.nan)
    assert nvsprior.Hint(pose, deviation=[0.1] * 6, age=0.5).age == 0.5


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"quality": 101}, "quality: 101"),
        ({"quality": float("nan")}, "quality"),
        ({"psnr": -1}, "psnr"),
        ({"quality": 10, "bytes": 100}, "give one of them"),
        ({"stream": "often"}, 'stream: "often", but there are "chain"'),
        ({"threshold": float("nan")}, "threshold"),
        ({"tune": "vmaf"}, "tune"),
    ],
)
def test_wrong_options_are_named(engine, prior, camera, options, text):
    with pytest.raises(nvsprior.ArgumentError, match=text):
        nvsprior.Encoder(engine, prior, camera, **options)


def test_wrong_arrays_are_named(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    frame = frames[0]
    with pytest.raises(TypeError, match="frame: dtype float64, but uint8"):
        encoder.encode(frame / 255.0, poses[0])
    with pytest.raises(TypeError, match="frame: a NumPy array is due"):
        encoder.encode(frame.tolist(), poses[0])
    with pytest.raises(nvsprior.ArgumentError, match=r"frame: .*\[96, 160, 4\]"):
        encoder.encode(np.zeros((96, 160, 4), np.uint8), poses[0])
    with pytest.raises(nvsprior.ArgumentError, match="frame of 80×96 pixels for a camera of 160×96"):
        encoder.encode(np.ascontiguousarray(frame[:, :80]), poses[0])
    with pytest.raises(TypeError, match="hint"):
        encoder.encode(frame, hint=[0.0] * 7)
    with pytest.raises(nvsprior.ArgumentError, match=r"mask: .*\[96, 160\]"):
        encoder.set_mask(np.ones((3, 4), bool))
    with pytest.raises(nvsprior.ArgumentError, match="no pixel counts"):
        encoder.set_mask(np.zeros((96, 160), bool))
    for out, text in [
        (np.zeros((96, 80, 3), np.uint8), "out: .*shape"),
        (np.zeros((160, 96, 3), np.uint8).transpose(1, 0, 2), "out: .*contiguous"),
        (frame, "out: .*writeable"),
    ]:
        with pytest.raises(nvsprior.ArgumentError, match=text):
            encoder.encode(frame, poses[0], out=out)
    assert encoder.encode(frame, poses[0]).frame == 0, "what was refused changed nothing"


def test_errors_have_the_librarys_texts(engine, prior, camera, frames, root, tmp_path):
    bare = prior.with_key_frames([])
    with pytest.raises(nvsprior.NoStartError, match="no pose to start from"):
        nvsprior.Encoder(engine, bare, camera).encode(frames[0])
    with pytest.raises(nvsprior.ArgumentError, match="before that of an earlier frame"):
        encoder = nvsprior.Encoder(engine, prior, camera)
        encoder.encode(frames[0], prior.key_frames[10], time=1.0)
        encoder.encode(frames[1], time=0.5)
    with pytest.raises(nvsprior.FileError, match="nowhere.ply") as raised:
        nvsprior.Prior.open(tmp_path / "nowhere.ply")
    assert isinstance(raised.value, OSError)
    with pytest.raises(nvsprior.PriorError, match="^odd: "):
        nvsprior.Prior.from_bytes(b"no prior", "odd")
    with pytest.raises(nvsprior.DeviceError, match="no such device"):
        nvsprior.Engine("no such device")
    decoder = nvsprior.Decoder(engine, prior, pixel_limit=100)
    with pytest.raises(nvsprior.PacketError, match="latent part: damaged, its check does not match"):
        decoder.decode(b"a" * 40)
    encoder = nvsprior.Encoder(engine, prior, camera)
    encoded = encoder.encode(frames[0], prior.key_frames[10])
    later = encoder.encode(frames[1])
    with pytest.raises(nvsprior.LimitError, match="at most 100 pixels"):
        decoder.decode(encoded.packet)
    other = nvsprior.Prior.open(root / "tests/vectors/prior.ply")
    decoder = nvsprior.Decoder(engine, other)
    with pytest.raises(nvsprior.CameraUnknownError, match="the packet that states them is missing"):
        decoder.decode(later.packet)
    with pytest.raises(nvsprior.OtherPriorError, match=prior.id):
        decoder.decode(encoded.packet)
    with pytest.raises(nvsprior.OtherPriorError, match="wait for one that states this prior"):
        decoder.decode(later.packet)
    damaged = bytearray(encoded.packet)
    damaged[-1] ^= 1
    decoded = nvsprior.Decoder(engine, prior).decode(bytes(damaged))
    assert isinstance(decoded.damage, nvsprior.ResidualError) and "check" in str(decoded.damage)
    assert all(issubclass(getattr(nvsprior, name), nvsprior.Error) for name in dir(nvsprior) if name.endswith("Error"))


def test_priors_are_kept(prior, root, tmp_path):
    assert len(prior) == 60_000 and prior.format == "compact prior" and prior.dropped == []
    content = (root / "tools/basin/prior.nvsg").read_bytes()
    assert nvsprior.Prior.from_bytes(content).id == prior.id
    prior.save(tmp_path / "copy.ply")
    copy = nvsprior.Prior.open(tmp_path / "copy.ply")
    assert len(copy) == len(prior) and len(copy.key_frames) == len(prior.key_frames)
    prior.save(tmp_path / "copy.nvsg")
    assert len(nvsprior.Prior.open(tmp_path / "copy.nvsg")) == len(prior)
    with pytest.raises(nvsprior.ArgumentError, match="path: .*copy.txt"):
        prior.save(tmp_path / "copy.txt")



def test_what_a_file_says_beyond_the_format_is_told():
    head = "ply\nformat ascii 1.0\nelement vertex 1\n"
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3", "temperature"]
    text = head + "".join(f"property float {name}\n" for name in names) + "end_header\n" + "1 " * len(names)
    with pytest.warns(UserWarning, match='"temperature" is not known here'):
        nvsprior.Prior.from_bytes(text.encode())


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("width", lambda given: nvsprior.Camera(-1, 8, 9, 9, 4, 4)),
        ("height", lambda given: given.camera.resized(8, 2**32)),
        ("memory_limit", lambda given: nvsprior.Engine(memory_limit=-1)),
        ("key_every", lambda given: given.encoder(key_every=-1)),
        ("first_frame", lambda given: given.encoder(first_frame=2**40)),
        ("bytes", lambda given: given.encoder(bytes=-5)),
        ("steady_bytes", lambda given: given.encoder().set_rate(steady_bytes=-5)),
        ("region", lambda given: given.encoder().set_region((0, -1, 4, 4))),
        ("weight", lambda given: given.encoder().set_region((0, 0, 4, 4), 256)),
        ("frame", lambda given: given.encoder().acknowledge(-1)),
        ("frames", lambda given: given.encoder().skip(-1)),
        ("most", lambda given: given.encoder().prepare(-1)),
        ("pixel_limit", lambda given: nvsprior.Decoder(given.engine, given.prior, pixel_limit=-1)),
        ("tag_bytes", lambda given: nvsprior.Keys("0" * 64, tag_bytes=-1)),
        ("seed", lambda given: nvsprior.Channel(bit_rate=1.0, seed=-1)),
        ("stream", lambda given: nvsprior.VehicleLink(64, 100.0, 1.0, stream=256)),
        ("max_shares", lambda given: nvsprior.Topside(given.engine, given.prior, 64, max_shares=-1)),
        ("iterations", lambda given: nvsprior.map(given.engine, [], given.camera, [], iterations=-1)),
        ("mtu", lambda given: nvsprior.split(b"", -1)),
    ],
)
def test_numbers_out_of_range_are_named(engine, prior, camera, name, call):
    class Given:
        def encoder(self, **options):
            return nvsprior.Encoder(engine, prior, camera, **options)

    given = Given()
    given.engine, given.prior, given.camera = engine, prior, camera
    with pytest.raises(nvsprior.ArgumentError, match=f"^{name}: -?[0-9]+, must be a whole number from 0 to"):
        call(given)


def test_devices_have_numbers(engine):
    assert nvsprior.Engine(0).device == nvsprior.devices()[0]
    with pytest.raises(nvsprior.DeviceError, match='"99"'):
        nvsprior.Engine(99)
    with pytest.raises(TypeError, match="device: a number, a part of a name or None is due, not list"):
        nvsprior.Engine([0])
    with pytest.raises(TypeError, match='bit_rate: a number, "pull" or None is due, not list'):
        nvsprior.VehicleLink(64, [1], 1.0)


def test_it_is_said_how_an_array_becomes_a_picture(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    for dtype, advice in [
        (np.float32, r"multiply by 255, round, and `astype\(np.uint8\)`"),
        (bool, "multiply by 255"),
        (np.int64, "if values lie in 0 to 255"),
        (np.uint16, "divide by 257"),
    ]:
        with pytest.raises(TypeError, match=f"frame: dtype {np.dtype(dtype)}, but uint8 is due: .*{advice}"):
            encoder.encode(frames[0].astype(dtype), poses[0])


def test_a_hint_takes_what_frames_give(engine, prior, camera, poses, frames):
    """While nothing is known of a pose, its covariance is infinite."""
    lost = nvsprior.Encoder(engine, prior, camera).encode(np.full_like(frames[0], 90), poses[0])
    assert not lost.certain and np.isinf(np.diag(lost.covariance)).any()
    assert np.array_equal(nvsprior.Hint(lost.pose, lost.covariance).covariance, lost.covariance)
    hint = nvsprior.Hint(lost.pose, deviation=[0.1, np.inf, 0.1, 0.01, 0.01, np.inf])
    assert nvsprior.Encoder(engine, prior, camera).encode(frames[0], hint).frame == 0
    for wrong in ({"covariance": np.full((6, 6), np.nan)}, {"deviation": [0.1] * 5 + [np.nan]}):
        with pytest.raises(nvsprior.ArgumentError, match=next(iter(wrong))):
            nvsprior.Hint(lost.pose, **wrong)

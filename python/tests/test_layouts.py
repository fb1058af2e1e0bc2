"""Every argument that is an array takes it in every layout."""

from __future__ import annotations

import itertools

import numpy as np

import nvsprior


def layouts(array: np.ndarray):
    """The same values in other places of memory."""
    for axes in itertools.permutations(range(array.ndim)):
        back = np.argsort(axes)
        yield f"axes {axes}", np.ascontiguousarray(array.transpose(axes)).transpose(back)
    for axis in range(array.ndim):
        yield f"backwards along {axis}", np.flip(np.ascontiguousarray(np.flip(array, axis)), axis)
        gaps = np.repeat(array, 3, axis)
        every_third = [slice(1, None, 3) if i == axis else slice(None) for i in range(array.ndim)]
        yield f"gaps along {axis}", gaps[tuple(every_third)]
    yield "an odd place", np.frombuffer(b"\0" + array.tobytes(), np.uint8)[1:].view(array.dtype).reshape(array.shape)
    fixed = np.ascontiguousarray(array).copy()
    fixed.flags.writeable = False
    yield "read-only", fixed
    if array.dtype.itemsize > 1:
        yield "bytes in the other order", array.astype(array.dtype.newbyteorder())


def arguments(engine, prior, camera, poses, frames, path) -> dict:
    """For each argument an array, and what a call makes of it."""
    generator = np.random.default_rng(11)
    rows = generator.normal(size=(6, 6))
    mask = np.ones(frames[0].shape[:2], bool)
    mask[:20, 30:] = False
    part = {name: array[:50] for name, array in prior.arrays(raw=True).items()}
    renderer, decoder = nvsprior.Renderer(engine, prior, camera), nvsprior.Decoder(engine, prior)
    few, matrices = frames[:2], np.stack([pose.matrix() for pose in poses[:2]])
    noisy = np.clip(frames[0].astype(int) + generator.integers(-9, 10, frames[0].shape), 0, 255).astype(np.uint8)

    def encoded(frame=frames[0], mask=None, hint=poses[0]) -> bytes:
        encoder = nvsprior.Encoder(engine, prior, camera)
        encoder.set_mask(mask)
        return encoder.encode(frame, hint).packet

    def mapped(pictures=few, poses=poses[:2], **options) -> str:
        return nvsprior.map(engine, pictures, camera, poses, splats=300, iterations=6, **options).id

    def background(values) -> str:
        return nvsprior.Prior.open(path, background=values).id

    def from_arrays(arrays) -> str:
        return nvsprior.Prior.from_arrays(**arrays, raw=True).id

    decoder.decode(encoded())
    points = generator.normal(size=(40, 3)) + poses[0].centre
    made = {
        "frame": (frames[0], encoded),
        "mask": (mask, lambda given: encoded(mask=given)),
        "mask of bytes": (mask.astype(np.uint8) * 255, lambda given: encoded(mask=given)),
        "hint": (matrices[0], lambda given: encoded(hint=given)),
        "pictures": (np.stack(few), mapped),
        "one picture": (frames[0], lambda given: mapped([given], poses[:1])),
        "masks": (mask, lambda given: mapped(masks=[given, None])),
        "poses": (matrices, lambda given: mapped(poses=given)),
        "points": (points, lambda given: mapped(points=given, colours=np.full((40, 3), 0.5))),
        "colours": (abs(points) / 9, lambda given: mapped(points=points, colours=given)),
        "rotation": (np.array([0.9, 0.1, -0.3, 0.2]), nvsprior.Pose),
        "translation": (points[0], lambda given: nvsprior.Pose(translation=given)),
        "matrix": (matrices[0], nvsprior.Pose.from_matrix),
        "step": (rows[0] / 9, poses[0].stepped),
        "other": (matrices[1], lambda given: poses[0].between(given, 0.5)),
        "covariance": (rows @ rows.T, lambda given: nvsprior.Hint(poses[0], covariance=given)),
        "deviation": (abs(rows[0]), lambda given: nvsprior.Hint(poses[0], deviation=given)),
        "rendered": (matrices[0], lambda given: renderer.render(given).tobytes()),
        "many rendered": (matrices, lambda given: renderer.render(given).tobytes()),
        "raw": (matrices[0], lambda given: renderer.render_raw(given).tobytes()),
        "derivatives": (noisy, lambda given: [str(part) for part in renderer.derivatives(given, poses[0])]),
        "drawn": (matrices[0], lambda given: decoder.draw(given).tobytes()),
        "key frames": (matrices, lambda given: prior.with_key_frames(given).key_frames),
        "background": (np.array([0.1, 0.2, 0.3]), background),
        "packet": (np.frombuffer(encoded(), np.uint8), lambda given: decoder.decode(given).picture.tobytes()),
        "psnr": (noisy, lambda given: round(nvsprior.psnr(given, frames[0]), 9)),
        "ssim": (noisy, lambda given: round(nvsprior.ssim(frames[0], given), 9)),
    }
    for name in part:
        made[name] = part[name], lambda given, name=name: from_arrays({**part, name: given})
    return made


# Calls that search or train, and the layouts that they are tried with.
SLOW = ("frame", "mask", "hint", "pictures", "one picture", "masks", "poses", "points", "colours")
FEW = ("backwards along 0", "gaps along 1", "an odd place", "bytes in the other order")


def test_every_layout_is_the_same_argument(engine, prior, camera, poses, frames, root):
    path = root / "tools/basin/prior.nvsg"
    for name, (array, call) in arguments(engine, prior, camera, poses, frames, path).items():
        due = call(array)
        for layout, given in layouts(array):
            assert np.array_equal(given, array), layout
            if name in SLOW and layout not in FEW and layout != f"axes {tuple(range(array.ndim))[::-1]}":
                continue
            assert call(given) == due, f"{name}, {layout}"

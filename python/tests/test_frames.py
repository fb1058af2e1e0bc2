"""Frames to packets, and back."""

from __future__ import annotations

import hashlib
import json
import os
import struct
import subprocess
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest

import nvsprior


def test_both_sides_have_the_same_pictures(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera, quality=10)
    decoder = nvsprior.Decoder(engine, prior)
    for number, frame in enumerate(frames[:3]):
        encoded = encoder.encode(frame, hint=poses[0] if number == 0 else None, time=0.1 * number)
        decoded = decoder.decode(encoded.packet)
        assert encoded.frame == decoded.frame == number
        assert np.array_equal(encoded.picture, decoded.picture)
        assert encoded.pose == decoded.pose
        assert encoded.certain and decoded.certain and decoded.damage is None
        assert encoded.known == decoded.known and encoded.known[0] > 0
        deviation = np.sqrt(np.diag(encoded.covariance))
        assert encoded.covariance.shape == (6, 6)
        assert (deviation[:3] <= encoded.known[0]).all() and (deviation[3:] <= encoded.known[1]).all()
        nvsprior.Hint(encoded.pose, covariance=encoded.covariance)
        assert encoded.psnr > encoded.render_psnr > 15
        assert decoded.truth.shape == (6, 10) and decoded.truth.dtype == np.uint8
    assert decoder.camera == camera == encoder.camera


def test_psnr_is_that_of_the_picture(engine, prior, camera, poses, frames):
    encoded = nvsprior.Encoder(engine, prior, camera, quality=30).encode(frames[0], poses[0])
    mse = np.mean((encoded.picture.astype(float) - frames[0]) ** 2)
    assert encoded.psnr == pytest.approx(10 * np.log10(255**2 / mse), abs=1e-6)


def test_rates_are_kept(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera, bytes=150)
    assert len(encoder.encode(frames[0], poses[0]).packet) <= 150
    encoder.set_rate(psnr=30)
    fine = encoder.encode(frames[1])
    assert fine.rate_kept and fine.psnr >= 30
    encoder.set_rate()
    assert len(encoder.encode(frames[2]).packet) == 20, "the pose alone"
    with pytest.raises(nvsprior.BudgetError, match="a budget of 10 bytes"):
        nvsprior.Encoder(engine, prior, camera, bytes=10).encode(frames[0], poses[0])


def layouts(frame: np.ndarray) -> dict[str, np.ndarray]:
    """The same picture in other places of memory."""
    height, width, _ = frame.shape
    wide = np.zeros((height * 2, width * 3, 4), np.uint8)
    wide[::2, 1::3, 1:] = frame
    return {
        "Fortran's order": np.asfortranarray(frame),
        "planes": np.ascontiguousarray(frame.transpose(2, 0, 1)).transpose(1, 2, 0),
        "columns": np.ascontiguousarray(frame.transpose(1, 0, 2)).transpose(1, 0, 2),
        "strides": wide[::2, 1::3, 1:],
        "upside down": np.ascontiguousarray(frame[::-1])[::-1],
        "colours exchanged twice": np.ascontiguousarray(frame[..., ::-1])[..., ::-1],
    }


def test_every_layout_of_an_array_is_the_same_picture(engine, prior, camera, poses, frames):
    due = nvsprior.Encoder(engine, prior, camera, psnr=45).encode(frames[0], poses[0]).packet
    mask = np.ones(frames[0].shape[:2], bool)
    mask[:20, 30:] = False
    masked = []
    for given in (mask, np.asfortranarray(mask)):
        encoder = nvsprior.Encoder(engine, prior, camera, quality=10)
        encoder.set_mask(given)
        masked.append(encoder.encode(frames[0], poses[0]).packet)
    assert masked[0] == masked[1]
    for name, frame in layouts(frames[0]).items():
        assert np.array_equal(frame, frames[0]), name
        encoder = nvsprior.Encoder(engine, prior, camera, psnr=45)
        assert encoder.encode(frame, poses[0]).packet == due, name
    trained = [
        nvsprior.map(engine, [f], camera, poses[:1], splats=500, iterations=20).id
        for f in (frames[0], np.asfortranarray(frames[0]))
    ]
    assert trained[0] == trained[1]


def test_arrays_of_the_caller_are_written_to(engine, prior, camera, poses, frames):
    encoder = nvsprior.Encoder(engine, prior, camera)
    decoder = nvsprior.Decoder(engine, prior)
    here, there, drawn = (np.zeros(frames[0].shape, np.uint8) for _ in range(3))
    encoded = encoder.encode(frames[0], poses[0], out=here)
    decoded = decoder.decode(encoded.packet, out=there)
    assert encoded.picture is here and decoded.picture is there
    assert here.any() and np.array_equal(here, there)
    renderer = nvsprior.Renderer(engine, prior, camera)
    assert renderer.render(encoded.pose, out=drawn) is drawn
    assert np.abs(drawn.astype(int) - encoder.render()).max() <= 1, "of a packet's pose the bits are fixed"


def test_no_picture_is_allocated_twice(engine, prior, camera, poses, frames):
    encoder, decoder = nvsprior.Encoder(engine, prior, camera), nvsprior.Decoder(engine, prior)
    out = np.zeros(frames[0].shape, np.uint8)
    decoder.decode(encoder.encode(frames[0], poses[0], out=out).packet, out=out)
    tracemalloc.start()  # NumPy tells it of its arrays.
    try:
        decoder.decode(encoder.encode(frames[1], out=out).packet, out=out)
        with_out = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        encoder.encode(frames[2])
        without = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert with_out < out.nbytes / 4 and without > out.nbytes


def test_arrays_with_gaps_are_read(engine, prior, camera, poses, frames):
    wide = np.zeros((frames[0].shape[0], 2 * frames[0].shape[1], 3), np.uint8)
    wide[:, ::2] = frames[0]
    packets = [
        nvsprior.Encoder(engine, prior, camera).encode(frame, poses[0]).packet for frame in (frames[0], wide[:, ::2])
    ]
    assert packets[0] == packets[1]


def test_streams_take_fewer_bytes(engine, prior, camera, poses, frames):
    def run(stream):
        encoder = nvsprior.Encoder(engine, prior, camera, psnr=32, stream=stream)
        return [encoder.encode(frame, poses[0] if k == 0 else None) for k, frame in enumerate(frames[:4])]

    intra, inter = run(None), run("chain")
    assert inter[3].reference == 2 and intra[3].reference is None
    assert sum(len(e.packet) for e in inter) < sum(len(e.packet) for e in intra)
    decoder = nvsprior.Decoder(engine, prior)
    decoder.decode(inter[0].packet)
    lost = decoder.decode(inter[2].packet)
    assert isinstance(lost.damage, nvsprior.ResidualError) and not lost.kept


def test_masks_and_regions(engine, prior, camera, poses, frames):
    mask = np.ones(frames[0].shape[:2], bool)
    mask[:, :80] = False
    covered = frames[0].copy()
    covered[:, :80] = 0
    packets = []
    for frame in (frames[0], covered):
        encoder = nvsprior.Encoder(engine, prior, camera)
        encoder.set_mask(mask)
        packets.append(encoder.encode(frame, poses[0]).packet)
    assert packets[0] == packets[1], "masked pixels do not count"

    def error_in_region(weight):
        encoder = nvsprior.Encoder(engine, prior, camera, bytes=200)
        encoder.set_region((70, 40, 40, 20) if weight else None, weight or 1)
        encoded = encoder.encode(frames[0], poses[0])
        off = encoded.picture[40:60, 70:110].astype(float) - frames[0][40:60, 70:110]
        return np.mean(off**2)

    assert error_in_region(16) < error_in_region(None)


def md5(data: bytes) -> str:
    return hashlib.md5(data).hexdigest()


VECTORS = Path(__file__).resolve().parents[2] / "tests/vectors"
MANIFEST = json.loads((VECTORS / "nvsprior.json").read_text())["test_vectors"]
DECODED = [vector for vector in MANIFEST if vector["kind"] in ("packets", "starts") and "keys" not in vector]


def told(decoded: nvsprior.Decoded) -> dict:
    """What the manifest says of a frame, but for the words for damage and the truth map."""
    value = {"frame": decoded.frame, "md5": md5(decoded.picture.tobytes())}
    value |= {"uncertain": not decoded.certain, "kept": decoded.kept, "portable": decoded.portable}
    value |= {"damaged": decoded.damage is not None, "known": decoded.known and list(decoded.known)}
    for name in ("same_render", "reference"):
        value[name] = getattr(decoded, name)
    return value


def expected_of(record: dict) -> dict:
    value = {"frame": record["frame"], "md5": record["md5"], "damaged": "damage" in record}
    value |= {"uncertain": record.get("uncertain", False), "kept": record.get("kept", False)}
    value |= {"portable": record.get("portable", True), "known": record.get("known")}
    for name in ("same_render", "reference"):
        value[name] = record.get(name)
    return value


@pytest.mark.parametrize("vector", DECODED, ids=lambda vector: vector["name"])
def test_pictures_are_those_of_the_format(engine, vector):
    """As docs/format.md says: sizes in front of the records, check sums of the pictures."""
    content = (VECTORS / vector["input_file"]).read_bytes()
    prior = nvsprior.Prior.open(VECTORS / vector["prior"])
    decoder = nvsprior.Decoder(engine, prior)
    for numbers in vector.get("cameras", []):
        decoder.add_camera(nvsprior.Camera(*numbers))
    start = vector["kind"] == "starts"
    records = []
    while content:
        (size,) = struct.unpack_from("<I", content)
        records.append(content[4 : 4 + size])
        content = content[4 + size :]
    assert len(records) == len(vector["records"]) > 0
    for record, expected in zip(records, vector["records"]):
        if "refused" in expected:
            with pytest.raises(nvsprior.Error):
                decoder.decode(record, start=start)
        else:
            assert told(decoder.decode(record, start=start)) == expected_of(expected)


def png(picture: np.ndarray) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = picture.shape
    rows = b"".join(b"\0" + row.tobytes() for row in picture)
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@pytest.mark.skipif("NVSPRIOR_PROGRAM" not in os.environ, reason="NVSPRIOR_PROGRAM does not name the program")
def test_packets_are_those_of_the_command_line(engine, prior, camera, poses, frames, root, tmp_path):
    images = []
    for number, (pose, frame) in enumerate(zip(poses[:4], frames)):
        name = f"{number:04}.png"
        (tmp_path / name).write_bytes(png(frame))
        qvec, tvec = pose.rotation.tolist(), pose.translation.tolist()
        images.append({"file": name, "index": number, "qvec": qvec, "tvec": tvec})
    size = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    cameras = tmp_path / "cameras.json"
    cameras.write_text(json.dumps({**size, "images": images}))
    packets = tmp_path / "packets"
    command = [os.environ["NVSPRIOR_PROGRAM"], "encode", "--prior", root / "tools/basin/prior.nvsg"]
    subprocess.run([*command, "--cameras", cameras, "--packets", packets], check=True)
    encoder = nvsprior.Encoder(engine, prior, camera)
    # The program reads the poses from the camera file, of which the first starts the search.
    for number, frame in enumerate(frames[:4]):
        encoded = encoder.encode(frame, poses[number])
        [packet] = packets.rglob(f"{number:04}*.nvsp")
        assert encoded.packet == packet.read_bytes(), f"frame {number}"


def test_red_and_blue_exchanged_are_told_once(engine, prior, camera, poses, frames, recwarn):
    def run(turned: bool) -> list[nvsprior.Encoded]:
        encoder = nvsprior.Encoder(engine, prior, camera)
        given = [frame[..., ::-1] if turned else frame for frame in frames[:4]]
        return [encoder.encode(frame, poses[0] if k == 0 else None) for k, frame in enumerate(given)]

    assert not any(encoded.colours_exchanged for encoded in run(False)) and not recwarn.list
    with pytest.warns(UserWarning, match="red and blue exchanged.*BGR") as warned:
        assert [encoded.colours_exchanged for encoded in run(True)] == [True, False, False, False]
    assert len(warned) == 1 and warned[0].filename == __file__
    grey = np.full_like(frames[0], 90)
    encoder = nvsprior.Encoder(engine, prior, camera, lost_renders=0)
    assert not encoder.encode(grey, poses[0]).colours_exchanged

"""From the layout of COLMAP and LLFF data sets, such as SeaThru-NeRF's, to our camera file.

Read: `images_wb/` or `images/`, and `sparse/0/{cameras,images,points3D}.bin`, or else `poses_bounds.npy`.
Written: `images/NAME.png`, undistorted and reduced; `cameras.json`, every 8th picture in the split `test` and the
others in `train`; `points.ply`, if there is a COLMAP model.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import cameras, colmap, llff, pictures, undistort
from .colmap import Picture, Points
from .errors import ArgumentError, FileError
from .lens import Lens

FOLDERS = ("images_wb", "images")
SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
TEST_EVERY = 8


@dataclass(frozen=True)
class Converted:
    cameras: Path
    pictures: int
    points: int | None
    # Pictures of the model that have no file.
    left_out: list[str]


def convert(source: Path, out: Path, width: int, folder: str | None) -> Converted:
    """Converts a data set; nothing is written before all of the model is read."""
    if width < 16:
        raise ArgumentError("--width must be at least 16")
    images = _picture_folder(source, folder)
    files = _files(images)
    found, points = _model(source, files)
    there = [picture for picture in found if Path(picture.name).stem in files]
    left_out = [picture.name for picture in found if Path(picture.name).stem not in files]
    if not there:
        raise FileError(images, "has none of the model's pictures")
    if len({Path(picture.name).stem for picture in there}) < len(there):
        raise FileError(source, "the model has pictures of one name in several folders")
    if out.resolve() == source.resolve():
        raise ArgumentError(f"--out {out}: would overwrite the data set's own pictures")
    views, (shape_width, shape_height) = _write_pictures(there, files, out, width)
    cameras.write(out / "cameras.json", shape_width, shape_height, views)
    if points is not None:
        write_points(out / "points.ply", points)
    return Converted(out / "cameras.json", len(views), None if points is None else len(points.positions), left_out)


def _write_pictures(
    there: list[Picture], files: dict[str, Path], out: Path, width: int
) -> tuple[list[cameras.View], tuple[int, int]]:
    """The views of the pictures that it writes, and their width and height."""
    views, sizes = [], []
    for index, picture in enumerate(there):
        file = files[Path(picture.name).stem]
        pixels, lens = _reduced(file, picture.lens, width)
        sizes.append((pixels.shape[1], pixels.shape[0]))
        if sizes[0] != sizes[-1]:
            raise FileError(file, f"becomes {sizes[-1]} pixels, others {sizes[0]}: their shapes differ")
        name = f"images/{file.stem}.png"
        pictures.write_rgb(out / name, pixels)
        split = "test" if index % TEST_EVERY == 0 else "train"
        intrinsics = (lens.fx, lens.fy, lens.cx, lens.cy)
        views.append(cameras.View(name, index, split, picture.rotation, picture.translation, *intrinsics))
    return views, sizes[0]


def _picture_folder(source: Path, folder: str | None) -> Path:
    for name in [folder] if folder else FOLDERS:
        if (source / name).is_dir():
            return source / name
    raise FileError(source, f"has no folder {folder or ' or '.join(FOLDERS)}")


def _files(images: Path) -> dict[str, Path]:
    """By name without its end: data sets hold PNGs of pictures that COLMAP saw as JPEGs."""
    files: dict[str, Path] = {}
    for file in sorted(images.iterdir()):
        if file.suffix.lower() in SUFFIXES:
            if file.stem in files:
                raise FileError(file, f"has the same name as {files[file.stem].name}")
            files[file.stem] = file
    if not files:
        raise FileError(images, "has no pictures")
    return files


def _model(source: Path, files: dict[str, Path]) -> tuple[list[Picture], Points | None]:
    sparse = source / "sparse" / "0"
    if (sparse / "cameras.bin").is_file():
        found = colmap.read_pictures(sparse / "images.bin", colmap.read_cameras(sparse / "cameras.bin"))
        for picture in found:
            if picture.lens.distorted and picture.lens.folds():
                coefficients = f"{picture.lens.model} {picture.lens.distortion}"
                raise FileError(sparse / "cameras.bin", f"{coefficients} is no lens: it folds over")
        points = sparse / "points3D.bin"
        return found, colmap.read_points(points) if points.is_file() else None
    if (source / "poses_bounds.npy").is_file():
        return llff.read(source / "poses_bounds.npy", [file.name for file in files.values()]), None
    raise FileError(source, "has neither sparse/0/cameras.bin nor poses_bounds.npy")


def _reduced(file: Path, lens: Lens, width: int) -> tuple[np.ndarray, Lens]:
    """Undistorted, at most `width` wide; with its pinhole. The model may be of larger pictures than the file's."""
    pixels = pictures.read_rgb(file)
    height = pixels.shape[0]
    shape, model = pixels.shape[1] / height, lens.width / lens.height
    if abs(shape / model - 1) > 0.02:
        raise FileError(file, f"{pixels.shape[1]}×{height}: not the shape of the model's {lens.width}×{lens.height}")
    lens = lens.scaled(pixels.shape[1], height)
    ideal = undistort.pinhole(lens)
    if lens.distorted:
        pixels = undistort.undistort(pixels, lens, ideal)
    if pixels.shape[1] > width:
        pixels = undistort.resize(pixels, width, max(1, round(height * width / pixels.shape[1])))
    return pixels, ideal.scaled(pixels.shape[1], pixels.shape[0])


def write_points(path: Path, points: Points) -> None:
    """PLY, binary, with colours."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points.positions)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    rows = np.zeros(len(points.positions), dtype=[("position", "<f4", 3), ("colour", "u1", 3)])
    rows["position"], rows["colour"] = points.positions, points.colours
    path.write_bytes(header.encode("ascii") + rows.tobytes())

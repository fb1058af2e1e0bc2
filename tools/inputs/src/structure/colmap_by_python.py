"""Runs pycolmap as the program `colmap` is run: COMMAND --option value ...

Only what nvsprior asks for. Options have the names of COLMAP 4's command line. `help` names the version, COMMAND -h the
options.
"""

import os
import sys

import pycolmap

FEATURES = pycolmap.FeatureExtractionOptions()
READER = pycolmap.ImageReaderOptions()
MATCHING = pycolmap.FeatureMatchingOptions()
PAIRS = pycolmap.ImportedPairingOptions()
GEOMETRY = pycolmap.TwoViewGeometryOptions()
GLOBAL = pycolmap.GlobalPipelineOptions()
BUNDLE = pycolmap.BundleAdjustmentOptions()
INCREMENTAL = pycolmap.IncrementalPipelineOptions()

# What the words before an option's dot stand for.
GROUPS = {
    "feature_extractor": {
        "ImageReader": READER,
        "FeatureExtraction": FEATURES,
        "SiftExtraction": FEATURES.sift,
    },
    "database_cleaner": {},
    "matches_importer": {
        "FeatureMatching": MATCHING,
        "SiftMatching": MATCHING.sift,
        "TwoViewGeometry": GEOMETRY,
        "TwoViewGeometry ransac": GEOMETRY.ransac,
    },
    "global_mapper": {
        "GlobalMapper": GLOBAL,
        "GlobalMapper mapper": GLOBAL.mapper,
        "GlobalMapper ba": GLOBAL.mapper.bundle_adjustment,
        "GlobalMapper ba_ceres": GLOBAL.mapper.bundle_adjustment.ceres.solver_options,
    },
    "bundle_adjuster": {"BundleAdjustment": BUNDLE},
    "mapper": {"Mapper": INCREMENTAL, "Mapper inner": INCREMENTAL.mapper},
}
PATHS = {
    "database_path",
    "image_path",
    "image_list_path",
    "input_path",
    "match_list_path",
    "match_type",
    "output_path",
    "type",
}
SHARED = {"single_camera": "SINGLE", "single_camera_per_folder": "PER_FOLDER", "single_camera_per_image": "PER_IMAGE"}


def fields(command):
    """The options of a command: name, the object that holds it, its field."""
    for words, options in GROUPS[command].items():
        group, _, part = words.partition(" ")
        begin = f"{part}_" if part.startswith("ba") else ""
        for field in options.todict():
            yield f"--{group}.{begin}{field}", options, field


def known(command):
    """The names of a command's options."""
    yield from (name for name, _, _ in fields(command))
    if command == "feature_extractor":
        yield from (f"--ImageReader.{name}" for name in SHARED)


def converted(text, like):
    if isinstance(like, bool):
        return text not in ("0", "false")
    return type(like)(text) if isinstance(like, (int, float)) else text


def parse(command, words):
    """Sets options. Returns the paths, and how cameras are shared."""
    paths, camera_mode = {}, pycolmap.CameraMode.AUTO
    held = {name: (options, field) for name, options, field in fields(command)}
    for option, value in zip(words[::2], words[1::2], strict=True):
        name = option.removeprefix("--")
        shared = SHARED.get(name.removeprefix("ImageReader."))
        if name in PATHS:
            paths[name] = value
        elif shared:
            camera_mode = getattr(pycolmap.CameraMode, shared)
        elif option in held:
            options, field = held[option]
            setattr(options, field, converted(value, getattr(options, field)))
        else:
            sys.exit(f"{command} does not know --{name}")
    return paths, camera_mode


def run(command, words):
    paths, camera_mode = parse(command, words)
    if command == "bundle_adjuster":
        model = pycolmap.Reconstruction(paths["input_path"])
        pycolmap.bundle_adjustment(model, BUNDLE)
        model.write(paths["output_path"])
        return
    database = paths["database_path"]
    if command == "feature_extractor":
        with open(paths["image_list_path"], encoding="utf-8") as file:
            names = file.read().splitlines()
        # So pictures get their numbers in order: threads that find features end in any order.
        pycolmap.Database.open(database).close()
        pycolmap.import_images(database, paths["image_path"], camera_mode, names, READER)
        pycolmap.extract_features(
            database,
            paths["image_path"],
            image_names=names,
            camera_mode=camera_mode,
            reader_options=READER,
            extraction_options=FEATURES,
            device=pycolmap.Device.cpu,
        )
        return
    if command == "database_cleaner":
        with pycolmap.Database.open(database) as opened:
            opened.clear_matches()
            opened.clear_two_view_geometries()
        return
    if command == "matches_importer":
        PAIRS.match_list_path = paths["match_list_path"]
        pycolmap.match_image_pairs(
            database,
            matching_options=MATCHING,
            pairing_options=PAIRS,
            verification_options=GEOMETRY,
            device=pycolmap.Device.cpu,
        )
        return
    mapping, options = {
        "global_mapper": (pycolmap.global_mapping, GLOBAL),
        "mapper": (pycolmap.incremental_mapping, INCREMENTAL),
    }[command]
    # A model to go on with.
    more = {"input_path": paths["input_path"]} if "input_path" in paths else {}
    if not mapping(database, paths["image_path"], paths["output_path"], options=options, **more):
        sys.exit(1)


def main():
    words = sys.argv[1:]
    if words == ["help"]:
        print(f"pycolmap {pycolmap.__version__}")
        print("\n".join(f"  {command}" for command in GROUPS))
    elif words[1:] == ["-h"] and words[0] in GROUPS:
        print("\n".join(known(words[0])))
    elif words and words[0] in GROUPS:
        run(words[0], words[1:])
        # Its threads may fail to end at exit.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
    else:
        sys.exit(f"unknown command {words[:1]}")


main()

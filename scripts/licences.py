#!/usr/bin/env python3
"""What is linked into library, program, GStreamer plugin and Python package: licences as Debian's copyright files, and
bills of materials in the form CycloneDX.

Usage: licences.py write   runs cargo-about (its feature cli) and cargo-cyclonedx (minutes), writes
                           packaging/licences/*.copyright and packaging/sbom/*.cdx.json
       licences.py check   fails if a crate is linked in that these files do not name

Debian's form: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
"""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import uuid

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "packaging" / "licences"
BILLS = ROOT / "packaging" / "sbom"
# What is linked, the manifest and features that say so, and the package whose dependencies are checked.
PARTS = {
    "library": ("crates/capi/Cargo.toml", "nvsprior-capi", []),
    "program": ("tools/cli/Cargo.toml", "nvsprior-cli", []),
    "gstreamer-plugin": ("gst-plugins/Cargo.toml", "nvsprior-gst", []),
    "python-package": ("python/Cargo.toml", "nvsprior-python", []),
}
TARGETS = ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"]
OURS = re.compile(r"nvsprior(-.*)?$")

HEAD = """Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: nvsprior
Comment: Written by scripts/licences.py. After nvsprior's own files come those of the crates that
 are linked in or generate code for it, in vendor/ of the source archive, then what the compilers add.

Files: *
Copyright: The nvsprior authors
License: Expat or Apache-2.0
"""

WEBP = """
Files: vendor/libwebp-sys/vendor/*
Copyright: 2010 Google Inc.
License: BSD-3-clause-libwebp
"""

TAIL = """Files: rust-standard-library/*
Copyright: The Rust Project contributors
License: Expat or Apache-2.0
Comment: Rust's standard library, part of the compiled code. What it is made of in turn is in
 rust-standard-library.html beside this file.

Files: llvm-libunwind/*
Copyright: The LLVM Project contributors
License: Apache-2.0 with LLVM-exception
Comment: LLVM's libunwind, which Zig links into the compiled code.

"""


def field(text):
    """A text as the continuation lines of a field."""
    return "".join(f" {line}\n" if line.strip() else " .\n" for line in text.strip("\n").expandtabs().splitlines())


NOTICE = re.compile(r"Copyright\s+(\(c\)|©)?\s*(\d{4}.*|\(c\).*|The .*)", re.IGNORECASE)


def notice(line):
    """The copyright notice that a line is, or `None`."""
    match = NOTICE.match(line)
    return match.group(2).strip() if match and "[yyyy]" not in line and "{yyyy}" not in line else None


def parted(text):
    """The copyright notices within a licence's text, and the text without them.

    Some texts are the heads of source files, from whose comments cargo-about takes them.
    """
    if text.lstrip().startswith("/*"):
        text = text.split("*/", 1)[0]
    lines = [re.sub(r"^[\s/*]*", "", line.expandtabs()).rstrip() for line in text.splitlines()]
    body = "\n".join(line for line in lines if not notice(line))
    return [notice(line) for line in lines if notice(line)], re.sub(r"\n{3,}", "\n\n", body).strip()


def common(name):
    """A licence that every Debian system has in full."""
    return f"On Debian systems the full text is in /usr/share/common-licenses/{name}.\n"


def stanzas(licences):
    """A paragraph for each notice of each licence, then each wording of a licence once, whoever holds the copyright.

    `licences`: the crates, the licence's name and its text.
    """
    bodies, files = {}, {}
    for crates, identifier, text in licences:
        crates = sorted({name for name in crates if not OURS.match(name)})
        if not crates:
            continue
        found, body = parted(text)
        if identifier == "Apache-2.0":
            body = common(identifier)
        # Titles, quotes and places where lines end make no other licence.
        key = re.sub(r"^(the )?(mit|isc|zlib|bsd)?[- \w]*licen[sc]e\s*(\(\w+\))?\W*(all rights reserved\.)?\s*", "",
                     " ".join(re.sub("[“”\"'`]", "", body).lower().split()))
        known = bodies.setdefault(identifier, {})
        name = known.setdefault(key, (f"{identifier.replace(' ', '-')}-{len(known) + 1}", body))[0]
        for holder in found or ["The authors of " + ", ".join(crates)]:
            files.setdefault((holder, name), set()).update(crates)
    notices = {}
    for (holder, name), crates in files.items():
        notices.setdefault((name, tuple(sorted(crates))), []).append(holder)
    for (name, crates), holders in notices.items():
        paths = "\n       ".join(textwrap.wrap(" ".join(f"vendor/{crate}/*" for crate in crates), 110))
        yield f"Files: {paths}\nCopyright: " + "\n           ".join(holders) + f"\nLicense: {name}\n\n"
    for known in bodies.values():
        for name, body in known.values():
            yield f"License: {name}\n" + field(body) + "\n"


def about(manifest, features):
    command = ["cargo-about", "generate", "--format", "json", "--config", str(FOLDER / "about.toml"),
               "--manifest-path", str(ROOT / manifest), "--locked", *features]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def libwebp():
    """The folder of libwebp's source, in its crate."""
    listed = json.loads(subprocess.run(["cargo", "metadata", "--format-version", "1", "--locked"], check=True, cwd=ROOT,
                                       stdout=subprocess.PIPE).stdout)
    manifest = next(crate["manifest_path"] for crate in listed["packages"] if crate["name"] == "libwebp-sys")
    return pathlib.Path(manifest).parent / "vendor"


def write(part, report):
    # The paragraph of each licence that the head and the tail name.
    expat = (ROOT / "LICENSE-MIT").read_text().split("\n\n", 2)[2]
    exception = FOLDER.joinpath("LLVM-exception.txt").read_text()
    licences = (
        "License: Expat\n" + field(expat) + "\nLicense: Apache-2.0\n" + field(common("Apache-2.0"))
        + "\nLicense: Apache-2.0 with LLVM-exception\n" + field(common("Apache-2.0") + "\n" + exception)
    )
    texts = [({used["crate"]["name"] for used in licence["used_by"]}, licence["id"], licence["text"])
             for licence in report["licenses"]]
    named = sorted({f"{used['crate']['name']} {used['crate']['version']}" for licence in report["licenses"]
                    for used in licence["used_by"] if not OURS.match(used["crate"]["name"])})
    crates = "Comment: Crates and versions:\n" + field("\n".join(named)) + "\n"
    head = HEAD.replace("Comment: Written", crates.rstrip("\n") + "\n .\n Written", 1)
    if any(crate.startswith("libwebp-sys ") for crate in named):
        folder = libwebp()
        text = (folder / "COPYING").read_text() + "\n" + (folder / "PATENTS").read_text()
        head, licences = head + WEBP, licences + "\nLicense: BSD-3-clause-libwebp\n" + field(text)
    (FOLDER / f"{part}.copyright").write_text(head + "\n" + "".join(stanzas(texts)) + TAIL + licences)
    print(f"{part}: {len(named)} crates, {len(report['licenses'])} texts")


def bill(part, manifest, package, features):
    """Writes the bill of materials: the same text for the same crates, without this machine's folders."""
    with tempfile.TemporaryDirectory() as scratch:
        tree = pathlib.Path(scratch) / "nvsprior"
        files = subprocess.run(["git", "ls-files", "*.rs", "*Cargo.toml", "Cargo.lock"], check=True, cwd=ROOT,
                               stdout=subprocess.PIPE, text=True).stdout.split()
        for name in files:
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tree / name)
        command = ["cargo", "cyclonedx", "--quiet", "--format", "json", "--spec-version", "1.5", "--target", "all",
                   "--no-build-deps", "--override-filename", "bill", "--manifest-path", str(tree / manifest), *features]
        subprocess.run(command, check=True, cwd=tree, env={**os.environ, "SOURCE_DATE_EPOCH": "0"})
        text = (tree / manifest).with_name("bill.json").read_text().replace(str(tree), ".")
    found = json.loads(text)
    # Those for other systems are left out.
    kept = set(linked(package, features))
    found["components"] = [component for component in found["components"] if OURS.match(component["name"])
                           or f"{component['name']} {component['version']}" in kept]
    refs = {component["bom-ref"] for component in [found["metadata"]["component"], *found["components"]]}
    found["dependencies"] = [{**entry, "dependsOn": sorted(refs & set(entry.get("dependsOn", [])))}
                             for entry in found["dependencies"] if entry["ref"] in refs]
    del found["metadata"]["timestamp"]
    found.pop("serialNumber", None)
    found["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(found, sort_keys=True))}"
    BILLS.mkdir(exist_ok=True)
    (BILLS / f"{part}.cdx.json").write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    print(f"{part}: a bill of {len(found['components'])} components for {package}")


def linked(package, features):
    """The crates that a package links in, or that generate code for it: name and version."""
    lines = set()
    for target in TARGETS:
        command = ["cargo", "tree", "--locked", "--edges", "normal", "--prefix", "none", "--format", "{p}",
                   "--target", target, "--package", package, *features]
        listed = subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True).stdout
        lines |= set(listed.splitlines())
    crates = {tuple(line.split()[:2]) for line in lines if line}
    return sorted(f"{name} {version[1:]}" for name, version in crates if not OURS.match(name))


def check(part, package, features):
    text = (FOLDER / f"{part}.copyright").read_text()
    named = {line.strip() for line in text.split("\nFiles:", 1)[0].splitlines()}
    missing = [crate for crate in linked(package, features) if crate not in named]
    if missing:
        sys.exit(f"packaging/licences/{part}.copyright lacks {', '.join(missing)}: run `make licences`")
    components = json.loads((BILLS / f"{part}.cdx.json").read_text())["components"]
    billed = {f"{component['name']} {component['version']}" for component in components}
    differ = billed.symmetric_difference(linked(package, features))
    differ = sorted(crate for crate in differ if not OURS.match(crate.split()[0]))
    if differ:
        sys.exit(f"packaging/sbom/{part}.cdx.json lacks, or has without need, {', '.join(differ)}: run `make licences`")
    print(f"{part}: every crate that is linked in is named")


def main():
    if sys.argv[1:] not in (["write"], ["check"]):
        sys.exit(__doc__)
    for part, (manifest, package, features) in PARTS.items():
        if sys.argv[1] == "write":
            write(part, about(manifest, features))
            bill(part, manifest, package, features)
        else:
            check(part, package, features)


main()

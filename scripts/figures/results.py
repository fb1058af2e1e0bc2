"""What was measured: docs/results/NAME.json, one file for each measurement.

A file has `name`, `commands` (a shell runs them from the root of the tree; OUT stands for a folder, REEF for the folder
of the reef footage), `commit`, `date`, `device` (as `nvsprior devices` names it), `machine`, `priors` (a hash of
what each prior draws: of a .nvsg the parts that its identity covers, of a foreign file its bytes) and `values`.
"""
import hashlib
import json
import pathlib
import struct

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "results"

# The priors that results are of. The reef's lies beside the tree or above it, on machines that have it.
PRIORS = {
    "demo": [ROOT / "tools/basin/prior.nvsg"],
    "reef": [folder / "shared/data/reef/prior.ply" for folder in (ROOT, ROOT.parent)],
}


class Problem(Exception):
    """What is wrong, and what to do."""


def find(prior):
    """The prior's file; None if this machine does not have it."""
    return next((path for path in PRIORS[prior] if path.exists()), None)


def drawn(data):
    """What of a prior's file is drawn: docs/format/prior.md."""
    if data[:4] != b"nvsg":
        return data
    covered, at = [], 28
    while at < len(data):
        name, flags, length = struct.unpack_from("<8sBQ", data, at)
        if flags & 1:
            covered.append(name + data[at + 21:at + 21 + length])
        at += 21 + length
    return b"".join(sorted(covered))


def check_of(path):
    return hashlib.sha256(drawn(path.read_bytes())).hexdigest()


def read(name):
    path = FOLDER / f"{name}.json"
    if not path.exists():
        raise Problem(f"{path.relative_to(ROOT)} is missing: make figures ONLY={name}")
    return json.loads(path.read_text())


def write(result):
    FOLDER.mkdir(exist_ok=True)
    text = json.dumps(result, indent=1, ensure_ascii=False) + "\n"
    (FOLDER / f"{result['name']}.json").write_text(text)


def stale_priors(result):
    """The priors of a result that are other ones today."""
    found = {prior: find(prior) for prior in result["priors"]}
    return [prior for prior, path in found.items() if path and check_of(path) != result["priors"][prior]]

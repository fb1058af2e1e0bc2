"""What was measured: docs/results/NAME.json, one file for each measurement.

A file has `name`, `commands` (a shell runs them from the root of the tree; OUT stands for a folder, REEF for the folder
of the reef footage), `commit`, `date`, `device` (as `nvsprior devices` names it), `machine`, `priors` (SHA-256 of each
prior's file) and `values`.
"""
import hashlib
import json
import pathlib

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


def check_of(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


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

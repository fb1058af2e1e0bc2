#!/usr/bin/env python3
"""Measures what the documents show: `make figures`.

Usage: measure.py [--quick] [--again] [NAME...]

Without names, all measurements. Those that docs/results has for the priors of today are left out, so that a run that
was cut goes on; --again measures them, too. --quick measures only those that take minutes, writes nothing, and fails if
a figure that every device must give differs from docs/results. NVSPRIOR names another program than the one in target.
"""
import argparse
import datetime
import os
import pathlib
import subprocess
import sys
import time

import measurements
import results
from results import ROOT, Problem

WORK = ROOT / "target" / "figures"
KNOWN = {measurement.name: measurement for measurement in measurements.ALL}
PROGRAM = os.environ.get("NVSPRIOR", measurements.NVSPRIOR)


def shell(command):
    started = time.monotonic()
    print(f"$ {command}", flush=True)
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, stdout=subprocess.DEVNULL)
    if done.returncode:
        raise Problem(f"exit code {done.returncode} of: {command}")
    print(f"  {time.monotonic() - started:.0f} s", flush=True)


def line(*command):
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def machine():
    text = pathlib.Path("/proc/cpuinfo").read_text()
    names = [row.split(":", 1)[1].strip() for row in text.splitlines() if row.startswith("model name")]
    return f"{len(names)} × {names[0]}" if names else "unknown"


def commit():
    changed = line("git", "status", "--porcelain", "--", "src", "tools", "shaders-rs")
    return line("git", "rev-parse", "--short=10", "HEAD") + (" with changes" if changed else "")


# What stands in commands for the folders of other measurements.
FOLDERS = {"mapping": "MAPPED"}


def in_folders(command, measurement, out, priors):
    """The command with its folders and its program."""
    command = command.replace("OUT", str(out)).replace(measurements.NVSPRIOR, PROGRAM)
    for need in measurement.needs:
        command = command.replace(FOLDERS[need], str(WORK / need))
    return command.replace("REEF", str(priors["reef"].parent)) if "reef" in priors else command


def measure(measurement):
    """Runs the commands in a folder of their own; the result, or None if a prior is not on this machine."""
    priors = {name: results.find(name) for name in measurement.priors}
    missing = [name for name, path in priors.items() if not path]
    if missing:
        print(f"{measurement.name}: left out, since the prior {missing[0]} is not on this machine")
        return None
    out = WORK / measurement.name
    out.mkdir(parents=True, exist_ok=True)
    for need in measurement.needs:
        if not (WORK / need / "prior.nvsg").exists():
            result = measure(KNOWN[need])
            if result:
                results.write(result)
    for command in measurement.commands:
        shell(in_folders(command, measurement, out, priors))
    return {
        "name": measurement.name,
        "commands": measurement.commands,
        "commit": commit(),
        "date": datetime.date.today().isoformat(),
        "device": ", ".join(row.strip() for row in line(PROGRAM, "devices").splitlines()[:2]).removeprefix("0: "),
        "machine": machine(),
        "priors": {name: results.check_of(path) for name, path in priors.items()},
        "values": measurement.read(out),
    }


def is_there(measurement):
    try:
        return not results.stale_priors(results.read(measurement.name))
    except Problem:
        return False


def compare(measurement, result):
    """Whether the figures that every device must give are those of docs/results."""
    stored = measurement.exact(results.read(measurement.name)["values"])
    found = measurement.exact(result["values"])
    for old, new in zip(stored, found):
        if old != new:
            print(f"{measurement.name}: docs/results has {old}, this machine gives {new}")
    same = stored == found
    print(f"{measurement.name}: {'the same' if same else 'OTHER'} figures as docs/results")
    return same


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--again", action="store_true")
    parser.add_argument("names", nargs="*")
    args = parser.parse_args()
    unknown = [name for name in args.names if name not in KNOWN]
    if unknown:
        raise Problem(f"no measurement is called {unknown[0]}: there are {', '.join(KNOWN)}")
    chosen = [KNOWN[name] for name in args.names] or [m for m in KNOWN.values() if m.quick or not args.quick]
    same = True
    for measurement in chosen:
        if not (args.quick or args.again) and is_there(measurement):
            print(f"{measurement.name}: is there")
            continue
        result = measure(measurement)
        if result and args.quick:
            same &= compare(measurement, result)
        elif result:
            results.write(result)
    return 0 if same else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Problem as problem:
        sys.exit(f"figures: {problem}")

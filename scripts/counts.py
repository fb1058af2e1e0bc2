#!/usr/bin/env python3
"""Counts what one has to hold in the mind: lines of code, targets, pages, words. Fails beyond a limit.

Usage: counts.py          prints the totals
       counts.py rooms    prints the lines of each crate and of the engine's rooms, too

Lines are all lines of a file. A crate's lines are those of its src/, unit tests with them. docs/experiments does not
count. tools/cli/tests/cli/size.rs counts subcommands and options.
"""

import collections
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
CODE = (".rs", ".py", ".c", ".cpp", ".h", ".js", ".sh")
LIMITS = {"lines of the engine": 41_000, "pages": 25, "words": 45_000}


def lines_of(name):
    return (ROOT / name).read_bytes().count(b"\n")


def room_of(name):
    """The crate or folder of a file of code; of the engine, the room within src/."""
    parts = name.split("/")
    if parts[0] in ("crates", "tools", "tests", "src", "shaders-rs") and len(parts) > 2:
        return "/".join(parts[:2])
    return parts[0] if len(parts) > 1 else "top"


def main():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    files = [name for name in listed.splitlines() if (ROOT / name).exists()]
    rooms = collections.Counter()
    for name in files:
        if name.endswith(CODE):
            rooms[room_of(name)] += lines_of(name)
    documents = [name for name in files if name.startswith("docs/") and name.endswith(".md")]
    pages = [name for name in documents if "/experiments/" not in name]
    engine = sum(lines for room, lines in rooms.items() if room.split("/")[0] == "src")
    phony = re.search(r"^\.PHONY: ((?:.|\\\n)*?[^\\])\n", (ROOT / "Makefile").read_text(), re.M).group(1)
    counted = {
        "lines of code": rooms.total(),
        "lines of the engine": engine,
        "make targets": len(set(phony.replace("\\\n", " ").split()) - {"help", "clean"}),
        "pages": len(pages),
        "words": sum(len((ROOT / name).read_text().split()) for name in pages),
    }
    if sys.argv[1:] == ["rooms"]:
        for room, lines in rooms.most_common():
            print(f"{lines:7}  {room}")
    print("counts: " + ", ".join(f"{count} {what}" for what, count in counted.items()))
    over = [f"counts: {counted[what]} {what}, at most {most}" for what, most in LIMITS.items() if counted[what] > most]
    print("\n".join(over), end="\n" if over else "")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())

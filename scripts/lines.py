#!/usr/bin/env python3
"""Fails if a line of a source or document is longer than 120 columns. Usage: lines.py

Tables and lines with links may be longer. What is copied from others or written by a tool does not count.
"""

import pathlib
import subprocess
import sys

LONGEST = 120
KINDS = [".rs", ".md", ".h", ".c", ".cpp", ".hpp", ".py", ".sh", ".toml"]
NOT_OURS = ("packaging/licences/", "tests/c/mock/")


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    listed = subprocess.run(["git", "ls-files"], cwd=root, check=True, stdout=subprocess.PIPE, text=True).stdout
    files = [name for name in listed.splitlines() if pathlib.Path(name).suffix in KINDS or name == "Makefile"]
    found = 0
    for name in files:
        if name.startswith(NOT_OURS) or not (root / name).exists():
            continue
        for number, line in enumerate((root / name).read_text(encoding="utf-8").splitlines(), 1):
            text = line.strip().lstrip("/!*# ")
            free = text.startswith("|") or (name.endswith(".md") and ("](" in text or "://" in text))
            if len(line) > LONGEST and not free:
                print(f"{name}:{number}: {len(line)} columns")
                found += 1
    print(f"lines: {found} longer than {LONGEST} columns in {len(files)} files")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

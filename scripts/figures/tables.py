#!/usr/bin/env python3
"""Writes the tables of documents from docs/results: `make docs-tables`.

Usage: tables.py [check]

A table stands between `<!-- table NAME -->` and `<!-- end of table -->`; documents.py says how it is made. With
`check`, writes nothing and fails if a table is another one, if a result is of a prior that is gone, if no table shows a
result, or if no document has a table.
"""
import re
import sys

import documents
import page
import measurements
import results
from results import ROOT, Problem

EXPERIMENTS = sorted((ROOT / "docs/experiments").glob("*.md"))
REGION = re.compile(r"(<!-- table ([a-z0-9-]+) -->\n)(.*?)(<!-- end of table -->)", re.DOTALL)


def rebuilt(path, shown):
    """The document with its tables made anew. Adds their names to `shown`."""
    def table(found):
        begin, name, _, end = found.groups()
        make = documents.TABLES.get(name)
        if not make:
            raise Problem(f"{path.name}: no table is called {name}")
        shown.add(name)
        return f"{begin}{make()}{end}"
    return REGION.sub(table, path.read_text())


def problems(shown, changed):
    """What is wrong, one sentence each."""
    found = [f"{path.relative_to(ROOT)}: a table is not what docs/results says: make docs-tables" for path in changed]
    for path in sorted(results.FOLDER.glob("*.json")):
        result = results.read(path.stem)
        stale = results.stale_priors(result)
        found += [f"{path.name} is of another prior {name}: make figures ONLY={path.stem}" for name in stale]
        if path.stem not in {measurement.name for measurement in measurements.ALL}:
            found.append(f"{path.name}: nothing measures it: delete it")
        if path.stem not in page.read:
            found.append(f"{path.name}: no table shows it")
    return found + [f"no document has the table {name}" for name in documents.TABLES if name not in shown]


def main():
    check = sys.argv[1:] == ["check"]
    if sys.argv[1:] and not check:
        raise Problem("the only argument is check")
    shown, changed = set(), []
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *EXPERIMENTS]:
        text = rebuilt(path, shown)
        if text != path.read_text():
            changed.append(path)
            if not check:
                path.write_text(text)
    wrong = problems(shown, changed if check else [])
    print("\n".join([*wrong, f"docs-tables: {len(shown)} tables, {len(changed)} documents "
                     + ("differ" if check else "written")]))
    return 1 if wrong else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Problem as problem:
        sys.exit(f"docs-tables: {problem}")

#!/usr/bin/env python3
"""Fails if a file of src/ knows a file that lies higher, or if files of a crate know each other in a circle.

Usage: arrows.py            prints what breaks the rules; exit status 1 if anything does
       arrows.py list       prints every arrow: file -> file: names
       arrows.py selftest   tries the check on small trees with known faults

File A knows file B if A's code names something that B defines: in a `use`, or in a path. Names are followed
through `use` and `pub use` to the file that defines them, so a `mod.rs` that only re-exports is no arrow's end.
A parent's `mod child;` and `pub use child::Name;` are no arrows unless the parent's own code uses the name. If a type
has `impl` blocks in several files, `self.name()`, `Self::name` and `Type::name` know the file of that function. Other
method calls do not count, since this script knows no types. Tests do not count.
"""

import graphlib
import os
import re
import sys
import tempfile

# From low to high. A room knows only rooms of the lines above its own; rooms of one line do not know each other.
# A room is a folder or a file of src/; the longest name that fits a file is its room.
ROOMS = """
random geometry queue range_coder
adaptive_numbers
image
vulkan
coder_tables filter_weights
prior
render
packet
residual truth
error
tracking
engine
error_kind
encoded frame_time
frame_work
encoder decoder doubt_view
pipeline
"""

ITEMS = {"fn", "struct", "enum", "union", "trait", "type", "const", "static"}
QUALIFIERS = {"unsafe", "async", "extern", "default"}
TOKEN = re.compile(
    r"//[^\n]*|/\*|(?P<string>b?r(?P<hash>#*)\".*?\"(?P=hash)|[bc]?\"(?:\\.|[^\"\\])*\")"
    r"|(?P<char>b?'(?:\\(?:x..|u\{[^}]*\}|.)|[^'\\])')|'(?P<life>\w+)|(?P<ident>(?:r#)?[A-Za-z_]\w*)|(?P<number>\d\w*)"
    r"|(?P<op>::|[^\s\w])",
    re.S,
)


def tokens_of(text):
    """The identifiers, `::` and marks of a source text, without comments, literals, lifetimes, attributes and tests.

    Beside them the paths that attributes name.
    """
    found, at = [], 0
    while match := TOKEN.search(text, at):
        at = match.end()
        if match.group() == "/*":
            depth = 1
            while depth:
                mark = re.compile(r"/\*|\*/").search(text, at)
                depth += 1 if mark.group() == "/*" else -1
                at = mark.end()
        elif token := match.group("ident") or match.group("op"):
            found.append(token.removeprefix("r#"))
        elif match.group("string") or match.group("char") or match.group("number"):
            found.append("0")
    return without_tests(found)


def closing(tokens, at):
    """The place behind the bracket that closes the one at `at`."""
    depth = 0
    for place in range(at, len(tokens)):
        if tokens[place] in "([{":
            depth += 1
        elif tokens[place] in ")]}":
            depth -= 1
            if depth == 0:
                return place + 1
    raise SystemExit(f"arrows: a bracket is not closed: {' '.join(tokens[at:at + 12])}")


def attribute(tokens, at):
    """The place behind the attribute at `at`, or `at` if there is none."""
    start = at + 1 + (tokens[at + 1 : at + 2] == ["!"])
    return closing(tokens, start) if tokens[at : at + 1] == ["#"] and tokens[start : start + 1] == ["["] else at


def is_test(words):
    return words[2] == "test" or words[2:5] == ["cfg", "(", "test"] or words[2:7] == ["cfg", "(", "all", "(", "test"]


def item_end(tokens, at):
    """The place behind the item, field or statement at `at`."""
    while (behind := attribute(tokens, at)) != at:
        at = behind
    # A comma ends a field or a variant, but not an item with type parameters.
    words = [token for token in tokens[at : at + 8] if token in ITEMS or token in ("impl", "mod", "use")]
    to_semicolon = words[:1] in (["const"], ["static"], ["type"], ["use"]) and "fn" not in words
    while at < len(tokens):
        if tokens[at] in "([{":
            brace, at = tokens[at] == "{", closing(tokens, at)
            if brace and not to_semicolon:
                return at
        elif tokens[at] == ";" or (tokens[at] == "," and not words):
            return at + 1
        elif tokens[at] in ")]}":
            return at
        else:
            at += 1
    return at


def without_tests(tokens):
    kept, named, at = [], [], 0
    while at < len(tokens):
        behind = attribute(tokens, at)
        if behind != at and is_test(tokens[at:behind]):
            at = item_end(tokens, behind)
        elif behind != at:
            named += [path_at(tokens, place)[0] for place in range(at, behind) if tokens[place] in ("super", "crate")]
            at = behind
        else:
            kept.append(tokens[at])
            at += 1
    return kept, named


class Module:
    def __init__(self, parent, file):
        self.parent, self.file = parent, file
        self.children, self.items, self.uses, self.globs = {}, set(), {}, []
        self.paths, self.exports, self.words = [], [], set()
        self.impls = []  # (the type's path, names of its functions, names called on self)


def path_at(tokens, at):
    """The path that starts at `at`, and the place behind it."""
    path = [tokens[at]]
    while tokens[at + 1 : at + 2] == ["::"] and at + 2 < len(tokens) and re.match(r"[A-Za-z_]", tokens[at + 2]):
        at += 2
        path.append(tokens[at])
    return path, at + 1


def use_tree(tokens, at, prefix, found):
    """Adds the (path, name) pairs of the use tree at `at`; `*` is a glob's name. The place behind it."""
    if tokens[at] == "::":
        at += 1
    path = list(prefix)
    while True:
        if tokens[at] == "{":
            end, at = closing(tokens, at), at + 1
            while at < end - 1:
                at = use_tree(tokens, at, path, found)
                at += tokens[at] == ","
            return end
        if tokens[at] == "*":
            found.append((path, "*"))
            return at + 1
        if tokens[at] != "self" or not path:
            path.append(tokens[at])
        at += 1
        if tokens[at] == "::":
            at += 1
            continue
        name = path[-1]
        if tokens[at] == "as":
            name, at = tokens[at + 1], at + 2
        found.append((path, name))
        return at


class Tree:
    def __init__(self, source, root="lib.rs"):
        self.source = source
        self.root = self.read(os.path.join(source, root), None, source)

    def read(self, file, parent, folder):
        module = Module(parent, os.path.relpath(file, self.source))
        with open(file, encoding="utf-8") as text:
            tokens, module.paths = tokens_of(text.read())
        self.parse(tokens, module, folder)
        return module

    def parse(self, tokens, module, folder):
        at = 0
        while at < len(tokens):
            start, public = at, tokens[at] == "pub"
            at += public
            if public and tokens[at] == "(":
                at = closing(tokens, at)
            while tokens[at] in QUALIFIERS or (tokens[at] == "0" and tokens[at - 1] == "extern"):
                at += 1
            if tokens[at : at + 2] == ["const", "fn"] or tokens[at : at + 2] == ["const", "unsafe"]:
                at += 1 + (tokens[at + 1] == "unsafe")
            word, name = tokens[at], tokens[at + 1] if at + 1 < len(tokens) else ""
            if word == "mod":
                at = self.child(tokens, at + 2, name, module, folder)
                continue
            if word == "use":
                found = []
                at = use_tree(tokens, at + 1, [], found) + 1
                self.bring(module, found, public)
                continue
            end = item_end(tokens, start)
            if word in ITEMS:
                module.items.add(name if name != "mut" else tokens[at + 2])
            elif word == "macro_rules":
                module.items.add(tokens[at + 2])
            elif word == "impl":
                self.methods(tokens[at:end], module)
            self.body(tokens[start:end], module)
            at = end

    def child(self, tokens, at, name, module, folder):
        inside = os.path.join(folder, name)
        if tokens[at] == "{":
            end = closing(tokens, at)
            child = module.children[name] = Module(module, module.file)
            self.parse(tokens[at + 1 : end - 1], child, inside)
            return end
        file = inside + ".rs" if os.path.exists(inside + ".rs") else os.path.join(inside, "mod.rs")
        module.children[name] = self.read(file, module, inside)
        return at + 1

    def methods(self, tokens, module):
        """Notes what an inherent `impl` defines, and what any `impl` calls on itself."""
        start, depth, before = 1, 0, 1
        while depth or tokens[start] == "<":  # Its type parameters.
            depth += {"<": 1, ">": -(tokens[start - 1] != "-")}.get(tokens[start], 0)
            start += 1
        brace = tokens.index("{")
        for_trait = "for" in tokens[start:brace]
        if for_trait:
            start += tokens[start:brace].index("for") + 1
        while tokens[start] in ("&", "mut", "::", "dyn"):
            start += 1
        path, _ = path_at(tokens, start)
        names, calls, at = set(), set(), brace + 1
        while at < len(tokens):
            if tokens[at] == "fn" and before == 1:
                names.add(tokens[at + 1])
            before += {"{": 1, "}": -1}.get(tokens[at], 0)
            if tokens[at : at + 2] == ["self", "."] or tokens[at : at + 2] == ["Self", "::"]:
                calls.add(tokens[at + 2])
            at += 1
        module.impls.append((path, set() if for_trait else names, calls))

    def bring(self, module, found, public):
        for path, name in found:
            if name == "*":
                module.globs.append(path)
            elif name != "_":
                module.uses[name] = path
            if name != "*":
                (module.exports if public else module.paths).append(path)

    def body(self, tokens, module):
        at = 0
        while at < len(tokens):
            if tokens[at] == "use" and tokens[at - 1 : at] != ["."]:
                found = []
                at = use_tree(tokens, at + 1, [], found)
                self.bring(module, found, False)
            elif re.match(r"[A-Za-z_]", tokens[at]) and (at == 0 or tokens[at - 1] not in (".", "::")):
                path, at = path_at(tokens, at)
                module.words.add(path[0])
                if len(path) > 1:
                    module.paths.append(path)
            else:
                at += 1

    def modules(self, module=None):
        module = module or self.root
        yield module
        for child in module.children.values():
            yield from self.modules(child)

    def find(self, module, path, seen=()):
        """The module that defines what a path names from `module`, and its name; a module itself has the name None."""
        first, rest = path[0], path[1:]
        if (id(module), tuple(path)) in seen or len(seen) > 40:
            return None
        seen = (*seen, (id(module), tuple(path)))
        if first in ("crate", "self", "super"):
            base = {"crate": self.root, "self": module, "super": module.parent}[first]
            return base and (self.find(base, rest, seen) if rest else (base, None))
        if first in module.children and (rest or first not in module.items):
            child = module.children[first]
            if inside := self.find(child, rest, seen) if rest else (child, None):
                return inside
        if first in module.items:
            return module, first
        if first in module.uses:
            return self.find(module, module.uses[first] + rest, seen)
        for glob in module.globs:
            target = self.find(module, glob, seen)
            if target and target[1] is None and (inside := self.find(target[0], path, seen)):
                return inside
        return None

    def defined_methods(self):
        """{type: {function: file}}"""
        defined = {}
        for module in self.modules():
            for path, names, _ in module.impls:
                if target := self.find(module, path):
                    defined.setdefault((target[0].file, target[1]), {}).update(dict.fromkeys(names, module.file))
        return defined

    def arrows(self):
        """{file: {file: names}}"""
        arrows, defined = {}, self.defined_methods()

        def note(module, file, name):
            if file != module.file:
                arrows.setdefault(module.file, {}).setdefault(file, set()).add(name)

        def add(module, path):
            target = self.find(module, path)
            if not target or not target[1]:
                return
            note(module, target[0].file, target[1])
            method = path[-1] if len(path) > 1 and self.find(module, path[:-1]) == target else None
            file = defined.get((target[0].file, target[1]), {}).get(method)
            if file and file != target[0].file:
                note(module, file, f"{target[1]}::{method}")

        for module in self.modules():
            arrows.setdefault(module.file, {})
            for path in module.paths:
                add(module, path)
            for path in module.exports:
                target = self.find(module, path)
                if not target or path[-1] in module.words or not self.below(module, target[0]):
                    add(module, path)
            for path, _, calls in module.impls:
                target = self.find(module, path)
                methods = defined.get((target[0].file, target[1]), {}) if target else {}
                for name in calls & set(methods):
                    note(module, methods[name], f"{target[1]}::{name}")
            if module.globs:
                for word in module.words - module.items - set(module.uses):
                    add(module, [word])
        return arrows

    @staticmethod
    def below(module, other):
        while other is not None and other is not module:
            other = other.parent
        return other is module


def levels():
    lines = [line.split() for line in ROOMS.strip().splitlines()]
    return {room: level for level, rooms in enumerate(lines) for room in rooms}


def room_of(file, known):
    name = file.removesuffix("/mod.rs").removesuffix(".rs")
    while name not in known and "/" in name:
        name = name.rsplit("/", 1)[0]
    return name


def faults(arrows):
    """What breaks the rules of src/, as lines."""
    known, lines = levels(), []
    for file, others in sorted(arrows.items()):
        for other, names in sorted(others.items()):
            room, target = room_of(file, known), room_of(other, known)
            if room == "lib" or room == target:
                continue
            if known.get(target, 99) >= known.get(room, 99):
                lines.append(f"up: {file} ({room}) -> {other} ({target}): {', '.join(sorted(names))}")
        if room_of(file, known) not in known and file != "lib.rs":
            lines.append(f"no room: {file}: scripts/arrows.py does not say how high it lies")
    return lines + circles(arrows)


def circles(arrows, crate=""):
    """The circle of a crate's files, if there is one, as lines."""
    try:
        graphlib.TopologicalSorter(arrows).prepare()
    except graphlib.CycleError as error:
        part = sorted(set(error.args[1]))
        within = [(file, other) for file in part for other in sorted(arrows[file]) if other in part]
        lines = [f"    {a} -> {b}: {', '.join(sorted(arrows[a][b]))}" for a, b in within]
        return [f"circle of {len(part)} files: {crate}{' '.join(part)}", *lines]
    return []


def crates(top):
    """Folder and root file of the other crates."""
    folders = [f"{folder}/{name}" for folder in ("crates", "tools") for name in sorted(os.listdir(f"{top}/{folder}"))]
    for folder in [f"{name}/src" for name in [*folders, "gst-plugins", "python", "shaders-rs/kernels"]]:
        yield from ((folder, root) for root in ("lib.rs", "main.rs") if os.path.exists(f"{top}/{folder}/{root}"))


def check(top):
    source = os.path.join(top, "src")
    lines = faults(Tree(source).arrows())
    for folder, root in crates(top):
        lines += circles(Tree(os.path.join(top, folder), root).arrows(), f"{folder}: ")
    for room in levels():
        if not any(os.path.exists(os.path.join(source, room + end)) for end in (".rs", "/mod.rs")):
            lines.append(f"no file: {room}: scripts/arrows.py names a room that is not there")
    for line in lines:
        print(line)
    up = sum(line.startswith("up:") for line in lines)
    circular = sum(line.startswith("circle") for line in lines)
    print(f"arrows: {up} up, {circular} circles")
    return 1 if lines else 0


# Files of a small tree, and what the check must say of it: the starts of its lines.
TRIALS = [
    (
        {"lib.rs": "mod image; mod render;", "image.rs": "pub struct A;", "render.rs": "use crate::image::A;"},
        [],
    ),
    (
        {"lib.rs": "mod image; mod render;", "image.rs": "fn f() { crate::render::g() }", "render.rs": "pub fn g() {}"},
        ["up: image.rs (image) -> render.rs (render): g"],
    ),
    (  # Through a re-export; comments, literals and tests do not count.
        {
            "lib.rs": "mod image; mod render; pub use render::Scene as S;",
            "image.rs": "// crate::render::T\n const X: &str = \"crate::render::T\"; use crate::{S};\n"
            "#[cfg(test)] mod tests { use crate::render::T; }",
            "render.rs": "mod scene; pub use scene::*; pub struct T;",
            "render/scene.rs": "pub struct Scene;",
        },
        ["up: image.rs (image) -> render/scene.rs (render): Scene"],
    ),
    (  # A child that uses its parent's type, which the parent's own code gives it.
        {
            "lib.rs": "mod image;",
            "image/mod.rs": "mod child; pub use child::B; pub struct A; fn f(b: B) {}",
            "image/child.rs": "use super::*; pub struct B(A);",
        },
        ["circle of 2 files: image/child.rs image/mod.rs"],
    ),
    (  # The parent only re-exports.
        {
            "lib.rs": "mod image;",
            "image/mod.rs": "mod child; pub use child::B; pub struct A;",
            "image/child.rs": "use super::A; pub struct B(A);",
        },
        [],
    ),
    (  # A type with functions in two files.
        {
            "lib.rs": "mod image;",
            "image/mod.rs": "mod more; pub struct A; impl A { fn f(&self) { self.g() } }",
            "image/more.rs": "impl super::A { pub fn g(&self) {} }",
        },
        ["circle of 2 files: image/mod.rs image/more.rs"],
    ),
    (  # An attribute's path.
        {"lib.rs": "mod image; mod render;", "image.rs": "#[a(crate::render::A)] enum B {}", "render.rs": "enum A {}"},
        ["up: image.rs (image) -> render.rs (render): A"],
    ),
    ({"lib.rs": "mod cellar;", "cellar.rs": ""}, ["no room: cellar.rs"]),
]


def selftest():
    for files, expected in TRIALS:
        with tempfile.TemporaryDirectory() as source:
            for name, text in files.items():
                os.makedirs(os.path.dirname(os.path.join(source, name)), exist_ok=True)
                with open(os.path.join(source, name), "w", encoding="utf-8") as file:
                    file.write(text)
            found = [line for line in faults(Tree(source).arrows()) if not line.startswith(" ")]
            if len(found) != len(expected) or not all(map(str.startswith, found, expected)):
                print(f"arrows: selftest: {files} gives {found}, not {expected}")
                return 1
    print(f"arrows: selftest: {len(TRIALS)} trees passed")
    return 0


def main():
    top = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    what = sys.argv[1] if len(sys.argv) > 1 else "check"
    if what == "selftest":
        return selftest()
    if what == "check":
        return check(top)
    for file, others in sorted(Tree(os.path.join(top, "src")).arrows().items()):
        for other, names in sorted(others.items()):
            print(f"{file} -> {other}: {', '.join(sorted(names))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

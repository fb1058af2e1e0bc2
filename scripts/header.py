#!/usr/bin/env python3
"""Writes include/nvsprior.h and include/nvsprior_extra.h as crates/capi/src has them. Usage: header.py [FOLDER]

cbindgen translates all of crates/capi/src at once. This script puts its output in order: into the templates
crates/capi/src/*.h.in go first the functions that the template's own list names, then all others by subject. Before a
function stand the types that it takes, and before a type the constants that stand above it in the source.
"""

import itertools
import re
import subprocess
import sys
import tempfile
import textwrap

# The headers, with their parts: a title, and the files of crates/capi/src.
HEADERS = {
    "nvsprior": {
        "Statuses, and what any handle takes": "status handle",
        "Structures and versions": "structs version",
        "Engines": "log thread engine",
        "Priors": "prior",
        "Images and poses": "image frame",
        "Encoders": "keys encoding encoder",
        "What an encoder's camera sees": "lens",
        "Decoders": "decoder",
        "How far a picture is from what the camera saw": "truth",
        "The vehicle's end of a link": "event vehicle",
        "The topside's end of a link": "topside",
    },
    "nvsprior_extra": {
        "A Vulkan device of yours": "vulkan",
        "Frames in DMA-BUFs": "dmabuf",
        "Memory of yours": "allocator memory",
        "The devices there are": "device",
        "Counts of both ends of a link": "statistics",
    },
}
# Handles: many threads may use one of the first kind at once, one thread at a time one of the second.
SHARED, OWN = "nvsp_(?:engine|prior|dmabuf)", "nvsp_(?:encoder|decoder|vehicle|topside)"
ITEM = re.compile(r'^pub (?:unsafe )?(?:extern "C" )?(const|type|struct|fn) (\w+)', re.M)


def source(file):
    """A file of crates/capi/src with the pointers of C in place of the types that stand for them."""
    with open(f"crates/capi/src/{file}.rs", encoding="utf-8") as text:
        text = re.sub(r"^//!.*\n", "", text.read(), flags=re.M)
    text = re.sub(r"pub type (nvsp_\w+) = Handle<.*>;", r"pub struct \1 { _opaque: [u8; 0] }", text)
    text = re.sub(rf"\bOption<&({SHARED})>", r"*const \1", text)
    text = re.sub(r"\bOption<(?:&|Box<)(nvsp_\w+)>>?", r"*mut \1", text)
    text = re.sub(r"\bPlace<Box<(\w+)>>", r"*mut *mut \1", text)
    text = re.sub(r"\b(?:Out|Place)<([a-z]\w+)>", r"*mut \1", text)
    return re.sub(r"\bIn<([a-z]\w+)>", r"*const \1", text)


def code(block):
    """A block without its comments."""
    return "\n".join(line for line in block.split("\n") if not line.lstrip().startswith("//"))


def translate(sources):
    """What cbindgen makes of the sources: for each name its comment and declaration."""
    with tempfile.NamedTemporaryFile("w", suffix=".rs", encoding="utf-8") as file:
        file.write("\n".join(sources))
        file.flush()
        command = ["cbindgen", "--quiet", "--config", "cbindgen.toml", file.name]
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    items = {}
    for block in output.strip().split("\n\n"):
        declared = re.search(r"#define (\w+)|\(\*(\w+)\)\(|(\w+)\(|(\w+);\s*$", code(block))
        items[next(filter(None, declared.groups()))] = block
    return items


def function(block):
    """A function's block with its attribute: the status must be looked at. That a pointer is not NULL is no attribute:
    a compiler would take checks of it away, though NULL has a status."""
    block = re.sub(r"^//\n// # (?:Safety|Parameters)\n", "", block, flags=re.M)
    block = re.sub(r"^//\n(?=// Fails )", "", block, flags=re.M)
    comment, declaration = re.match(r"((?://.*\n)*)((?:.|\n)*)", block).groups()
    name = re.search(r"(\w+)\(", declaration)[1]
    # A call that cannot fail if it is used as it should be may be left unchecked.
    checked = declaration.startswith("nvsp_status ") and name not in ("nvsp_last_error", "nvsp_struct_init")
    declaration = ("NVSP_CHECKED " if checked else "") + re.sub(r"\s+", " ", declaration)
    # Lines end behind parameters.
    whole = re.sub(r"(?<!,) ", "\N{NO-BREAK SPACE}", declaration).replace("(", "( ", 1)
    filled = textwrap.fill(whole, 120, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return comment + re.sub(r"\( ", "(", filled.replace("\N{NO-BREAK SPACE}", " "))


def filled(block):
    """A block whose comments have full lines, and whose structure has its first two fields on one."""
    lines, text = [], None

    def put():
        if text is not None:
            indent, first, rest, words = text
            whole = textwrap.fill(" ".join(words), 120 - len(indent), initial_indent=first, subsequent_indent=rest,
                                  break_long_words=False, break_on_hyphens=False)
            lines.extend(indent + line for line in whole.split("\n"))

    for line in block.split("\n"):
        comment = re.fullmatch(r"( *)// (- )?(\S.*)", line)
        continued = re.fullmatch(r"( *)//   (\S.*)", line)
        fails = comment and comment[3].startswith("Fails ")
        if comment and (comment[2] or text is None or text[2] != "// " or fails):
            put()
            item = comment[2] or ""
            text = comment[1], "// " + item, "// " + " " * len(item), [comment[3]]
        elif comment:
            text[3].append(comment[3])
        elif continued and text and text[2] == "//   ":
            text[3].append(continued[2])
        else:
            put()
            text = None
            lines.append(line)
    put()
    head = "uint32_t struct_size;\n  uint32_t abi_version;"
    return beside("\n".join(lines)).replace(head, "uint32_t struct_size, abi_version;")


def beside(block):
    """A block whose constants and fields have their comment on the same line, if that has room for it."""
    lines = []
    for line in block.split("\n"):
        comment = re.fullmatch(r" *(// [^-].*)", lines[-1]) if lines else None
        long = len(lines) > 1 and lines[-2].lstrip().startswith("//")
        if comment and not long and re.fullmatch(r"#define .*| .*;", line) and len(line) + 1 + len(comment[1]) <= 120:
            lines[-1] = f"{line} {comment[1]}"
        else:
            lines.append(line)
    return "\n".join(lines)


def paragraphs(text):
    """The text with constants of one kind, such as statuses, next to each other."""
    between = re.compile(r"^(#define NVSP_([A-Z]+)_.*\n)\n(?=(?://.*\n)*#define NVSP_\2_)", re.M)
    return between.sub(r"\1", text)


class Writer:
    """Puts items in order."""

    def __init__(self, items, sources):
        self.items, self.left, self.text = items, set(items), []
        # The constants that stand above a name.
        self.above, constants = {}, []
        for kind, name in ITEM.findall("\n".join(sources)):
            if kind != "const":
                self.above[name], constants = constants, []
            elif name in items:
                constants.append(name)

    def put(self, name):
        """Writes an item, unless it is written, after all that it needs."""
        if name not in self.left:
            return
        self.left.remove(name)
        block = self.items[name]
        for word in re.findall(r"\w+", code(block)):
            self.put(word)
        # Constants of one kind form a paragraph.
        for _, kind in itertools.groupby(self.above.get(name, []), lambda constant: constant.split("_")[1]):
            paragraph = [self.items[constant] for constant in kind if constant in self.left]
            self.text += [filled("\n".join(paragraph))] if paragraph else []
        self.left -= set(self.above.get(name, []))
        # Examples are indented.
        lines = r"^// ```c$\n((?:.|\n)*?)^// ```$\n"
        block = re.sub(lines, lambda example: re.sub("^// ", "//     ", example[1], flags=re.M), block, flags=re.M)
        self.text.append(filled(function(block) if re.search(rf"\b{name}\(", code(block)) else block))


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else "include"
    files = {file: source(file) for parts in HEADERS.values() for names in parts.values() for file in names.split()}
    items = translate(files.values())
    for header, parts in HEADERS.items():
        own = [files[file] for names in parts.values() for file in names.split()]
        names = {name for _, name in ITEM.findall("\n".join(own))}
        writer = Writer({name: block for name, block in items.items() if name in names}, own)
        with open(f"crates/capi/src/{header}.h.in", encoding="utf-8") as file:
            template = file.read()
        for name in re.findall(r"^ \*   (nvsp_\w+)  ", template, flags=re.M):
            if name not in names:
                sys.exit(f"header: crates/capi/src/{header}.h.in lists {name}, which is no function of it")
            writer.put(name)
        for title, part in parts.items():
            writer.text.append(f"// ---- {title} ----")
            for _, name in ITEM.findall("\n".join(files[file] for file in part.split())):
                writer.put(name)
        with open(f"{folder}/{header}.h", "w", encoding="utf-8") as file:
            file.write(template.replace("@ITEMS@", paragraphs("\n\n".join(writer.text))))


main()

//! `docs/architecture.md` names files, functions and rooms, and `CONTRIBUTING.md` names files: they must exist.

use std::fs;
use std::path::Path;

fn text(file: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The texts between backquotes of the form `file.rs: function`, as file and function.
fn functions(document: &str) -> Vec<(String, &str)> {
    let quoted = document.split('`').skip(1).step_by(2);
    let pairs = quoted.filter_map(|quoted| quoted.split_once(".rs: "));
    pairs.map(|(file, function)| (format!("{file}.rs"), function)).collect()
}

/// The type of an `impl` block that begins with this line.
fn owner_of(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("impl")?;
    let mut depth = 0;
    let start = rest.find(|c| {
        depth += i32::from(c == '<') - i32::from(c == '>');
        depth == 0 && c == ' '
    })?;
    let subject = rest[start + 1..].rsplit(" for ").next()?;
    subject.split(['<', ' ', '{']).next()?.rsplit("::").next()
}

/// Whether a source defines `function`, or `function` of `Type` if that is `Type::function`.
fn defines(source: &str, function: &str) -> bool {
    let (owner, name) = function.split_once("::").unwrap_or(("", function));
    let is_definition = |line: &str| {
        let rest = line.split_once("fn ").and_then(|(_, rest)| rest.strip_prefix(name));
        rest.is_some_and(|rest| rest.starts_with(['(', '<']))
    };
    let mut within = String::new();
    source.lines().any(|line| {
        if let Some(owner) = owner_of(line) {
            within = owner.into();
        } else if line.starts_with('}') {
            within.clear();
        }
        within == owner && is_definition(line)
    })
}

#[test]
fn the_functions_of_a_frames_way_exist() {
    let document = text("docs/architecture.md");
    let functions = functions(&document);
    assert!(functions.len() >= 20, "the document lists {} functions", functions.len());
    let missing = functions.iter().filter(|(file, function)| !defines(&text(file), function));
    let missing: Vec<_> = missing.collect();
    assert!(missing.is_empty(), "{missing:?}");
}

/// NAME, SUBJECT and VERSION stand for what is new; `target/` is what the targets write.
#[test]
fn the_files_that_contributing_lists_exist() {
    let document = text("CONTRIBUTING.md");
    let quoted = document.split('`').skip(1).step_by(2).filter(|quoted| !quoted.contains(' '));
    let is_pattern =
        |path: &str| ["NAME", "SUBJECT", "VERSION", "*"].iter().any(|part| path.contains(part));
    let files = quoted.filter(|path| path.contains('/') && !path.starts_with("target/"));
    let files: Vec<&str> = files.filter(|path| !is_pattern(path)).collect();
    assert!(files.len() >= 20, "the document names {} files", files.len());
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let missing = files.iter().filter(|path| !root.join(path).exists());
    assert_eq!(missing.collect::<Vec<_>>(), [&""; 0]);
}

#[test]
fn the_rooms_are_those_that_make_lint_checks() {
    let (document, script) = (text("docs/architecture.md"), text("scripts/arrows.py"));
    let rooms =
        script.split("ROOMS = \"\"\"\n").nth(1).and_then(|rest| rest.split("\"\"\"").next());
    let listed = document.split("```\n").nth(1);
    assert_eq!(listed, rooms);
}

#[test]
fn a_function_is_found_with_its_type_only() {
    let source = "impl<'a, T: Copy> super::Packet<'a, T>\nwhere\n{\n    pub fn write(&self) {}\n}\n\
        fn size<T>() {}\n";
    for (function, expected) in [
        ("Packet::write", true),
        ("size", true),
        ("write", false),
        ("Other::write", false),
        ("Packet::wr", false),
    ] {
        assert_eq!(defines(source, function), expected, "{function}");
    }
}

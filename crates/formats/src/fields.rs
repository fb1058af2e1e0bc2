//! Whether docs/format/prior.md says what is done with each field of each format.

use nvsprior::prior::{Field, FieldUse, ply};

use crate::{gltf, sog, spz};

/// Each format, and what is done with its fields.
const FIELDS: [(&str, &[Field]); 5] = [
    ("PLY, properties", &ply::FIELDS),
    ("SPZ, extensions", &spz::FIELDS),
    ("SOG, `meta.json`", &sog::FIELDS),
    ("glTF, `KHR_gaussian_splatting`", &gltf::FIELDS),
    ("glTF, attributes", &gltf::ATTRIBUTES),
];

/// The table, in Markdown.
fn table() -> String {
    let names = |fields: &[Field], wanted: FieldUse| {
        let names = fields.iter().filter(|(_, used)| *used == wanted);
        names.map(|(name, _)| format!("`{name}`")).collect::<Vec<_>>().join(" ")
    };
    let mut table = String::from("| of | read | harmless | refused |\n| --- | --- | --- | --- |\n");
    for (format, fields) in FIELDS {
        let columns =
            [FieldUse::Read, FieldUse::Harmless, FieldUse::Refused].map(|used| names(fields, used));
        table += &format!("| {format} | {} |\n", columns.join(" | "));
    }
    table
}

/// `RENEW=1` writes it.
#[test]
fn the_document_has_this_table() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/format/prior.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (before, rest) = text.split_once("<!-- fields").unwrap();
    let (mark, rest) = rest.split_once("-->\n").unwrap();
    let (found, after) = rest.split_once("<!-- end of fields").unwrap();
    if std::env::var_os("RENEW").is_some() {
        let new = format!("{before}<!-- fields{mark}-->\n{}<!-- end of fields{after}", table());
        std::fs::write(path, new).unwrap();
        return;
    }
    assert_eq!(found, table(), "RENEW=1 writes it");
}

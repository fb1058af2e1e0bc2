//! `docs/gstreamer.md` lists the properties as they are.

use std::collections::BTreeMap;

use gst::glib::ParamFlags;
use gst::prelude::*;

/// Name to default and whether it is live, from the tables whose title names an element.
fn documented(text: &str, element: &str) -> BTreeMap<String, (String, bool)> {
    let sections = text.split("\n### ").skip(1);
    let of_it = sections.filter(|section| {
        let title = section.lines().next().unwrap_or_default();
        title.split([',', ' ']).any(|word| word == element)
    });
    let rows =
        of_it.flat_map(|section| section.lines().filter_map(|line| line.strip_prefix("| `")));
    rows.map(|row| {
        let cells: Vec<&str> = row.trim_end_matches('|').split('|').map(str::trim).collect();
        let name = cells[0].trim_end_matches('`').to_owned();
        (name, (cells[1].to_owned(), cells.last() == Some(&"live")))
    })
    .collect()
}

/// The same, from the element.
fn true_ones(element: &str) -> BTreeMap<String, (String, bool)> {
    let element = gst::ElementFactory::make(element).build().unwrap();
    let playing = ParamFlags::from_bits_retain(gst::ffi::GST_PARAM_MUTABLE_PLAYING as u32);
    let specs = element.list_properties();
    let own = specs.iter().filter(|spec| spec.owner_type() == element.type_());
    own.map(|spec| {
        let writable = spec.flags().contains(ParamFlags::WRITABLE);
        let default = spec.default_value();
        let text = match default.get::<Option<String>>() {
            Ok(text) => text.unwrap_or_default(),
            Err(_) if !writable => String::new(),
            Err(_) => number(&default.serialize().unwrap()),
        };
        (spec.name().to_owned(), (text, !writable || spec.flags().contains(playing)))
    })
    .collect()
}

/// A number as one writes it: without zeros at its end.
fn number(text: &str) -> String {
    match text.parse::<f64>() {
        Ok(value) => ((value * 1e6).round() / 1e6).to_string(),
        Err(_) => text.to_owned(),
    }
}

#[test]
fn the_tables_of_properties_are_true() {
    gst::init().unwrap();
    gstnvsprior::plugin_register_static().unwrap();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/gstreamer.md");
    let text = std::fs::read_to_string(file).unwrap();
    for element in ["nvspvehicle", "nvsptopside", "nvspenc", "nvspdec"] {
        assert_eq!(documented(&text, element), true_ones(element), "{element}");
    }
}

//! The vectors of `tests/vectors/`: the library makes of them what the manifest says. With `RENEW=1` they are made
//! anew (`make vectors`).

#[path = "../common/mod.rs"]
mod common;

mod bad;
mod dive;
mod keyed;
mod links;
mod packets;
mod priors;
mod results;
mod streams;
mod vector;

use std::path::{Path, PathBuf};
use std::sync::Once;

use nvsprior::coder_tables::Tables;
use nvsprior::prior::blocked::BlockedWriter;
use nvsprior::prior::{KeyFrames, compact, ply, with_coder_tables};
use nvsprior::{Prior, RenderOptions};
use serde_json::{Value, json};

use common::{assert_silent, engine};
use dive::{CAMERA, odd_prior, own_tables, prior};
use vector::{Kind, Vector, VectorKeys};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors")
}

fn manifest_path() -> PathBuf {
    folder().join("nvsprior.json")
}

/// The priors' files.
fn priors() -> Vec<(&'static str, Vec<u8>)> {
    let ply = |prior: &Prior| {
        let mut bytes = Vec::new();
        let (splats, options) = (prior.splats(), prior.options());
        ply::write_ply(splats, options, &KeyFrames::NONE, prior.preprocessing(), &mut bytes)
            .unwrap();
        bytes
    };
    let packed = {
        let key_frames = KeyFrames::new((0..3).map(dive::pose).collect()).unwrap();
        let (prior, mut bytes) = (prior().with_key_frames(key_frames), Vec::new());
        let besides = prior.besides();
        compact::write(prior.splats(), &besides, &Default::default(), &mut bytes).unwrap();
        bytes
    };
    let tables = with_coder_tables(&packed, Some(&own_tables())).unwrap();
    let focal = RenderOptions { trained_focal: Some(CAMERA.fx), ..RenderOptions::INRIA };
    let blocked = {
        let key_frames = KeyFrames::new((0..2).map(dive::pose).collect()).unwrap();
        let prior = Prior::from_splats(prior().splats().clone(), focal).unwrap();
        let prior = prior.with_key_frames(key_frames).with_coder_tables(Some(own_tables()));
        let (writer, mut bytes) =
            (BlockedWriter { block: 100, ..BlockedWriter::default() }, Vec::new());
        writer.write(prior.splats(), &prior.besides(), &mut bytes, &mut |_| ()).unwrap();
        bytes
    };
    vec![
        ("prior.ply", ply(&prior())),
        ("focal.ply", ply(&Prior::from_splats(prior().splats().clone(), focal).unwrap())),
        ("blocked.nvsb", blocked),
        ("odd.ply", ply(&odd_prior())),
        ("prior.nvsg", packed),
        ("tables.nvsg", tables),
    ]
}

fn open(name: &str, bytes: &[u8]) -> Prior {
    Prior::from_bytes(bytes, name, &Default::default()).unwrap()
}

/// Writes all vectors and the manifest.
fn renew() {
    let folder = folder();
    if folder.exists() {
        std::fs::remove_dir_all(&folder).unwrap();
    }
    std::fs::create_dir_all(&folder).unwrap();
    let files = priors();
    let prior = |name: &str| {
        let (name, bytes) = files.iter().find(|(own, _)| *own == name).unwrap();
        open(name, bytes)
    };
    files.iter().for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes).unwrap());
    let vectors: Vec<Vector> = [
        packets::vectors(&prior),
        streams::vectors(&prior),
        priors::vectors(),
        links::vectors(&prior),
        keyed::vectors(&prior),
        bad::vectors(&prior),
    ]
    .into_iter()
    .flatten()
    .collect();
    let entries: Vec<Value> = vectors
        .iter()
        .map(|vector| {
            std::fs::write(folder.join(format!("{}.bin", vector.name)), vector.file()).unwrap();
            vector.entry(&results::of(vector, &prior(vector.prior)))
        })
        .collect();
    let tables = |bytes: &[u8]| results::md5(&[bytes]);
    let manifest = json!({
        "name": "NVSPRIOR", "codec": "nvsprior", "format": "docs/format.md",
        "description": "Conformance vectors of the packet format: see docs/format.md, \"Vectors\"",
        "tables": {
            "generic": tables(&Tables::generic().write()),
            "stream": tables(&Tables::stream().write()),
        },
        "test_vectors": entries,
    });
    let text = serde_json::to_string_pretty(&manifest).unwrap() + "\n";
    std::fs::write(manifest_path(), text).unwrap();
}

/// The manifest; made anew first, if that is asked for.
fn manifest() -> Value {
    static RENEWED: Once = Once::new();
    RENEWED.call_once(|| {
        if std::env::var_os("RENEW").is_some() {
            renew();
        }
    });
    let bytes = std::fs::read(manifest_path()).expect("vectors: make them by `make vectors`");
    serde_json::from_slice(&bytes).unwrap()
}

/// A vector as the manifest and its file state it.
fn read(entry: &Value) -> Vector {
    let text = |name: &str| entry[name].as_str().unwrap_or_default().to_owned();
    let bytes = std::fs::read(folder().join(text("input_file"))).unwrap();
    assert_eq!(results::md5(&[&bytes]), text("source_checksum"), "{}", text("name"));
    let mut records = Vec::new();
    let mut rest = &bytes[..];
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let (record, after) = after.split_at(u32::from_le_bytes(*length) as usize);
        records.push(record.to_vec());
        rest = after;
    }
    let number = |name: &str| entry[name].as_u64().unwrap_or_default() as usize;
    let kind = match entry["kind"].as_str().unwrap() {
        "packets" => Kind::Packets { trust: nvsprior::Trust::Whole },
        "starts" => Kind::Packets { trust: nvsprior::Trust::Start },
        "link" => links::kind(number("mtu"), number("streams"), number("room")),
        "reports" => Kind::Reports,
        _ => Kind::Priors,
    };
    let camera = |v: &Value| {
        let at = |i: usize| v[i].as_f64().unwrap();
        nvsprior::Camera {
            width: at(0) as u32,
            height: at(1) as u32,
            fx: at(2) as f32,
            fy: at(3) as f32,
            cx: at(4) as f32,
            cy: at(5) as f32,
        }
    };
    let cameras = entry["cameras"].as_array().into_iter().flatten().map(camera).collect();
    let bytes_of = |text: &str| -> [u8; 32] {
        let digit = |at: usize| u8::from_str_radix(&text[2 * at..2 * at + 2], 16).unwrap();
        std::array::from_fn(digit)
    };
    let keys = entry["keys"].as_array().map(|keys| VectorKeys {
        keys: keys.iter().map(|key| bytes_of(key.as_str().unwrap())).collect(),
        tag_bytes: number("tag"),
        epoch: text("epoch").parse().unwrap(),
    });
    Vector {
        kind,
        cameras,
        keys,
        frames: links::FRAMES,
        name: text("name"),
        ..Vector::packets("", "", records)
    }
}

#[test]
fn the_library_makes_of_the_vectors_what_the_manifest_says() {
    let manifest = manifest();
    let entries = manifest["test_vectors"].as_array().unwrap();
    assert!(entries.len() >= 60, "{}", entries.len());
    for entry in entries {
        let vector = read(entry);
        let name = entry["prior"].as_str().unwrap();
        let prior = open(name, &std::fs::read(folder().join(name)).unwrap());
        let outcome = results::of(&vector, &prior);
        let found = vector.entry(&outcome);
        for (place, record) in outcome.records.iter().enumerate() {
            assert_eq!(*record, entry["records"][place], "{}, record {place}", vector.name);
        }
        assert_eq!(found["packets"], entry["packets"], "{}", vector.name);
        assert_eq!(found["result"], entry["result"], "{}", vector.name);
    }
    assert_silent(&engine());
}

#[test]
fn the_tables_are_those_that_the_vectors_were_made_with() {
    let manifest = manifest();
    let found = [Tables::generic(), Tables::stream()].map(|t| results::md5(&[&t.write()]));
    let told =
        ["generic", "stream"].map(|name| manifest["tables"][name].as_str().unwrap().to_owned());
    assert_eq!(found, told, "coder tables changed: `make vectors`");
}

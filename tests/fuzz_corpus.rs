//! Runs the fuzz targets on the corpora that fuzzing left, and on what it found. This is quick
//! enough for every run of the tests. `fuzz/README.md` says how to go on fuzzing.

#[path = "../fuzz/src/compact.rs"]
mod compact;
#[path = "../fuzz/src/keyed.rs"]
mod keyed;
#[path = "../fuzz/src/packed.rs"]
mod packed;
#[path = "../fuzz/src/packet.rs"]
mod packet;
#[path = "../fuzz/src/ply.rs"]
mod ply;
#[path = "../fuzz/src/shares.rs"]
mod shares;
#[path = "../fuzz/src/unprotected.rs"]
mod unprotected;
#[path = "../fuzz/src/vehicle.rs"]
mod vehicle;
#[path = "../fuzz/src/wavelet.rs"]
mod wavelet;

use std::collections::BTreeSet;
use std::path::PathBuf;

/// The files of a target's corpus, and what is in them.
fn corpus(name: &str) -> impl Iterator<Item = (PathBuf, Vec<u8>)> {
    let folder = format!("{}/fuzz/corpus/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_dir(folder).expect("a corpus").map(|entry| {
        let path = entry.expect("an entry").path();
        let bytes = std::fs::read(&path).expect("a file");
        (path, bytes)
    })
}

/// Runs a target on its corpus.
fn run(name: &str, target: fn(&[u8])) {
    let mut count = 0;
    for (path, bytes) in corpus(name) {
        println!("{}", path.display());
        target(&bytes);
        count += 1;
    }
    assert!(count >= 20, "{count} inputs of {name}");
}

#[test]
fn packets() {
    run("packet", packet::run);
}

#[test]
fn packets_reach_all_of_the_decoder() {
    let reached: BTreeSet<String> =
        corpus("packet").flat_map(|(_, bytes)| packet::reaches(&bytes)).collect();
    let parts = [
        "small blocks",
        "stream",
        "inter frame",
        "missing reference",
        "start of a residual",
        "truth map",
        "truth map that is predicted",
        "session part",
        "render part",
        "uncertain pose",
        "device that is not portable",
        "short pose",
        "compact pose",
    ];
    for expected in parts {
        assert!(reached.contains(expected), "no packet of the corpus has: {expected}");
    }
}

#[test]
fn payloads() {
    run("wavelet", wavelet::run);
}

#[test]
fn unprotected_packets() {
    run("unprotected", unprotected::run);
}

#[test]
fn shares_of_packets() {
    run("shares", shares::run);
}

#[test]
fn keyed_frames() {
    run("keyed", keyed::run);
}

#[test]
fn priors() {
    run("ply", ply::run);
}

#[test]
fn compact_priors() {
    run("compact", compact::run);
}

#[test]
fn packed_priors() {
    run("packed", packed::run);
}

//! Runs the fuzz targets on the corpora that fuzzing left, and on what it found. This is quick
//! enough for every run of the tests. `fuzz/README.md` says how to go on fuzzing.

#[path = "../fuzz/src/compact.rs"]
mod compact;
#[path = "../fuzz/src/packed.rs"]
mod packed;
#[path = "../fuzz/src/packet.rs"]
mod packet;
#[path = "../fuzz/src/pieces.rs"]
mod pieces;
#[path = "../fuzz/src/ply.rs"]
mod ply;
#[path = "../fuzz/src/shares.rs"]
mod shares;
#[path = "../fuzz/src/unprotected.rs"]
mod unprotected;
#[path = "../fuzz/src/update.rs"]
mod update;
#[path = "../fuzz/src/wavelet.rs"]
mod wavelet;

/// Runs a target on its corpus.
fn run(name: &str, target: fn(&[u8])) {
    let folder = format!("{}/fuzz/corpus/{name}", env!("CARGO_MANIFEST_DIR"));
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).expect("a corpus") {
        let path = entry.expect("an entry").path();
        let bytes = std::fs::read(&path).expect("a file");
        println!("{}", path.display());
        target(&bytes);
        count += 1;
    }
    assert!(count >= 20, "{count} inputs in {folder}");
}

#[test]
fn packets() {
    run("packet", packet::run);
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
fn pieces_of_updates() {
    run("pieces", pieces::run);
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

#[test]
fn updates_of_priors() {
    run("update", update::run);
}

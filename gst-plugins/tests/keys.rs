//! Elements with keys: what `nvsppay` sends is shown, and nothing else.

#[path = "../../tests/common/mod.rs"]
mod common;
mod fixture;
#[path = "../../tests/scene/mod.rs"]
mod scene;

use fixture::{Pipeline, fixture};
use gst::glib;
use gst::prelude::*;
use nvsprior::keys::{Content, Key, Keys, Refusal, Verifier};
use nvsprior::modem::Report;

/// A folder with key files.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = tempfile::tempdir().unwrap();
        for (name, digit) in [("own", "1"), ("other", "2")] {
            let text = format!("# {name}\n{}\n", digit.repeat(64));
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        std::fs::write(folder.path().join("bad"), "5ec4e7\n").unwrap();
        Folder(folder)
    }

    /// The property with a file of this name.
    fn key(&self, name: &str) -> String {
        format!("key-file={}", self.0.path().join(name).display())
    }
}

fn count(stats: &gst::Structure, name: &str) -> u64 {
    stats.get(name).unwrap()
}

#[test]
fn pictures_come_through_and_strangers_do_not() {
    let (fixture, folder) = (fixture(), Folder::new());
    let frames = &fixture.frames[..6];
    let own = folder.key("own");
    for (encoder, payloader) in [
        ("rate=link bit-rate=40000 loss=0 mtu=64 tag-bytes=4", "loss=0"),
        ("rate=bytes bytes=200", "loss=0 mtu=64"),
    ] {
        let pay = format!("nvsppay name=payloader {payloader} {own} epoch=3");
        let shares = fixture.encoding(encoder, &pay).run(frames);
        assert!(shares.bytes().iter().all(|share| share.len() <= 64), "{encoder}");
        let shown = |topside: &str| {
            let depay = format!("{pay} ! nvspdepay name=depayloader mtu=64 {topside}");
            let pipeline = fixture.pipeline(encoder, &depay);
            let shown = pipeline.run(frames);
            (shown.buffers.len(), pipeline.stats("payloader"), pipeline.stats("depayloader"))
        };
        let (pictures, sent, heard) = shown(&format!("{own} epoch=3"));
        assert_eq!(pictures, 6, "{encoder}: {heard}");
        assert_eq!(count(&sent, "next-number"), count(&heard, "datagrams"));
        assert_eq!((count(&heard, "refused"), count(&heard, "foreign")), (0, 0));
        for strange in ["", &own, &format!("{own} epoch=3 tag-bytes=5"), &folder.key("other")] {
            let (pictures, _, heard) = shown(strange);
            assert_eq!(pictures, 0, "{strange}: {heard}");
            assert_eq!(count(&heard, "refused"), count(&heard, "datagrams"));
            let foreign = if strange.is_empty() { 0 } else { count(&heard, "datagrams") };
            assert_eq!(count(&heard, "foreign"), foreign, "{strange}");
        }
    }
}

#[test]
fn a_plan_without_room_for_tags_is_named() {
    let (fixture, folder) = (fixture(), Folder::new());
    let own = folder.key("own");
    for (tag, payloader) in [(0, format!("nvsppay {own}")), (4, "nvsppay".into())] {
        let encoder = format!("rate=link bit-rate=40000 tag-bytes={tag}");
        let pipeline = fixture.encoding(&encoder, &payloader);
        assert!(pipeline.run(&fixture.frames[..2]).buffers.is_empty());
        let warnings = pipeline.warnings();
        assert!(warnings.iter().any(|text| text.contains("its tag-bytes must be")), "{warnings:?}");
    }
}

#[test]
fn key_files_that_cannot_be_used_are_named_and_not_shown() {
    let (fixture, folder) = (fixture(), Folder::new());
    for (name, text) in [("bad", "line 1: a key is 64 hexadecimal digits"), ("none", "none")] {
        let key = folder.key(name);
        let pipeline = fixture.encoding("rate=bytes bytes=200", &format!("nvsppay {key}"));
        assert!(pipeline.0.set_state(gst::State::Playing).is_err());
        let error = pipeline.error().unwrap();
        assert!(error.contains("property key-file") && error.contains(text), "{error}");
        assert!(!error.contains("5ec4e7"), "{error}");
    }
}

/// The vehicle takes a report once, by the key that both have.
#[test]
fn reports_have_a_tag() {
    let (fixture, folder) = (fixture(), Folder::new());
    let own = folder.key("own");
    let text = format!("nvsppay loss=0 {own} ! nvspdepay name=depayloader {own}");
    let pipeline: Pipeline = fixture.encoding("rate=bytes bytes=200", &text);
    pipeline.play();
    pipeline.push_frames(&fixture.frames[..4]);
    pipeline.end();
    pipeline.drain();
    let report = pipeline
        .element("depayloader")
        .emit_by_name::<Option<glib::Bytes>>("report", &[])
        .expect("packets have come");
    assert_eq!(count(&pipeline.stats("depayloader"), "next-number"), 1);
    let verifier = |byte| {
        let keys = Keys::new([Key::new([byte; 32])]).unwrap();
        Verifier::new(&keys.with_tag_bytes(4).unwrap(), Content::Report)
    };
    assert_eq!(verifier(0x22).verify(&report).err(), Some(Refusal::Foreign));
    let mut own = verifier(0x11);
    let content = own.verify(&report).unwrap().content;
    let (report_of, _) = Report::read(content).unwrap();
    assert_eq!(report_of.newest(), 3);
    assert_eq!(own.verify(&report).err(), Some(Refusal::Replayed));
}

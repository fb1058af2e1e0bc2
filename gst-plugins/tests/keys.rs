//! Ends of a link with keys: what the vehicle sends is shown, and nothing else.

#[path = "../../tests/common/mod.rs"]
mod common;
mod fixture;
#[path = "../../tests/scene/mod.rs"]
mod scene;

use fixture::fixture;
use gst::glib;
use gst::prelude::*;
use nvsprior_link::keys::{Content, Key, Keys, Refusal, Verifier};
use nvsprior_link::modem::Report;

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
    let vehicle = format!("bit-rate=40000 loss=0 mtu=64 {own} epoch=3");
    let shares = fixture.sending(&vehicle).run(frames);
    assert!(shares.bytes().iter().all(|share| share.len() <= 64));
    let shown = |topside: &str| {
        let pipeline = fixture.link(&vehicle, topside);
        let shown = pipeline.run(frames);
        (shown.buffers.len(), pipeline.stats("vehicle"), pipeline.stats("topside"))
    };
    let (pictures, sent, heard) = shown(&format!("{own} epoch=3"));
    assert_eq!(pictures, 6, "{heard}");
    assert_eq!(count(&sent, "shares"), count(&heard, "datagrams"));
    assert_eq!((count(&heard, "refused"), count(&heard, "foreign")), (0, 0));
    for strange in ["", &own, &format!("{own} epoch=3 tag-bytes=5"), &folder.key("other")] {
        let (pictures, _, heard) = shown(strange);
        assert_eq!(pictures, 0, "{strange}: {heard}");
        assert_eq!(count(&heard, "refused"), count(&heard, "datagrams"));
        let foreign = if strange.is_empty() { 0 } else { count(&heard, "datagrams") };
        assert_eq!(count(&heard, "foreign"), foreign, "{strange}");
    }
}

#[test]
fn key_files_that_cannot_be_used_are_named_and_not_shown() {
    let (fixture, folder) = (fixture(), Folder::new());
    for (name, text) in [("bad", "line 1: a key is 64 hexadecimal digits"), ("none", "none")] {
        let key = folder.key(name);
        let pipeline = fixture.sending(&key);
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
    let pipeline = fixture.link(&format!("loss=0 bit-rate=20000 {own}"), &own);
    pipeline.play();
    pipeline.push_frames(&fixture.frames[..4]);
    pipeline.end();
    pipeline.drain();
    let report = pipeline
        .element("topside")
        .emit_by_name::<Option<glib::Bytes>>("report", &[])
        .expect("packets have come");
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

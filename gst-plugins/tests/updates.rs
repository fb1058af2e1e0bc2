//! Updates of the prior in pipelines: what the vehicle learns, the topside draws with.

#[path = "../../tests/common/mod.rs"]
mod common;
mod fixture;
#[path = "../../tests/scene/mod.rs"]
mod scene;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use fixture::{Fixture, Given, Pipeline, fixture, pose_text, psnr};
use gst::glib;
use gst::prelude::*;
use nvsprior::prior::UpdateChain;
use nvsprior::{Picture, Pose};
use scene::{CAMERA, clean_frame, wall, wall_with_box};

/// A camera that goes along the wall and back, some pixels from frame to frame.
fn dive_pose(index: usize) -> Pose {
    let back = 2 * (LENGTH - 1);
    let at = (index % back).min(back - index % back) as f64;
    Pose::IDENTITY.stepped(&[1.5 - 0.15 * at, 0.02 * at, 0.0, 0.0, 0.0, 0.0])
}

/// Frames from one end of the wall to the other.
const LENGTH: usize = 20;
const FRAMES: usize = 80;
/// So many are enough to learn from.
const FEW: usize = 32;

/// The wall with a box that the prior does not show.
fn frames() -> &'static [Picture] {
    static DIVE: OnceLock<Vec<Picture>> = OnceLock::new();
    DIVE.get_or_init(|| {
        let engine = common::engine();
        let scene = engine.upload(&wall_with_box(1)).unwrap();
        (0..FRAMES).map(|t| clean_frame(&engine, &scene, &dive_pose(t))).collect()
    })
}

/// A link with room for updates.
const LINK: &str = "rate=link bit-rate=20000 mtu=64";

/// A vehicle that learns, on its dive.
fn vehicle(properties: &str) -> String {
    // The last start counts.
    let start = pose_text(&dive_pose(0));
    let properties = format!("{properties} post-messages=true start={start}");
    format!("{} ! {}", Fixture::source(), fixture().encoder(&properties))
}

fn topside(properties: &str) -> String {
    let camera = format!(
        "camera={},{},{},{},{},{}",
        CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy
    );
    format!("{} post-messages=true {camera} {properties}", fixture().decoder())
}

/// What elements said of frames, by frame number.
struct Said {
    vehicle: BTreeMap<u32, gst::Structure>,
    topside: BTreeMap<u32, gst::Structure>,
}

impl Said {
    fn of(pipeline: &Pipeline) -> Said {
        let mut said = Said { vehicle: BTreeMap::new(), topside: BTreeMap::new() };
        for figures in pipeline.element_messages() {
            let side = match figures.name().as_str() {
                "nvspenc-frame" => &mut said.vehicle,
                _ => &mut said.topside,
            };
            side.insert(figures.get("frame").unwrap(), figures);
        }
        said
    }

    /// Number of the update that the vehicle drew a frame with.
    fn update(&self, frame: u32) -> u32 {
        self.vehicle[&frame].get("updates").unwrap()
    }

    /// The first frame that was drawn with an update of this number.
    fn adopted(&self, number: u32) -> u32 {
        let of = self.vehicle.keys().copied().find(|frame| self.update(*frame) == number);
        of.unwrap_or_else(|| panic!("update {number} was never drawn with: {:?}", self.vehicle))
    }

    /// Checks that the pictures of packets that came whole are those that the vehicle saw: they have its PSNR to the
    /// last digits. Returns how many of them were drawn with an update.
    fn assert_same(&self, shown: &Given) -> usize {
        let frames = frames();
        let mut learnt = 0;
        assert_eq!(shown.buffers.len(), self.topside.len());
        for (picture, (frame, figures)) in shown.bytes().iter().zip(&self.topside) {
            let vehicle = &self.vehicle[frame];
            let field = |name| vehicle.get::<f64>(name).unwrap();
            let bytes = |of: &gst::Structure| of.get::<u32>("bytes").unwrap();
            let found = psnr(picture, &frames[*frame as usize].data);
            if figures.has_field("missing-update") {
                let expected = field("render-psnr");
                assert!(found < expected - 1.0, "frame {frame}: {found} dB is the render's");
            } else if bytes(figures) == bytes(vehicle) {
                let expected = field("psnr");
                assert!((found - expected).abs() < 1e-9, "frame {frame}: {found}, {expected} dB");
                learnt += usize::from(self.update(*frame) > 0);
            }
        }
        learnt
    }
}

fn count(stats: &gst::Structure, name: &str) -> u64 {
    stats.get(name).unwrap_or_else(|error| panic!("{error}: {stats}"))
}

fn state(stats: &gst::Structure) -> String {
    stats.get("state").unwrap_or_else(|error| panic!("{error}: {stats}"))
}

/// Pieces of updates begin with two zero bits.
fn is_piece(share: &gst::Buffer) -> bool {
    share.map_readable().unwrap()[0] >> 6 == 0
}

#[test]
fn over_a_lossy_link_both_sides_draw_with_what_the_vehicle_learnt() {
    let vehicle = vehicle(&format!("learn=60 {LINK} loss=0.2"));
    let text = format!(
        "{vehicle} ! queue ! nvsppay name=payloader ! nvspdepay name=depayloader ! queue ! {}",
        topside("")
    );
    let pipeline = Pipeline::new(&text);
    let (all, lost) = (AtomicUsize::new(0), Arc::new(AtomicUsize::new(0)));
    let pieces = lost.clone();
    let pad = pipeline.element("payloader").static_pad("src").unwrap();
    // The first packet tells the camera.
    pad.add_probe(gst::PadProbeType::BUFFER, move |_, info| {
        let index = all.fetch_add(1, Ordering::Relaxed);
        if index < 20 || !index.is_multiple_of(6) {
            return gst::PadProbeReturn::Ok;
        }
        let is_piece = info.buffer().is_some_and(|buffer| is_piece(&buffer.to_owned()));
        pieces.fetch_add(usize::from(is_piece), Ordering::Relaxed);
        gst::PadProbeReturn::Drop
    });
    let shown = pipeline.run(&frames()[..FEW]);
    let said = Said::of(&pipeline);
    assert!(lost.load(Ordering::Relaxed) > 2, "pieces were lost, too");
    let [vehicle, sent, came, topside] =
        ["encoder", "payloader", "depayloader", "decoder"].map(|name| pipeline.stats(name));
    assert_eq!(state(&vehicle), state(&topside));
    assert!(vehicle.get::<u32>("updates").unwrap() >= 1 && count(&topside, "outdated") == 0);
    assert!(count(&came, "updates") >= 1 && count(&sent, "pieces") > 10, "{sent} {came}");
    assert!(said.assert_same(&shown) > 3);
    let psnr = |frame| said.vehicle[&frame].get::<f64>("render-psnr").unwrap();
    let adopted = said.adopted(1);
    assert!(psnr(adopted) > psnr(adopted - 1) + 5.0, "it shows what is new");
    // While pieces go, pictures get less of the link.
    let budget = |frame: u32| said.vehicle[&frame].get::<u32>("budget").unwrap();
    assert!(budget(adopted - 1) * 4 < budget(4) * 3, "{} of {}", budget(adopted - 1), budget(4));
    let bytes = count(&sent, "bytes") + count(&sent, "piece-bytes");
    assert!(bytes * 8 < 20_000 * (FEW as u64 / 5 + 1), "{bytes} bytes");
    assert_eq!(pipeline.warnings(), Vec::<String>::new());
}

#[test]
fn without_a_link_the_decoder_says_that_it_holds_an_update() {
    for mode in ["intra", "stream"] {
        let vehicle = vehicle(&format!("learn=60 rate=bytes bytes=300 mode={mode}"));
        let pipeline = Pipeline::new(&format!("{vehicle} ! {}", topside("")));
        let shown = pipeline.run(&frames()[..FEW]);
        let said = Said::of(&pipeline);
        assert!(said.assert_same(&shown) > 10, "{mode}");
        let (vehicle, topside) = (pipeline.stats("encoder"), pipeline.stats("decoder"));
        assert_eq!((state(&vehicle), count(&topside, "outdated")), (state(&topside), 0));
    }
}

/// A topside that began in the middle gets the updates when they are repeated. Until then it says so, once.
#[test]
fn a_topside_that_joins_late_gets_the_updates() {
    let vehicle = vehicle(&format!("learn=60 {LINK} loss=0.05"));
    let sending = Pipeline::new(&format!("{vehicle} ! nvsppay"));
    let shares = sending.run(frames());
    let vehicle = Said::of(&sending).vehicle;
    let mut said = Said { vehicle, topside: BTreeMap::new() };
    let from = said.adopted(1) as u64 + 2;
    let source = "appsrc name=source format=time caps=application/x-nvsprior-share,framerate=5/1";
    let text = format!("{source} ! nvspdepay name=depayloader ! {}", topside(""));
    let joined = Pipeline::new(&text);
    joined.play();
    let joins = gst::ClockTime::SECOND / fixture::RATE * from;
    let late = shares.buffers.iter().filter(|share| share.pts() >= Some(joins));
    late.for_each(|share| joined.push_buffer(share.clone()));
    joined.end();
    let shown = joined.drain();
    said.topside = Said::of(&joined).topside;
    let outdated: Vec<bool> =
        said.topside.values().map(|of| of.has_field("missing-update")).collect();
    let last = outdated.iter().rposition(|outdated| *outdated).expect("first it lacks the update");
    assert!(outdated[0] && last + 5 < outdated.len(), "{outdated:?}");
    assert!(said.assert_same(&shown) > 4);
    let newest = said.vehicle.values().next_back().unwrap();
    assert_eq!(state(&joined.stats("decoder")), state(newest));
    let warnings = joined.warnings();
    assert!(warnings.len() == 1 && warnings[0].contains("drawn with update 1"), "{warnings:?}");
}

/// The updates in the dive file of a folder.
fn kept(folder: &Path) -> UpdateChain {
    let read = UpdateChain::open(&folder.join("dive.nvsu")).unwrap();
    assert!(read.left_out.is_none());
    read.chain
}

#[test]
fn the_next_dive_begins_with_what_both_sides_kept() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [own, theirs] = [0, 1].map(|side: usize| folders[side].path());
    let vehicle =
        |learn: u32| vehicle(&format!("learn={learn} updates={} {LINK} loss=0", own.display()));
    let topside = topside(&format!("learnt={}", theirs.display()));
    let link = "nvsppay name=payloader ! nvspdepay";
    let first = Pipeline::new(&format!("{} ! {link} ! {topside}", vehicle(60)));
    first.run(&frames()[..FEW]);
    first.stop();
    let chain = kept(own);
    assert!(!chain.updates().is_empty());
    assert_eq!(kept(theirs), chain);
    // The next dive: nothing is learnt, and nothing is sent but repetitions.
    let second = Pipeline::new(&format!("{} ! {link} ! {topside}", vehicle(0)));
    let shown = second.run(&frames()[..6]);
    let said = Said::of(&second);
    let of_chain = chain.learnt().state().to_string();
    assert!(said.vehicle.values().all(|figures| state(figures) == of_chain));
    assert_eq!(said.assert_same(&shown), 6);
    let sent = second.stats("payloader");
    assert_eq!(count(&sent, "updates"), chain.updates().len() as u64);
    assert!(count(&sent, "piece-bytes") * 8 < 2 * 20_000 / 10, "{sent}");
    assert_eq!(count(&second.stats("decoder"), "outdated"), 0);
    assert_eq!(second.warnings(), Vec::<String>::new());
}

#[test]
fn files_that_cannot_be_used_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("dive.nvsu");
    UpdateChain::none(wall(2).id()).save(&file).unwrap();
    let file = file.display();
    for (text, named) in [
        (vehicle(&format!("updates={file}")), "property updates"),
        (vehicle("updates=/no/such/folder/dive.nvsu"), "/no/such/folder"),
        (topside(&format!("learnt={file}")), "property learnt"),
        (topside(&format!("learnt={} updates=false", folder.path().display())), "updates=false"),
    ] {
        let source = if text.starts_with("nvspdec") { "appsrc ! " } else { "" };
        let pipeline = Pipeline::new(&format!("{source}{text}"));
        assert!(pipeline.0.set_state(gst::State::Playing).is_err(), "{text}");
        let error = pipeline.error().unwrap();
        assert!(error.contains(named), "{error}");
    }
}

/// Without room on the topside nothing is adopted.
#[test]
fn a_topside_without_room_says_so_once() {
    let text =
        format!("{} ! {}", vehicle("learn=60 rate=bytes bytes=300"), topside("updates=false"));
    let pipeline = Pipeline::new(&text);
    let shown = pipeline.run(&frames()[..20]);
    let said = Said::of(&pipeline);
    assert_eq!((said.assert_same(&shown), said.update(19)), (0, 0));
    assert!(count(&pipeline.stats("encoder"), "update-bytes") > 0, "one was proven");
    let warnings = pipeline.warnings();
    assert!(warnings.len() == 1 && warnings[0].contains("property updates"), "{warnings:?}");
}

/// With a return channel the vehicle draws with an update once a report says that the topside holds it.
#[test]
fn reports_tell_the_vehicle_what_the_topside_holds() {
    let vehicle = vehicle(&format!("learn=60 {LINK} loss=0.05 spread=0"));
    let link = "nvsppay name=payloader expect-reports=true ! nvspdepay name=depayloader";
    let pipeline = Pipeline::new(&format!("{vehicle} ! {link} ! {}", topside("")));
    let [payloader, depayloader] = ["payloader", "depayloader"].map(|of| pipeline.element(of));
    let report = || depayloader.emit_by_name::<Option<glib::Bytes>>("report", &[]);
    let hear = |report: &glib::Bytes| payloader.emit_by_name::<bool>("report", &[report]);
    pipeline.play();
    assert!(report().is_none(), "nothing has come");
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    let mut shown = Given::default();
    let mut step = |index: usize| {
        pipeline.push(index, &frames()[index].data);
        let sample = sink.try_pull_sample(gst::ClockTime::from_seconds(60)).expect("a picture");
        shown.buffers.push(sample.buffer_owned().unwrap());
    };
    (0..24).for_each(&mut step);
    assert!(pipeline.stats("decoder").has_field("updates"), "the topside holds it");
    assert!(!hear(&glib::Bytes::from_static(b"no report")));
    assert!(hear(&report().unwrap()));
    (24..26).for_each(&mut step);
    let said = Said::of(&pipeline);
    assert_eq!((said.update(23), said.adopted(1)), (0, 24));
    assert_eq!(said.assert_same(&shown), 2);
}

#[test]
fn after_a_flush_an_update_that_waited_is_adopted() {
    for link in ["nvsppay ! nvspdepay ! ", ""] {
        let text =
            format!("{} ! {link}{}", vehicle(&format!("learn=60 {LINK} loss=0")), topside(""));
        let pipeline = Pipeline::new(&text);
        let encoder = pipeline.element("encoder");
        let is_update = |event: &gst::EventRef| {
            event.structure().is_some_and(|fields| fields.name() == "nvsprior-update")
        };
        // The flush takes the update away.
        let (is_gone, gone) = (Arc::new(AtomicUsize::new(0)), AtomicUsize::new(0));
        let seen = is_gone.clone();
        let pad = encoder.static_pad("src").unwrap();
        pad.add_probe(gst::PadProbeType::EVENT_DOWNSTREAM, move |_, info| {
            let is_first = info.event().is_some_and(|event| is_update(event))
                && gone.fetch_add(1, Ordering::Relaxed) == 0;
            seen.fetch_add(usize::from(is_first), Ordering::Relaxed);
            if is_first { gst::PadProbeReturn::Handled } else { gst::PadProbeReturn::Ok }
        });
        pipeline.play();
        let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
        let mut index = 0;
        while is_gone.load(Ordering::Relaxed) == 0 {
            pipeline.push(index, &frames()[index].data);
            assert!(sink.pull_sample().is_ok());
            index += 1;
        }
        let source = pipeline.element("source");
        assert!(source.send_event(gst::event::FlushStart::new()));
        assert!(source.send_event(gst::event::FlushStop::new(true)));
        // The camera is at the start of the dive again.
        for (k, frame) in frames()[..12].iter().enumerate() {
            pipeline.push(k, &frame.data);
        }
        pipeline.end();
        let shown = pipeline.drain();
        assert_eq!(shown.buffers.len(), 12);
        let (vehicle, topside) = (pipeline.stats("encoder"), pipeline.stats("decoder"));
        assert!(vehicle.get::<u32>("updates").unwrap() >= 1, "{vehicle}");
        assert_eq!((state(&vehicle), count(&topside, "outdated")), (state(&topside), 0));
    }
}

/// A program of one's own gives `nvsppay` packets and updates. While no packet comes, pieces wait, and most of them are
/// then left out.
#[test]
fn after_a_pause_pieces_do_not_pile_up() {
    let packets = fixture().encoding("rate=bytes bytes=200", "").run(&fixture().frames).bytes();
    let source = "appsrc name=source format=time caps=video/x-nvsprior,framerate=5/1";
    let properties = "bit-rate=20000 loss=0 update-share=0.5";
    let pipeline = Pipeline::new(&format!("{source} ! nvsppay name=payloader {properties}"));
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    pipeline.play();
    pipeline.push(0, &packets[0]);
    assert!(sink.pull_sample().is_ok());
    let (update, learnt) = &scene::chain(&wall(1), 1)[0];
    let event = gst::event::CustomDownstream::new(
        gst::Structure::builder("nvsprior-update")
            .field("number", u32::from(learnt.number()))
            .field("state", learnt.state().0)
            .field("update", glib::Bytes::from(update))
            .field("held", false)
            .build(),
    );
    assert!(pipeline.element("payloader").static_pad("sink").unwrap().send_event(event));
    for (index, packet) in packets.iter().enumerate().skip(1) {
        // Ten minutes without packets.
        pipeline.push(if index < 6 { index } else { 3000 + index }, packet);
    }
    pipeline.end();
    let pieces: Vec<_> = pipeline.drain().buffers.into_iter().filter(is_piece).collect();
    let times: Vec<f64> = pieces.iter().map(|piece| piece.pts().unwrap().seconds_f64()).collect();
    assert!(
        times.is_sorted() && times.iter().filter(|time| **time < 1.3).count() >= 2,
        "{times:?}"
    );
    let after = times.iter().filter(|time| **time > 600.0).count();
    assert!(
        (1..20).contains(&after) && !times.iter().any(|t| (2.0..600.0).contains(t)),
        "{times:?}"
    );
    let stats = pipeline.stats("payloader");
    assert_eq!((count(&stats, "updates"), count(&stats, "pieces")), (1, pieces.len() as u64));
}

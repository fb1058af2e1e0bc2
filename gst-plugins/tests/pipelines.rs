//! The elements in pipelines: frames in, pictures out.

#[path = "../../tests/common/mod.rs"]
mod common;
mod fixture;
#[path = "../../tests/scene/mod.rs"]
mod scene;

use common::write_blocked;
use fixture::{FRAMES, Fixture, Pipeline, RATE, bytes, fixture, frame_pose, pose_text, psnr};
use gst::prelude::*;
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior::{Camera, Decoder, Encoder, EncoderOptions, Mode, Rate, Structure, Trust};
use nvsprior_link::modem::{Collected, Collector, CollectorOptions};
use scene::{CAMERA, wall};

const SECOND: gst::ClockTime = gst::ClockTime::SECOND;

/// What the library makes of the frames.
fn by_library(options: EncoderOptions) -> Vec<nvsprior::Encoded> {
    let engine = common::engine();
    let scene = engine.upload(&wall(1)).unwrap();
    let options = EncoderOptions { truth: true, ..options };
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    let frames = fixture().frames.iter().enumerate();
    frames
        .map(|(index, frame)| {
            let hint = (index == 0).then(|| Hint::of(frame_pose(0)));
            let time = Some(index as f64 / RATE as f64);
            encoder.encode(frame, FrameInfo { hint, time }).unwrap()
        })
        .collect()
}

#[test]
fn packets_and_pictures_are_the_librarys() {
    let fixture = fixture();
    let structure = Structure::Chain { key_every: 4 };
    let stream = EncoderOptions {
        rate: Some(Rate::Quality(30.0)),
        mode: Mode::Stream(structure),
        ..EncoderOptions::default()
    };
    let intra = EncoderOptions { rate: Some(Rate::Bytes(300)), ..EncoderOptions::default() };
    for (properties, options) in [
        ("rate=bytes bytes=300", intra),
        ("quality=30 mode=stream structure=chain key-every=4", stream),
    ] {
        let expected = by_library(options);
        let encoder = fixture.encoder(properties);
        let packets = Pipeline::new(&format!("{} ! {encoder}", Fixture::source()));
        let given = packets.run(&fixture.frames);
        let packets: Vec<_> = expected.iter().map(|encoded| encoded.packet.clone()).collect();
        assert_eq!(given.bytes(), packets, "{properties}");
        assert_eq!(given.field::<i32>("width"), Some(160));
        assert_eq!(given.field::<String>("prior"), Some(wall(1).id().to_string()));
        for (index, (buffer, encoded)) in given.buffers.iter().zip(&expected).enumerate() {
            assert_eq!(buffer.pts(), Some(SECOND / RATE * index as u64));
            let delta = buffer.flags().contains(gst::BufferFlags::DELTA_UNIT);
            assert_eq!(delta, encoded.stats.reference.is_some(), "frame {index}");
        }
        let all = format!("{} ! {encoder} ! {}", Fixture::source(), fixture.decoder());
        let shown = Pipeline::new(&all).run(&fixture.frames);
        let pictures: Vec<_> = expected.into_iter().map(|encoded| encoded.picture.data).collect();
        assert!(shown.bytes() == pictures, "{properties}");
        assert_eq!(shown.field::<String>("format"), Some("RGB".into()));
        assert_eq!(shown.field("framerate"), Some(gst::Fraction::new(RATE as i32, 1)));
    }
}

#[test]
fn a_prior_in_blocks_gives_the_packets_of_the_whole_one() {
    let fixture = fixture();
    let path = fixture.file("wall.nvsb");
    write_blocked(path.as_ref(), &wall(1), 256);
    let run = |memory: u32, behind: &str| {
        let encoder = format!("rate=bytes bytes=300 prior={path} prior-memory={memory}");
        fixture.encoding(&encoder, behind).run(&fixture.frames).bytes()
    };
    let (whole, blocks) = (run(0, ""), run(2, ""));
    assert_eq!(whole.len(), FRAMES);
    assert_eq!(blocks, whole);
    let decoder = |memory: u32| format!("nvspdec prior={path} prior-memory={memory}");
    assert!(run(0, &decoder(2)) == run(2, &decoder(0)));
}

#[test]
fn frames_come_in_many_formats_and_sizes() {
    let fixture = fixture();
    let frames = &fixture.frames[..2];
    for (format, least) in [
        ("RGB", 33.0),
        ("BGR", 33.0),
        ("RGBA", 33.0),
        ("RGBx", 33.0),
        ("NV12", 28.0),
        ("I420", 28.0),
    ] {
        let text = format!(
            "{} ! videoconvert ! videoscale ! video/x-raw,format={format},width=320,height=180 ! {} ! {} \
             ! video/x-raw,format={}",
            Fixture::source(),
            fixture.encoder("quality=60"),
            fixture.decoder(),
            if format.starts_with("RGB") { format } else { "BGR" },
        );
        let shown = Pipeline::new(&text).run(frames);
        let step =
            if shown.field::<String>("format").is_some_and(|of| of.len() == 4) { 4 } else { 3 };
        let swapped = shown.field::<String>("format").as_deref() == Some("BGR");
        assert_eq!(shown.buffers.len(), 2);
        for (picture, frame) in shown.bytes().iter().zip(frames) {
            let pixels = picture.chunks_exact(step);
            let rgb = |p: &[u8]| if swapped { [p[2], p[1], p[0]] } else { [p[0], p[1], p[2]] };
            let picture: Vec<u8> = pixels.flat_map(rgb).collect();
            let psnr = psnr(&picture, &frame.data);
            assert!(psnr > least, "{format}: {psnr} dB");
        }
    }
}

/// Modem frames of which some are lost.
#[test]
fn a_lossy_link_shows_nearly_all() {
    let fixture = fixture();
    let pipeline =
        fixture.link("bit-rate=12000 loss=0.2 mtu=48 latency=1500 delay=100", "mtu=48 latency=800");
    let pad = pipeline.element("vehicle").static_pad("src").unwrap();
    let count = std::sync::atomic::AtomicUsize::new(0);
    // Every fifth one is lost. Those of the first packet all come: it tells the camera.
    pad.add_probe(gst::PadProbeType::BUFFER, move |_, _| {
        let index = count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        match index > 12 && index.is_multiple_of(5) {
            true => gst::PadProbeReturn::Drop,
            false => gst::PadProbeReturn::Ok,
        }
    });
    let shown = pipeline.run(&fixture.frames);
    assert_eq!(shown.buffers.len(), FRAMES);
    assert_eq!(shown.field::<String>("format"), Some("RGB".into()));
    assert_eq!(shown.field("framerate"), Some(gst::Fraction::new(RATE as i32, 1)));
    for (index, (picture, frame)) in shown.bytes().iter().zip(&fixture.frames).enumerate() {
        let psnr = psnr(picture, &frame.data);
        assert!(psnr > 24.0, "frame {index}: {psnr} dB");
    }
    // Evenly.
    for pair in shown.buffers.windows(2) {
        let step = pair[1].pts().unwrap() - pair[0].pts().unwrap();
        assert!(step.mseconds().abs_diff(1000 / RATE) < 10, "{step}");
    }
    let (sent, heard) = (pipeline.stats("vehicle"), pipeline.stats("topside"));
    let (sent, heard) =
        (sent.get::<u64>("shares").unwrap(), heard.get::<u64>("datagrams").unwrap());
    assert!(heard < sent && heard * 10 > sent * 7, "{heard} of {sent}");
}

/// A frame that did not come at all is drawn between its neighbours, in its turn.
#[test]
fn a_frame_that_is_lost_is_drawn_from_the_prior() {
    let fixture = fixture();
    let pipeline = fixture.link("bit-rate=20000 loss=0 spread=0 latency=600", "");
    let pad = pipeline.element("vehicle").static_pad("src").unwrap();
    pad.add_probe(gst::PadProbeType::BUFFER, |_, info| {
        let time = info.buffer().and_then(|buffer| buffer.pts()).unwrap();
        let of_frame_4 = time >= SECOND / RATE * 4 && time < SECOND / RATE * 5;
        if of_frame_4 { gst::PadProbeReturn::Drop } else { gst::PadProbeReturn::Ok }
    });
    let shown = pipeline.run(&fixture.frames);
    let stats = pipeline.stats("topside");
    assert_eq!((shown.buffers.len(), stats.get::<u64>("between")), (FRAMES, Ok(1)), "{stats}");
    assert!(psnr(&shown.bytes()[4], &fixture.frames[4].data) > 20.0);
}

#[test]
fn the_bit_rate_is_kept_and_frames_are_left_out() {
    let fixture = fixture();
    let (bit_rate, overhead) = (1600, 4);
    let pipeline = fixture.sending(&format!(
        "bit-rate={bit_rate} overhead={overhead} least=80 loss=0 latency=2000 post-messages=true"
    ));
    let shares = pipeline.run(&fixture.frames);
    let bytes: usize = shares.bytes().iter().map(|share| share.len() + overhead).sum();
    // Two seconds of frames, and the credit that a run begins with.
    assert!(bytes * 8 <= bit_rate * 2 + 8 * 2 * 150, "{bytes}");
    let stats = pipeline.stats("vehicle");
    let count = |name| stats.get::<u64>(name).unwrap() as usize;
    assert_eq!((count("frames"), count("packets") + count("left-out")), (FRAMES, FRAMES));
    assert!(count("left-out") >= 3 && count("packets") >= 3, "{stats}");
    assert!(shares.buffers.windows(2).all(|pair| pair[0].pts() <= pair[1].pts()));
    // Numbers count all frames of the camera.
    let messages = pipeline.element_messages();
    let frames = messages.iter().filter(|of| of.name() == "nvspvehicle-frame");
    let numbers: Vec<u32> = frames.map(|of| of.get("frame").unwrap()).collect();
    assert_eq!(numbers.len(), count("packets"));
    assert!(*numbers.last().unwrap() as usize >= FRAMES - 3, "{numbers:?}");
}

#[test]
fn modem_frames_are_spread_over_time() {
    let fixture = fixture();
    let shares = fixture.sending("bit-rate=12000 spread=600 loss=0.2 mtu=40").run(&fixture.frames);
    assert!(shares.buffers.windows(2).all(|pair| pair[0].pts() <= pair[1].pts()));
    let mut collector = Collector::new(CollectorOptions::new(40)).unwrap();
    let mut order = Vec::new();
    for share in shares.bytes() {
        let before: Vec<usize> =
            (0..FRAMES).map(|frame| collector.arrived(0, frame as u32).count()).collect();
        collector.push(0.0, &share).unwrap();
        let of = (0..FRAMES).position(|k| collector.arrived(0, k as u32).count() > before[k]);
        order.push(of.unwrap());
    }
    // Of the packet's last ones some lie behind first ones of the next packets.
    assert!(order.windows(2).any(|pair| pair[0] > pair[1]), "{order:?}");
    let complete =
        (0..FRAMES as u32).filter(|k| collector.packet(0, *k).is_some_and(|p| p.complete));
    assert_eq!(complete.count(), FRAMES);
}

/// Runs frame by frame, with a report after each if `reports`. Bytes of packets without those that state the camera,
/// and of their poses: means.
fn bytes_per_packet(reports: bool) -> (f64, f64) {
    let fixture = fixture();
    let pipeline = fixture.link("bit-rate=20000 loss=0 post-messages=true", "");
    pipeline.play();
    let (vehicle, topside) = (pipeline.element("vehicle"), pipeline.element("topside"));
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    for (index, frame) in fixture.frames.iter().enumerate() {
        pipeline.push(index, &frame.data);
        assert!(sink.pull_sample().is_ok());
        if let Some(report) = topside.emit_by_name::<Option<gst::glib::Bytes>>("report", &[])
            && reports
        {
            vehicle.emit_by_name::<()>("report", &[&report]);
        }
    }
    let stats = vehicle.property::<gst::Structure>("stats");
    assert_eq!(stats.get::<u64>("refused"), Ok(0), "{stats}");
    assert_eq!(stats.get::<u64>("reports").unwrap() > 0, reports, "{stats}");
    let messages = pipeline.element_messages();
    let frames = messages.iter().filter(|of| of.name() == "nvspvehicle-frame").skip(3);
    let mean = |name: &str| {
        let bytes = frames.clone().map(|of| f64::from(of.get::<u32>(name).unwrap()));
        bytes.sum::<f64>() / (FRAMES - 3) as f64
    };
    (mean("bytes"), mean("pose-bytes"))
}

/// With reports poses are predicted: packets of the same bytes hold more of the picture.
#[test]
fn reports_make_poses_short() {
    let ((bytes, stated), (with, predicted)) = (bytes_per_packet(false), bytes_per_packet(true));
    println!(
        "bytes per packet: {bytes:.1}, of them pose {stated:.1}; with reports {with:.1}, pose {predicted:.1}"
    );
    assert!(predicted < stated - 1.0, "{predicted} bytes, {stated} without reports");
}

/// Reports go from pad to pad, and the pilot's region with them.
#[test]
fn reports_go_from_pad_to_pad() {
    let fixture = fixture();
    let vehicle = fixture.vehicle("bit-rate=20000 loss=0");
    let topside = fixture.topside("report-every=200 region=0,0,0.5,1");
    let pipeline = Pipeline::new(&format!(
        "{} ! {vehicle} ! {topside} topside.reports ! vehicle.reports topside.src",
        Fixture::source()
    ));
    let shown = pipeline.run(&fixture.frames);
    assert_eq!(shown.buffers.len(), FRAMES);
    let (sent, heard) = (pipeline.stats("topside"), pipeline.stats("vehicle"));
    assert!(sent.get::<u64>("reports").unwrap() >= 3, "{sent}");
    assert!(heard.get::<u64>("reports").unwrap() >= 3, "{heard}");
    assert_eq!(heard.get::<u64>("refused"), Ok(0), "{heard}");
    let events: Vec<String> = pipeline
        .element_messages()
        .iter()
        .filter(|of| of.name() == "nvspvehicle-event")
        .map(|of| of.get("event").unwrap())
        .collect();
    for event in ["topside-heard", "region"] {
        assert!(events.iter().any(|of| of == event), "{event}: {events:?}");
    }
}

/// Numbers go on after a restart.
#[test]
fn a_state_file_is_written_and_read() {
    let fixture = fixture();
    let file = fixture.file("vehicle.state");
    let number = || {
        let pipeline = fixture.sending(&format!("loss=0 state-file={file}"));
        pipeline.run(&fixture.frames[..2]);
        let last = pipeline.stats("vehicle").get::<gst::Structure>("last").unwrap();
        last.get::<u32>("frame").unwrap()
    };
    let first = number();
    assert!(first < 2 && number() > first + 1);
    let pipeline = Pipeline::new(&format!(
        "{} ! {}",
        Fixture::source(),
        fixture.vehicle(&format!("state-file={}", fixture.file("prior.ply")))
    ));
    pipeline.play();
    pipeline.push(0, &fixture.frames[0].data);
    let error = pipeline.wait_for_error(20 * SECOND).unwrap();
    assert!(error.contains("a state of"), "{error}");
    // One that cannot be written does not end the dive.
    let pipeline = fixture.sending("loss=0 state-file=/no/such/folder/state");
    assert!(!pipeline.run(&fixture.frames[..2]).buffers.is_empty());
    let warnings = pipeline.warnings();
    let text = "property state-file: /no/such/folder/state";
    assert!(warnings.iter().any(|of| of.contains(text)), "{warnings:?}");
}

#[test]
fn what_cannot_start_says_why() {
    let fixture = fixture();
    let camera = "camera=160,90,130,130,80,45";
    let prior = fixture.file("prior.ply");
    for (encoder, text) in [
        (format!("nvspenc prior=/no/such.ply {camera}"), "/no/such.ply"),
        (format!("nvspenc {camera}"), "property prior"),
        (format!("nvspenc prior={prior} {camera} device=nonesuch"), "nonesuch"),
        (format!("nvspenc prior={prior} {camera} start=1,2"), "property start"),
        (format!("nvspenc prior={prior} {camera} prior-memory=8"), "prior.ply"),
    ] {
        let pipeline = Pipeline::new(&format!("{} ! {encoder}", Fixture::source()));
        assert!(pipeline.0.set_state(gst::State::Playing).is_err(), "{encoder}");
        let error = pipeline.error().unwrap();
        assert!(error.contains(text), "{error}");
    }
    for (encoder, text) in [
        (format!("nvspenc prior={prior}"), "property camera"),
        (format!("nvspenc prior={prior} camera=1,2,3"), "property camera"),
        (format!("nvspenc prior={prior} {camera} lens=brown,1"), "property lens"),
        (format!("nvspenc prior={prior} {camera} mask=/no/mask.png"), "/no/mask.png"),
        (format!("nvspenc prior={prior} camera=90,90,130,130,45,45"), "shape"),
        (fixture.vehicle("latency=50"), "latency"),
        (fixture.vehicle("mtu=8"), "8"),
    ] {
        let pipeline = Pipeline::new(&format!("{} ! {encoder}", Fixture::source()));
        pipeline.play();
        pipeline.push(0, &fixture.frames[0].data);
        let error = pipeline.wait_for_error(20 * SECOND).unwrap_or_else(|| panic!("{encoder}"));
        assert!(error.contains(text), "{error}");
    }
}

/// The prior has no key frames.
#[test]
fn frames_are_left_out_until_there_is_a_pose() {
    let fixture = fixture();
    let prior = fixture.file("prior.ply");
    let encoder = format!("nvspenc name=encoder prior={prior} camera=130,130,80,45");
    let pipeline = Pipeline::new(&format!("{} ! {encoder}", Fixture::source()));
    pipeline.play();
    let encoder = pipeline.element("encoder");
    let frames = || encoder.property::<gst::Structure>("stats").get::<u64>("left-out").unwrap();
    pipeline.push_frames(&fixture.frames[..2]);
    while frames() < 2 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    encoder.set_property("start", pose_text(&frame_pose(2)));
    pipeline.push(2, &fixture.frames[2].data);
    pipeline.end();
    assert_eq!(pipeline.drain().buffers.len(), 1);
    let warnings = pipeline.warnings();
    assert!(warnings.len() == 1 && warnings[0].contains("property start"), "{warnings:?}");
}

/// A source whose times go back.
#[test]
fn times_that_go_back_do_no_harm() {
    let fixture = fixture();
    let pipeline = fixture.encoding("", "");
    pipeline.play();
    for index in [1, 2, 1, 0, 3] {
        pipeline.push(index, &fixture.frames[index].data);
    }
    pipeline.end();
    assert_eq!(pipeline.drain().buffers.len(), 5);
}

#[test]
fn a_decoder_with_another_prior_says_so() {
    let fixture = fixture();
    let other = format!("nvspdec prior={}", fixture.file("other.ply"));
    let text = format!("{} ! {} ! {other}", Fixture::source(), fixture.encoder(""));
    let pipeline = Pipeline::new(&text);
    pipeline.play();
    pipeline.push_frames(&fixture.frames[..1]);
    let error = pipeline.wait_for_error(20 * SECOND).unwrap();
    let ids = [wall(1).id().to_string(), wall(2).id().to_string(), "other.ply".into()];
    assert!(ids.iter().all(|id| error.contains(id)), "{error}");
}

#[test]
fn a_pipeline_plays_again_after_a_stop() {
    let fixture = fixture();
    let pipeline = fixture.link("bit-rate=12000 loss=0", "");
    let first = pipeline.run(&fixture.frames[..3]);
    pipeline.stop();
    let second = pipeline.run(&fixture.frames[..3]);
    assert_eq!(first.buffers.len(), 3);
    assert!(first.bytes() == second.bytes());
    let stats = pipeline.stats("vehicle");
    assert_eq!(stats.get::<u64>("packets"), Ok(3));
    // Ready and back, without a frame.
    for state in [gst::State::Ready, gst::State::Paused, gst::State::Null] {
        pipeline.0.set_state(state).unwrap();
    }
}

#[test]
fn after_a_flush_frames_are_searched_for_anew() {
    let fixture = fixture();
    let pipeline = fixture.link("bit-rate=20000 loss=0 mode=stream", "");
    pipeline.play();
    pipeline.push_frames(&fixture.frames[..4]);
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    assert!(sink.pull_sample().is_ok());
    let source = pipeline.element("source");
    assert!(source.send_event(gst::event::FlushStart::new()));
    assert!(source.send_event(gst::event::FlushStop::new(true)));
    pipeline.push_frames(&fixture.frames[..3]);
    pipeline.end();
    let shown = pipeline.drain();
    assert_eq!(shown.buffers.len(), 3);
    for (picture, frame) in shown.bytes().iter().zip(&fixture.frames) {
        assert!(psnr(picture, &frame.data) > 28.0);
    }
}

/// What the topside gets is not all valid.
#[test]
fn packets_that_give_nothing_do_not_end_the_pipeline() {
    let fixture = fixture();
    let mode = Mode::Stream(Structure::Chain { key_every: 0 });
    let rate = Some(Rate::Quality(40.0));
    let encoded = by_library(EncoderOptions { mode, rate, ..EncoderOptions::default() });
    assert!(encoded[4].stats.reference == Some(3));
    let source = "appsrc name=source format=time caps=video/x-nvsprior,trust=start";
    let pipeline = Pipeline::new(&format!("{source} ! {}", fixture.decoder()));
    pipeline.play();
    let whole = |index: usize| encoded[index].packet.clone();
    let mut damaged = whole(2);
    damaged[4] ^= 0x55;
    let cut = whole(3)[..encoded[3].stats.latent_bytes + 9].to_vec();
    // A packet whose camera is not known yet; all; junk; damaged; cut; one that is predicted from the cut one.
    let packets = [whole(1), whole(0), whole(1), vec![1, 2, 3], damaged, cut, whole(4)];
    for (index, packet) in packets.iter().enumerate() {
        pipeline.push(index, packet);
    }
    pipeline.end();
    let shown = pipeline.drain();
    let pictures = shown.bytes();
    assert_eq!(pictures.len(), 4);
    assert!(pictures[0] == encoded[0].picture.data && pictures[1] == encoded[1].picture.data);
    // What the library shows of them.
    let engine = common::engine();
    let scene = engine.upload(&wall(1)).unwrap();
    let (mut decoder, mut decoded) = (Decoder::new(&engine, &scene), nvsprior::Decoded::default());
    for (packet, picture) in [(1, None), (2, None), (5, Some(2)), (6, Some(3))] {
        decoder.decode_into(&packets[packet], Trust::Start, &mut decoded).unwrap();
        assert!(picture.is_none_or(|at: usize| pictures[at] == decoded.picture.data), "{packet}");
    }
    assert!(decoded.damage.is_some());
    let stats = pipeline.stats("decoder");
    let count = |name| stats.get::<u64>(name).unwrap();
    assert_eq!((count("packets"), count("refused"), count("damaged")), (7, 3, 2), "{stats}");
    let warnings = pipeline.warnings();
    for text in ["its tag", "its check does not match", "predicted from that of frame 2"] {
        assert!(warnings.iter().any(|of| of.contains(text)), "{text}: {warnings:?}");
    }
}

#[test]
fn a_topside_that_lacks_the_reference_asks_for_a_key_frame() {
    let fixture = fixture();
    let pipeline =
        fixture.pipeline("mode=stream key-every=0 post-messages=true", "identity name=link");
    let pad = pipeline.element("link").static_pad("src").unwrap();
    pad.add_probe(gst::PadProbeType::BUFFER, |_, info| {
        let lost = info.buffer().is_some_and(|buffer| buffer.pts() == Some(SECOND / RATE * 2));
        if lost { gst::PadProbeReturn::Drop } else { gst::PadProbeReturn::Ok }
    });
    let shown = pipeline.run(&fixture.frames);
    assert_eq!(shown.buffers.len(), FRAMES - 1);
    let messages = pipeline.element_messages();
    let alone: Vec<bool> = messages.iter().map(|of| !of.has_field("reference")).collect();
    // Frame 3 is predicted from the lost one, so frame 4 is intra.
    assert_eq!(alone[..6], [true, false, false, false, true, false]);
}

#[test]
fn a_start_may_come_while_playing() {
    let fixture = fixture();
    let pipeline = fixture.encoding("post-messages=true", "");
    let encoder = pipeline.element("encoder");
    pipeline.play();
    encoder.set_property("start", "1,2");
    assert!(pipeline.warnings()[0].contains("property start"));
    // The pose before counts.
    pipeline.push(0, &fixture.frames[0].data);
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    assert!(sink.pull_sample().is_ok());
    // A pose that no camera can have is left aside.
    encoder.set_property("start", "1,0,0,0,1e12,0,0");
    encoder.set_property_from_str("rate", "none");
    pipeline.push(1, &fixture.frames[1].data);
    let last = sink.pull_sample().unwrap().buffer_owned().unwrap();
    assert!(bytes(&last).len() < 40, "no residual");
    assert!(pipeline.warnings().iter().any(|of| of.contains("million")));
}

/// The modem frames of a packet, and how many of them give a picture without being all of the packet.
fn some_shares(fixture: &Fixture) -> (usize, Vec<Vec<u8>>) {
    let shares = fixture
        .sending("bit-rate=40000 loss=0.3 least=500 spread=0 shares=12")
        .run(&fixture.frames[..1])
        .bytes();
    let mut collector = Collector::new(CollectorOptions::new(64)).unwrap();
    let gives = |share: &Vec<u8>| matches!(collector.push(0.0, share), Ok(Collected::Grown(..)));
    let few = 1 + shares.iter().position(gives).expect("a picture before the whole packet");
    (few, shares)
}

/// While nothing comes, a second thread sees to what is due.
#[test]
fn in_a_live_pipeline_a_packet_does_not_wait_for_the_next_share() {
    let fixture = fixture();
    let (few, shares) = some_shares(fixture);
    let source = "appsrc name=source format=time is-live=true do-timestamp=true \
                  caps=application/x-nvsprior-share,framerate=5/1";
    let pipeline = Pipeline::new(&format!("{source} ! {}", fixture.topside("latency=400")));
    pipeline.play();
    shares[..few].iter().for_each(|share| {
        pipeline.push_buffer(gst::Buffer::from_slice(share.clone()));
    });
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    assert!(sink.try_pull_sample(gst::ClockTime::from_mseconds(200)).is_none());
    let sample = sink.try_pull_sample(3 * SECOND).expect("what has come");
    let first = sample.buffer_owned().unwrap();
    drop(sample);
    assert!(first.flags().contains(gst::BufferFlags::CORRUPTED));
    let mut query = gst::query::Latency::new();
    assert!(pipeline.element("topside").static_pad("src").unwrap().query(&mut query));
    let (live, least, _) = query.result();
    assert!(live && least >= gst::ClockTime::from_mseconds(400), "{least}");
    // The same after a flush. The pad takes it: a live source would hold its state's lock, which the pipeline wants,
    // too.
    let sink_pad = pipeline.element("topside").static_pad("sink").unwrap();
    assert!(sink_pad.send_event(gst::event::FlushStart::new()));
    assert!(sink_pad.send_event(gst::event::FlushStop::new(true)));
    let segment = gst::FormattedSegment::<gst::ClockTime>::new();
    assert!(sink_pad.send_event(gst::event::Segment::new(&segment)));
    shares[..few].iter().for_each(|share| {
        pipeline.push_buffer(gst::Buffer::from_slice(share.clone()));
    });
    let again = sink.try_pull_sample(3 * SECOND).expect("what has come after the flush");
    assert_eq!(bytes(&again.buffer_owned().unwrap()), bytes(&first));
    // Down while its thread waits.
    pipeline.push_buffer(gst::Buffer::from_slice(shares[few].clone()));
    pipeline.stop();
}

/// The timer's thread may come to a packet after its time.
#[test]
fn in_a_live_pipeline_a_packet_that_is_overdue_goes_on() {
    let fixture = fixture();
    let source = "appsrc name=source format=time is-live=true \
                  caps=application/x-nvsprior-share,framerate=5/1";
    let pipeline = Pipeline::new(&format!("{source} ! {}", fixture.topside("latency=100")));
    let (few, shares) = some_shares(fixture);
    pipeline.play();
    std::thread::sleep(std::time::Duration::from_millis(300));
    shares[..few].iter().for_each(|share| pipeline.push(0, share));
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    assert!(sink.try_pull_sample(3 * SECOND).is_some());
}

#[test]
fn properties_have_their_defaults() {
    fixture();
    for (name, least) in [("nvspenc", 26), ("nvspdec", 9), ("nvspvehicle", 40), ("nvsptopside", 15)]
    {
        let element = gst::ElementFactory::make(name).build().unwrap();
        let own = element.type_();
        let specs = element.list_properties();
        let specs = specs.iter().filter(|spec| spec.owner_type() == own);
        let mut count = 0;
        for spec in specs.filter(|spec| spec.flags().contains(gst::glib::ParamFlags::WRITABLE)) {
            let value = element.property_value(spec.name());
            let (value, default) = (value.serialize().ok(), spec.default_value().serialize().ok());
            assert_eq!(value, default, "{name} {}", spec.name());
            assert!(spec.blurb().is_some_and(|text| text.len() > 10), "{name} {}", spec.name());
            count += 1;
        }
        assert!(count >= least, "{name}: {count}");
    }
}

/// With a lens and a mask, as the library does it.
#[test]
fn lenses_and_masks_count() {
    let fixture = fixture();
    let file = fixture.file("mask.png");
    let arm = |x: u32, y: u32| if x > 110 && y > 50 { 0 } else { 255 };
    image::GrayImage::from_fn(160, 90, |x, y| image::Luma([arm(x, y)])).save(&file).unwrap();
    let pipeline = |properties: &str| {
        let prior = fixture.file("prior.ply");
        let start = pose_text(&frame_pose(0));
        let encoder = format!("nvspenc name=encoder prior={prior} start={start} {properties}");
        let decoder = fixture.decoder();
        Pipeline::new(&format!("{} ! {encoder} ! {decoder}", Fixture::source()))
    };
    let camera = "camera=160,90,130,130,80,45";
    // Hidden pixels that change cost nothing.
    let mut frames = fixture.frames[..2].to_vec();
    let visible = pipeline(&format!("{camera} mask={file}")).run(&frames).bytes();
    for frame in &mut frames {
        for (index, value) in frame.data.iter_mut().enumerate() {
            let pixel = index as u32 / 3;
            if arm(pixel % 160, pixel / 160) == 0 {
                *value = 255 - *value;
            }
        }
    }
    let hidden = pipeline(&format!("{camera} mask={file}")).run(&frames).bytes();
    assert!(visible == hidden);
    // A lens without distortion is its pinhole.
    let plain = pipeline(camera).run(&frames).bytes();
    let lens = "lens=brown,160,90,130,130,80,45,0,0,0,0";
    assert!(pipeline(&format!("{camera} {lens}")).run(&frames).bytes() == plain);
    assert!(pipeline(lens).run(&frames).bytes() == plain);
    let bent = "lens=brown,160,90,130,130,80,45,-0.1,0.02,0,0";
    let bent = pipeline(bent);
    assert_eq!(bent.run(&frames).buffers.len(), 2);
}

/// A region gets more of the bytes while the pipeline plays. A wrong one is left aside.
#[test]
fn a_region_gets_more_of_the_bytes() {
    let fixture = fixture();
    let pipeline = fixture.pipeline("rate=bytes bytes=250", "");
    pipeline.play();
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    let encoder = pipeline.element("encoder");
    // Silt, of which the prior knows nothing.
    let mut frame = fixture.frames[1].clone();
    for (index, value) in frame.data.iter_mut().enumerate() {
        let (x, y) = ((index / 3) % 160, index / 480);
        let grain = ((x / 3 * 7919 + y / 3 * 104_729) % 61) as i16 - 30;
        *value = (i16::from(*value) + grain).clamp(0, 255) as u8;
    }
    // PSNR of the left half, where the region is.
    let shown = |index: usize| {
        pipeline.push(index, &frame.data);
        let picture = bytes(&sink.pull_sample().unwrap().buffer_owned().unwrap());
        let half =
            |rgb: &[u8]| rgb.chunks(160 * 3).flat_map(|row| &row[..80 * 3]).copied().collect();
        let (own, theirs): (Vec<u8>, Vec<u8>) = (half(&picture), half(&frame.data));
        psnr(&own, &theirs)
    };
    shown(0);
    let plain = shown(1);
    encoder.set_property("region", "0,0,0.5,1");
    encoder.set_property("region-weight", 32_u32);
    let looked_at = shown(2);
    assert!(looked_at > plain + 0.5, "{looked_at} dB with the region, {plain} without");
    encoder.set_property("region", "0,0,2,1");
    let kept = shown(3);
    assert!((kept - looked_at).abs() < 0.3, "{kept} dB, {looked_at} before");
    assert!(pipeline.warnings().iter().any(|text| text.contains("property region")));
    encoder.set_property("region", None::<String>);
    assert!(shown(4) < looked_at - 0.3);
}

#[test]
fn a_camera_with_another_size_is_followed() {
    let fixture = fixture();
    let text = format!(
        "appsrc name=source format=time ! {} ! {}",
        fixture.encoder("rate=bytes bytes=300"),
        fixture.decoder()
    );
    let pipeline = Pipeline::new(&text);
    let source = pipeline.element("source").downcast::<gst_app::AppSrc>().unwrap();
    let caps = |width: i32, height: i32, rate: i32| {
        gst::Caps::builder("video/x-raw")
            .field("format", "RGB")
            .field("width", width)
            .field("height", height)
            .field("framerate", gst::Fraction::new(rate, 1))
            .build()
    };
    pipeline.play();
    source.set_caps(Some(&caps(160, 90, 5)));
    pipeline.push_frames(&fixture.frames[..2]);
    // Twice as large; the camera's own size stays that of the packets.
    source.set_caps(Some(&caps(320, 180, 10)));
    let frame = &fixture.frames[2];
    let large: Vec<u8> = (0..180 * 320)
        .flat_map(|pixel| {
            let at = (pixel / 320 / 2 * 160 + pixel % 320 / 2) * 3;
            [frame.data[at], frame.data[at + 1], frame.data[at + 2]]
        })
        .collect();
    pipeline.push(2, &large);
    pipeline.end();
    let shown = pipeline.drain();
    assert_eq!(shown.buffers.len(), 3);
    assert_eq!(shown.field("framerate"), Some(gst::Fraction::new(10, 1)));
    assert!(psnr(&shown.bytes()[2], &frame.data) > 28.0);
}

/// A source that is done at once, and one that gives nothing.
#[test]
fn an_end_without_frames_is_an_end() {
    let fixture = fixture();
    let pipeline = fixture.link("", "");
    assert!(pipeline.run(&[]).buffers.is_empty());
    let mut black = fixture.frames[0].clone();
    black.data.fill(0);
    // Nothing to see: the frame is uncertain, and shown as well as can be.
    let dark = fixture.link("", "");
    assert_eq!(dark.run(&[black]).buffers.len(), 1);
    assert_eq!(dark.stats("vehicle").get::<u64>("uncertain"), Ok(1));
}

/// What a sink says of late frames decides what is encoded.
#[test]
fn late_frames_are_left_out() {
    let fixture = fixture();
    let pipeline = fixture.encoding("post-messages=true", "");
    pipeline.play();
    pipeline.push(0, &fixture.frames[0].data);
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    assert!(sink.pull_sample().is_ok());
    // 0.4 s late.
    let late = gst::event::Qos::new(gst::QOSType::Underflow, 2.0, 400_000_000, SECOND / RATE);
    let pad = pipeline.element("encoder").static_pad("src").unwrap();
    assert!(pad.send_event(late));
    (1..FRAMES).for_each(|index| pipeline.push(index, &fixture.frames[index].data));
    pipeline.end();
    let shown = pipeline.drain();
    let stats = pipeline.stats("encoder");
    let late = stats.get::<u64>("late").unwrap() as usize;
    assert!(late >= 3, "{stats}");
    assert_eq!(shown.buffers.len() + late, FRAMES - 1);
    let numbers: Vec<u32> =
        pipeline.element_messages().iter().map(|of| of.get("frame").unwrap()).collect();
    assert_eq!(numbers.last(), Some(&(FRAMES as u32 - 1)));
    assert_eq!(numbers.get(1), Some(&(1 + late as u32)));
}

/// Two cameras on one link.
#[test]
fn streams_are_told_apart() {
    let fixture = fixture();
    let shares = |stream: usize, bit_rate: usize| {
        let vehicle = format!("stream={stream} loss=0 bit-rate={bit_rate}");
        fixture.sending(&vehicle).run(&fixture.frames[..3])
    };
    let (one, other) = (shares(0, 12000), shares(2, 6000));
    let mut all: Vec<_> = one.buffers.iter().chain(&other.buffers).collect();
    all.sort_by_key(|share| share.pts());
    let shown = |stream: usize| {
        let source =
            "appsrc name=source format=time caps=application/x-nvsprior-share,framerate=5/1";
        let topside = fixture.topside(&format!("stream={stream}"));
        let pipeline = Pipeline::new(&format!("{source} ! {topside}"));
        pipeline.play();
        all.iter().for_each(|share| pipeline.push_buffer((*share).clone()));
        pipeline.end();
        let pictures = pipeline.drain();
        assert_eq!(pictures.buffers.len(), 3);
        pipeline
            .stats("topside")
            .get::<gst::Structure>("last")
            .unwrap()
            .get::<u32>("bytes")
            .unwrap()
    };
    let (fine, coarse) = (shown(0), shown(2));
    assert!(fine > coarse + 50, "{fine} and {coarse} bytes");
}

#[test]
fn what_is_no_modem_frame_and_no_report_is_refused() {
    let fixture = fixture();
    let junk = [&[][..], &[1, 2, 3], &[0xB1; 64]];
    let source = "appsrc name=source format=time caps=application/x-nvsprior-share,framerate=5/1";
    let pipeline = Pipeline::new(&format!("{source} ! {}", fixture.topside("")));
    pipeline.play();
    junk.into_iter().enumerate().for_each(|(index, junk)| pipeline.push(index, junk));
    pipeline.end();
    assert!(pipeline.drain().buffers.is_empty());
    assert_eq!(pipeline.stats("topside").get::<u64>("refused"), Ok(3));
    let pipeline = fixture.sending("");
    pipeline.play();
    let vehicle = pipeline.element("vehicle");
    for junk in junk {
        vehicle.emit_by_name::<()>("report", &[&gst::glib::Bytes::from(junk)]);
    }
    pipeline.push_frames(&fixture.frames[..1]);
    pipeline.end();
    assert!(!pipeline.drain().buffers.is_empty());
    assert_eq!(pipeline.stats("vehicle").get::<u64>("refused"), Ok(3));
}

/// Bit rate and loss change while the pipeline plays, and a camera its frame rate.
#[test]
fn a_link_may_change() {
    let fixture = fixture();
    let pipeline = fixture.sending("bit-rate=20000 loss=0 spread=0");
    let vehicle = pipeline.element("vehicle");
    pipeline.play();
    let sink = pipeline.element("sink").downcast::<gst_app::AppSink>().unwrap();
    let last = || {
        let stats = vehicle.property::<gst::Structure>("stats");
        let last = stats.get::<gst::Structure>("last").unwrap();
        (last.get::<u32>("frame").unwrap(), last.get::<u32>("bytes").unwrap())
    };
    (0..3).for_each(|index| pipeline.push(index, &fixture.frames[index].data));
    let counted = |frames: u64| {
        while vehicle.property::<gst::Structure>("stats").get::<u64>("frames").unwrap() < frames
            || sink.try_pull_sample(gst::ClockTime::from_mseconds(300)).is_some()
        {}
        last()
    };
    let (_, fine) = counted(3);
    vehicle.set_property("bit-rate", 5000_u32);
    vehicle.set_property("loss", 0.3);
    (3..6).for_each(|index| pipeline.push(index, &fixture.frames[index].data));
    let (number, coarse) = counted(6);
    assert!(coarse < fine, "{coarse} bytes, {fine} before");
    let Camera { width, height, .. } = CAMERA;
    let caps = gst::Caps::builder("video/x-raw")
        .field("format", "RGB")
        .field("width", width as i32)
        .field("height", height as i32)
        .field("framerate", gst::Fraction::new(10, 1))
        .build();
    let source = pipeline.element("source").downcast::<gst_app::AppSrc>().unwrap();
    source.set_caps(Some(&caps));
    (6..8).for_each(|index| pipeline.push(index, &fixture.frames[index].data));
    assert!(counted(8).0 > number, "numbers go on");
    assert_eq!(pipeline.stats("vehicle").get::<u64>("uncertain"), Ok(0));
}

#[test]
fn what_a_prior_leaves_out_is_a_warning() {
    let fixture = fixture();
    let plain = std::fs::read(fixture.file("prior.ply")).unwrap();
    let end = plain.windows(10).position(|w| w == b"end_header").unwrap();
    let header = String::from_utf8(plain[..end].to_vec()).unwrap();
    let header = header.replace("property float nx", "property float segment");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("other.ply");
    std::fs::write(&file, [header.as_bytes(), &plain[end..]].concat()).unwrap();
    let encoder = fixture.encoder(&format!("prior={}", file.display()));
    let pipeline = Pipeline::new(&format!("{} ! {encoder}", Fixture::source()));
    pipeline.run(&fixture.frames[..1]);
    let warnings = pipeline.warnings();
    assert!(warnings.iter().any(|of| of.contains("other.ply: PLY property")), "{warnings:?}");
}

//! Eight hours of packets, without waiting for them: `make console-soak`. A recording of some minutes is played over
//! and over, with the clock set on, and a page looks on.

use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::sync::mpsc::sync_channel;

use nvsprior::link::{CameraFrame, STAMP_PERIOD as PERIOD, Vehicle};
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior_channel::forth_and_back;

use super::*;
use crate::console::event::EVENTS;
use crate::console::pictures::tests::{FRAME_RATE, MTU, encoder, options};
use crate::console::server::Server;
use crate::journal::LogArgs;
use crate::scene::{CAMERA, clean_frame, pose, wall};

const HOURS: usize = 8;
/// Seconds of the recording. A lap takes a stamp's period, so that ages are right in each; the rest of it is silence,
/// after which the vehicle begins anew.
const SECONDS: f64 = 640.0;
/// Different frames.
const FRAMES: usize = 24;
/// The first lap begins then, UTC.
const START: f64 = 2_600_000.0 * PERIOD;
/// What the last hour may hold more than the first one did at most, kibibytes. The start is in the first one.
const MORE: f64 = 2048.0;

/// A modem frame, and when it came since the recording began.
type Recorded = (f64, Vec<u8>);

/// What a vehicle sends in [`SECONDS`].
fn recording(engine: &Engine, prior: &Prior) -> Vec<Recorded> {
    let scene = engine.upload(prior).unwrap();
    let frames: Vec<_> =
        (0..FRAMES).map(|t| clean_frame(engine, &scene, &pose(t as f64))).collect();
    let mut vehicle = Vehicle::new(engine, &scene, &CAMERA, encoder(), &options()).unwrap();
    let (mut recorded, mut sent) = (Vec::new(), 0);
    for number in 0..(SECONDS * FRAME_RATE) as usize {
        let exposed = START + number as f64 / FRAME_RATE;
        let frame = CameraFrame {
            exposed,
            picture: &frames[forth_and_back(number, FRAMES)],
            info: FrameInfo { time: None, hint: (number == 0).then(|| Hint::of(pose(0.0))) },
            user: &[],
        };
        vehicle.frame(exposed, &frame, || exposed).unwrap();
        let link = vehicle.link();
        while let Some(due) = link.due()
            && let Some(frame) = link.transmit(exposed + 1.0 / FRAME_RATE, MTU).unwrap()
        {
            // It takes half a second, and a tenth is lost.
            sent += 1;
            if sent % 10 > 0 {
                recorded.push((due.max(exposed) - START + 0.5, frame.to_vec()));
            }
        }
    }
    recorded
}

/// Resident memory of this process, kibibytes.
fn resident() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.split_whitespace().next().unwrap().parse().unwrap()
}

/// A page that takes states and pictures as they come.
fn look_on(page: &str) {
    let host = page.trim_start_matches("http://").trim_end_matches('/').to_owned();
    let ask = |host: &str, path: &str| {
        let mut stream = TcpStream::connect(host).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        stream
    };
    let mut events = ask(&host, "/events");
    std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        while events.read(&mut buffer).is_ok_and(|read| read > 0) {
            for path in ["/picture.png", "/chase.png"] {
                // The console may have ended.
                let _ = ask(&host, path).read_to_end(&mut Vec::new());
            }
        }
    });
}

#[test]
#[ignore = "takes minutes: make console-soak"]
fn memory_is_flat_over_eight_hours_of_packets() {
    let engine = Engine::new(&Default::default()).unwrap();
    let prior = wall(5);
    let recording = recording(&engine, &prior);
    let folder = tempfile::tempdir().unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let vehicle = socket.local_addr().unwrap();
    let options = TopsideOptions {
        prior_file: String::new(),
        link: Pictures::options(MTU),
        source: "a recording".into(),
        clock: Clock::of_recording(START, 0.0),
        return_path: ReturnPath::Udp(socket),
        keeper: Keeper::new(folder.path().into()),
        video: None,
        filter: true,
        resume: None,
        journal: LogArgs::default().open("console").unwrap(),
        key: None,
        state: None,
    };
    let (mut topside, published) = Topside::new(&engine, &prior, options).unwrap();
    let server = Server::bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let (events, _commands) = sync_channel(EVENTS);
    look_on(&server.start(topside.plan_picture(), published, events).unwrap());
    topside.take(Event::Command(Asked { page: None, command: Command::Record(true) }));
    let laps = (HOURS as f64 * 3600.0 / PERIOD).ceil() as usize;
    // By hour: the sum, the least and the most of what was measured, and how often.
    let mut hours = [(0.0, f64::INFINITY, 0.0_f64, 0.0); HOURS];
    for lap in 0..laps {
        let mut shown = f64::MIN;
        for (time, bytes) in &recording {
            let now = START + lap as f64 * PERIOD + time;
            topside.options.clock = Clock::of_recording(now, 0.0);
            let (bytes, from) = (bytes.clone(), Some(vehicle));
            topside.take(Event::Arrived(Arrived { time: now, bytes, from }));
            if now - shown >= 0.9 / FRAME_RATE {
                topside.show(true).unwrap();
                shown = now;
                let hour = ((now - START) / 3600.0) as usize;
                if let Some((sum, least, most, count)) = hours.get_mut(hour) {
                    let kib = resident();
                    (*sum, *least, *most, *count) =
                        (*sum + kib, least.min(kib), most.max(kib), *count + 1.0);
                }
            }
        }
    }
    let pictures = topside.pictures.shown().unwrap().number;
    println!("{pictures} pictures, {} packets", topside.pictures.link().statistics().completed);
    println!("hour  resident MiB: mean, least, most");
    for (hour, (sum, least, most, count)) in hours.iter().enumerate() {
        let [mean, least, most] = [sum / count, *least, *most].map(|kib| kib / 1024.0);
        println!("{:4}  {mean:7.1} {least:7.1} {most:7.1}", hour + 1);
    }
    assert!(pictures as f64 > 0.9 * HOURS as f64 * 3600.0 * FRAME_RATE * SECONDS / PERIOD);
    assert!(hours[HOURS - 1].2 < hours[0].2 + MORE, "the last hour against the first");
}

//! `nvsprior vehicle`, `channel` and `console`: two ends and the link between them.

#[cfg(unix)]
mod serial;
mod video;

use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel as queue};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::dive::{Dive, pictures};

/// How long a test waits for what must come.
const PATIENCE: Duration = Duration::from_secs(60);

/// A program that runs until it is dropped.
struct Running {
    child: Child,
    lines: Receiver<String>,
    input: Option<ChildStdin>,
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Running {
    fn start(dive: &Dive, args: &str) -> Running {
        Running::by(&mut Command::new(env!("CARGO_BIN_EXE_nvsprior")), dive, args)
    }

    /// Starts a program that takes the arguments.
    fn by(command: &mut Command, dive: &Dive, args: &str) -> Running {
        let mut child = command
            .args(args.split_whitespace())
            .current_dir(dive.path(""))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = queue();
        std::thread::spawn(move || {
            output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        let input = child.stdin.take();
        Running { child, lines, input }
    }

    /// The next line that has a text in it, within a minute.
    fn line_with(&mut self, text: &str) -> String {
        let end = Instant::now() + PATIENCE;
        loop {
            let line = self.lines.recv_timeout(end.saturating_duration_since(Instant::now()));
            let line = line.unwrap_or_else(|error| panic!("{text:?} was not said: {error}"));
            if line.contains(text) {
                return line;
            }
        }
    }
}

/// The part of a line behind a word, up to a space.
fn behind<'a>(line: &'a str, word: &str) -> &'a str {
    let rest = line.split_once(word).unwrap_or_else(|| panic!("no {word:?} in {line:?}")).1;
    rest.split([' ', ',', '\n']).next().unwrap()
}

struct Console {
    running: Running,
    udp: String,
    page: String,
}

impl Console {
    fn start(dive: &Dive, source: &str) -> Console {
        Console::by(&mut Command::new(env!("CARGO_BIN_EXE_nvsprior")), dive, source)
    }

    fn by(command: &mut Command, dive: &Dive, source: &str) -> Console {
        let args = format!("console --prior prior.ply --listen 127.0.0.1:0 --keep kept {source}");
        let mut running = Running::by(command, dive, &args);
        let line = running.line_with(" on http");
        let page = behind(&line, " on ").trim_end_matches('/').to_owned();
        let udp =
            if line.contains("UDP ") { behind(&line, "UDP ").to_owned() } else { String::new() };
        Console { running, udp, page }
    }

    fn get(&self, path: &str) -> Vec<u8> {
        let mut response = ureq::get(format!("{}{path}", self.page)).call().unwrap();
        response.body_mut().read_to_vec().unwrap()
    }

    fn state(&self) -> Value {
        serde_json::from_slice(&self.get("/state")).unwrap()
    }

    fn post(&self, path: &str, body: &Value) -> u16 {
        post(&format!("{}{path}", self.page), body)
    }

    /// Waits for a state.
    fn until(&self, what: &str, is_there: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let state = self.state();
            if is_there(&state) {
                return state;
            }
            assert!(start.elapsed() < PATIENCE, "{what} did not come: {state:#}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn until_picture(&self, number: u64) -> Value {
        self.until("a picture", |state| state["picture"]["number"].as_u64() >= Some(number))
    }
}

fn vehicle(dive: &Dive, to: &str, more: &str) -> Running {
    let fixed = "vehicle --prior prior.ply --cameras cameras.json --split dive --bit-rate 20000";
    Running::start(dive, &format!("{fixed} --frame-rate 5 --to {to} {more}"))
}

fn channel(dive: &Dive, args: &str) -> (Running, String) {
    let mut running = Running::start(dive, &format!("channel --from 127.0.0.1:0 {args}"));
    let line = running.line_with("channel: ");
    let from = behind(&line, "from ").to_owned();
    (running, from)
}

fn socket() -> (UdpSocket, String) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    let at = socket.local_addr().unwrap().to_string();
    (socket, at)
}

/// The datagrams that come, and the sender of the last one. Ends after two seconds without any.
fn datagrams(socket: &UdpSocket) -> (Vec<Vec<u8>>, Option<std::net::SocketAddr>) {
    let (mut found, mut peer, mut buffer) = (Vec::new(), None, [0; 2048]);
    while let Ok((len, from)) = socket.recv_from(&mut buffer) {
        found.push(buffer[..len].to_vec());
        peer = Some(from);
    }
    (found, peer)
}

#[test]
fn a_channel_loses_the_same_datagrams_with_the_same_seed_in_both_directions() {
    let dive = Dive::without_frames();
    let carried = |seed: u32| {
        let (topside, at) = socket();
        let args =
            format!("--to {at} --bit-rate 1000000 --delay 0 --loss 0.3 --burst 3 --seed {seed}");
        let (_channel, from) = channel(&dive, &args);
        let (vehicle, _) = socket();
        for k in 0..200_u8 {
            vehicle.send_to(&[k; 9], &from).unwrap();
        }
        let (came, peer) = datagrams(&topside);
        for k in 0..200_u8 {
            topside.send_to(&[k; 9], peer.unwrap()).unwrap();
        }
        (came, datagrams(&vehicle).0)
    };
    let (one, back) = carried(7);
    assert!((100..180).contains(&one.len()), "{} of 200", one.len());
    assert!((100..180).contains(&back.len()), "{} of 200", back.len());
    assert!(one.is_sorted() && one.iter().all(|datagram| datagram.len() == 9));
    assert_ne!(one, back, "each direction has losses of its own");
    assert_eq!(carried(7), (one.clone(), back));
    assert_ne!(carried(8).0, one);
}

#[test]
fn a_channel_takes_its_time() {
    let dive = Dive::without_frames();
    let (topside, at) = socket();
    let (_channel, from) = channel(&dive, &format!("--to {at} --bit-rate 1600 --delay 0.5"));
    let (vehicle, _) = socket();
    let start = Instant::now();
    for _ in 0..5 {
        vehicle.send_to(&[1; 40], &from).unwrap();
    }
    let mut buffer = [0; 64];
    for k in 1..=5 {
        assert_eq!(topside.recv(&mut buffer).unwrap(), 40);
        let least = 0.5 + 0.2 * f64::from(k);
        assert!(start.elapsed().as_secs_f64() >= least, "datagram {k} came too early");
    }
}

/// Carries datagrams between a vehicle and a topside, and with each one to the vehicle many that are none of its own.
fn carry_with_strangers(topside: &str) -> String {
    let (carrier, at) = socket();
    carrier.set_read_timeout(None).unwrap();
    let topside: std::net::SocketAddr = topside.parse().unwrap();
    std::thread::spawn(move || {
        let (mut vehicle, mut buffer) = (None, [0; 2048]);
        while let Ok((len, from)) = carrier.recv_from(&mut buffer) {
            let to = if from == topside { vehicle } else { Some(topside) };
            if from != topside {
                vehicle = Some(from);
            } else if let Some(vehicle) = vehicle {
                (0..200).for_each(|k| drop(carrier.send_to(&[k; 40], vehicle)));
            }
            to.into_iter().for_each(|to| drop(carrier.send_to(&buffer[..len], to)));
        }
    });
    at
}

#[test]
fn a_vehicle_that_is_too_slow_hears_its_topside_among_strangers() {
    let dive = Dive::new();
    let console = Console::start(&dive, "--udp 127.0.0.1:0");
    let to = carry_with_strangers(&console.udp);
    // A search in pictures of nothing, as large as these, takes longer than 60 of them allow on any device of a test.
    let rates = "--raw 480x270 --frame-rate 60 --bit-rate 100000";
    let input = "--prior prior.ply --cameras cameras.json --split dive";
    let mut vehicle = Running::start(&dive, &format!("vehicle {input} {rates} --to {to}"));
    let mut frames = vehicle.input.take().unwrap();
    std::thread::spawn(move || while frames.write_all(&[0; 480 * 270 * 3]).is_ok() {});
    vehicle.line_with("too slow for 60 frames per second, takes ");
    console.until_picture(1);
    let parts = json!({ "parts": [0.25, 0.25, 0.75, 0.75] });
    assert_eq!(console.post("/region", &parts), 202);
    vehicle.line_with("a region of interest");
}

#[test]
fn the_page_is_told_which_run_and_which_prior_it_shows() {
    let dive = Dive::without_frames();
    let one = Console::start(&dive, "--udp 127.0.0.1:0").state();
    let other = Console::start(&dive, "--udp 127.0.0.1:0").state();
    assert_ne!(one["run"], other["run"]);
    assert_eq!(one["prior"], other["prior"]);
    assert_eq!(one["prior"]["file"], "prior.ply");
    assert_eq!(one["prior"]["identity"].as_str().unwrap().len(), 8);
}

#[test]
fn what_the_vehicle_sees_is_on_the_page() {
    let dive = Dive::new();
    let console = Console::start(&dive, "--udp 127.0.0.1:0");
    assert_eq!(console.state()["pose"], "waiting");
    let page = String::from_utf8(console.get("/")).unwrap();
    assert!(page.contains("<title>nvsprior console</title>") && page.contains("EventSource"));
    assert!(image::load_from_memory(&console.get("/plan.png")).is_ok());
    let (_channel, from) =
        channel(&dive, &format!("--to {} --bit-rate 20000 --loss 0.1", console.udp));
    let mut vehicle = vehicle(&dive, &from, "--forth-and-back");
    let state = console.until("the vehicle's time", |state| state["picture"]["clock"] == "reports");
    // A frame waits for its turn, for the channel, and for this machine; but it is not of yesterday.
    let age = state["picture"]["age"].as_f64().unwrap();
    assert!((0.1..20.0).contains(&age), "{age} s");
    let state = console.until("a residual", |state| state["picture"]["has_residual"] == true);
    assert_eq!(state["pose"], "certain");
    assert_eq!(state["link"]["garbage"], 0);
    // 2 · (2 s + 1/5 s + 0.5 s + 64 bytes at 20 kbit/s), rounded up: of what the vehicle is told of its link.
    assert_eq!(state["picture"]["limits"], json!([8.0, 20.0]));
    assert!(state["plan"]["vehicle"].is_array() && state["chase"]["number"].as_u64() > Some(0));
    let shown = image::load_from_memory(&console.get("/picture.png")).unwrap().to_rgb8();
    let shown =
        nvsprior::Picture::from_rgb(shown.width(), shown.height(), shown.into_raw()).unwrap();
    let best = pictures().iter().map(|frame| frame.psnr(&shown)).fold(0.0, f64::max);
    assert!(best > 25.0, "{best} dB");

    // Garbage changes a counter, and nothing else.
    let (noise, _) = socket();
    for k in 0..100_u8 {
        noise.send_to(&vec![k.wrapping_mul(37); usize::from(k)], &console.udp).unwrap();
    }
    let state = console.until("garbage", |state| state["link"]["garbage"].as_u64() >= Some(90));
    console.until_picture(state["picture"]["number"].as_u64().unwrap() + 3);

    // The region goes to the vehicle, not to who sent garbage.
    assert_eq!(console.post("/region", &json!({ "parts": [0.5, 0.25, 0.75, 0.5] })), 202);
    vehicle.line_with("a region of interest");
    let region = &console.state()["region"];
    assert!((region[0].as_f64().unwrap() - 0.5).abs() < 0.003, "{region}");
    for wrong in [json!({ "parts": [0.5, 0.5, 0.2, 0.9] }), json!({ "parts": [0, 0, 2, 2] })] {
        assert_eq!(console.post("/region", &wrong), 400);
    }
    assert_eq!(console.post("/region", &json!({ "parts": null })), 202);
    vehicle.line_with("no region");
}

#[test]
fn a_console_that_is_started_again_goes_on() {
    let dive = Dive::new();
    let first = Console::start(&dive, "--udp 127.0.0.1:0 --log console.jsonl");
    let at = first.udp.clone();
    let mut vehicle = vehicle(&dive, &at, "--forth-and-back --log vehicle.jsonl");
    first.until("a stream", |state| state["picture"]["has_residual"] == true);
    assert_eq!(first.post("/region", &json!({ "parts": [0.5, 0.25, 0.75, 0.5] })), 202);
    assert_eq!(first.post("/record", &json!({ "on": true })), 202);
    vehicle.line_with("a region of interest");
    let before =
        first.until("a recording", |state| state["recorded"]["frames"].as_u64() >= Some(3));
    drop(first);
    let again = Console::start(&dive, &format!("--udp {at} --log console.jsonl"));
    let state = again.state();
    assert_eq!(state["region"], before["region"]);
    assert!(state["recorded"].is_object(), "{state:#}");
    again.until("a whole picture", |state| state["picture"]["has_residual"] == true);
    drop(again);
    // What was kept is gone: the vehicle tells once more what its packets are about.
    std::fs::remove_file(dive.path("kept/console.resume")).unwrap();
    let mut again = Console::start(&dive, &format!("--udp {at} --log console.jsonl"));
    again.until("a whole picture", |state| state["picture"]["has_residual"] == true);
    // Without the vehicle, it says what is missing, and what to do.
    drop(vehicle);
    let state = again.until("silence", |state| state["missing"]["cause"] == "no-bytes");
    assert!(state["missing"]["advice"].as_str().unwrap().contains("whether the vehicle runs"));
    again.running.line_with("Nothing comes, for ");
    let events = |file: &str| -> Vec<String> {
        let text = String::from_utf8(dive.bytes(file)).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines.map(|line| line["event"].as_str().unwrap().to_owned()).collect()
    };
    let told = events("console.jsonl");
    let wanted =
        ["start", "vehicle", "region", "recording", "start", "restart", "vehicle", "no-bytes"];
    assert!(wanted.iter().all(|event| told.iter().any(|told| told == event)), "{told:?}");
    assert_eq!(told.iter().filter(|event| *event == "start").count(), 3);
    assert!(events("vehicle.jsonl").contains(&"region".to_owned()));
    // Another prior is another site: nothing of this one goes on.
    drop(again);
    crate::scene::write_prior(&dive.path("prior.ply"), &crate::scene::wall(2));
    let other = Console::start(&dive, &format!("--udp {at}")).state();
    assert_eq!((&other["region"], &other["recorded"]), (&Value::Null, &Value::Null));
}

#[test]
fn another_prior_and_a_key_on_one_side_are_named() {
    let dive = Dive::new();
    crate::scene::write_prior(&dive.path("other.ply"), &crate::scene::wall(2));
    dive.run("key --out own.key").ends_with(0);
    let console = Console::start(&dive, "--udp 127.0.0.1:0");
    let missing = |what: &'static str| {
        console.until(what, move |state| {
            state["missing"]["what"].as_str().is_some_and(|text| text.contains(what))
        })
    };
    let keyed = vehicle(&dive, &console.udp, "--forth-and-back --key own.key");
    missing("none of them readable; this side has no key");
    drop(keyed);
    let args = "vehicle --prior other.ply --cameras cameras.json --split dive --bit-rate 20000";
    let to = &console.udp;
    let _other =
        Running::start(&dive, &format!("{args} --frame-rate 5 --to {to} --forth-and-back"));
    let state = missing("not about prior.ply (");
    assert_eq!(state["missing"]["cause"], "other-prior");
    assert_eq!(state["picture"], Value::Null);
}

#[test]
fn with_a_key_nothing_of_strangers_is_shown() {
    let dive = Dive::new();
    dive.run("key --out own.key").ends_with(0);
    dive.run("key --out other.key").ends_with(0);
    // The console's own copy, as on another machine.
    std::fs::copy(dive.path("own.key"), dive.path("topside.key")).unwrap();
    let console = Console::start(&dive, "--udp 127.0.0.1:0 --key topside.key --epoch 2");
    let stranger = vehicle(&dive, &console.udp, "--forth-and-back --key other.key --epoch 2");
    let state = console.until("strangers", |state| state["link"]["foreign"].as_u64() >= Some(20));
    assert_eq!((&state["picture"], &state["link"]["bytes"].is_u64()), (&Value::Null, &true));
    let told = |state: &Value| {
        let what = state["missing"]["what"].as_str().unwrap_or_default();
        what.contains(
            " modem frames came, none with a valid tag of the key in topside.key, epoch 2",
        )
    };
    console.until("what is missing", told);
    // What the vehicle sends, from a socket that keeps it, to send it again. The console's own reports come there, too,
    // and go back to it: they are of strangers.
    let (tap, at) = socket();
    let own = "--forth-and-back --key own.key --epoch 2";
    let first = vehicle(&dive, &at, own);
    let mut kept = Vec::new();
    let mut buffer = [0; 2048];
    while kept.len() < 30 {
        let len = tap.recv(&mut buffer).unwrap();
        tap.send_to(&buffer[..len], &console.udp).unwrap();
        kept.push(buffer[..len].to_vec());
    }
    let state = console.until_picture(1);
    assert!(!told(&state), "{state:#}");
    drop((first, stranger));
    kept.iter().for_each(|frame| _ = tap.send_to(frame, &console.udp).unwrap());
    let replayed = |state: &Value| state["link"]["replayed"].as_u64() >= Some(20);
    let frame = |state: &Value| state["picture"]["frame"].as_u64();
    let before = console.until("what came once more", replayed);
    // The vehicle starts again, and goes on counting: its frames are taken, and so are reports.
    let mut again = vehicle(&dive, &console.udp, own);
    assert_eq!(console.post("/region", &json!({ "parts": [0.5, 0.25, 0.75, 0.5] })), 202);
    again.line_with("a region of interest");
    let number = before["picture"]["number"].as_u64().unwrap();
    let after = console.until_picture(number + 1);
    assert!(frame(&after).is_some(), "{after:#}");
    let count = |state: &Value| state["link"]["replayed"].as_u64();
    assert!(count(&after) <= Some(30), "{after:#}");
    for side in ["own.key.vehicle", "topside.key.topside"] {
        let state = dive.bytes(side);
        assert!(
            state.starts_with(b"NVS1") && state[5..13] == 2u64.to_le_bytes(),
            "{side}: {state:?}"
        );
    }
}

#[test]
fn a_dive_is_kept_and_played_again() {
    let dive = Dive::new();
    let console = Console::start(&dive, "--udp 127.0.0.1:0");
    assert_eq!(console.post("/record", &json!({ "on": true })), 202);
    let _vehicle = vehicle(&dive, &console.udp, "--forth-and-back");
    console.until_picture(3);
    assert_eq!(console.post("/snapshot", &json!({})), 202);
    console.until("a recording", |state| state["recorded"]["frames"].as_u64() >= Some(40));
    assert_eq!(console.post("/record", &json!({ "on": false })), 202);
    console.until("its end", |state| state["recorded"].is_null());
    drop(console);
    let kept = |ending: &str| {
        let mut files: Vec<_> = std::fs::read_dir(dive.path("kept"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|own| own == ending))
            .collect();
        assert_eq!(files.len(), 1, "{files:?}");
        files.remove(0)
    };
    let snapshot: Value = serde_json::from_slice(&std::fs::read(kept("json")).unwrap()).unwrap();
    let [width, height] =
        ["width", "height"].map(|side| snapshot["picture"][side].as_u64().unwrap());
    let picture = image::open(kept("png")).unwrap();
    assert_eq!([picture.width(), picture.height()].map(u64::from), [width, height]);
    let recording = kept("nvsr");
    let console = Console::start(&dive, &format!("--play {},50", recording.display()));
    let state = console.until("the end", |state| state["stopped"].is_string());
    assert!(state["picture"]["number"].as_u64() > Some(0), "{state:#}");
    assert_eq!(state["link"]["garbage"], 0, "{state:#}");
    assert_eq!(console.get("/picture.png")[1..4], *b"PNG");
}

/// No file may be longer than some kilobytes, as on a disk that is full.
#[cfg(unix)]
#[test]
fn a_full_disk_is_told_and_leaves_no_half_snapshot() {
    let dive = Dive::new();
    let mut limited = Command::new("sh");
    // What it says on stderr finds no room, either.
    let script =
        "trap '' XFSZ; head -c 9000 /dev/zero > said; ulimit -f 8; exec \"$0\" \"$@\" 2>> said";
    limited.args(["-c", script, env!("CARGO_BIN_EXE_nvsprior")]);
    let console = Console::by(&mut limited, &dive, "--udp 127.0.0.1:0");
    assert_eq!(console.post("/record", &json!({ "on": true })), 202);
    let _vehicle = vehicle(&dive, &console.udp, "--forth-and-back");
    console.until_picture(1);
    assert_eq!(console.post("/snapshot", &json!({})), 202);
    let told = |what: &'static str| {
        move |state: &Value| {
            let alarms = state["alarms"].as_array().unwrap();
            alarms.iter().any(|alarm| alarm["text"].as_str().unwrap().contains(what))
        }
    };
    console.until("the snapshot's failure", told("failed: "));
    let state = console.until("the recording's end", told("the recording has ended: "));
    assert_eq!(state["recorded"], Value::Null);
    // It stays, and pictures go on.
    let state = console.until_picture(state["picture"]["number"].as_u64().unwrap() + 2);
    assert_eq!(state["alarms"].as_array().unwrap().len(), 2, "{state:#}");
    let kept = std::fs::read_dir(dive.path("kept")).unwrap().map(|entry| entry.unwrap().path());
    let kept: Vec<_> = kept.filter(|path| !path.ends_with("console.resume")).collect();
    assert!(kept.len() == 1 && kept[0].extension().unwrap() == "nvsr", "{kept:?}");
    let play = Console::start(&dive, &format!("--play {},50", kept[0].display()));
    play.until("what was recorded", |state| state["picture"]["number"].as_u64() > Some(0));
}

#[test]
fn both_ends_may_begin_anew() {
    let dive = Dive::new();
    let console = Console::start(&dive, "--udp 127.0.0.1:0");
    let udp = console.udp.clone();
    let vehicle_before = vehicle(&dive, &udp, "--forth-and-back");
    // From the second packet on they do not state the session.
    console.until_picture(6);
    drop(console);
    let console = Console::start(&dive, &format!("--udp {udp}"));
    console.until_picture(3);
    drop(vehicle_before);
    let before = console.until("silence", |state| state["link"]["silence"].as_f64() > Some(4.5));
    let number = before["picture"]["number"].as_u64().unwrap();
    let _vehicle = vehicle(&dive, &udp, "--forth-and-back");
    let after = console.until_picture(number + 3);
    assert!(after["picture"]["frame"].as_u64() < before["picture"]["frame"].as_u64(), "{after:#}");
}

#[test]
fn modem_frames_come_on_standard_input() {
    let dive = Dive::new();
    dive.encode("--psnr 40 --limit 1");
    dive.run("split packets/0.nvsp --out frames --mtu 64").ends_with(0);
    let mut console = Console::start(&dive, "--serial -");
    let mut input = console.running.input.take().unwrap();
    let mut files: Vec<_> = std::fs::read_dir(dive.path("frames"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    for file in files {
        let mut framed = cobs::encode_vec(&std::fs::read(file).unwrap());
        framed.push(0);
        input.write_all(&framed).unwrap();
    }
    drop(input);
    let state = console.until("the end", |state| state["stopped"].is_string());
    let picture = &state["picture"];
    assert_eq!((&picture["complete"], &picture["clock"]), (&json!(true), &Value::Null));
    assert_eq!(state["link"]["reports"], Value::Null);
}

fn post(url: &str, body: &Value) -> u16 {
    let request = ureq::post(url).config().http_status_as_error(false).build();
    request.send_json(body).unwrap().status().as_u16()
}

fn status(url: &str, host: Option<&str>) -> u16 {
    let mut request = ureq::get(url);
    if let Some(host) = host {
        request = request.header("host", host);
    }
    request.config().http_status_as_error(false).build().call().unwrap().status().as_u16()
}

#[test]
fn other_addresses_take_a_token() {
    let dive = Dive::without_frames();
    let args = "console --prior prior.ply --listen 0.0.0.0:0 --udp 127.0.0.1:0";
    let mut console = Running::start(&dive, args);
    let line = console.line_with("console: ");
    let page = behind(&line, " on ").replace("0.0.0.0", "127.0.0.1");
    let (root, token) = page.split_once("/?").unwrap();
    let view = console.line_with("to look only: ");
    let view = behind(&view, "/?").to_owned();
    assert_eq!(status(&page, None), 200);
    assert_eq!(status(&format!("{root}/state?{token}"), Some("boat.example")), 200);
    for path in ["/", "/state", "/picture.png", "/state?token=", "/state?token=0000", "/nothing"] {
        assert_eq!(status(&format!("{root}{path}"), None), 403, "{path}");
    }
    assert_eq!(status(&format!("{root}/?{view}"), None), 200);
    let bodies = [
        ("/region", json!({ "parts": null })),
        ("/record", json!({ "on": true })),
        ("/snapshot", json!({})),
    ];
    for (path, body) in &bodies {
        assert_eq!(post(&format!("{root}{path}?{view}"), body), 403, "{path}");
        assert_eq!(post(&format!("{root}{path}?view&{token}"), body), 403, "{path}");
        assert_eq!(post(&format!("{root}{path}?{token}"), body), 202, "{path}");
    }
    let open = Console::start(&dive, "--udp 127.0.0.1:0");
    for (path, body) in &bodies {
        assert_eq!(open.post(&format!("{path}?view"), body), 403, "{path}");
    }
    let state = format!("{}/state", open.page);
    assert_eq!(status(&state, None), 200);
    assert_eq!(
        status(&state, Some("rebound.example")),
        403,
        "another site's name for this machine"
    );
}

#[test]
fn wrong_arguments_are_told() {
    let dive = Dive::without_frames();
    let console = "console --prior prior.ply";
    dive.run(console).ends_with(2).says("--udp");
    dive.run(&format!("{console} --udp 5600 --serial -")).ends_with(2).says("cannot be used with");
    dive.run(&format!("{console} --play prior.ply")).ends_with(1).says("no recording of a console");
    dive.run(&format!("{console} --serial /dev/none")).ends_with(1).says("--serial /dev/none");
    let (_taken, at) = socket();
    dive.run(&format!("{console} --udp {at}")).ends_with(1).says("another program may have it");
    dive.run("channel --from 0 --to 127.0.0.1:9 --loss 1").ends_with(2).says("--loss");
    dive.run("channel --from 0 --to nowhere").ends_with(2).says("ADDRESS:PORT");
    let vehicle = "vehicle --prior prior.ply --cameras cameras.json --to 127.0.0.1:9";
    dive.run(&format!("{vehicle} --raw 0x9")).ends_with(2).says("must be WxH");
    dive.run(&format!("{vehicle} --latency 0.1")).ends_with(2).says("latency");
    assert!(!Path::new("console-out").exists());
}

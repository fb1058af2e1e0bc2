//! Vehicle, channel and console on one machine, on the demo's run T2.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const FRAMES: usize = 60;
pub const FRAMES_PER_SECOND: f64 = 3.0;
const SIZE: (u32, u32) = (320, 180);

/// Bits per second of the vehicle's link.
const BIT_RATE: u32 = 8000;

/// What the camera sees.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Water {
    Clear,
    Silt,
    /// The vehicle stays where it took this frame.
    Still(usize),
}

/// A program that ends when it is dropped.
struct Program {
    child: Child,
    /// What it says, and when.
    lines: Receiver<(Instant, String)>,
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Program {
    fn start(args: &str) -> (Program, ChildStdin) {
        let mut child = Command::new(env!("CARGO_BIN_EXE_nvsprior"))
            .args(args.split_whitespace())
            .current_dir(folder())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            output
                .lines()
                .map_while(Result::ok)
                .try_for_each(|line| sender.send((Instant::now(), line)))
        });
        let input = child.stdin.take().unwrap();
        (Program { child, lines }, input)
    }

    /// The next line that has a text in it.
    fn says(&self, text: &str) -> String {
        loop {
            let line = self.lines.recv_timeout(Duration::from_secs(90));
            let (_, line) = line.unwrap_or_else(|_| panic!("nobody said {text:?}"));
            if line.contains(text) {
                return line;
            }
        }
    }
}

pub struct Desk {
    console: Option<Program>,
    vehicle: Option<Program>,
    channel: Option<Program>,
    pub page: String,
    udp: String,
    /// Where the vehicle sends to.
    modem: String,
    water: Arc<Mutex<Water>>,
}

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/console-test");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn behind<'a>(line: &'a str, word: &str) -> &'a str {
    line.split_once(word).unwrap().1.split([' ', '\n']).next().unwrap()
}

impl Desk {
    pub fn start() -> Desk {
        let run = |args: &str| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_nvsprior"));
            let done =
                command.args(args.split_whitespace()).current_dir(folder()).output().unwrap();
            assert!(done.status.success(), "{args}: {}", String::from_utf8_lossy(&done.stderr));
        };
        if !folder().join("prior.ply").exists() {
            run("demo --out . --frames 1");
        }
        let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/vectors/prior.ply");
        std::fs::copy(vectors, folder().join("other.ply")).unwrap();
        // That site's console has no folder to write to: a file has its name.
        std::fs::write(folder().join("other.ply.kept"), "").unwrap();
        // Nothing of a test before goes on.
        let _ = std::fs::remove_dir_all(folder().join("prior.ply.kept"));
        if !folder().join(format!("T2/T2/{FRAMES:04}.png")).exists() {
            run(&format!("demo --run T2 --draw-only --frames {FRAMES} --out ."));
        }
        let (console, page, udp) = console("prior.ply", "127.0.0.1:0", "127.0.0.1:0");
        let channel = link("127.0.0.1:0", &udp);
        let modem = behind(&channel.says("channel: "), "from ").to_owned();
        let water = Arc::new(Mutex::new(Water::Clear));
        let vehicle = Some(vehicle(&modem, BIT_RATE, &water));
        Desk { console: Some(console), vehicle, channel: Some(channel), page, udp, modem, water }
    }

    pub fn water(&self, water: Water) {
        *self.water.lock().unwrap() = water;
    }

    /// Starts the vehicle anew, with another bit rate.
    pub fn restart_vehicle(&mut self, bit_rate: u32) {
        self.vehicle = Some(vehicle(&self.modem, bit_rate, &self.water));
    }

    pub fn stop_vehicle(&mut self) {
        self.vehicle = None;
    }

    pub fn vehicle_says(&self, text: &str) {
        self.vehicle.as_ref().unwrap().says(text);
    }

    /// When the vehicle began to send, if it has said so since this was asked last.
    pub fn vehicle_began(&self) -> Option<Instant> {
        let mut said = self.vehicle.as_ref()?.lines.try_iter();
        said.find(|(_, line)| line.contains("bit/s to")).map(|(when, _)| when)
    }

    pub fn stop_console(&mut self) {
        self.console = None;
    }

    /// Starts it at the addresses that it had, with a prior of the folder.
    pub fn start_console(&mut self, prior: &str) {
        let page = self.page.trim_start_matches("http://").trim_end_matches('/');
        self.console = Some(console(prior, page, &self.udp).0);
    }

    /// The same, without waiting for it, and with more arguments.
    pub fn begin_console(&mut self, prior: &str, more: &str) {
        let page = self.page.trim_start_matches("http://").trim_end_matches('/');
        self.console = Some(Program::start(&console_line(prior, page, &self.udp, more)).0);
    }

    /// Makes a key that the vehicle does not have.
    pub fn make_key(&self, name: &str) {
        let _ = std::fs::remove_file(folder().join(name));
        drop(Program::start(&format!("key --out {name}")).0.child.wait());
    }

    /// What the vehicle sends no longer arrives.
    pub fn cut_the_link(&mut self) {
        self.channel = None;
    }

    pub fn mend_the_link(&mut self) {
        self.channel = Some(link(&self.modem, &self.udp));
    }

    /// Garbage, from nobody: a lot to the console, a little to the modem, whose link is slow.
    pub fn flood(&self) {
        let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        for k in 0..2000_usize {
            let garbage: Vec<u8> = (0..k % 80).map(|at| (at * k) as u8).collect();
            let _ = socket.send_to(&garbage, &self.udp);
            if k % 100 == 0 {
                let _ = socket.send_to(&garbage, &self.modem);
            }
        }
    }

    /// Processor time that the console has taken, seconds.
    pub fn console_cpu(&self) -> f64 {
        let id = self.console.as_ref().unwrap().child.id();
        let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap();
        // After the program's name: utime and stime are fields 14 and 15 of all, in hundredths of a second.
        let fields: Vec<_> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
        fields[11..13].iter().map(|ticks| ticks.parse::<f64>().unwrap() / 100.0).sum()
    }
}

fn console_line(prior: &str, page: &str, udp: &str, more: &str) -> String {
    format!("console --prior {prior} --keep {prior}.kept --listen {page} --udp {udp} {more}")
}

fn link(from: &str, to: &str) -> Program {
    let sends = format!("channel --from {from} --to {to}");
    Program::start(&format!("{sends} --bit-rate {BIT_RATE} --loss 0.1 --delay 0.5")).0
}

fn console(prior: &str, page: &str, udp: &str) -> (Program, String, String) {
    let (program, _) = Program::start(&console_line(prior, page, udp, ""));
    let line = program.says(" on http");
    (program, behind(&line, " on ").to_owned(), behind(&line, "UDP ").to_owned())
}

fn vehicle(modem: &str, bit_rate: u32, water: &Arc<Mutex<Water>>) -> Program {
    let input = "--prior prior.ply --cameras T2/cameras.json --split T2 --raw 320x180";
    let link = format!("--bit-rate {bit_rate} --least 60 --frame-rate {FRAMES_PER_SECOND}");
    let (program, camera) = Program::start(&format!("vehicle {input} {link} --to {modem}"));
    film(camera, water.clone());
    program
}

/// The camera: the run forth and back, or what the water makes of it, until the vehicle ends.
fn film(mut vehicle: ChildStdin, water: Arc<Mutex<Water>>) {
    let (width, height) = SIZE;
    let read = |k: usize| {
        let path = folder().join(format!("T2/T2/{k:04}.png"));
        let image = image::open(&path).unwrap();
        image
            .resize_exact(width, height, image::imageops::FilterType::Triangle)
            .to_rgb8()
            .into_raw()
    };
    let frames: Vec<Vec<u8>> = (1..=FRAMES).map(read).collect();
    std::thread::spawn(move || {
        let mut random = nvsprior::random::Random::new(5);
        for k in 0.. {
            let back = k % (2 * FRAMES - 2);
            let frame = &frames[back.min(2 * FRAMES - 2 - back)];
            let mut grain = |_| (120.0 + random.within(-4.0, 4.0)) as u8;
            let now = *water.lock().unwrap();
            let sent = match now {
                Water::Silt => vehicle.write_all(&frame.iter().map(&mut grain).collect::<Vec<_>>()),
                Water::Clear => vehicle.write_all(frame),
                Water::Still(frame) => vehicle.write_all(&frames[frame]),
            };
            if sent.is_err() {
                return;
            }
            std::thread::sleep(Duration::from_secs_f64(1.0 / FRAMES_PER_SECOND));
        }
    });
}

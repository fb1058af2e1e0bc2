//! The picture with its overlay as RTP, H.264, for consoles that take video. GStreamer codes and sends it, as a program
//! of its own: a failure there does not end the console.

use std::io::Write;
use std::net::SocketAddr;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use nvsprior::Picture;

use super::canvas;
use super::clock::Clock;
use super::overlay::Overlay;
use super::pictures::Shown;
use super::state::PoseState;

/// Video frames per second: the age on them goes on between pictures.
const RATE: u32 = 10;
/// Time between two starts of GStreamer, if it fails.
const AGAIN: Duration = Duration::from_secs(5);
/// Encoders, the first that is there is taken: each with settings for 2 Mbit/s, a key frame each second, no delay.
const ENCODERS: [(&str, &str); 3] = [
    ("x264enc", "tune=zerolatency speed-preset=veryfast bitrate=2000 key-int-max=10"),
    ("openh264enc", "bitrate=2000000 gop-size=10"),
    ("vah264enc", "bitrate=2000 key-int-max=10"),
];
/// What else is used of GStreamer, and Debian's package that has it.
const ELEMENTS: [(&str, &str); 4] = [
    ("rawvideoparse", "gstreamer1.0-plugins-base"),
    ("videoconvert", "gstreamer1.0-plugins-base"),
    ("rtph264pay", "gstreamer1.0-plugins-good"),
    ("udpsink", "gstreamer1.0-plugins-good"),
];

#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    #[error(
        "--rtp takes GStreamer, and gst-inspect-1.0 does not start: {0}; on Debian it is in gstreamer1.0-tools"
    )]
    GStreamer(std::io::Error),
    #[error("--rtp takes GStreamer's {0}, which is not there; on Debian it is in {1}")]
    Element(&'static str, &'static str),
    #[error(
        "--rtp takes one of GStreamer's x264enc, openh264enc and vah264enc; on Debian x264enc is in \
         gstreamer1.0-plugins-ugly"
    )]
    Encoder,
}

/// What the video shows.
#[derive(Clone)]
struct Told {
    number: u64,
    picture: Arc<Picture>,
    overlay: Option<Overlay>,
    exposed: f64,
    /// The vehicle told when that was.
    is_told: bool,
    pose: PoseState,
}

#[derive(Default)]
struct Shared {
    told: Mutex<Option<Told>>,
    trouble: Mutex<Option<String>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Where GStreamer sends to, and by what.
#[derive(Clone, Copy)]
pub struct VideoTarget {
    to: SocketAddr,
    encoder: (&'static str, &'static str),
}

impl VideoTarget {
    /// # Errors
    /// If GStreamer lacks something.
    pub fn new(to: SocketAddr) -> Result<VideoTarget, VideoError> {
        for (element, package) in ELEMENTS {
            if !has(element)? {
                return Err(VideoError::Element(element, package));
            }
        }
        for encoder in ENCODERS {
            if has(encoder.0)? {
                return Ok(VideoTarget { to, encoder });
            }
        }
        Err(VideoError::Encoder)
    }

    /// Sends on a thread of its own.
    pub fn start(self, clock: Clock) -> std::io::Result<Video> {
        let shared = Arc::new(Shared::default());
        let video = Video { shared: shared.clone() };
        let feed =
            move || Feed { target: self, clock, shared, pipeline: None, started: None }.run();
        std::thread::Builder::new().name("video".into()).spawn(feed)?;
        Ok(video)
    }
}

/// Whether GStreamer has an element.
fn has(element: &str) -> Result<bool, VideoError> {
    let mut inspect = Command::new("gst-inspect-1.0");
    let inspect = inspect.args(["--exists", element]).stdout(Stdio::null()).stderr(Stdio::null());
    Ok(inspect.status().map_err(VideoError::GStreamer)?.success())
}

/// A video that runs.
pub struct Video {
    shared: Arc<Shared>,
}

impl Video {
    /// Tells what is to be seen from here on.
    pub fn show(&self, shown: &Shown, overlay: Option<Overlay>, pose: PoseState) {
        let mut told = lock(&self.shared.told);
        let picture = match &*told {
            Some(before) if before.number == shown.number => before.picture.clone(),
            _ => Arc::new(shown.decoded.picture.clone()),
        };
        let (number, exposed, is_told) = (shown.number, shown.exposed, shown.clock.is_some());
        *told = Some(Told { number, picture, overlay, exposed, is_told, pose });
    }

    /// Why no video is sent.
    pub fn trouble(&self) -> Option<String> {
        lock(&self.shared.trouble).clone()
    }
}

/// What writes frames to GStreamer.
struct Feed {
    target: VideoTarget,
    clock: Clock,
    shared: Arc<Shared>,
    pipeline: Option<Pipeline>,
    /// When GStreamer was started last.
    started: Option<Instant>,
}

impl Feed {
    fn run(mut self) {
        let mut drawn: Option<(u64, Picture)> = None;
        let mut next = Instant::now();
        loop {
            next = (next + Duration::from_secs(1) / RATE).max(Instant::now());
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            let Some(told) = lock(&self.shared.told).clone() else { continue };
            let base = match drawn.take() {
                Some((number, base)) if number == told.number => base,
                _ => draw(&told),
            };
            let mut frame = base.clone();
            let age = (self.clock.now() - told.exposed).max(0.0);
            canvas::draw_words(&mut frame, age, told.is_told, told.pose, told.overlay.as_ref());
            drawn = Some((told.number, base));
            self.send(&frame);
        }
    }

    fn send(&mut self, frame: &Picture) {
        let size = (frame.width, frame.height);
        self.pipeline.take_if(|pipeline| pipeline.size != size);
        let sent = match &mut self.pipeline {
            Some(pipeline) => pipeline.input.write_all(&frame.data),
            None if self.started.is_some_and(|started| started.elapsed() < AGAIN) => return,
            None => {
                self.started = Some(Instant::now());
                Pipeline::start(&self.target, size).map(|pipeline| self.pipeline = Some(pipeline))
            }
        };
        *lock(&self.shared.trouble) = sent.err().map(|error| {
            self.pipeline = None;
            format!("No video is sent: GStreamer has ended ({error}); it is started again.")
        });
    }
}

/// A picture with its overlay.
fn draw(told: &Told) -> Picture {
    let mut large = canvas::enlarged(&told.picture);
    if let Some(overlay) = &told.overlay {
        canvas::draw_overlay(&mut large, overlay, told.picture.width);
    }
    large
}

/// GStreamer at work. It ends with its input.
struct Pipeline {
    child: Child,
    input: ChildStdin,
    size: (u32, u32),
}

impl Pipeline {
    fn start(target: &VideoTarget, size: (u32, u32)) -> std::io::Result<Pipeline> {
        let VideoTarget { to, encoder: (encoder, settings) } = target;
        let (width, height) = size;
        let line = format!(
            "fdsrc ! rawvideoparse format=rgb width={width} height={height} framerate={RATE}/1 ! videoconvert \
             ! video/x-raw,format=I420 ! {encoder} {settings} ! rtph264pay config-interval=1 pt=96 \
             ! udpsink sync=false host={} port={}",
            to.ip(),
            to.port()
        );
        let mut child = Command::new("gst-launch-1.0")
            .arg("--quiet")
            .args(line.split_whitespace())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()?;
        let input = child.stdin.take().ok_or(std::io::ErrorKind::BrokenPipe)?;
        Ok(Pipeline { child, input, size })
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

//! What the page is told, as JSON. Times are seconds, places are pixels of the picture that they are drawn into.

use nvsprior_link::ClockSource;
use serde::Serialize;

use super::missing::{Missing, PriorState};
use super::overlay::Overlay;
use super::projection::Pixel;

#[derive(Debug, Serialize)]
pub struct State {
    /// Tells one run of the console from another: a page shows nothing of one that has ended.
    pub run: String,
    pub prior: PriorState,
    /// The topside's UTC.
    pub now: f64,
    /// How fast it goes: a recording may be played faster.
    pub speed: f64,
    /// How many are open.
    pub pages: usize,
    pub source: String,
    /// Why nothing comes.
    pub stopped: Option<String>,
    pub picture: Option<PictureState>,
    pub pose: PoseState,
    /// For how long the vehicle has not been certain.
    pub uncertain_for: f64,
    pub link: LinkState,
    pub plan: PlanState,
    pub chase: ChaseState,
    /// `None`: nothing is known of where the vehicle goes.
    pub path: Option<PathState>,
    /// Left, top, right and bottom as parts of the picture.
    pub region: Option<[f64; 4]>,
    /// The recording that runs.
    pub recorded: Option<RecordingState>,
    /// Bytes that the disk has room for.
    pub free: Option<u64>,
    /// What is missing for a picture.
    pub missing: Option<Missing>,
    /// What the last command came to.
    pub note: Option<String>,
    /// Which page gave it.
    pub note_page: Option<String>,
    pub warnings: Vec<String>,
    /// In order of time.
    pub alarms: Vec<Alarm>,
    pub overlay: Option<Overlay>,
}

/// What went wrong and is over, such as a recording that ended. A page shows it until its pilot has seen it.
#[derive(Clone, Debug, Serialize)]
pub struct Alarm {
    /// UTC. Each has another.
    pub time: f64,
    pub text: String,
}

#[derive(Debug, PartialEq, Serialize)]
pub struct RecordingState {
    /// Modem frames.
    pub frames: u64,
    pub bytes: u64,
    /// Since it began.
    pub seconds: f64,
}

/// What the vehicle says of its pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseState {
    /// No picture has come.
    Waiting,
    Certain,
    /// Not certain for a short time.
    Searching,
    Lost,
}

#[derive(Debug, Serialize)]
pub struct PictureState {
    /// Counts pictures: a new one has another number.
    pub number: u64,
    pub frame: u32,
    pub width: u32,
    pub height: u32,
    /// How old it is.
    pub age: f64,
    /// From which ages on it is old, and very old.
    pub limits: [f64; 2],
    /// By whose clock; `None`: since its packet came, so it is older than that.
    pub clock: Option<&'static str>,
    /// The vehicle's clock cannot be right.
    pub is_clock_off: bool,
    /// When the modem frame came that it was drawn after, UTC.
    pub arrived: f64,
    /// Modem frames of its packet that came, and that were sent.
    pub shares: [Option<usize>; 2],
    /// Of its packet; the bytes that came.
    pub bytes: usize,
    pub complete: bool,
    /// A difference was added: it is not the render alone.
    pub has_residual: bool,
    /// It went through the display filter.
    pub filtered: bool,
    /// Within how much the vehicle knows its position: the prior's unit, and degrees. `None`: it does not.
    pub known: Option<[f64; 2]>,
}

/// The name of a clock.
pub fn clock_name(source: ClockSource) -> &'static str {
    match source {
        ClockSource::Reports => "reports",
        ClockSource::Vehicle => "vehicle",
    }
}

#[derive(Debug, Serialize)]
pub struct LinkState {
    /// Since the last valid modem frame came.
    pub silence: Option<f64>,
    /// Bits per second, over the last seconds.
    pub bit_rate: f64,
    pub pictures_per_second: f64,
    /// Part of the modem frames that was lost of late.
    pub loss: Option<f64>,
    pub bytes: u64,
    pub frames: u64,
    /// Modem frames that were none, or of no use.
    pub garbage: u64,
    /// Those of them that no key has made; `None`: there are no keys.
    pub foreign: Option<u64>,
    /// Those of them that came a second time.
    pub replayed: Option<u64>,
    pub packets: u64,
    /// Reports that were sent; `None`: there is no return channel.
    pub reports: Option<u64>,
    /// By second, oldest first: bytes, and the part that was lost.
    pub seconds: Vec<(usize, Option<f64>)>,
}

#[derive(Debug, Default, Serialize)]
pub struct PlanState {
    pub vehicle: Option<Pixel>,
    /// Within what the vehicle is known to be, as points of an outline; empty if that is not known.
    pub known: Vec<Pixel>,
    /// What the camera sees, as a triangle's far corners.
    pub cone: Vec<Pixel>,
    /// Which way it looks, degrees from the map's upper edge, clockwise.
    pub heading: Option<f64>,
    /// What a unit of the prior's ground has.
    pub pixels_per_unit: f64,
    pub track: Vec<Pixel>,
    pub predicted: Vec<Pixel>,
}

#[derive(Debug, Default, Serialize)]
pub struct ChaseState {
    /// Counts its pictures.
    pub number: u64,
    /// How old the pose is that it was drawn for.
    pub age: Option<f64>,
    pub vehicle: Vec<Vec<Pixel>>,
    pub track: Vec<Vec<Pixel>>,
    pub predicted: Vec<Vec<Pixel>>,
}

/// Where the vehicle goes, in the picture: two rails below the camera, with sleepers at whole seconds.
#[derive(Debug, Default, Serialize)]
pub struct PathState {
    pub rails: Vec<Vec<Pixel>>,
    pub sleepers: Vec<Sleeper>,
    /// Where the vehicle is by now, as old as the picture is.
    pub now: Option<[Pixel; 2]>,
}

#[derive(Debug, Serialize)]
pub struct Sleeper {
    /// After the picture, seconds.
    pub seconds: f64,
    pub line: [Pixel; 2],
}

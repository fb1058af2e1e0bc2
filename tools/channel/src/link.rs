//! `nvsprior link`: encoder, simulated acoustic channel and decoder in one command.

mod channel;
mod chart;
mod footage;
mod region;
mod report;
mod sent;
mod setting;
mod simulation;
mod video;

use std::path::PathBuf;

use nvsprior::image::Preprocessor;
use nvsprior::{Mode, Picture};
use nvsprior_inputs::args::{DeviceArgs, OverwriteArgs, PriorArgs, progress, with_progress};
use nvsprior_inputs::input::InputArgs;
use nvsprior_inputs::keys::KeyArgs;
use nvsprior_inputs::mode::ModeArgs;
use nvsprior_inputs::tune::TuneArgs;
use nvsprior_inputs::values::{self, WrongUsage};
use nvsprior_link::keys::Keys;
use nvsprior_link::modem::{Loss, MIN_MTU};
use nvsprior_link::{LinkError, TopsideLink, VehicleLink};
use nvsprior_runs::{FrameFolder, FrameKind};

use footage::{AtSize, Footage, WidthFrom};
use region::Region;
use report::LinkRun;
use setting::Setting;
use simulation::Simulation;
use video::{Coder, Video};

/// Send a run of frames over a simulated acoustic link, and see what the pilot sees
///
/// Frames come at --fps. If there are fewer than --seconds take, the run is gone through forth and back. A rate control
/// gives each frame its bytes. Packets are spread over modem frames (*shares*) so that those that arrive give a
/// picture, whichever they are. The channel carries --bit-rate, and loses modem frames one by one or in bursts. The
/// topside shows each camera frame --latency after its exposure: its own picture, as far as it has come by then; else
/// the prior, drawn at a pose between those of frames before and after; else the picture before. Its PSNR against the
/// frame is the figure: all camera frames count, those that were left out or lost, too.
///
/// Give several values to --loss to compare them. Writes link.json, frames.csv and link.svg. The same arguments give
/// the same result.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    link: LinkArgs,
    #[command(flatten)]
    mode: ModeArgs,
    #[command(flatten)]
    tune: TuneArgs,
    #[command(flatten)]
    key: KeyArgs,
    /// Folder for what the pilot sees of each frame, at the first --loss: NUMBER.png
    #[arg(long, alias = "frames-out", value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Camera frames per second
    #[arg(long, value_name = "N", default_value_t = 15.0, value_parser = values::rate)]
    fps: f64,
    /// Length of the run [default: as many frames as there are]
    #[arg(long, value_name = "S", value_parser = values::not_negative)]
    seconds: Option<f64>,
    /// See `nvsprior encode`
    #[arg(long, value_name = "MSE", default_value_t = 1e-3, value_parser = values::mse, allow_hyphen_values = true)]
    threshold: f64,
    /// Folder for link.json, frames.csv and link.svg; made if it is missing
    #[arg(long, value_name = "DIR")]
    report: PathBuf,
    #[command(flatten)]
    device: DeviceArgs,
}

/// The channel, and how it is used.
#[derive(clap::Args)]
struct LinkArgs {
    /// Bits per second
    #[arg(long, value_name = "BPS", default_value_t = 5_000.0, value_parser = values::rate)]
    bit_rate: f64,
    /// Most bytes of a modem frame. Below 16 packets are not protected against losses
    #[arg(long, value_name = "N", default_value_t = 64,
        value_parser = clap::value_parser!(u16).range(MIN_MTU as i64..))]
    mtu: u16,
    /// What a modem frame takes beside its bytes, as bytes
    #[arg(long, value_name = "BYTES", default_value_t = 0)]
    overhead: usize,
    /// Seconds from vehicle to topside
    #[arg(long, alias = "propagation", value_name = "S", default_value_t = 0.1, value_parser = values::not_negative)]
    delay: f64,
    /// Chance that a modem frame is lost, 0 up to but not 1; several with commas between them
    #[arg(long, value_name = "X", value_delimiter = ',', default_value = "0", value_parser = values::not_negative)]
    loss: Vec<f64>,
    /// Mean number of modem frames that are lost in a row
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = values::not_negative)]
    burst: f64,
    /// Loss that the vehicle protects its packets against at first [default: --loss]
    #[arg(long, value_name = "X", value_parser = values::not_negative)]
    assume_loss: Option<f64>,
    /// There is a return channel: once a second the topside says what came, and the vehicle knows it so many seconds
    /// later. It then measures the loss, and sends again what a picture still lacks
    #[arg(long, value_name = "S", value_parser = values::not_negative)]
    return_delay: Option<f64>,
    /// Seconds from exposure to display [default: 1.5, more on a link that needs more for a picture of --least bytes]
    #[arg(long, value_name = "S", value_parser = values::rate)]
    latency: Option<f64>,
    /// Most pictures per second [default: --fps]
    #[arg(long, value_name = "N", value_parser = values::rate)]
    frame_rate: Option<f64>,
    /// Fewest bytes for a picture, all counted: below it frames are left out. As many as a good picture takes: the
    /// frame rate falls before quality does [default: 40; those of the prior at a pose, 24, if the link does not carry
    /// 40 bytes in time]
    #[arg(long = "least", value_name = "BYTES")]
    min_bytes: Option<usize>,
    /// Seed of the channel's losses
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// What only the laboratory asks of a link: `nvsprior-lab link`.
#[derive(Default, clap::Args)]
pub struct LabArgs {
    /// Also tell the PSNR inside and outside of what the prior does not show: where the frames differ from its render,
    /// at the poses of the camera file
    #[arg(long)]
    region: bool,
    /// Pictures are so wide from a frame of the run on, counted from 0: the size changes in flight. Before it they have
    /// --width. Several with commas between them. PSNR is that at the size that is shown
    #[arg(long, value_name = "FRAME:WIDTH", value_delimiter = ',', conflicts_with_all = ["region", "beside"])]
    width_from: Vec<WidthFrom>,
    /// Also send the frames by a video coder, over the same channel, with the same part of the bytes as parity. Shows
    /// the best of all its frame rates and qualities. Its first picture is there from the start, at no cost. Needs
    /// ffmpeg
    #[arg(long, value_enum, value_name = "CODER", value_delimiter = ',')]
    beside: Vec<Coder>,
    /// Seconds from a packet's first modem frame to its last one; those of other packets lie between them [default:
    /// half of what the latency leaves, 0 without loss]
    #[arg(long, value_name = "S", value_parser = values::not_negative)]
    spread: Option<f64>,
    /// Chance that a modem frame arrives late, after those behind them
    #[arg(long, value_name = "X", default_value_t = 0.0, value_parser = values::not_negative)]
    reorder: f64,
    /// Nothing arrives for so long, from the middle of the run on
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = values::not_negative)]
    blackout: f64,
    /// Seconds between two reports of the topside [default: 1]
    #[arg(long, value_name = "S", requires = "return_delay", value_parser = values::rate)]
    report_every: Option<f64>,
    /// State all poses in full, even if the topside holds others that they could be predicted from
    #[arg(long)]
    state_poses: bool,
    /// What the topside sends takes the channel from the vehicle
    #[arg(long, requires = "return_delay")]
    half_duplex: bool,
    /// Seconds of --latency for search, coding and decoding [default: 0.1]
    #[arg(long, value_name = "S", value_parser = values::not_negative)]
    coding: Option<f64>,
    /// Most modem frames of a packet [default: as many as MTU and rate take, 16 to 64]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    shares: Option<u16>,
    /// The link is shared with other traffic: of the modem frames that it carries, this part is asked of the vehicle
    /// when one can go. It has no bit rate of its own then
    #[arg(long, value_name = "PART", value_parser = values::part)]
    pull: Option<f64>,
}

/// Bytes of a good picture, and of the prior at a pose, all counted.
const GOOD_PICTURE: usize = 40;
const BARE_PICTURE: usize = 24;
/// Seconds for search, coding and decoding.
const CODING: f64 = 0.1;
/// Seconds from exposure to display.
const LATENCY: f64 = 1.5;
/// Times that a picture takes on the link for which its latency has room: those before it may take longer.
const ROOM: f64 = 1.5;

impl LinkArgs {
    /// Fewest bytes of a picture, and seconds from exposure to display. `delay`: seconds of them that are no
    /// transmission. `part`: the part of the others in which a packet's first share goes.
    fn least_and_latency(&self, bit_rate: f64, delay: f64, part: f64) -> (usize, f64) {
        let needed = |bytes: usize| delay + ROOM * 8.0 * bytes as f64 / bit_rate / part;
        let is_slow = needed(GOOD_PICTURE) > self.latency.unwrap_or(LATENCY);
        let usual = if is_slow { BARE_PICTURE } else { GOOD_PICTURE };
        let least = self.min_bytes.unwrap_or(usual);
        (least, self.latency.unwrap_or(LATENCY.max(needed(least))))
    }

    fn setting(
        &self,
        chance: f64,
        mode: Mode,
        keys: Option<&Keys>,
        args: &Args,
        lab: &LabArgs,
    ) -> Result<Setting, LinkError> {
        let fps = args.fps;
        let loss = Loss { chance, burst: self.burst };
        loss.check()?;
        let assumed = Loss { chance: self.assume_loss.unwrap_or(chance), ..loss };
        let coding = lab.coding.unwrap_or(CODING);
        let (bit_rate, propagation) = (self.bit_rate, self.delay);
        let delay = coding + propagation;
        let spread = if assumed.chance > 0.0 { 0.5 } else { 0.0 };
        let (min_bytes, latency) = self.least_and_latency(bit_rate, delay, 1.0 - spread);
        let spread = spread * (latency - delay).max(0.0);
        let setting = Setting {
            mode,
            tune: args.tune.tune,
            bit_rate,
            mtu: self.mtu.into(),
            overhead: self.overhead,
            propagation,
            loss,
            reorder: lab.reorder,
            blackout: lab.blackout,
            assumed,
            spread: lab.spread.unwrap_or(spread),
            return_delay: self.return_delay,
            report_every: lab.report_every.unwrap_or(1.0),
            predict_poses: !lab.state_poses,
            half_duplex: lab.half_duplex,
            keys: keys.cloned(),
            latency,
            coding,
            fps,
            frame_rate: self.frame_rate.unwrap_or(fps),
            min_bytes,
            shares: lab.shares.map(usize::from),
            pull: lab.pull,
            seed: self.seed,
        };
        VehicleLink::new(&setting.vehicle())?;
        TopsideLink::new(&setting.topside())?;
        Ok(setting)
    }
}

impl Args {
    /// One setting for each loss.
    fn settings(
        &self,
        mode: Mode,
        keys: Option<&Keys>,
        lab: &LabArgs,
    ) -> Result<Vec<Setting>, WrongUsage> {
        let losses = self.link.loss.iter();
        let settings: Result<_, LinkError> =
            losses.map(|loss| self.link.setting(*loss, mode, keys, self, lab)).collect();
        settings.map_err(|error| WrongUsage(error.to_string()))
    }
}

/// Reads the frames at all sizes that they are sent at.
fn footage(args: &Args, lab: &LabArgs, preprocessor: &mut Preprocessor) -> anyhow::Result<Footage> {
    let inputs = args.input.frames()?;
    let first = inputs[0].external;
    let mut sizes = vec![(0, AtSize::read(&inputs, preprocessor)?)];
    let widest = inputs[0].camera.width;
    let mut changes = lab.width_from.clone();
    changes.sort_by_key(|change| change.frame);
    for WidthFrom { frame, width } in changes {
        if width > widest {
            let text = format!("--width-from: {width} is more than the frames' {widest} pixels");
            return Err(WrongUsage(text).into());
        }
        let inputs = args.input.at_width(width).frames()?;
        sizes.push((frame, AtSize::read(&inputs, preprocessor)?));
    }
    Ok(Footage { first, sizes, regions: Vec::new() })
}

/// Simulates, prints and writes the report.
pub fn run(args: &Args, lab: &LabArgs) -> anyhow::Result<()> {
    let mode = args.mode.mode(args.link.return_delay.is_some())?;
    let keys = args.key.open()?;
    let settings = args.settings(mode, keys.as_ref(), lab)?;
    lab.beside.iter().try_for_each(|coder| coder.check())?;
    values::make_folder("--report", &args.report)?;
    let kind = FrameKind::RECONSTRUCTION;
    let mut pictures = args.overwrite.open_given("--pictures", &args.pictures, kind)?;
    let inputs = args.input.frames()?;
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let mut footage = footage(args, lab, &mut Preprocessor::new(scene.preprocessing()))?;
    let frames = match args.seconds {
        Some(seconds) => ((seconds * args.fps) as usize).max(1),
        None => footage.len(),
    };
    if lab.region {
        let AtSize { camera, pictures } = &footage.sizes[0].1;
        let frames = pictures.iter().zip(inputs.iter().map(|input| input.known));
        footage.regions = Region::of_all(&engine, &scene, camera, frames)?;
    }
    let bar = progress(frames * settings.len(), "frames");
    let mut runs: Vec<LinkRun> = Vec::new();
    for setting in settings {
        let mut simulation = Simulation::new(&engine, &scene, &footage, setting, args.threshold)?;
        simulation.frames_out = pictures.as_mut().filter(|_| runs.is_empty());
        runs.push(simulation.run(frames, || bar.inc(1))?);
    }
    bar.finish_and_clear();
    pictures.iter_mut().try_for_each(FrameFolder::finish)?;
    let shown: Vec<_> = (0..frames).map(|frame| footage.picture(frame)).collect();
    for coder in &lab.beside {
        compare(*coder, &shown, args.fps, &mut runs)?;
    }
    report::print(&runs);
    report::write(&args.report, &runs)?;
    chart::draw(&args.report.join("link.svg"), &runs)?;
    args.device.check(&engine)
}

/// Adds what a video coder comes to at each setting.
fn compare(
    coder: Coder,
    frames: &[&Picture],
    fps: f64,
    runs: &mut [LinkRun],
) -> anyhow::Result<()> {
    let video = with_progress(Video::codings(coder), coder.name(), |done| {
        Video::code(coder, frames, fps, done)
    })?;
    for run in runs {
        run.beside.extend(video.beside(run, frames)?);
    }
    Ok(())
}

//! `nvsprior encode`: frames in, packets out.

mod frames;

use std::path::PathBuf;
use std::time::Duration;

use nvsprior::residual::Interest;
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, Mode, Picture, Rate, RenderChecks};
use nvsprior_inputs::args::{DeviceArgs, OverwriteArgs, PriorArgs, progress};
use nvsprior_inputs::input::{Input, InputArgs};
use nvsprior_inputs::keys::KeyArgs;
use nvsprior_inputs::mode::ModeArgs;
use nvsprior_inputs::tune::TuneArgs;
use nvsprior_inputs::values;
use nvsprior_inputs::video_input::VideoInputArgs;
use nvsprior_link::keys::Keys;

use crate::keyed_files::FileTags;
use frames::Frames;
use nvsprior_inputs::summary::{self, Row};
use nvsprior_inputs::track_file::{TrackFile, TrackPoint};
use nvsprior_runs::{FrameFolder, FrameKind, SheetRow, write_contact_sheet};

/// Encode the frames of a camera file, or of a video, to packets
///
/// Frames are taken in time order. The first one starts from its pose in the camera file (or the CSV file). Each later
/// one starts from the pose that constant velocity predicts. If that fails (--threshold), it starts from a pose given
/// for it with --starts. `time` in cameras.json, or the CSV file, says when a frame was taken.
#[derive(clap::Args)]
#[command(
    mut_arg("cameras", |arg| arg.required(false).required_unless_present("video")),
    arg = optimizer()
)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    video: VideoInputArgs,
    #[command(flatten)]
    refine: RefineArgs,
    /// The frames are already treated as the prior's preprocessing says (white balance, CLAHE): do not treat them again
    #[arg(long)]
    frames_treated: bool,
    #[command(flatten)]
    rate: RateArgs,
    #[command(flatten)]
    mode: ModeArgs,
    #[command(flatten)]
    tune: TuneArgs,
    #[command(flatten)]
    interest: InterestArgs,
    #[command(flatten)]
    key: KeyArgs,
    /// Folder for the packets, NAME.nvsp; made if it is missing, refused if it holds packets
    #[arg(long, value_name = "DIR")]
    packets: PathBuf,
    /// Summary to write (JSON)
    #[arg(long, value_name = "FILE", value_parser = values::json)]
    summary: Option<PathBuf>,
    /// Track to write (CSV): the pose of each frame, in the columns that --starts reads, with the standard deviations
    /// srx,sry,srz,sax,say,saz; `inf` along an axis that is open, and along all while a frame is not certain
    #[arg(long, value_name = "FILE", value_parser = values::csv)]
    track: Option<PathBuf>,
    /// Folder for the reconstructed pictures (PNG), as the topside will see them
    #[arg(long, alias = "frames-out", value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Contact sheet to write (PNG): camera | render | difference | reconstruction
    #[arg(long, value_name = "FILE", value_parser = values::png)]
    sheet: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// The one optimiser that there is; the others are `nvsprior-lab paper encode`'s.
fn optimizer() -> clap::Arg {
    clap::Arg::new("optimizer").long("optimizer").hide(true).value_parser(["gauss-newton"])
}

/// The part of the picture that gets more of the bits.
#[derive(clap::Args)]
struct InterestArgs {
    /// Rectangle that gets more of the bits, pixels: left, top, width, height. All else gets fewer; --psnr stays that
    /// of the whole picture. WEIGHT: how many times more an error there counts than one beside it; 8 if it is left out
    #[arg(long, value_name = "X,Y,W,H[,WEIGHT]", value_parser = region)]
    region: Option<RegionArg>,
}

#[derive(Clone, Copy)]
struct RegionArg {
    rectangle: [u32; 4],
    weight: u8,
}

/// A rectangle, and its weight if that is stated.
fn region(text: &str) -> Result<RegionArg, String> {
    if text.split(',').count() < 5 {
        return Ok(RegionArg { rectangle: values::rectangle(text)?, weight: 8 });
    }
    let (rectangle, weight) = text.rsplit_once(',').unwrap_or_default();
    match weight.trim().parse() {
        Ok(weight @ 1..) => Ok(RegionArg { rectangle: values::rectangle(rectangle)?, weight }),
        _ => Err("the weight must be a whole number from 1 to 255".into()),
    }
}

impl InterestArgs {
    fn interest(&self, camera: &Camera) -> Result<Option<Interest>, values::WrongUsage> {
        let Some(RegionArg { rectangle: [x, y, width, height], weight }) = self.region else {
            return Ok(None);
        };
        let size = (camera.width, camera.height);
        let (x, y) = (x..x.saturating_add(width), y..y.saturating_add(height));
        let interest = Interest::rectangle(size, x, y, weight);
        let wrong = |error| values::WrongUsage(format!("--region: {error}"));
        interest.map(Some).map_err(wrong)
    }
}

/// How to find poses.
#[derive(clap::Args)]
struct RefineArgs {
    /// Mean squared error (values in [0, 1]) below which a pose is right, used only if the prior shows too little to
    /// tell (1e-2 suits real footage)
    #[arg(long, value_name = "MSE", default_value_t = 1e-3, value_parser = values::mse, allow_hyphen_values = true)]
    threshold: f64,
    /// Most time that a frame takes, milliseconds. Once it is up, the best pose so far is sent, and the next frames
    /// search on. One render and one coding must fit; less than that on this device is refused [default: as long as
    /// the search takes]
    #[arg(long, value_name = "MS", value_parser = values::milliseconds)]
    frame_time: Option<Duration>,
}

/// How fine the difference picture is.
#[derive(clap::Args)]
struct RateArgs {
    /// The difference picture: coded by the `wavelet` coder, or `none`: the packet is the pose alone
    #[arg(long, default_value = "wavelet", value_parser = values::named(&RESIDUALS))]
    residual: Residual,
    /// Quality of the difference picture, 0 to 100 [default: 10]
    #[arg(long, value_name = "Q", group = "rate", value_parser = values::quality, allow_hyphen_values = true)]
    quality: Option<f32>,
    /// Bytes of the whole packet, never exceeded; its tag counts, if there is a --key
    #[arg(long, value_name = "N", group = "rate")]
    bytes: Option<usize>,
    /// PSNR to reach at the least bytes, dB
    #[arg(long, value_name = "DB", group = "rate", value_parser = values::psnr, allow_hyphen_values = true)]
    psnr: Option<f64>,
    /// Send a check of the render (6 bytes) every N frames, so that the topside knows whether its
    /// render is the same; 0: never
    #[arg(long, value_name = "FRAMES", default_value_t = 0)]
    render_check: u32,
    /// Leave out the truth map, which tells the topside which parts of the picture are not what the camera saw
    #[arg(long)]
    no_truth: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Residual {
    Wavelet,
    None,
}

const RESIDUALS: [(&str, Residual); 2] = [("wavelet", Residual::Wavelet), ("none", Residual::None)];

impl RateArgs {
    /// `tag`: bytes of each packet's number and tag.
    fn rate(&self, tag: usize) -> Option<Rate> {
        let rate = match (self.bytes, self.psnr) {
            (Some(bytes), _) => Rate::Bytes(bytes.saturating_sub(tag)),
            (_, Some(psnr)) => Rate::Psnr(psnr),
            _ => Rate::Quality(self.quality.unwrap_or(10.0)),
        };
        (self.residual != Residual::None).then_some(rate)
    }
}

/// What the command writes.
struct Outputs {
    packets: FrameFolder,
    pictures: Option<FrameFolder>,
    track: Option<TrackFile>,
    sheet: Vec<SheetRow>,
}

/// Makes the folders, and finds out before any work whether the files can be written.
fn outputs(args: &Args) -> anyhow::Result<Outputs> {
    if let Some(file) = &args.summary {
        values::check_file("--summary", file)?;
    }
    if let Some(file) = &args.sheet {
        values::check_file("--sheet", file)?;
    }
    if let Some(file) = &args.track {
        values::check_file("--track", file)?;
    }
    let packets = args.overwrite.open("--packets", &args.packets, FrameKind::PACKET)?;
    let kind = FrameKind::RECONSTRUCTION;
    let pictures = args.overwrite.open_given("--pictures", &args.pictures, kind)?;
    let track = args.track.as_deref().map(TrackFile::of_vehicle).transpose()?;
    Ok(Outputs { packets, pictures, track, sheet: Vec::new() })
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let keys = args.key.open()?;
    let mut frames = Frames::open(&args.prior, &args.input, &args.video)?;
    let mut outputs = outputs(args)?;
    let mode = args.mode.mode(false)?;
    let camera = frames.camera();
    let interest = args.interest.interest(&camera)?;
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let RefineArgs { threshold, frame_time } = args.refine;
    let mut options = EncoderOptions { threshold, frame_time, ..Default::default() };
    options.rate = args.rate.rate(keys.as_ref().map_or(0, Keys::overhead));
    options.mode = mode;
    options.tune = args.tune.tune;
    if options.mode != Mode::Intra && !engine.device().portable {
        tell!("the device is not portable: every frame is an intra frame");
    }
    options.render_checks = RenderChecks::every(args.rate.render_check);
    options.truth = !args.rate.no_truth;
    options.frames_treated = args.frames_treated;
    let mut encoder = Encoder::new(&engine, &scene, &camera, options)?;
    encoder.set_interest(interest);
    let mut tags = FileTags::new(keys.as_ref());
    if frames.begin_lost(&args.input.starts) {
        render_key_frames(&mut encoder)?;
    }
    let bar = progress(frames.about(), "encoding");
    let mut rows = Vec::new();
    while let Some((input, frame)) = frames.next_frame()? {
        let (frame, encoded) = input.encode(&mut encoder, &frame)?;
        if rows.is_empty() {
            args.prior.tell_if_cut(&encoded.render, &input.camera, &encoded.pose)?;
        }
        if encoded.stats.colours_exchanged {
            let what = "fits the prior much better with red and blue exchanged: is its order BGR?";
            tell!("{}: {what}", input.file);
        }
        outputs.packets.write(&format!("{}.nvsp", input.name), tags.put(&encoded.packet))?;
        rows.push(outputs.add(args, &input, frame, encoded)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    summary::print(&rows);
    if let Some(path) = &args.summary {
        summary::write(path, &rows)?;
    }
    if let Some(path) = &args.sheet {
        write_contact_sheet(path, &outputs.sheet)?;
    }
    outputs.packets.finish()?;
    outputs.pictures.iter_mut().try_for_each(FrameFolder::finish)?;
    args.device.check(&engine)
}

/// Renders all key frames: if no pose is given, they find the first frame.
fn render_key_frames(encoder: &mut Encoder) -> anyhow::Result<()> {
    /// Between two steps of the progress bar.
    const AT_ONCE: usize = 8;
    let all = encoder.prepare(0)?;
    let bar = progress(all, "key frames");
    let mut left = all;
    while left > 0 {
        left = encoder.prepare(AT_ONCE)?;
        bar.set_position((all - left) as u64);
    }
    Ok(())
}

impl Outputs {
    /// Writes what is asked for beside the packet.
    fn add(
        &mut self,
        args: &Args,
        input: &Input,
        frame: Picture,
        encoded: Encoded,
    ) -> anyhow::Result<Row> {
        if let Some(pictures) = &mut self.pictures {
            pictures.write_picture(&input.name, &encoded.picture)?;
        }
        let (time, pose) = (input.external.time, encoded.pose);
        if let Some(track) = &mut self.track {
            let deviation = TrackPoint::Deviation(encoded.stats.pose_deviation());
            track.write(&input.file, time, &pose, deviation)?;
        }
        if args.sheet.is_some() {
            let (render, reconstruction) = (encoded.render, Some(encoded.picture));
            self.sheet.push(SheetRow { frame, render, reconstruction });
        }
        Ok(Row { file: input.file.clone(), time, pose, stats: encoded.stats })
    }
}

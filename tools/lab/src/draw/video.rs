//! `nvsprior-lab draw --video`: a survey of the quay as a video.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::geometry::Distortion;
use nvsprior_basin::{COURSE, Conditions, Filmed, survey, survey_lens};
use nvsprior_inputs::args::progress;
use nvsprior_inputs::values;
use nvsprior_inputs::video::{DecoderChoice, encode_video, frame_name};
use nvsprior_runs::write_png;

/// What is drawn as a video.
#[derive(clap::Args)]
pub struct VideoArgs {
    /// Only draws a survey of the quay as a video (MP4, 1280×720) through a lens that distorts, to map from. Where the
    /// camera was is written beside it (FILE.csv, as `encode --starts` reads it)
    #[arg(long, value_name = "FILE",
        conflicts_with_all = ["run", "mapping_run", "views", "site", "width"])]
    video: Option<PathBuf>,
    /// Draw a later dive along a part of the survey's course, to be encoded with the survey's prior
    #[arg(long, requires = "video")]
    later: bool,
    /// Length of the video. The course takes 60 s, then goes back
    #[arg(long, value_name = "SECONDS", default_value_t = COURSE, requires = "video", value_parser = seconds)]
    seconds: f64,
    /// Frames per second of the video. Drawing one takes 5 s of a CPU core
    #[arg(long, value_name = "FPS", default_value_t = 4.0, requires = "video", value_parser = values::frame_rate)]
    fps: f64,
    /// The program that makes the video
    #[arg(long, value_name = "WHICH", default_value = "auto", requires = "video")]
    decoder: DecoderChoice,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = values::positive(text)?;
    if seconds <= 3600.0 { Ok(seconds) } else { Err("must be at most 3600".into()) }
}

impl VideoArgs {
    pub fn file(&self) -> Option<&Path> {
        self.video.as_deref()
    }

    /// Draws the frames into a folder beside the video, which goes when the video is there.
    pub fn draw(&self, file: &Path) -> anyhow::Result<()> {
        values::check_file("--video", file)?;
        self.decoder.decoders()?;
        let folder = beside(file, ".drawn");
        values::make_folder("--video", &folder)?;
        let lens = survey_lens()?;
        let frames = ((self.seconds * self.fps).round() as usize).max(1);
        let mut poses = String::from("file,time,qw,qx,qy,qz,tx,ty,tz\n");
        let filmed = if self.later { Filmed::Dive } else { Filmed::Survey };
        let bar = progress(frames, "drawing");
        let drawn = survey(&lens, filmed, frames, self.fps, Conditions::CALM);
        for (index, frame) in drawn.enumerate() {
            let file = frame_name(index);
            write_png(&folder.join(&file), &frame.picture)?;
            let name = file.trim_end_matches(".png");
            let ([w, x, y, z], t) = (frame.pose.wxyz(), frame.pose.translation);
            writeln!(poses, "{name},{},{w},{x},{y},{z},{},{},{}", frame.time, t.x, t.y, t.z)?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        let command = encode_video(&folder, self.fps, file, self.decoder)?;
        tell!("{command}");
        let csv = beside(file, ".csv");
        std::fs::write(&csv, poses).with_context(|| format!("writing {}", csv.display()))?;
        std::fs::remove_dir_all(&folder)
            .with_context(|| format!("removing {}", folder.display()))?;
        let own = lens.intrinsics();
        let (width, height) = (own.width, own.height);
        println!("{}: {frames} frames of {width}×{height}", file.display());
        let mut params = format!("{},{},{},{}", own.fx, own.fy, own.cx, own.cy);
        if let Distortion::Brown(k) = lens.distortion() {
            for value in &k[..4] {
                write!(params, ",{value}")?;
            }
        }
        println!("its lens: --camera OPENCV:{params}");
        Ok(())
    }
}

fn beside(file: &Path, ending: &str) -> PathBuf {
    let mut name = file.file_name().unwrap_or_default().to_owned();
    name.push(ending);
    file.with_file_name(name)
}

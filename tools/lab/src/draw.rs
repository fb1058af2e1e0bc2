//! `nvsprior-lab draw`: the sites that the program draws, and all runs through them.

mod rig;
mod scene;
mod video;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use nvsprior_basin::{Conditions, Course};
use nvsprior_inputs::args::progress;
use nvsprior_inputs::values;

use scene::{SceneArgs, draw_dive, draw_mapping_run};
use video::VideoArgs;

/// Draw a run through a basin, along a quay, a row or a tower
///
/// Writes the frames and the camera file of inspection runs, or of a mapping run. Opens no device. `nvsprior demo`
/// encodes those of the basin.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for the runs; made if it is missing
    #[arg(long, value_name = "DIR", default_value = "drawn")]
    out: PathBuf,
    /// Frames of each inspection run
    #[arg(long, value_name = "N", default_value = "5")]
    frames: NonZeroUsize,
    /// Also draws this many views from random places of the basin, to test the search for lost cameras
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = values::count)]
    views: usize,
    #[command(flatten)]
    scene: SceneArgs,
    /// Draws the site's mapping run, M1, M2, M3 or M4, that a prior is trained from
    #[arg(long, conflicts_with = "run")]
    mapping_run: bool,
    /// Course of the tower's mapping run: along the line of sight, from 4.5 to 1.6 m; about the tower, in three rows;
    /// or both, if it is not there
    #[arg(long, value_name = "COURSE", requires = "mapping_run", value_parser = values::named(&COURSES))]
    course: Option<Course>,
    #[command(flatten)]
    video: VideoArgs,
}

const COURSES: [(&str, Course); 3] =
    [("approach", Course::Approach), ("arcs", Course::Arcs), ("both", Course::Both)];

pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(file) = args.video.file() {
        return args.video.draw(file);
    }
    values::make_folder("--out", &args.out)?;
    let camera = args.scene.camera()?;
    if args.mapping_run {
        return draw_mapping_run(&args.out, camera, args.scene.mapping_run(args.course)?);
    }
    for dive in args.scene.dives()? {
        draw_dive(&args.out, camera, dive, args.frames.get())?;
    }
    if args.views > 0 {
        let bar = progress(args.views, "drawing random views");
        let views = nvsprior_basin::random_views(camera, args.views, Conditions::CALM);
        nvsprior_basin::write_run(&args.out.join("views"), "views", camera, views, |_| bar.inc(1))?;
        bar.finish_and_clear();
    }
    Ok(())
}

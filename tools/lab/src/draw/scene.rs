//! Which runs are drawn, and drawing them into folders.

use std::path::Path;

use nvsprior::Camera;
use nvsprior_basin::{Conditions, Course, Dive, MappingRun, Run, Site, camera_of_width};
use nvsprior_inputs::args::progress;
use nvsprior_inputs::values::{self, WrongUsage, named};

use super::rig::{ONLY_TOWER, RigArgs};

/// What is drawn.
#[derive(clap::Args)]
pub struct SceneArgs {
    /// Which scene: a structure of oil barrels in an indoor basin; a harbour's wall of sheet piles in green water;
    /// three such structures in a long basin; a steel lattice tower in black water, in the light of the vehicle's own
    /// lamps [default: that of --run, else the basin]
    #[arg(long, value_name = "SITE", value_parser = named(&SITES))]
    site: Option<Site>,
    /// Only this inspection run: T1, T2, T4 (weeks later: growth, a brace that is gone, a new chain, other light) or T5
    /// (months later: more of it, and a pipe that has fallen) of the basin, T3 of the quay, T6 of the row, T7 of the
    /// tower
    #[arg(long, value_name = "RUN")]
    run: Option<Run>,
    /// Weeks since the mapping run, 0 to 520, instead of T4's 4 or T5's 26
    #[arg(long, value_name = "WEEKS", value_parser = values::weeks, requires = "run",
        allow_hyphen_values = true)]
    age: Option<f32>,
    /// Which of five dives: each has a track of its own, and the water's light at another moment
    #[arg(long, value_name = "K", default_value_t = 1,
        value_parser = clap::value_parser!(u8).range(1..=5))]
    dive: u8,
    /// Frames per second of the inspection runs
    #[arg(long, value_name = "FPS", default_value_t = nvsprior_basin::FRAME_RATE,
        value_parser = values::frame_rate, allow_hyphen_values = true)]
    rate: f64,
    /// Width of the pictures. Height and focal length follow: 16:9, the same field of view
    #[arg(long, value_name = "PIXELS", default_value_t = nvsprior_basin::CAMERA.width,
        value_parser = clap::value_parser!(u32).range(LEAST_WIDTH..=i64::from(Camera::MAX_SIDE)))]
    width: u32,
    #[command(flatten)]
    rig: RigArgs,
}

/// Narrower pictures show too little of the scene to search by.
const LEAST_WIDTH: i64 = 160;

const SITES: [(&str, Site); 4] =
    [("basin", Site::Basin), ("quay", Site::Quay), ("row", Site::Row), ("tower", Site::Tower)];

impl SceneArgs {
    /// The camera of the site that is drawn.
    pub fn camera(&self) -> Result<Camera, WrongUsage> {
        Ok(if self.site()?.has_lamps() {
            self.rig.rig().pinhole(self.width)
        } else {
            camera_of_width(self.width)
        })
    }

    /// The site's mapping run, on a course if the site has a choice.
    pub fn mapping_run(&self, course: Option<Course>) -> Result<MappingRun, WrongUsage> {
        let site = self.site()?;
        if course.is_some() && !site.has_lamps() {
            return Err(WrongUsage(format!("--course: {ONLY_TOWER}")));
        }
        let course = course.unwrap_or(Course::Both);
        Ok(MappingRun { site, course, rig: self.rig.rig() })
    }

    /// The site that is named, or the one of the run that is.
    pub fn site(&self) -> Result<Site, WrongUsage> {
        let site = self.named_site()?;
        match self.rig.stated() {
            Some(option) if !site.has_lamps() => Err(WrongUsage(format!("{option}: {ONLY_TOWER}"))),
            _ => Ok(site),
        }
    }

    fn named_site(&self) -> Result<Site, WrongUsage> {
        match (self.site, self.run) {
            (Some(site), Some(run)) if run.site() != site => {
                let run = run.name();
                Err(WrongUsage(format!("--run {run}: it is not a run of that --site")))
            }
            (Some(site), _) => Ok(site),
            (None, Some(run)) => Ok(run.site()),
            (None, None) => Ok(Site::Basin),
        }
    }

    /// The dives to draw: of the run that is named, or of those that the demo shows of a site.
    pub fn dives(&self) -> Result<Vec<Dive>, WrongUsage> {
        let runs = match (self.run, self.site()?) {
            (Some(run), _) => vec![run],
            (None, Site::Basin) => vec![Run::T1, Run::T2],
            (None, Site::Quay) => vec![Run::T3],
            (None, Site::Row) => vec![Run::T6],
            (None, Site::Tower) => vec![Run::T7],
        };
        runs.into_iter().map(|run| self.dive(run)).collect()
    }

    fn dive(&self, run: Run) -> Result<Dive, WrongUsage> {
        let rig = self.rig.rig();
        let mut dive = Dive { number: self.dive, rate: self.rate, rig, ..Dive::of(run) };
        if let Some(weeks) = self.age {
            if run.weeks() == 0.0 {
                let what = "only the scene of T4 and T5 ages. Leave --age out";
                return Err(WrongUsage(format!("--run {}: {what}", run.name())));
            }
            dive.weeks = weeks;
        }
        Ok(dive)
    }
}

/// Draws a dive into a folder of its run's name.
pub fn draw_dive(out: &Path, camera: Camera, dive: Dive, frames: usize) -> anyhow::Result<()> {
    let name = dive.run.name();
    let bar = progress(frames, "drawing an inspection run");
    let drawn = nvsprior_basin::dive_by(camera, dive, frames, Conditions::CALM);
    nvsprior_basin::write_run(&out.join(name), name, camera, drawn, |_| bar.inc(1))?;
    bar.finish_and_clear();
    println!("the inspection run is in {}", out.join(name).display());
    Ok(())
}

/// Draws a mapping run into a folder of its name.
pub fn draw_mapping_run(out: &Path, camera: Camera, run: MappingRun) -> anyhow::Result<()> {
    let name = run.site.mapping_run_name();
    let folder = out.join(name);
    let run = nvsprior_basin::mapping_run_by(camera, run, Conditions::CALM);
    let bar = progress(run.len(), "drawing the mapping run");
    nvsprior_basin::write_run(&folder, name, camera, run, |_| bar.inc(1))?;
    bar.finish_and_clear();
    println!("the mapping run is in {}", folder.display());
    Ok(())
}

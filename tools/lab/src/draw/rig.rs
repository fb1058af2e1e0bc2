//! What the vehicle carries at the tower, and the course of its mapping run.

use nvsprior_basin::{Course, Lamps, Rig, RigCamera};
use nvsprior_inputs::values;

/// What the vehicle carries at the tower. Other sites have a light and a camera of their own.
#[derive(clap::Args)]
pub struct RigArgs {
    /// The tower's vehicle: how wide its lens sees, horizontally, 20 to 100; 33 if it is not there
    #[arg(long, value_name = "DEGREES", value_parser = values::field_of_view)]
    lens: Option<f64>,
    /// The tower's vehicle: which camera of its stereo pair takes the pictures; 1 if it is not there
    #[arg(long, value_name = "WHICH", value_enum)]
    camera: Option<CameraArg>,
    /// The tower's vehicle: which of its lamps are on; both if it is not there
    #[arg(long, value_name = "WHICH", value_enum)]
    lamps: Option<LampsArg>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CameraArg {
    #[value(name = "1")]
    First,
    /// 0.2 m to the right, with another response, gain and white balance
    #[value(name = "2")]
    Second,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum LampsArg {
    Both,
    Left,
    Right,
}

/// Course of the tower's mapping run.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum CourseArg {
    /// Along the line of sight, from 4.5 to 1.6 m
    Approach,
    /// About the tower, in three rows
    Arcs,
    Both,
}

impl RigArgs {
    /// The name of an option that is stated.
    pub fn stated(&self) -> Option<&'static str> {
        let stated = [
            ("--lens", self.lens.is_some()),
            ("--camera", self.camera.is_some()),
            ("--lamps", self.lamps.is_some()),
        ];
        stated.into_iter().find_map(|(name, there)| there.then_some(name))
    }

    pub fn rig(&self) -> Rig {
        let default = Rig::default();
        Rig {
            lens: self.lens.unwrap_or(default.lens),
            camera: match self.camera {
                None | Some(CameraArg::First) => RigCamera::First,
                Some(CameraArg::Second) => RigCamera::Second,
            },
            lamps: match self.lamps {
                None | Some(LampsArg::Both) => Lamps::Both,
                Some(LampsArg::Left) => Lamps::Left,
                Some(LampsArg::Right) => Lamps::Right,
            },
        }
    }
}

impl From<CourseArg> for Course {
    fn from(course: CourseArg) -> Course {
        match course {
            CourseArg::Approach => Course::Approach,
            CourseArg::Arcs => Course::Arcs,
            CourseArg::Both => Course::Both,
        }
    }
}

/// Said of options that other sites do not have.
pub const ONLY_TOWER: &str = "only --site tower has it, where the vehicle brings its own light";

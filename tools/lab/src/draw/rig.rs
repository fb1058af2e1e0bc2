//! What the vehicle carries at the tower.

use nvsprior_basin::{Lamps, Rig, RigCamera};
use nvsprior_inputs::values::{self, named};

/// What the vehicle carries at the tower. Other sites have a light and a camera of their own.
#[derive(clap::Args)]
pub struct RigArgs {
    /// The tower's vehicle: how wide its lens sees, horizontally, 20 to 100; 33 if it is not there
    #[arg(long, value_name = "DEGREES", value_parser = values::field_of_view)]
    lens: Option<f64>,
    /// The tower's vehicle: which camera of its stereo pair takes the pictures; 1 if it is not there. The second one is
    /// 0.2 m to the right, with another response, gain and white balance
    #[arg(long, value_name = "WHICH", value_parser = named(&CAMERAS))]
    camera: Option<RigCamera>,
    /// The tower's vehicle: which of its lamps are on; both if it is not there
    #[arg(long, value_name = "WHICH", value_parser = named(&LAMPS))]
    lamps: Option<Lamps>,
}

const CAMERAS: [(&str, RigCamera); 2] = [("1", RigCamera::First), ("2", RigCamera::Second)];
const LAMPS: [(&str, Lamps); 3] =
    [("both", Lamps::Both), ("left", Lamps::Left), ("right", Lamps::Right)];

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
            camera: self.camera.unwrap_or(RigCamera::First),
            lamps: self.lamps.unwrap_or(Lamps::Both),
        }
    }
}

/// Said of options that other sites do not have.
pub const ONLY_TOWER: &str = "only --site tower has it, where the vehicle brings its own light";

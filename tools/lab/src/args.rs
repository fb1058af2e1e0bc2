//! Arguments that several measurements share.

use glam::DVec3;
use nvsprior::render::Scene;
use nvsprior_inputs::args::numbers;
use nvsprior_paper::Optimizer;

/// The optimisers by their names.
pub const OPTIMIZERS: [(&str, Optimizer); 4] = [
    ("gauss-newton", Optimizer::GaussNewton),
    ("bfgs", Optimizer::Bfgs),
    ("adam", Optimizer::Adam),
    ("adam-bfgs", Optimizer::AdamBfgs),
];

/// A pose step as τ = (ρx, ρy, ρz, θx, θy, θz), angles in degrees on the command line.
#[derive(Clone, Copy)]
pub struct StepArg(pub [f64; 6]);

impl std::str::FromStr for StepArg {
    type Err = String;

    fn from_str(text: &str) -> Result<StepArg, String> {
        let values = numbers::<6>(text)?;
        Ok(StepArg(std::array::from_fn(|i| if i < 3 { values[i] } else { values[i].to_radians() })))
    }
}

/// Refuses a scene that lies far from the origin of its coordinates: the paper's packets state poses in 32 bits.
pub fn check_origin(scene: &Scene) -> anyhow::Result<()> {
    let is_near = scene.origin() == DVec3::ZERO;
    anyhow::ensure!(
        is_near,
        "the prior lies far from the origin of its coordinates, {}: the laboratory measures priors near to it",
        scene.origin()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_six_finite_numbers() {
        let step: StepArg = "0.08,-0.06,0.1,2,-2.5,180".parse().unwrap();
        assert_eq!(step.0[1], -0.06);
        assert_eq!(step.0[5], std::f64::consts::PI);
        assert!("1,2,3".parse::<StepArg>().is_err());
        assert!("1,2,3,4,5,nan".parse::<StepArg>().is_err());
        assert!("1,2,3,4,5,x".parse::<StepArg>().is_err());
    }
}

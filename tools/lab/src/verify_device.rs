//! `nvsprior verify-device`: whether a device draws final pictures to the same bytes as every other one.

mod compare;
mod scenes;

use std::process::ExitCode;

use anyhow::Context;
use compare::Comparison;
use nvsprior_inputs::args::{DeviceArgs, progress};
use scenes::{GOLDEN, Scene};

/// Tell whether a device draws the same bytes as every other one
///
/// Draws built-in random scenes, ordinary and extreme, and compares pictures, depths and transmittances with the host's
/// own, bit for bit. The host's are compared with committed check sums. Prints "portable", or the first stage that
/// differs with what went in and what came out.
///
/// Exit codes: 0 portable, 1 not portable or something failed, 2 wrong usage.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    /// Scenes to draw; each gives a picture at a pose and one at a packet's pose
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    scenes: u64,
}

/// Compares; the exit code says whether the device is portable.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let engine = args.device.open()?;
    check_host()?;
    let bar = progress(args.scenes as usize, "scenes");
    let mut pictures = 0;
    for seed in 0..args.scenes {
        let Some(scene) = Scene::of(seed) else { continue };
        match compare::compare(&engine, &scene).with_context(|| format!("scene {seed}"))? {
            Comparison::Same { pictures: count } => pictures += count,
            Comparison::Different(difference) => {
                bar.finish_and_clear();
                println!("NOT portable: {}", engine.device());
                println!("scene {seed}: {difference}");
                return Ok(ExitCode::FAILURE);
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    args.device.check(&engine)?;
    println!("portable: {pictures} pictures, no byte differs");
    Ok(ExitCode::SUCCESS)
}

/// Fails unless this host computes what every other host does.
fn check_host() -> anyhow::Result<()> {
    for (seed, expected) in GOLDEN.iter().enumerate() {
        let found = scenes::check_sum(seed as u64);
        anyhow::ensure!(
            found == *expected,
            "this host computes otherwise: scene {seed} has check sum {found:08x}, not {expected:08x}. \
             Report it with the name of the processor and of the compiler",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::compare::Difference;
    use super::*;

    #[test]
    fn the_host_draws_what_every_host_draws() {
        let found: Vec<String> = (0..GOLDEN.len() as u64)
            .map(|seed| format!("0x{:08x}", scenes::check_sum(seed)))
            .collect();
        let expected: Vec<String> = GOLDEN.iter().map(|sum| format!("0x{sum:08x}")).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_difference_names_its_stage() {
        let text =
            Difference::new("project", 7, "splat 3, z = 2", "0x3f800000", "0x3f800001").to_string();
        assert!(text.contains("stage project") && text.contains("splat 3"), "{text}");
    }
}

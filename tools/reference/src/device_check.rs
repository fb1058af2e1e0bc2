//! Whether a device draws final pictures to the same bytes as every other one: `nvsprior devices --check`.

mod compare;
mod scenes;

use anyhow::Context;
pub use compare::{Compared, Difference};
use nvsprior::Engine;
use scenes::{GOLDEN, Scene};
use serde::{Deserialize, Serialize};

/// How many pictures are the same, or the first that differs: what it is of, and how.
pub type Same = Result<u64, (String, Difference)>;

/// Compares built-in scenes as long as it may go on. Also returns how many were.
pub fn built_in(
    engine: &Engine,
    scenes: u64,
    goes_on: impl Fn() -> bool,
) -> anyhow::Result<(Same, u64)> {
    let (mut pictures, mut done) = (0, 0);
    while done < scenes && (done == 0 || goes_on()) {
        let seed = done;
        done += 1;
        if let Some(Scene { prior, camera, pose }) = Scene::of(seed) {
            let compared = Compared::new(engine, &prior).and_then(|c| c.compare(&camera, &pose));
            match compared.with_context(|| format!("scene {seed}"))? {
                Ok(count) => pictures += count,
                Err(difference) => return Ok((Err((format!("scene {seed}"), difference)), done)),
            }
        }
    }
    Ok((Ok(pictures), done))
}

/// What a comparison of a device with the host came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Whether no byte differs, and the host draws what every host draws.
    pub portable: bool,
    /// Scenes that were drawn.
    pub scenes: u64,
    /// Pictures of which no byte differs.
    pub pictures: u64,
    /// The first difference.
    pub difference: Option<String>,
    /// Check sums (CRC-32) of what the host draws of the first scenes.
    pub check_sums: Vec<String>,
}

/// Compares up to `scenes` built-in scenes, as long as it may go on; one at least.
pub fn verify(engine: &Engine, scenes: u64, goes_on: impl Fn() -> bool) -> anyhow::Result<Verdict> {
    let sums: Vec<u32> = (0..GOLDEN.len() as u64).map(scenes::check_sum).collect();
    let (compared, scenes) = built_in(engine, scenes, goes_on)?;
    let (pictures, difference) = match compared {
        Ok(pictures) => (pictures, check_sums(&sums).err().map(|error| error.to_string())),
        Err((of, difference)) => (0, Some(format!("{of}: {difference}"))),
    };
    let check_sums = sums.iter().map(|sum| format!("{sum:08x}")).collect();
    Ok(Verdict { portable: difference.is_none(), scenes, pictures, difference, check_sums })
}

/// Fails unless this host computes what every other host does.
pub fn check_host() -> anyhow::Result<()> {
    check_sums(&(0..GOLDEN.len() as u64).map(scenes::check_sum).collect::<Vec<_>>())
}

/// Fails unless these are the check sums of every host.
fn check_sums(sums: &[u32]) -> anyhow::Result<()> {
    for (seed, (found, expected)) in sums.iter().zip(GOLDEN).enumerate() {
        anyhow::ensure!(
            *found == expected,
            "this host computes other results: scene {seed} has check sum {found:08x}, not {expected:08x}. \
             Report it with the name of the processor and of the compiler",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
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
    fn a_host_that_computes_other_results_is_named() {
        let mut sums = GOLDEN.to_vec();
        assert!(check_sums(&sums).is_ok());
        sums[3] ^= 1;
        let error = check_sums(&sums).unwrap_err().to_string();
        assert!(error.starts_with("this host computes other results: scene 3 "), "{error}");
    }

    #[test]
    fn a_difference_names_its_stage() {
        let text =
            Difference::new("project", 7, "splat 3, z = 2", "0x3f800000", "0x3f800001").to_string();
        assert!(text.contains("stage project") && text.contains("splat 3"), "{text}");
    }
}

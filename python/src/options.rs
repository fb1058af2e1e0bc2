//! Options by their names.

use std::time::Duration;

use nvsprior::residual::Tune;
use nvsprior::{Mode, Rate, Structure};

use crate::errors::Failure;

/// What a name stands for.
fn named<T: Copy>(argument: &str, name: &str, known: &[(&str, T)]) -> Result<T, Failure> {
    let found = known.iter().find(|(known, _)| *known == name).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let names: Vec<_> = known.iter().map(|(name, _)| format!("{name:?}")).collect();
        Failure::argument(format!("{argument}: {name:?}, but there are {}", names.join(", ")))
    })
}

/// `None`: no difference picture is sent, or none of the numbers was given.
pub fn rate(
    quality: Option<f32>,
    psnr: Option<f64>,
    bytes: Option<usize>,
) -> Result<Option<Rate>, Failure> {
    let rate = match (quality, psnr, bytes) {
        (None, None, None) => return Ok(None),
        (Some(quality), None, None) => Rate::Quality(quality),
        (None, Some(psnr), None) => Rate::Psnr(psnr),
        (None, None, Some(bytes)) => Rate::Bytes(bytes),
        _ => return Err(Failure::argument("quality, psnr and bytes: give one of them")),
    };
    match rate {
        Rate::Quality(value) if !(0.0..=100.0).contains(&value) => {
            Err(Failure::argument(format!("quality: {value}, must lie in 0 to 100")))
        }
        Rate::Psnr(value) if !(value > 0.0 && value <= 100.0) => {
            Err(Failure::argument(format!("psnr: {value} dB, must be above 0 and at most 100")))
        }
        rate => Ok(Some(rate)),
    }
}

/// A time in milliseconds.
pub fn frame_time(milliseconds: f64) -> Result<Duration, Failure> {
    let time = Duration::try_from_secs_f64(milliseconds / 1e3);
    let time = time.ok().filter(|time| !time.is_zero());
    let wrong = format!("frame_time: {milliseconds} ms, must be finite and above 0");
    time.ok_or_else(|| Failure::argument(wrong))
}

pub fn mode(stream: Option<&str>, key_every: u32) -> Result<Mode, Failure> {
    let Some(name) = stream else { return Ok(Mode::Intra) };
    let structure = named(
        "stream",
        name,
        &[
            ("chain", Structure::Chain { key_every }),
            ("layers", Structure::Layers { key_every }),
            ("keys", Structure::Keys { key_every }),
            ("acknowledged", Structure::Acknowledged),
        ],
    )?;
    Ok(Mode::Stream(structure))
}

pub fn tune(name: &str) -> Result<Tune, Failure> {
    let known = [("psnr", Tune::Psnr), ("ssim", Tune::Ssim), ("detection", Tune::Detection)];
    named("tune", name, &known)
}

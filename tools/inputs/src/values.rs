//! Values of arguments, checked before work begins.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use clap::builder::{PossibleValuesParser, TypedValueParser};
pub use nvsprior_runs::{OutputError, check_file, make_folder};
use nvsprior_runs::{end_replacing, files_of};

/// Wrong usage that shows only after the arguments were parsed. The program exits with 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WrongUsage(pub String);

/// A value by its name. The names are what the help lists.
pub fn named<T>(all: &'static [(&'static str, T)]) -> impl TypedValueParser<Value = T>
where
    T: Clone + Send + Sync + 'static,
{
    let names = PossibleValuesParser::new(all.iter().map(|(name, _)| *name));
    names.try_map(move |text| {
        let found = all.iter().find(|(name, _)| *name == text);
        found.map(|(_, value)| value.clone()).ok_or("no such value")
    })
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "not a number".to_owned())
}

fn within(text: &str, low: f64, high: f64, range: &str) -> Result<f64, String> {
    let value = number(text)?;
    // So that NaN fails.
    if value >= low && value <= high { Ok(value) } else { Err(format!("must lie {range}")) }
}

/// A quality: 0 to 100.
pub fn quality(text: &str) -> Result<f32, String> {
    Ok(within(text, 0.0, 100.0, "between 0 and 100")? as f32)
}

/// A PSNR to reach, dB.
pub fn psnr(text: &str) -> Result<f64, String> {
    within(text, 1.0, 100.0, "between 1 and 100 dB")
}

/// A share of a whole.
pub fn share(text: &str) -> Result<f32, String> {
    Ok(mse(text)? as f32)
}

/// A positive number.
pub fn positive(text: &str) -> Result<f64, String> {
    match number(text)? {
        value if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("must be above 0".into()),
    }
}

/// A time above 0, milliseconds.
pub fn milliseconds(text: &str) -> Result<Duration, String> {
    /// An hour.
    const MOST: f64 = 3.6e6;
    match positive(text)? {
        value if value <= MOST => Ok(Duration::from_secs_f64(value / 1e3)),
        _ => Err("must be at most an hour".into()),
    }
}

/// A mean squared error of values in [0, 1].
pub fn mse(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1.0, "between 0 and 1")
}

/// An angle of a camera, degrees.
pub fn tilt(text: &str) -> Result<f64, String> {
    within(text, -180.0, 180.0, "between −180 and 180")
}

/// How wide a drawn camera sees, degrees.
pub fn field_of_view(text: &str) -> Result<f64, String> {
    within(text, 20.0, 100.0, "between 20 and 100 degrees")
}

/// A near plane: nothing of a scene lies beyond the upper end.
pub fn near(text: &str) -> Result<f32, String> {
    Ok(within(text, 1e-6, 1e6, "between 1e-6 and 1e6")? as f32)
}

pub fn focal(text: &str) -> Result<f32, String> {
    Ok(within(text, 1.0, 1e6, "between 1 and 1e6 pixels")? as f32)
}

pub fn alpha_max(text: &str) -> Result<f32, String> {
    Ok(within(text, 0.01, 0.9999, "between 0.01 and 0.9999")? as f32)
}

/// A finite number, not negative.
pub fn not_negative(text: &str) -> Result<f64, String> {
    match number(text)? {
        value if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("must be a finite number, not negative".into()),
    }
}

/// A number, and one behind a comma if that is stated; finite, not negative.
pub fn pair(text: &str) -> Result<(f64, Option<f64>), String> {
    match text.split_once(',') {
        Some((first, second)) => Ok((not_negative(first)?, Some(not_negative(second)?))),
        None => Ok((not_negative(text)?, None)),
    }
}

/// A part of a whole.
pub fn part(text: &str) -> Result<f64, String> {
    match number(text)? {
        value if value > 0.0 && value <= 1.0 => Ok(value),
        _ => Err("must lie above 0 and be at most 1".into()),
    }
}

/// Things per second: bits, frames.
pub fn rate(text: &str) -> Result<f64, String> {
    within(text, 0.01, 1e9, "between 0.01 and 1e9")
}

/// A time on a link, seconds.
pub fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.0, 3600.0, "between 0 and 3600 seconds")
}

/// A number of things: at most 100,000.
pub fn count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count <= 100_000 => Ok(count),
        _ => Err("must be a whole number from 0 to 100,000".into()),
    }
}

/// How many frames a run has per second.
pub fn frame_rate(text: &str) -> Result<f64, String> {
    within(text, 0.1, 1000.0, "between 0.1 and 1000 frames per second")
}

/// An age of a scene: up to ten years.
pub fn weeks(text: &str) -> Result<f32, String> {
    Ok(within(text, 0.0, 520.0, "between 0 and 520 weeks")? as f32)
}

/// A rectangle: left, top, width and height, pixels, with commas between them.
pub fn rectangle(text: &str) -> Result<[u32; 4], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or("must be four whole numbers: left,top,width,height".into())
}

pub fn png(text: &str) -> Result<PathBuf, String> {
    ends_with(text, "png")
}

/// A JSON file to write.
pub fn json(text: &str) -> Result<PathBuf, String> {
    ends_with(text, "json")
}

/// A CSV file to write.
pub fn csv(text: &str) -> Result<PathBuf, String> {
    ends_with(text, "csv")
}

fn ends_with(text: &str, ending: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let fits = path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending));
    if fits { Ok(path) } else { Err(format!("the file's name must end in .{ending}")) }
}

/// Files of a folder that end in `.ending`, in the order of their names; at least one. `what`: what they hold.
pub fn files(folder: &Path, ending: &str, what: &str) -> anyhow::Result<Vec<PathBuf>> {
    let reading = || format!("reading {}", folder.display());
    end_replacing(folder, ending).with_context(reading)?;
    let files = files_of(folder, ending).with_context(reading)?;
    anyhow::ensure!(!files.is_empty(), "{}: no {what} (*.{ending})", folder.display());
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_or_none_are_refused() {
        for text in ["nan", "-1", "inf", "1e30", "many", ""] {
            assert!(quality(text).is_err(), "{text}");
            assert!(psnr(text).is_err(), "{text}");
            assert!(mse(text).is_err(), "{text}");
            assert!(near(text).is_err(), "{text}");
            assert!(alpha_max(text).is_err(), "{text}");
            assert!(count(text).is_err(), "{text}");
        }
        assert!(not_negative("-0.1").is_err() && not_negative("nan").is_err());
        assert!(not_negative("inf").is_err());
        assert_eq!(quality("12.5"), Ok(12.5));
        assert_eq!(count("100000"), Ok(100_000));
        assert!(count("999999999999").is_err());
    }

    #[test]
    fn endings_tell_the_format() {
        assert!(png("a/b.PNG").is_ok() && png("a.jpg").is_err() && png("png").is_err());
        assert!(json("a.json").is_ok() && json("a").is_err());
    }

    #[test]
    fn outputs_are_tried_and_left_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.json");
        check_file("--summary", &file).unwrap();
        assert!(!file.exists());
        std::fs::write(&file, "kept").unwrap();
        check_file("--summary", &file).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"kept");
        assert!(matches!(check_file("--summary", folder.path()), Err(OutputError::Folder { .. })));
        let none = folder.path().join("none/a.json");
        assert!(matches!(check_file("--summary", &none), Err(OutputError::Write { .. })));
        assert!(matches!(make_folder("--packets", &file), Err(OutputError::File { .. })));
        make_folder("--packets", &folder.path().join("b/c")).unwrap();
    }
}

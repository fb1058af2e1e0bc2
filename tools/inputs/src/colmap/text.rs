//! The text form: a record each line, words with blanks between, lines with `#` are comments.

use std::str::FromStr;

use glam::DVec3;

use super::error::{ColmapFault, FilePosition, Wrong};
use super::model::{CameraRecord, ImageRecord, Model, point};
use crate::points::Point;

/// The words of a line that are not read yet.
#[derive(Clone, Copy)]
struct Line<'a> {
    at: FilePosition,
    rest: &'a str,
}

impl<'a> Line<'a> {
    fn word(&mut self, what: &'static str) -> Result<&'a str, Wrong> {
        let rest = self.rest.trim_start();
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        if word.is_empty() {
            return Err(Wrong::new(self.at, ColmapFault::Missing { what }));
        }
        Ok(word)
    }

    fn value<T: FromStr>(&mut self, what: &'static str) -> Result<T, Wrong> {
        let word = self.word(what)?;
        let wrong = |_| Wrong::new(self.at, ColmapFault::Word { what, found: word.to_owned() });
        word.parse().map_err(wrong)
    }

    fn floats<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N], Wrong> {
        let mut floats = [0.0; N];
        for float in &mut floats {
            *float = self.value(what)?;
        }
        Ok(floats)
    }

    /// Whether it has three numbers for each observation, or none: names of pictures have other words.
    fn is_observations(&self) -> bool {
        let mut words = self.rest.split_whitespace();
        self.count().is_multiple_of(3) && words.all(|word| word.parse::<f64>().is_ok())
    }

    /// How many words are left.
    fn count(&self) -> usize {
        self.rest.split_whitespace().count()
    }
}

/// The lines of a text, with comments and empty ones.
fn lines(bytes: &[u8]) -> Result<impl Iterator<Item = Line<'_>>, Wrong> {
    // Editors of Windows begin a text with a mark.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let before = &bytes[..error.valid_up_to()];
        let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
        Wrong::new(FilePosition::Line(line), ColmapFault::Text)
    })?;
    let numbered = text.lines().enumerate();
    Ok(numbered.map(|(i, line)| Line { at: FilePosition::Line(i + 1), rest: line.trim() }))
}

fn is_record(line: &Line) -> bool {
    !(line.rest.is_empty() || line.rest.starts_with('#'))
}

pub fn cameras(bytes: &[u8]) -> Result<Vec<CameraRecord>, Wrong> {
    let camera = |mut line: Line| {
        let at = line.at;
        let id = line.value("the camera's number")?;
        let model = line.word("the camera's model")?;
        let model = Model::named(model).map_err(|fault| Wrong::new(at, fault))?;
        let (width, height) = (line.value("the width")?, line.value("the height")?);
        let mut parameters = Vec::with_capacity(model.parameters);
        while line.count() > 0 {
            parameters.push(line.value("a camera's parameter")?);
        }
        Ok(CameraRecord { at, id, model, width, height, parameters })
    };
    lines(bytes)?.filter(is_record).map(camera).collect()
}

/// Two lines for each picture. The second, of its observations, may be empty, and is left out by some converters.
pub fn images(bytes: &[u8]) -> Result<Vec<ImageRecord>, Wrong> {
    let mut lines = lines(bytes)?.peekable();
    let mut images = Vec::new();
    while let Some(line) = lines.next() {
        if !is_record(&line) {
            continue;
        }
        images.push(image(line)?);
        match lines.peek() {
            Some(next) if next.is_observations() => drop(lines.next()),
            Some(next) if is_record(next) && image(*next).is_err() => {
                let fault = ColmapFault::Observations { count: next.count() };
                return Err(Wrong::new(next.at, fault));
            }
            _ => {}
        }
    }
    Ok(images)
}

fn image(mut line: Line) -> Result<ImageRecord, Wrong> {
    let at = line.at;
    line.value::<u32>("the picture's number")?;
    let (quaternion, translation) = (line.floats("the pose")?, line.floats("the pose")?);
    let camera = line.value("the camera's number")?;
    let name = line.rest.trim().to_owned();
    if name.is_empty() {
        return Err(Wrong::new(at, ColmapFault::Name));
    }
    Ok(ImageRecord { at, quaternion, translation, camera, name })
}

pub fn points(bytes: &[u8]) -> Result<Vec<Point>, Wrong> {
    let point = |mut line: Line| {
        line.value::<u64>("the point's number")?;
        let position = DVec3::from(line.floats::<3>("the position")?);
        let rgb = [line.value("red")?, line.value("green")?, line.value("blue")?];
        let error = line.value("the error")?;
        let track = line.count();
        if !track.is_multiple_of(2) {
            return Err(Wrong::new(line.at, ColmapFault::Missing { what: "half of a track" }));
        }
        point(line.at, position, rgb, error, track / 2)
    };
    lines(bytes)?.filter(is_record).map(point).collect()
}

//! Reads a stated course.

use std::collections::HashMap;
use std::path::Path;

use serde::Deserialize;

use super::{NavigationError, Stated};

/// What the rows of a course are found by.
#[derive(Clone, Debug, PartialEq)]
pub enum Key {
    /// The picture's name, with or without its folders and ending.
    File(HashMap<String, Stated>),
    /// Seconds in the video, in order.
    Time(Vec<(f64, Stated)>),
}

/// A course that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct StatedCourse {
    pub rows: Key,
}

/// Rows farther apart than this say nothing of what lies between them, seconds.
const GAP: f64 = 5.0;
/// How far beyond the first and the last row they still count, seconds.
const BEYOND: f64 = 0.5;

/// A row as the file has it.
#[derive(Clone, Debug, Deserialize)]
struct Row {
    file: Option<String>,
    time: Option<f64>,
    north: Option<f64>,
    east: Option<f64>,
    depth: Option<f64>,
    heading: Option<f64>,
    pitch: Option<f64>,
    roll: Option<f64>,
}

impl Row {
    fn stated(&self) -> Result<Stated, String> {
        let all =
            [self.north, self.east, self.depth, self.heading, self.pitch, self.roll, self.time];
        if let Some(value) = all.into_iter().flatten().find(|value| !value.is_finite()) {
            return Err(format!("{value} is not finite"));
        }
        let pair = |a: Option<f64>, b: Option<f64>, names: &str| match (a, b) {
            (Some(a), Some(b)) => Ok(Some([a, b])),
            (None, None) => Ok(None),
            _ => Err(format!("{names} go together")),
        };
        let angles = pair(self.pitch, self.roll, "pitch and roll")?;
        Ok(Stated {
            place: pair(self.north, self.east, "north and east")?,
            depth: self.depth,
            pitch_roll: angles.map(|angles| angles.map(f64::to_radians)),
            heading: self.heading.map(f64::to_radians),
        })
    }
}

/// Reads a course. Other columns are passed over; fields may be empty.
pub fn read(path: &Path) -> Result<StatedCourse, NavigationError> {
    let failed = |error| NavigationError::Csv { path: path.to_path_buf(), error };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(failed)?;
    let header = reader.headers().map_err(failed)?.clone();
    let has = |name: &str| header.iter().any(|column| column == name);
    let columns =
        |what: &str| NavigationError::Columns { path: path.to_path_buf(), what: what.into() };
    let by_file = match (has("file"), has("time")) {
        (true, _) => true,
        (false, true) => false,
        (false, false) => return Err(columns("there is neither `file` nor `time`")),
    };
    if !["north", "depth", "pitch"].iter().any(|name| has(name)) {
        return Err(columns("it states nothing"));
    }
    let (mut files, mut times) = (HashMap::new(), Vec::new());
    for (row, record) in reader.deserialize::<Row>().enumerate() {
        let record = record.map_err(failed)?;
        let wrong =
            |what: String| NavigationError::Row { path: path.to_path_buf(), row: row + 1, what };
        let stated = record.stated().map_err(wrong)?;
        match (by_file, record.file, record.time) {
            (true, Some(file), _) => {
                if files.insert(file.clone(), stated).is_some() {
                    return Err(wrong(format!("\"{file}\" stands there twice")));
                }
            }
            (false, _, Some(time)) => {
                if times.last().is_some_and(|(last, _)| *last >= time) {
                    return Err(wrong(format!("time {time} is not after the row before")));
                }
                times.push((time, stated));
            }
            _ => return Err(wrong("it names no picture".into())),
        }
    }
    Ok(StatedCourse { rows: if by_file { Key::File(files) } else { Key::Time(times) } })
}

impl StatedCourse {
    /// Whether pictures are found by their times.
    pub fn is_by_time(&self) -> bool {
        matches!(self.rows, Key::Time(_))
    }

    /// What is stated of a picture. `time`: in its video, seconds.
    pub fn of(&self, name: &str, time: Option<f64>) -> Option<Stated> {
        match &self.rows {
            Key::File(files) => {
                let path = Path::new(name);
                let whole = path.file_name().and_then(|name| name.to_str());
                let stem = path.file_stem().and_then(|name| name.to_str());
                let names = [Some(name), whole, stem];
                names.into_iter().flatten().find_map(|name| files.get(name)).copied()
            }
            Key::Time(rows) => at(rows, time?),
        }
    }
}

/// What is stated of a time, between the two rows about it.
fn at(rows: &[(f64, Stated)], time: f64) -> Option<Stated> {
    let after = rows.partition_point(|(other, _)| *other < time);
    let near = |i: usize| rows.get(i).filter(|(other, _)| (other - time).abs() <= BEYOND);
    match (after.checked_sub(1).and_then(|i| rows.get(i)), rows.get(after)) {
        (Some(a), Some(b)) if b.0 - a.0 <= GAP => {
            Some(between(&a.1, &b.1, (time - a.0) / (b.0 - a.0)))
        }
        _ => near(after).or_else(|| after.checked_sub(1).and_then(near)).map(|row| row.1),
    }
}

fn between(a: &Stated, b: &Stated, share: f64) -> Stated {
    let mix = |a: f64, b: f64| a + share * (b - a);
    // The shorter way around.
    let turn = |a: f64, b: f64| {
        let way = (b - a + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
        a + share * (way - std::f64::consts::PI)
    };
    let pair = |a: Option<[f64; 2]>, b: Option<[f64; 2]>, mix: &dyn Fn(f64, f64) -> f64| {
        a.zip(b).map(|(a, b)| [mix(a[0], b[0]), mix(a[1], b[1])])
    };
    Stated {
        place: pair(a.place, b.place, &mix),
        depth: a.depth.zip(b.depth).map(|(a, b)| mix(a, b)),
        pitch_roll: pair(a.pitch_roll, b.pitch_roll, &turn),
        heading: a.heading.zip(b.heading).map(|(a, b)| turn(a, b)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(text: &str) -> Result<StatedCourse, NavigationError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path())
    }

    #[test]
    fn pictures_are_found_by_name_and_by_time() {
        let named = course("file, depth, extra\na/1.jpg, 3.5, x\n2, , y\n").unwrap();
        assert_eq!(named.of("a/1.jpg", None).unwrap().depth, Some(3.5));
        assert_eq!(named.of("b/2.png", None).unwrap(), Stated::default());
        assert_eq!(named.of("3.png", None), None);
        let timed = course("time,north,east,depth,heading\n1,0,0,2,350\n2,4,8,3,10\n20,9,9,9,0\n");
        let timed = timed.unwrap();
        let middle = timed.of("x.png", Some(1.5)).unwrap();
        assert_eq!((middle.place, middle.depth), (Some([2.0, 4.0]), Some(2.5)));
        let heading = middle.heading.unwrap().to_degrees();
        assert!((heading - 360.0).abs() < 1e-9, "{heading}");
        assert_eq!(timed.of("x.png", Some(0.7)).unwrap().depth, Some(2.0));
        for nothing in [None, Some(0.4), Some(11.0), Some(30.0)] {
            assert_eq!(timed.of("x.png", nothing), None, "{nothing:?}");
        }
    }

    #[test]
    fn wrong_files_are_named_with_the_row() {
        for (text, said) in [
            ("a,b\n1,2\n", "neither `file` nor `time`"),
            ("time,speed\n1,2\n", "states nothing"),
            ("time,north\n1,2\n", "row 1: north and east go together"),
            ("time,depth\n1,2\n1,3\n", "row 2: time 1 is not after"),
            ("file,depth\na,1\na,2\n", "row 2: \"a\" stands there twice"),
            ("file,depth\na,x\n", "line: 2"),
            ("file,depth\na,inf\n", "row 1: inf is not finite"),
            ("time,depth\n,2\n", "row 1: it names no picture"),
        ] {
            let error = course(text).unwrap_err().to_string();
            assert!(error.contains(said), "{text}: {error}");
        }
    }
}

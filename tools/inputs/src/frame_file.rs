//! Pictures on disk, and what is known of them from outside.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use image::imageops::FilterType;
use image::{DynamicImage, ImageFormat, RgbImage};
use nvsprior::{FrameInfo, Hint, Picture, Pose};

use crate::jpeg::{self, JpegError};

/// Why a file of pictures or poses cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FrameFileError {
    #[error("{}: {error}", path.display())]
    Image { path: PathBuf, error: image::ImageError },
    #[error("{}: not a picture of a kind that is read here: PNG, JPEG, WebP", path.display())]
    NoPicture { path: PathBuf },
    #[error("{}: {error}", path.display())]
    Jpeg { path: PathBuf, error: JpegError },
    #[error("{}: parts of it are transparent. Frames are encoded whole: put it on a ground, or save it without alpha",
        path.display())]
    Transparent { path: PathBuf },
    #[error("{}: {error}", path.display())]
    Csv { path: PathBuf, error: csv::Error },
    #[error("{}: {}×{} is of another shape than the camera's {}×{}; resizing would distort it",
        path.display(), found.0, found.1, expected.0, expected.1)]
    Shape { path: PathBuf, found: (u32, u32), expected: (u32, u32) },
    #[error("{}: {}×{}, but a picture of {}×{} is needed",
        path.display(), found.0, found.1, expected.0, expected.1)]
    Size { path: PathBuf, found: (u32, u32), expected: (u32, u32) },
    #[error("{}: column \"{column}\" is missing; the header must name {key},{}",
        path.display(), POSE.join(","))]
    Column { path: PathBuf, key: &'static str, column: &'static str },
    #[error("{}: the columns {} must be there all or not at all", path.display(), DEVIATION.join(","))]
    Deviation { path: PathBuf },
    #[error("{}: row {row}: {what}", path.display())]
    Row { path: PathBuf, row: usize, what: String },
}

/// Endings of the names of pictures.
pub(crate) const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// How far the ratio of the sides may be off, since sizes are rounded to whole pixels.
const SHAPE_TOLERANCE: f64 = 0.01;

/// Reads a PNG, JPEG or WebP. Resizes it (Lanczos, 3 lobes) if it has another size of the same
/// shape. Grey becomes RGB, 16 bits become 8. It may have no transparent pixels.
pub fn read_frame(path: &Path, width: u32, height: u32) -> Result<Picture, FrameFileError> {
    let picture = open_opaque(path)?;
    let (found, expected) = (picture.dimensions(), (width, height));
    let picture = if found == expected {
        picture
    } else if same_shape(found, expected) {
        image::imageops::resize(&picture, width, height, FilterType::Lanczos3)
    } else {
        return Err(FrameFileError::Shape { path: path.to_path_buf(), found, expected });
    };
    Ok(Picture { width, height, data: picture.into_raw() })
}

/// Reads a PNG, JPEG or WebP that must have this size.
pub fn read_picture(path: &Path, width: u32, height: u32) -> Result<Picture, FrameFileError> {
    let picture = open_opaque(path)?;
    let (found, expected) = (picture.dimensions(), (width, height));
    if found != expected {
        return Err(FrameFileError::Size { path: path.to_path_buf(), found, expected });
    }
    Ok(Picture { width, height, data: picture.into_raw() })
}

/// Finds out whether a file is there and begins as a picture does; it is not read.
pub fn check_picture(path: &Path) -> Result<(), FrameFileError> {
    let failed = |error: std::io::Error| FrameFileError::Image {
        path: path.to_path_buf(),
        error: error.into(),
    };
    let mut start = [0; 16];
    let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut start));
    let start = &start[..read.map_err(failed)?];
    match image::guess_format(start) {
        Ok(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP) => Ok(()),
        _ => Err(FrameFileError::NoPicture { path: path.to_path_buf() }),
    }
}

/// Reads a PNG, JPEG or WebP, told by its content, of which nothing may be missing.
pub(crate) fn open_image(path: &Path) -> Result<DynamicImage, FrameFileError> {
    let failed = |error| FrameFileError::Image { path: path.to_path_buf(), error };
    let bytes = std::fs::read(path).map_err(|error| failed(error.into()))?;
    let format = image::guess_format(&bytes).map_err(failed)?;
    if format == ImageFormat::Jpeg {
        let broken = |error| FrameFileError::Jpeg { path: path.to_path_buf(), error };
        jpeg::check(&bytes).map_err(broken)?;
    }
    image::load_from_memory_with_format(&bytes, format).map_err(failed)
}

fn open_opaque(path: &Path) -> Result<RgbImage, FrameFileError> {
    let picture = open_image(path)?;
    match alpha(&picture) {
        Some(_) => Err(FrameFileError::Transparent { path: path.to_path_buf() }),
        None => Ok(picture.into_rgb8()),
    }
}

/// Reads a picture whole. Whether none of it is transparent.
pub fn is_opaque(path: &Path) -> Result<bool, FrameFileError> {
    Ok(alpha(&open_image(path)?).is_none())
}

/// The alpha of a picture's pixels, in rows, if any of it is transparent.
pub(crate) fn alpha(picture: &DynamicImage) -> Option<Vec<u8>> {
    if !picture.color().has_alpha() {
        return None;
    }
    let alpha: Vec<u8> = picture.to_rgba8().pixels().map(|pixel| pixel.0[3]).collect();
    alpha.iter().any(|alpha| *alpha < u8::MAX).then_some(alpha)
}

/// Whether sizes have the same shape. Rounding to whole pixels does not count.
pub(crate) fn same_shape(a: (u32, u32), b: (u32, u32)) -> bool {
    let ratio = |(width, height): (u32, u32)| f64::from(width) / f64::from(height);
    (ratio(a) / ratio(b) - 1.0).abs() <= SHAPE_TOLERANCE
}

/// The column that names a frame: by its file.
pub(crate) const FILE: &str = "file";
pub(crate) const POSE: [&str; 7] = ["qw", "qx", "qy", "qz", "tx", "ty", "tz"];
/// Standard deviations of a pose, those of a left step: ρ in the prior's unit, θ in degrees.
pub(crate) const DEVIATION: [&str; 6] = ["srx", "sry", "srz", "sax", "say", "saz"];

/// The places of a CSV file's columns.
struct Columns {
    key: usize,
    pose: [usize; 7],
    time: Option<usize>,
    age: Option<usize>,
    deviation: Option<[usize; 6]>,
}

impl Columns {
    /// `key`: the column that names a frame.
    fn of(
        header: &csv::StringRecord,
        key: &'static str,
        path: &Path,
    ) -> Result<Columns, FrameFileError> {
        let at = |column: &str| header.iter().position(|name| name == column);
        let place = |column: &'static str| {
            let missing = || FrameFileError::Column { path: path.to_path_buf(), key, column };
            at(column).ok_or_else(missing)
        };
        let mut pose = [0; 7];
        for (to, column) in pose.iter_mut().zip(POSE) {
            *to = place(column)?;
        }
        let found = DEVIATION.map(at);
        let deviation = match found.iter().flatten().count() {
            0 => None,
            6 => Some(found.map(Option::unwrap_or_default)),
            _ => return Err(FrameFileError::Deviation { path: path.to_path_buf() }),
        };
        Ok(Columns { key: place(key)?, pose, time: at("time"), age: at("age"), deviation })
    }

    /// What a row states; what is wrong with it.
    fn known(&self, record: &csv::StringRecord) -> Result<FrameInfo, String> {
        let at = |i: usize| record.get(i).unwrap_or_default();
        let any = |i: usize, name: &str| at(i).parse::<f64>().map_err(|e| format!("{name}: {e}"));
        let number = |i: usize, name: &str| {
            let number = any(i, name)?;
            let finite = number.is_finite();
            finite.then_some(number).ok_or_else(|| format!("{name}: {number} is not finite"))
        };
        let optional = |i: Option<usize>, name: &str| {
            i.filter(|i| !at(*i).is_empty()).map(|i| number(i, name)).transpose()
        };
        let pose = |i: usize| number(self.pose[i], POSE[i]);
        let (q, t) = ([pose(0)?, pose(1)?, pose(2)?, pose(3)?], [pose(4)?, pose(5)?, pose(6)?]);
        let pose = Pose::from_wxyz(q, t).ok_or("no pose")?;
        let mut hint = Hint::of(pose);
        if let Some(columns) = self.deviation.filter(|c| c.iter().any(|i| !at(*i).is_empty())) {
            let mut deviation = [0.0; 6];
            for (i, value) in deviation.iter_mut().enumerate() {
                let unit = if i < 3 { 1.0 } else { 1f64.to_radians() };
                *value = any(columns[i], DEVIATION[i])? * unit;
            }
            let hinted = Hint::with_deviation(pose, &deviation);
            hint = hinted.ok_or("a standard deviation is negative, too large, or no number")?;
        }
        hint.age = optional(self.age, "age")?.unwrap_or(0.0);
        if hint.age < 0.0 {
            return Err(format!("age: {} is negative", hint.age));
        }
        Ok(FrameInfo { hint: Some(hint), time: optional(self.time, "time")? })
    }
}

/// Reads what is known of frames, by file name, from a CSV file with a header: poses
/// (world-to-camera) and optional columns for the frame's time, the pose's age (seconds) and its
/// standard deviations. Fields of optional columns may be empty. Columns may have any order.
pub fn read_known(path: &Path) -> Result<HashMap<String, FrameInfo>, FrameFileError> {
    read_known_by(FILE, path)
}

/// As [`read_known`]; `key` is the column that names the frames.
pub fn read_known_by(
    key: &'static str,
    path: &Path,
) -> Result<HashMap<String, FrameInfo>, FrameFileError> {
    let failed = |error| FrameFileError::Csv { path: path.to_path_buf(), error };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(failed)?;
    let columns = Columns::of(reader.headers().map_err(failed)?, key, path)?;
    let mut frames = HashMap::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(failed)?;
        let file = record.get(columns.key).unwrap_or_default();
        let wrong = |what| FrameFileError::Row { path: path.to_path_buf(), row: row + 1, what };
        let known = columns.known(&record).map_err(wrong)?;
        if frames.insert(file.to_owned(), known).is_some() {
            return Err(wrong(format!("\"{file}\" stands there twice")));
        }
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use nvsprior_runs::write_png;

    use super::*;

    #[test]
    fn pictures_round_trip_and_resize() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = Picture::from_rgb(4, 2, (0..24).collect()).unwrap();
        write_png(&path, &picture).unwrap();
        assert_eq!(read_frame(&path, 4, 2).unwrap(), picture);
        assert_eq!(read_frame(&path, 2, 1).unwrap().data.len(), 6);
        let error = read_frame(&path, 2, 2).unwrap_err();
        assert!(matches!(error, FrameFileError::Shape { found: (4, 2), expected: (2, 2), .. }));
        let grey = image::GrayImage::from_pixel(3, 3, image::Luma([7]));
        grey.save(&path).unwrap();
        assert_eq!(read_frame(&path, 3, 3).unwrap().data, vec![7; 27]);
        check_picture(&path).unwrap();
        std::fs::write(&path, b"no picture").unwrap();
        assert!(matches!(check_picture(&path), Err(FrameFileError::NoPicture { .. })));
        assert!(check_picture(&folder.path().join("none.png")).is_err());
        assert!(read_frame(&path, 3, 3).unwrap_err().to_string().contains("a.png"));
    }

    #[test]
    fn poses_come_by_name_in_any_column_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.csv");
        std::fs::write(&path, "tx,ty,tz,qw,qx,qy,qz,file\n1,2,3, 1,0,0,0, a.png\n").unwrap();
        let known = read_known(&path).unwrap()["a.png"];
        assert_eq!(known.hint.unwrap().pose.translation.z, 3.0);
        assert_eq!(known, known.hint.map(|hint| hint.pose).into(), "and nothing else");
        let row = "a,1,0,0,0,1,2,3\n";
        std::fs::write(&path, format!("file,qw,qx,qy,qz,tx,ty,tz\n{row}{row}")).unwrap();
        assert!(read_known(&path).unwrap_err().to_string().contains("row 2: \"a\""));
        std::fs::write(&path, "file,qw\n").unwrap();
        assert!(read_known(&path).unwrap_err().to_string().contains("\"qx\""));
        std::fs::write(&path, "file,qw,qx,qy,qz,tx,ty,tz\na,0,0,0,0,1,2,3\n").unwrap();
        assert!(read_known(&path).unwrap_err().to_string().contains("row 1"));
        std::fs::write(&path, "file,qw,qx,qy,qz,tx,ty,tz\na,1,0,0,0,1,2,x\n").unwrap();
        assert!(read_known(&path).unwrap_err().to_string().contains("tz"));
    }
    #[test]
    fn time_age_and_deviation_are_optional_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_known(&path)
        };
        let pose = "file,qw,qx,qy,qz,tx,ty,tz";
        let all = format!("time,age,{pose},saz,say,sax,srz,sry,srx\n");
        let known = read(&format!(
            "{all}7.5,0.25,a,1,0,0,0,1,2,3,180,90,0,3,2,1\n,,b,1,0,0,0,1,2,3,,,,,,\n"
        ))
        .unwrap();
        let a = known["a"];
        let hint = a.hint.unwrap();
        assert_eq!((a.time, hint.age), (Some(7.5), 0.25));
        let expected = [1.0, 2.0, 3.0, 0.0, std::f64::consts::FRAC_PI_2, std::f64::consts::PI];
        let found = hint.deviation().unwrap();
        assert!(expected.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        assert_eq!(known["b"], hint.pose.into());
        for (text, named) in [
            (format!("{pose},srx\na,1,0,0,0,1,2,3,1\n"), "srx,sry,srz,sax,say,saz"),
            (format!("{all}1,1,a,1,0,0,0,1,2,3,1,,1,1,1,1\n"), "row 1: say"),
            (format!("{all}1,1,a,1,0,0,0,1,2,3,1,1,1,1,1,-1\n"), "row 1: a standard deviation"),
            (format!("{all}1,-1,a,1,0,0,0,1,2,3,,,,,,\n"), "row 1: age"),
            (format!("{all}inf,1,a,1,0,0,0,1,2,3,,,,,,\n"), "row 1: time"),
            (format!("{all}noon,1,a,1,0,0,0,1,2,3,,,,,,\n"), "row 1: time"),
        ] {
            let error = read(&text).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}

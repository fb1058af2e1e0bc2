//! Pictures and start poses on disk.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use image::imageops::FilterType;
use nvsprior::{Picture, Pose};

/// Why a file of pictures or poses cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FrameFileError {
    #[error("{}: {error}", path.display())]
    Image { path: PathBuf, error: image::ImageError },
    #[error("{}: {error}", path.display())]
    Csv { path: PathBuf, error: csv::Error },
    #[error("{}: {}×{} is of another shape than the camera's {}×{}; resizing would distort it",
        path.display(), found.0, found.1, expected.0, expected.1)]
    Shape { path: PathBuf, found: (u32, u32), expected: (u32, u32) },
    #[error("{}: column \"{column}\" is missing; the header must name {}",
        path.display(), COLUMNS.join(","))]
    Column { path: PathBuf, column: &'static str },
    #[error("{}: row {row}: {what}", path.display())]
    Row { path: PathBuf, row: usize, what: String },
}

/// How far the ratio of the sides may be off, for sizes that were rounded to whole pixels.
const SHAPE_TOLERANCE: f64 = 0.01;

/// Reads a PNG, JPEG or WebP, resized (Lanczos, 3 lobes) where its size is another of the same
/// shape. Alpha is dropped, grey becomes RGB, 16 bits become 8.
pub fn read_frame(path: &Path, width: u32, height: u32) -> Result<Picture, FrameFileError> {
    let failed = |error| FrameFileError::Image { path: path.to_path_buf(), error };
    let reader = image::ImageReader::open(path).map_err(|e| failed(e.into()))?;
    let reader = reader.with_guessed_format().map_err(|e| failed(e.into()))?;
    let picture = reader.decode().map_err(failed)?.to_rgb8();
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

fn same_shape(a: (u32, u32), b: (u32, u32)) -> bool {
    let ratio = |(width, height): (u32, u32)| f64::from(width) / f64::from(height);
    (ratio(a) / ratio(b) - 1.0).abs() <= SHAPE_TOLERANCE
}

/// Writes a PNG.
pub fn write_png(path: &Path, picture: &Picture) -> Result<(), FrameFileError> {
    let Picture { width, height, data } = picture;
    let format = image::ImageFormat::Png;
    image::save_buffer_with_format(path, data, *width, *height, image::ColorType::Rgb8, format)
        .map_err(|error| FrameFileError::Image { path: path.to_path_buf(), error })
}

const COLUMNS: [&str; 8] = ["file", "qw", "qx", "qy", "qz", "tx", "ty", "tz"];

/// Reads start poses (world-to-camera) by file name from a CSV file with a header; columns in any
/// order.
pub fn read_poses(path: &Path) -> Result<HashMap<String, Pose>, FrameFileError> {
    let failed = |error| FrameFileError::Csv { path: path.to_path_buf(), error };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(failed)?;
    let header = reader.headers().map_err(failed)?.clone();
    let mut columns = [0; 8];
    for (at, column) in columns.iter_mut().zip(COLUMNS) {
        *at = header
            .iter()
            .position(|name| name == column)
            .ok_or(FrameFileError::Column { path: path.to_path_buf(), column })?;
    }
    let mut poses = HashMap::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(failed)?;
        let field = |i: usize| record.get(columns[i]).unwrap_or_default();
        let number = |i: usize| field(i).parse::<f64>().map_err(|e| format!("{}: {e}", COLUMNS[i]));
        let pose = || {
            let q = [number(1)?, number(2)?, number(3)?, number(4)?];
            let t = [number(5)?, number(6)?, number(7)?];
            Pose::from_wxyz(q, t).ok_or_else(|| "no pose".to_owned())
        };
        let wrong = |what| FrameFileError::Row { path: path.to_path_buf(), row: row + 1, what };
        if poses.insert(field(0).to_owned(), pose().map_err(wrong)?).is_some() {
            return Err(wrong(format!("\"{}\" stands there twice", field(0))));
        }
    }
    Ok(poses)
}

#[cfg(test)]
mod tests {
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
        std::fs::write(&path, b"no picture").unwrap();
        assert!(read_frame(&path, 3, 3).unwrap_err().to_string().contains("a.png"));
    }

    #[test]
    fn poses_come_by_name_in_any_column_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.csv");
        std::fs::write(&path, "tx,ty,tz,qw,qx,qy,qz,file\n1,2,3, 1,0,0,0, a.png\n").unwrap();
        assert_eq!(read_poses(&path).unwrap()["a.png"].translation.z, 3.0);
        let row = "a,1,0,0,0,1,2,3\n";
        std::fs::write(&path, format!("file,qw,qx,qy,qz,tx,ty,tz\n{row}{row}")).unwrap();
        assert!(read_poses(&path).unwrap_err().to_string().contains("row 2: \"a\""));
        std::fs::write(&path, "file,qw\n").unwrap();
        assert!(read_poses(&path).unwrap_err().to_string().contains("\"qx\""));
        std::fs::write(&path, "file,qw,qx,qy,qz,tx,ty,tz\na,0,0,0,0,1,2,3\n").unwrap();
        assert!(read_poses(&path).unwrap_err().to_string().contains("row 1"));
        std::fs::write(&path, "file,qw,qx,qy,qz,tx,ty,tz\na,1,0,0,0,1,2,x\n").unwrap();
        assert!(read_poses(&path).unwrap_err().to_string().contains("tz"));
    }
}

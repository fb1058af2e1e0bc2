//! The track of a dive as a CSV file: the poses of its frames, in the columns that `--starts` reads.

use std::fs::File;
use std::path::{Path, PathBuf};

use nvsprior::Pose;
use nvsprior::packet::KnownPose;

use crate::frame_file::{DEVIATION, FILE, FrameFileError, POSE};

/// What is written beside a frame's pose.
#[derive(Clone, Copy, Debug)]
pub enum TrackPoint {
    /// Standard deviations along the camera's axes (the prior's unit) and about them (radians), infinite along open
    /// axes.
    Deviation([f64; 6]),
    /// Within how much a packet says that the position is known, if it does.
    Known(Option<KnownPose>),
}

/// Writes a track, row by row.
pub struct TrackFile {
    path: PathBuf,
    writer: csv::Writer<File>,
}

/// Columns of what a packet says: greatest standard deviations along an axis (the prior's unit), and about one
/// (degrees).
const KNOWN: [&str; 2] = ["known", "known_angle"];

impl TrackFile {
    /// Begins a track with deviations, as the vehicle knows them.
    pub fn of_vehicle(path: &Path) -> Result<TrackFile, FrameFileError> {
        TrackFile::begin(path, &DEVIATION)
    }

    /// Begins a track as packets tell it.
    pub fn of_packets(path: &Path) -> Result<TrackFile, FrameFileError> {
        TrackFile::begin(path, &KNOWN)
    }

    fn begin(path: &Path, last: &[&str]) -> Result<TrackFile, FrameFileError> {
        let path = path.to_path_buf();
        let failed = |error| FrameFileError::Csv { path: path.clone(), error };
        let mut writer = csv::Writer::from_path(&path).map_err(failed)?;
        let header = [FILE, "time"].into_iter().chain(POSE).chain(last.iter().copied());
        writer.write_record(header).map_err(failed)?;
        Ok(TrackFile { path, writer })
    }

    /// Writes a frame's row. A row that was written stays if the work ends early.
    pub fn write(
        &mut self,
        file: &str,
        time: Option<f64>,
        pose: &Pose,
        point: TrackPoint,
    ) -> Result<(), FrameFileError> {
        let (q, t) = (pose.rotation, pose.translation);
        let pose = [q.w, q.x, q.y, q.z, t.x, t.y, t.z].map(|v| v.to_string());
        let last: Vec<String> = match point {
            TrackPoint::Deviation(deviation) => {
                let in_degrees = |(i, v): (usize, f64)| if i < 3 { v } else { v.to_degrees() };
                deviation.into_iter().enumerate().map(in_degrees).map(|v| v.to_string()).collect()
            }
            TrackPoint::Known(Some(known)) => {
                [known.position, known.rotation.to_degrees()].map(|v| v.to_string()).into()
            }
            TrackPoint::Known(None) => vec![String::new(); KNOWN.len()],
        };
        let time = time.map_or(String::new(), |time| time.to_string());
        let row = [file.to_owned(), time].into_iter().chain(pose).chain(last);
        let failed = |error| FrameFileError::Csv { path: self.path.clone(), error };
        self.writer.write_record(row).map_err(failed)?;
        self.writer.flush().map_err(|error| failed(error.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame_file::read_known;

    #[test]
    fn what_is_written_is_read_as_starts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("track.csv");
        let pose = Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.25, -3.5, 1e-9]).unwrap();
        let open = [0.01, f64::INFINITY, 0.02, 0.001, 0.002, f64::INFINITY];
        let mut track = TrackFile::of_vehicle(&path).unwrap();
        track.write("a, b.png", Some(12.25), &pose, TrackPoint::Deviation(open)).unwrap();
        track.write("c.png", None, &pose, TrackPoint::Deviation([f64::INFINITY; 6])).unwrap();
        let known = read_known(&path).unwrap();
        let hint = known["a, b.png"].hint.unwrap();
        assert_eq!((known["a, b.png"].time, known["c.png"].time), (Some(12.25), None));
        assert!(hint.pose.angle_to(&pose) < 1e-12 && hint.pose.translation == pose.translation);
        let read = hint.deviation().unwrap();
        assert!(std::iter::zip(read, open).all(|(a, b)| a == b || (a - b).abs() < 1e-12));
        let nothing = known["c.png"].hint.unwrap().deviation().unwrap();
        assert_eq!(nothing, [f64::INFINITY; 6]);

        let mut track = TrackFile::of_packets(&path).unwrap();
        let bound = KnownPose { position: 0.05, rotation: 0.01 };
        track.write("0001", None, &pose, TrackPoint::Known(Some(bound))).unwrap();
        track.write("0002", None, &pose, TrackPoint::Known(None)).unwrap();
        let known = read_known(&path).unwrap();
        assert!(known["0001"].hint.unwrap().covariance.is_none(), "packets state no deviations");
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(",0.05,0.57") && text.trim_end().ends_with(",,"), "{text}");
    }
}

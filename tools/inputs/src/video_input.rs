//! The frames of a video as those of a run: undistorted, at the size that they are encoded at, with their times.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::geometry::Lens;
use nvsprior::image::Converter;
use nvsprior::{Camera, FrameInfo, Picture};

use crate::frame_file::{FrameFileError, read_known_by, same_shape};
use crate::input::{Input, InputArgs, starts_file};
use crate::posed::lens_of;
use crate::values::{self, WrongUsage};
use crate::video::{DecoderChoice, FrameSize, Video, VideoFrame, VideoReader};

/// Which video, and which of its frames.
#[derive(clap::Args)]
pub struct VideoInputArgs {
    /// Take the frames from a video (GStreamer or FFmpeg decodes it), undistorted and reduced. --cameras then tells the
    /// lens only, and may be the folder of a COLMAP model, such as OUT.colmap; without it the lens is the one that the
    /// prior states. Frames are named by their number in the
    /// video, as 000123; --starts is `none`, or a CSV file with these names, or without a column `file` and with times
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Take at most so many frames per second of the video [default: all]
    #[arg(long, value_name = "FPS", requires = "video", value_parser = values::frame_rate)]
    fps: Option<f64>,
    /// The program that decodes the video
    #[arg(long, value_name = "WHICH", requires = "video", default_value = "auto")]
    decoder: DecoderChoice,
}

impl VideoInputArgs {
    /// The video's frames, if one was given. `lens`: of the prior, which counts if there is no camera file.
    pub fn frames(
        &self,
        input: &InputArgs,
        lens: impl FnOnce() -> anyhow::Result<Lens>,
    ) -> anyhow::Result<Option<VideoFrames>> {
        let Some(path) = &self.video else { return Ok(None) };
        if input.starts == "camera-file" {
            let what =
                "the camera file has no poses of a video's frames; give `none` or a CSV file";
            return Err(WrongUsage(format!("--starts camera-file: {what}")).into());
        }
        let known = starts_file(&input.starts).map(|path| Known::read(input, path)).transpose()?;
        let (lens, of) = match &input.cameras {
            Some(cameras) => {
                (lens_of(cameras, input.split.as_deref())?, cameras.display().to_string())
            }
            None => (lens()?, "the prior's lens".into()),
        };
        let video = Video::open(path, self.decoder)?;
        tell!("{}", video.command);
        for note in &video.notes {
            tell!("{}: {note}", video.name());
        }
        let lens = lens_for(&lens, &video)?;
        let camera = input.size.reduced(&lens.pinhole());
        camera.check().with_context(|| of.clone())?;
        let converter = Converter::undistorting(&lens, &camera).with_context(|| of.clone())?;
        let reader = video.read(FrameSize::Full)?;
        let every = self.fps.map_or(0.0, |fps| 1.0 / fps);
        let (known, most) = (known.unwrap_or_default(), input.limit.unwrap_or(usize::MAX));
        let taken = Taken { every, due: None };
        Ok(Some(VideoFrames { video, reader, converter, camera, known, taken, most, last: 0.0 }))
    }
}

/// The lens at the size of the video's frames.
fn lens_for(lens: &Lens, video: &Video) -> anyhow::Result<Lens> {
    let (found, expected) = ((video.header.width, video.header.height), lens.size());
    if found == expected {
        return Ok(*lens);
    }
    if !same_shape(found, expected) {
        return Err(FrameFileError::Shape { path: video.path.clone(), found, expected }.into());
    }
    lens.resized(found.0, found.1).with_context(|| video.name())
}

/// The frames of a video, one after the other.
pub struct VideoFrames {
    video: Video,
    reader: VideoReader,
    converter: Converter,
    camera: Camera,
    known: Known,
    taken: Taken,
    /// Frames that are still wanted.
    most: usize,
    /// The time of the last frame that was read.
    last: f64,
}

/// What is known of frames from outside.
enum Known {
    Names(HashMap<String, FrameInfo>),
    /// By their times, in order.
    Times(Vec<(f64, FrameInfo)>),
}

impl Default for Known {
    fn default() -> Known {
        Known::Times(Vec::new())
    }
}

impl Known {
    /// Reads a CSV file of starts. Without a column of names its times count.
    fn read(input: &InputArgs, path: &Path) -> anyhow::Result<Known> {
        let nameless = |error: &anyhow::Error| {
            let column = error.downcast_ref::<FrameFileError>();
            matches!(column, Some(FrameFileError::Column { column: "file", .. }))
        };
        match input.read_starts(path) {
            Err(error) if nameless(&error) => {}
            names => return Ok(Known::Names(names?)),
        }
        let rows = read_known_by("time", path)?.into_values();
        let mut rows: Vec<_> = rows.filter_map(|known| Some((known.time?, known))).collect();
        rows.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        Ok(Known::Times(rows))
    }

    /// Of a frame by its name, or by its time: the last pose before it, if that is not too old.
    fn of(&self, name: &str, time: f64) -> FrameInfo {
        /// Seconds.
        const TOO_OLD: f64 = 5.0;
        let rows = match self {
            Known::Names(names) => return names.get(name).copied().unwrap_or_default(),
            Known::Times(rows) => rows,
        };
        let before = rows.partition_point(|(at, _)| *at <= time + CLOSE);
        let Some((at, mut known)) = before.checked_sub(1).map(|last| rows[last]) else {
            return FrameInfo::default();
        };
        let older = (time - at).max(0.0);
        known.hint = known.hint.filter(|_| older <= TOO_OLD);
        if let Some(hint) = &mut known.hint {
            hint.age += older;
        }
        known
    }
}

/// Times are rounded to microseconds.
const CLOSE: f64 = 2e-6;

/// Which frames are taken, by their times.
struct Taken {
    /// Seconds from one to the next, at least; 0: all are taken.
    every: f64,
    /// When the next one is due.
    due: Option<f64>,
}

impl Taken {
    /// Whether a frame of this time is taken.
    fn takes(&mut self, time: f64) -> bool {
        let due = self.due.unwrap_or(time);
        // So that NaN is left out.
        if !(time + CLOSE >= due) {
            return false;
        }
        // Gaps in the video are not made up for.
        self.due = Some(if time > due + self.every { time } else { due } + self.every);
        true
    }
}

impl VideoFrames {
    /// The camera that all frames are of.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// About how many frames come, if the video's length is known.
    pub fn about(&self) -> Option<usize> {
        let frames = self.video.duration? / self.taken.every;
        frames.is_finite().then_some((frames as usize + 1).min(self.most))
    }

    /// The next frame, and what is known of it.
    pub fn next_frame(&mut self) -> anyhow::Result<Option<(Input, Picture)>> {
        if self.most == 0 {
            return Ok(None);
        }
        while let Some(frame) = self.reader.next_frame()? {
            self.last = frame.time;
            if self.taken.takes(frame.time) {
                self.most -= 1;
                return self.picture(&frame).map(Some);
            }
        }
        for note in self.video.told(&self.reader, self.last) {
            tell!("{note}");
        }
        Ok(None)
    }

    fn picture(&mut self, frame: &VideoFrame) -> anyhow::Result<(Input, Picture)> {
        let name = format!("{:06}", frame.index);
        let mut picture = Picture::new(self.camera.width, self.camera.height);
        let converted = self.converter.convert(&frame.view(), &mut picture);
        converted.with_context(|| format!("{}, frame {name}", self.video.name()))?;
        let mut external = self.known.of(&name, frame.time);
        external.time = Some(frame.time);
        let input = Input {
            path: Path::new(&self.video.path).to_path_buf(),
            file: name.clone(),
            name,
            camera: self.camera,
            external,
            known: None,
        };
        Ok((input, picture))
    }
}

#[cfg(test)]
mod tests {
    use nvsprior::Hint;

    use super::*;

    fn taken(fps: Option<f64>, times: &[f64]) -> Vec<usize> {
        let every = fps.map_or(0.0, |fps| 1.0 / fps);
        let mut taken = Taken { every, due: None };
        (0..times.len()).filter(|i| taken.takes(times[*i])).collect()
    }

    #[test]
    fn frames_are_taken_by_their_times() {
        let steady: Vec<f64> = (0..60).map(|i| f64::from(i) / 30.0).collect();
        assert_eq!(taken(None, &steady).len(), 60);
        assert_eq!(taken(Some(10.0), &steady), (0..20).map(|i| 3 * i).collect::<Vec<_>>());
        assert_eq!(taken(Some(30.0), &steady).len(), 60);
        assert_eq!(taken(Some(12.0), &steady).len(), 24);
        // A gap is not made up for by frames that follow each other closely.
        assert_eq!(taken(Some(1.0), &[0.0, 0.5, 5.3, 5.4, 5.9, 6.3, 7.0]), [0, 2, 5]);
        assert_eq!(taken(None, &[0.0, 0.2, 0.1, f64::NAN, 0.3]), [0, 1, 4]);
    }

    #[test]
    fn poses_without_names_are_joined_by_time() {
        let hint = |x: f64| {
            let translation = glam::DVec3::new(x, 0.0, 0.0);
            Some(Hint::of(nvsprior::Pose { translation, ..nvsprior::Pose::IDENTITY }))
        };
        let row = |time: f64, x: f64| (time, FrameInfo { hint: hint(x), time: Some(time) });
        let known = Known::Times(vec![row(1.0, 0.1), row(2.0, 0.2), row(60.0, 6.0)]);
        let of = |time: f64| {
            known.of("000000", time).hint.map(|hint| (hint.pose.translation.x, hint.age))
        };
        assert_eq!(of(0.5), None);
        assert_eq!(of(1.0), Some((0.1, 0.0)));
        assert_eq!(of(1.75), Some((0.1, 0.75)));
        assert_eq!(of(3.0), Some((0.2, 1.0)));
        assert_eq!(of(20.0), None);
        assert_eq!(of(60.0), Some((6.0, 0.0)));
    }
}

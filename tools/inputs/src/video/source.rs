//! A video file that was found to be one.

use std::path::{Path, PathBuf};

use super::clock::STEP;
use super::decoder::{Decoder, DecoderChoice, FrameSize, Way};
use super::frame::VideoFrame;
use super::interlaced::is_interlaced;
use super::probe::Probe;
use super::reader::{Ended, VideoReader};
use super::{Header, VideoError};

/// A video of which a frame was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Video {
    /// Absolute.
    pub path: PathBuf,
    pub decoder: Decoder,
    pub way: Way,
    pub header: Header,
    /// Seconds, as its file says.
    pub duration: Option<f64>,
    /// About, by its file's word.
    pub frames: Option<f64>,
    /// Of its file.
    pub bytes: u64,
    /// The decoder's name of what it is coded by; empty if that is not known.
    pub codec: String,
    /// Tracks that are neither pictures nor sound.
    pub others: Vec<String>,
    /// What is to be told of it before it is decoded: which of its tracks is taken.
    pub notes: Vec<String>,
    /// How it is decoded.
    pub command: String,
}

impl Video {
    /// Reads a video's first frame, by the first of the wanted programs that can.
    pub fn open(path: &Path, choice: DecoderChoice) -> Result<Video, VideoError> {
        let decoders = choice.decoders()?;
        let failed = VideoError::file(path);
        let length = std::fs::metadata(path).map_err(&failed)?.len();
        // A file that may not be read is found here, not by another program.
        std::fs::File::open(path).map_err(&failed)?;
        let path = std::path::absolute(path).map_err(&failed)?;
        if length == 0 {
            return Err(VideoError::Empty { path });
        }
        let mut said = Vec::new();
        let only = decoders.len() == 1;
        for decoder in decoders {
            match Video::by(&path, length, decoder) {
                Err(VideoError::NoFrame { said: own, .. }) => said.push(own),
                Err(VideoError::Hangs { program, .. }) if !only => {
                    said.push(format!("{program} hangs"));
                }
                other => return other,
            }
        }
        Err(VideoError::NoFrame { path, said: said.join("; ") })
    }

    fn by(path: &Path, bytes: u64, decoder: Decoder) -> Result<Video, VideoError> {
        let probe = Probe::of(decoder, path);
        if probe.has_video == Some(false) {
            return Err(VideoError::NoPictures { path: path.to_path_buf() });
        }
        let Probe { track, rate, untimed, .. } = probe;
        let mut way = Way { track, rate, untimed, interlaced: false };
        let mut notes: Vec<String> = probe.choice.into_iter().collect();
        let mut reader = VideoReader::start(path, decoder, &way, FrameSize::Full, &[])?;
        let mut frames = reader.first_frames(LOOKED_AT);
        let moves = decoder == Decoder::Ffmpeg || frames.len() > 1;
        if let Some((number, next, first)) = (!moves).then(|| moving(path, way)).flatten() {
            way.track = Some(number);
            notes.push(format!("track of pictures {number} is taken: none before it moves"));
            (reader, frames) = (next, first);
        }
        way.interlaced = reader.header().interlaced || is_interlaced(&frames);
        if way.interlaced {
            notes.push("interlaced: of the two fields of each frame one picture is made".into());
        }
        Ok(Video {
            path: path.to_path_buf(),
            decoder,
            way,
            header: *reader.header(),
            duration: probe.duration,
            frames: probe.frames,
            bytes,
            codec: probe.codec,
            others: probe.others,
            notes,
            command: reader.command().to_owned(),
        })
    }

    /// Decodes it from its beginning. Frames of an interlaced one come at their full size.
    pub fn read(&self, size: FrameSize) -> Result<VideoReader, VideoError> {
        self.read_some(size, &[])
    }

    /// The same for the frames of these numbers, in rising order. Others may come between; each has its time, and no
    /// number of its own.
    pub fn read_some(&self, size: FrameSize, frames: &[usize]) -> Result<VideoReader, VideoError> {
        // A frame's place in a bare stream tells its time, and fields are joined with those of the frames beside them.
        let whole = self.way.untimed || self.way.interlaced;
        let frames = if whole { &[] } else { frames };
        let size = if self.way.interlaced { FrameSize::Full } else { size };
        VideoReader::start(&self.path, self.decoder, &self.way, size, frames)
    }

    /// What is to be told of it once it was read to its end. `last`: its last frame's time.
    pub fn told(&self, reader: &VideoReader, last: f64) -> Vec<String> {
        let (name, mended) = (self.name(), reader.mended());
        let mut notes = Vec::from_iter(self.cut_off(reader, last));
        if self.way.untimed {
            let rate = self.way.rate.unwrap_or(1.0 / STEP);
            notes.push(format!(
                "{name}: a bare stream has no times: {rate} frames a second are assumed"
            ));
        } else if mended > 0 {
            notes.push(format!(
                "{name}: the times of {mended} frames go back, stand still or are missing: each comes one step after \
                 the frame before it, and what follows is moved by as much; join no logs by these times"
            ));
        }
        notes
    }

    /// Whether it ends before its end.
    fn cut_off(&self, reader: &VideoReader, last: f64) -> Option<String> {
        /// Lengths that containers tell may be off by this, seconds, and by this share.
        const OFF: (f64, f64) = (1.0, 0.01);
        let name = self.name();
        match (reader.ended(), self.duration) {
            // GStreamer's words for frames that do not fit into the stream any more.
            (Some(Ended::CutOff(said)), _) if said.contains("Could not multiplex") => {
                Some(format!(
                    "{name}: its pictures change their size after {last:.1} s; what was read is used; --decoder ffmpeg \
                 reads on"
                ))
            }
            (Some(Ended::CutOff(said)), _) => Some(format!(
                "{name}: is cut off or damaged after {last:.1} s; what was read is used ({said})"
            )),
            // Times that were mended tell no length.
            (_, Some(length)) if reader.mended() == 0 && last + OFF.0 + OFF.1 * length < length => {
                Some(format!(
                    "{name}: ends after {last:.1} s, but says that it lasts {length:.1} s: it is cut off; what was \
                     read is used"
                ))
            }
            _ => None,
        }
    }

    /// Its file's name, for messages.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}

impl Video {
    /// Which share of it lies before a time, if its length is known.
    pub fn share(&self, time: f64) -> Option<f64> {
        Some((time / self.duration?).clamp(0.0, 1.0))
    }
}

/// Frames at its beginning by which a track is judged.
const LOOKED_AT: usize = 24;

/// GStreamer's next track of pictures that moves, if the first does not: a cover may come first. With its first frames.
fn moving(path: &Path, way: Way) -> Option<(usize, VideoReader, Vec<VideoFrame>)> {
    const MOST: usize = 4;
    for number in 1..MOST {
        let way = Way { track: Some(number), ..way };
        // There is no such track.
        let mut reader = VideoReader::once(path, Decoder::Gstreamer, &way).ok()?;
        let frames = reader.first_frames(LOOKED_AT);
        if frames.len() > 1 {
            return Some((number, reader, frames));
        }
    }
    None
}

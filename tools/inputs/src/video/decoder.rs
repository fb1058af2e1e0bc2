//! The programs that decode videos, and how each is called.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::ValueEnum;

use super::VideoError;

/// Which program is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum DecoderChoice {
    /// FFmpeg if it is there, else GStreamer; the other one if the first cannot read a video
    #[default]
    Auto,
    /// gst-launch-1.0, with its plugins
    Gstreamer,
    /// ffmpeg, with its ffprobe
    Ffmpeg,
}

/// A program that decodes videos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoder {
    Gstreamer,
    Ffmpeg,
}

/// What of a file is read, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Way {
    /// The track of pictures, by the decoder's own number; `None`: its first one.
    pub track: Option<usize>,
    /// Frames per second, as the file states.
    pub rate: Option<f64>,
    /// The file is a bare stream, without times.
    pub untimed: bool,
    /// Frames are woven of two fields: a picture is made of each.
    pub interlaced: bool,
}

/// How frames come out of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameSize {
    /// As the video has them.
    Full,
    /// Reduced to this width, if they are wider.
    AtMost(u32),
}

impl DecoderChoice {
    /// The programs to try, in order: those that are there.
    pub fn decoders(self) -> Result<Vec<Decoder>, VideoError> {
        let wanted: &[Decoder] = match self {
            DecoderChoice::Auto => &[Decoder::Ffmpeg, Decoder::Gstreamer],
            DecoderChoice::Gstreamer => &[Decoder::Gstreamer],
            DecoderChoice::Ffmpeg => &[Decoder::Ffmpeg],
        };
        let there: Vec<Decoder> = wanted.iter().copied().filter(|of| of.is_there()).collect();
        match (&there[..], self) {
            ([], DecoderChoice::Auto) => Err(VideoError::NoDecoder),
            ([], _) => Err(wanted[0].not_installed()),
            _ => Ok(there),
        }
    }
}

impl Decoder {
    pub fn program(self) -> &'static str {
        match self {
            Decoder::Gstreamer => "gst-launch-1.0",
            Decoder::Ffmpeg => "ffmpeg",
        }
    }

    /// What the times of its stream are to be multiplied by.
    pub fn time_scale(self) -> f64 {
        match self {
            Decoder::Gstreamer => 1.0,
            Decoder::Ffmpeg => 1.0 / f64::from(FFMPEG_TIMES),
        }
    }

    pub fn not_installed(self) -> VideoError {
        // What Debian and Ubuntu call them.
        let packages = match self {
            Decoder::Gstreamer => {
                "gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-libav"
            }
            Decoder::Ffmpeg => "ffmpeg",
        };
        VideoError::NotInstalled { program: self.program(), packages }
    }

    fn is_there(self) -> bool {
        on_path(self.program()).is_some()
    }

    /// The arguments that decode a video to standard output: Matroska with I420, times to a microsecond. Pixels
    /// become square, and the video's rotation is done. No frame is doubled or left out, unless `frames` is not empty:
    /// then FFmpeg leaves out most others than those of these numbers.
    pub fn arguments(
        self,
        video: &Path,
        way: &Way,
        size: FrameSize,
        frames: &[usize],
    ) -> Vec<OsString> {
        match self {
            Decoder::Gstreamer => gstreamer(video, way, size),
            Decoder::Ffmpeg => ffmpeg(video, way, size, frames),
        }
    }
}

fn gstreamer(video: &Path, way: &Way, size: FrameSize) -> Vec<OsString> {
    let width = match size {
        FrameSize::Full => String::new(),
        FrameSize::AtMost(width) => format!(",width=(int)[1,{width}]"),
    };
    // The muxer leaves out frames without a time. So each gets one, by its bytes.
    let times = if way.untimed { "identity datarate=1000000 ! " } else { "" };
    let words = format!(
        "-q uridecodebin name=d uri={} caps=video/x-raw(ANY) expose-all-streams=false d.src_{} ! queue ! \
         videoflip video-direction=auto ! videoscale add-borders=false ! videoconvert ! \
         video/x-raw,format=I420,pixel-aspect-ratio=1/1{width} ! \
         {times}matroskamux streamable=true timecodescale=1000 min-cluster-duration=0 ! fdsink fd=1",
        file_uri(video),
        way.track.unwrap_or(0)
    );
    words.split(' ').map(OsString::from).collect()
}

/// FFmpeg's Matroska has ticks of a millisecond, so it is given times a thousandfold.
const FFMPEG_TIMES: u32 = 1000;

/// Of frames that are left out, every so many is taken all the same: a decoder that works is not silent for long.
const SIGN_OF_LIFE: usize = 100;
/// More frames than these are not asked for by their numbers: an argument has a greatest length.
const ASKED_FOR: usize = 4_000;

/// FFmpeg's filter that leaves frames out.
fn select(frames: &[usize]) -> String {
    if frames.is_empty() || frames.len() > ASKED_FOR {
        return String::new();
    }
    let each: String = frames.iter().map(|number| format!("+eq(n,{number})")).collect();
    format!("select='not(mod(n,{SIGN_OF_LIFE})){each}',")
}

fn ffmpeg(video: &Path, way: &Way, size: FrameSize, frames: &[usize]) -> Vec<OsString> {
    let reduce = match size {
        FrameSize::Full => String::new(),
        FrameSize::AtMost(width) => format!("scale='min({width},iw)':-1:flags=area,"),
    };
    let filters = format!(
        "{}scale=trunc(iw*sar+0.5):ih,setsar=1,{reduce}settb=1/1000000,setpts={FFMPEG_TIMES}*PTS",
        select(frames)
    );
    let words = |text: &str| text.split(' ').map(OsString::from).collect::<Vec<_>>();
    let mut arguments = words("-nostdin -v error -i");
    arguments.push(protocol(video));
    let track = way.track.map_or("V:0".into(), |number| number.to_string());
    arguments.extend(words(&format!("-map 0:{track} -vf")));
    arguments.push(filters.into());
    arguments.extend(words(
        "-fps_mode passthrough -enc_time_base 1/1000 -c:v rawvideo -pix_fmt yuv420p -f matroska -",
    ));
    arguments
}

/// A path as ffmpeg takes it, whatever its name begins with.
pub fn protocol(path: &Path) -> OsString {
    let mut text = OsString::from("file:");
    text.push(path);
    text
}

/// The URI of an absolute path. What pipelines read otherwise is escaped.
pub fn file_uri(path: &Path) -> String {
    let mut uri = String::from("file://");
    let bytes = path.as_os_str().as_encoded_bytes();
    if cfg!(windows) {
        uri.push('/');
    }
    for byte in bytes {
        match byte {
            b'\\' if cfg!(windows) => uri.push('/'),
            b':' if cfg!(windows) => uri.push(':'),
            b'/' | b'-' | b'.' | b'_' | b'~' => uri.push(char::from(*byte)),
            byte if byte.is_ascii_alphanumeric() => uri.push(char::from(*byte)),
            byte => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri
}

/// Where a program is, if it is on the PATH.
pub fn on_path(program: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let name = format!("{program}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&folders).map(|folder| folder.join(&name)).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn uris_hold_no_character_that_a_pipeline_reads() {
        assert_eq!(file_uri(Path::new("/a/dive 1!.mp4")), "file:///a/dive%201%21.mp4");
        assert_eq!(file_uri(Path::new("/ü\"'=;")), "file:///%C3%BC%22%27%3D%3B");
    }

    #[test]
    fn analysis_asks_for_small_frames() {
        for decoder in [Decoder::Gstreamer, Decoder::Ffmpeg] {
            let words = |size| decoder.arguments(Path::new("/a.mp4"), &Way::default(), size, &[]);
            let text = |size| format!("{:?}", words(size));
            assert!(text(FrameSize::AtMost(640)).contains("640"));
            assert!(!text(FrameSize::Full).contains("640"));
        }
    }
}

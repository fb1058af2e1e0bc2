//! The frames of a video, one after the other, from a program that decodes it.

use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use super::VideoError;
use super::clock::Clock;
use super::decoder::{Decoder, FrameSize, Way};
use super::frame::{Layout, VideoFrame};
use super::interlaced::Fields;
use super::matroska::{Block, Header, Matroska};
use crate::child::{Running, shown};

/// Frames that wait between the program and this one.
const WAITING: usize = 4;
/// A decoder that gives nothing for so long is said to be slow, and is ended in the end.
const PATIENCE: Duration = Duration::from_secs(30);
const LONGEST: Duration = Duration::from_secs(120);
/// How long the first frame may take, in tries one after the other: GStreamer's program hangs now and then if it cannot
/// read a file, and does not say that it failed.
const FIRST: [Duration; 3] =
    [Duration::from_secs(10), Duration::from_secs(20), Duration::from_secs(60)];
/// FFmpeg's words for a file that is cut off; it does not count as a failure.
const CUT: [&str; 2] = ["File ended prematurely", "partial file"];
/// Between two looks at how a program is that gives nothing.
const LOOK: Duration = Duration::from_millis(500);
/// How long a program may take to end after it said that it failed.
const AFTER_FAILURE: Duration = Duration::from_secs(3);
/// How long a program may take to end after its last frame.
const TO_END: Duration = Duration::from_secs(10);

/// What the reading thread sends.
enum Message {
    Header(Header),
    Frame(VideoFrame),
    /// The stream is not as it should be.
    Broken(std::io::Error),
}

/// How a video ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    Whole,
    /// Amid itself: the program's last words.
    CutOff(String),
}

pub struct VideoReader {
    path: PathBuf,
    decoder: Decoder,
    command: String,
    messages: Receiver<Message>,
    running: Running,
    header: Header,
    clock: Clock,
    ended: Option<Ended>,
}

impl VideoReader {
    /// Starts the program, and waits for what it says of the frames. `path` is absolute. `frames`: the numbers of those
    /// that are wanted, or none if all are.
    pub fn start(
        path: &Path,
        decoder: Decoder,
        way: &Way,
        size: FrameSize,
        frames: &[usize],
    ) -> Result<VideoReader, VideoError> {
        let mut last = Err(VideoError::NoDecoder);
        for patience in FIRST {
            last = VideoReader::try_start(path, decoder, (way, size, frames), patience);
            if !matches!(last, Err(VideoError::Hangs { .. })) {
                break;
            }
        }
        last
    }

    /// The same, without a second try.
    pub fn once(path: &Path, decoder: Decoder, way: &Way) -> Result<VideoReader, VideoError> {
        VideoReader::try_start(path, decoder, (way, FrameSize::Full, &[]), FIRST[0])
    }

    fn try_start(
        path: &Path,
        decoder: Decoder,
        (way, size, frames): (&Way, FrameSize, &[usize]),
        patience: Duration,
    ) -> Result<VideoReader, VideoError> {
        let mut command = Command::new(decoder.program());
        command.args(decoder.arguments(path, way, size, frames));
        let shown = shown(&command);
        let started = Running::with_output(command);
        let (running, output) = started.map_err(|error| match error.kind() {
            ErrorKind::NotFound => decoder.not_installed(),
            _ => VideoError::File { path: decoder.program().into(), error },
        })?;
        let (sender, messages) = sync_channel(WAITING);
        let interlaced = way.interlaced;
        std::thread::spawn(move || read(output, decoder, interlaced, &sender));
        let header = Header::of_size(0, 0);
        let path = path.to_path_buf();
        let (clock, command, ended) = (Clock::new(way), shown, None);
        let mut reader =
            VideoReader { path, decoder, command, messages, running, header, clock, ended };
        match reader.message(patience)? {
            Some(Message::Header(header)) => reader.header = header,
            first => return Err(reader.no_frame(first)),
        }
        Ok(reader)
    }

    fn no_frame(&mut self, first: Option<Message>) -> VideoError {
        let said = self.running.end(TO_END).map(|(_, said)| said).unwrap_or_default();
        let said = match first {
            Some(Message::Broken(error)) if said.is_empty() => error.to_string(),
            _ => said,
        };
        let said = format!("{} says: {said}", self.decoder.program());
        VideoError::NoFrame { path: self.path.clone(), said }
    }

    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The program with its arguments.
    pub fn command(&self) -> &str {
        &self.command
    }

    /// The first frames: at most so many, as far as they come without a long wait.
    pub fn first_frames(&mut self, most: usize) -> Vec<VideoFrame> {
        let next = |_| match self.message(FIRST[0]) {
            Ok(Some(Message::Frame(frame))) => Some(frame),
            _ => None,
        };
        (0..most).map_while(next).collect()
    }

    /// Frames so far whose times were mended.
    pub fn mended(&self) -> usize {
        self.clock.mended
    }

    /// How the video ended, once it has.
    pub fn ended(&self) -> Option<&Ended> {
        self.ended.as_ref()
    }

    /// The next frame; `None` at the end, of which [`VideoReader::ended`] tells more.
    pub fn next_frame(&mut self) -> Result<Option<VideoFrame>, VideoError> {
        if self.ended.is_some() {
            return Ok(None);
        }
        let broken = match self.message(LONGEST)? {
            Some(Message::Frame(mut frame)) => {
                frame.time = self.clock.time(frame.time);
                return Ok(Some(frame));
            }
            Some(Message::Broken(error)) => Some(error),
            Some(Message::Header(_)) | None => None,
        };
        let ended = self.running.end(TO_END);
        let (status, said) = ended.map_err(VideoError::file(&self.path))?;
        self.ended = Some(match broken {
            None if status.success() && !CUT.iter().any(|word| said.contains(word)) => Ended::Whole,
            Some(error) if said.is_empty() => Ended::CutOff(error.to_string()),
            None if said.is_empty() => Ended::CutOff(status.to_string()),
            _ => Ended::CutOff(said),
        });
        Ok(None)
    }

    /// Waits for a message. A decoder that has failed and does not end is ended soon, one that hangs is in the end.
    fn message(&mut self, longest: Duration) -> Result<Option<Message>, VideoError> {
        let since = Instant::now();
        let mut said = 0;
        loop {
            match self.messages.recv_timeout(LOOK) {
                Ok(message) => return Ok(Some(message)),
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
            }
            let waited = since.elapsed();
            if self.running.is_failing() && waited > AFTER_FAILURE {
                self.running.kill();
                return Ok(None);
            }
            let (program, times) = (self.decoder.program(), waited.as_secs() / PATIENCE.as_secs());
            if times > said {
                said = times;
                let seconds = waited.as_secs();
                tell!("{}: no frame from {program} for {seconds} s", self.path.display());
            }
            if waited >= longest {
                self.running.kill();
                let (path, seconds) = (self.path.clone(), waited.as_secs());
                return Err(VideoError::Hangs { path, program, seconds });
            }
        }
    }
}

/// Reads the program's output, until it ends or nobody listens.
fn read(output: ChildStdout, decoder: Decoder, interlaced: bool, sender: &SyncSender<Message>) {
    const BUFFER: usize = 1 << 18;
    let messages = || -> std::io::Result<()> {
        let mut stream = Matroska::open(BufReader::with_capacity(BUFFER, output))?;
        let header = *stream.header();
        if sender.send(Message::Header(header)).is_err() {
            return Ok(());
        }
        let layout = Layout::of(decoder, header);
        let tick = stream.tick() * decoder.time_scale();
        let (mut index, mut fields) = (0, interlaced.then(Fields::default));
        loop {
            let next = stream.next(layout.bytes());
            let (next, broken) = next.map_or_else(|error| (None, Some(error)), |next| (next, None));
            let ends = next.is_none();
            let block = match &mut fields {
                Some(fields) => fields.add(next, &layout),
                None => next,
            };
            if let Some(Block { ticks, data }) = block {
                let frame = VideoFrame { index, time: ticks as f64 * tick, layout, data };
                if sender.send(Message::Frame(frame)).is_err() {
                    return Ok(());
                }
                index += 1;
            }
            if ends {
                return broken.map_or(Ok(()), Err);
            }
        }
    };
    if let Err(error) = messages() {
        // If nobody listens, nobody wants to know.
        let _ = sender.send(Message::Broken(error));
    }
}

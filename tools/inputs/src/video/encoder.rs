//! Numbered PNGs as a video, by the programs that decode videos.

use std::path::Path;
use std::process::Command;

use super::decoder::{Decoder, DecoderChoice};
use crate::child;

#[derive(Debug, thiserror::Error)]
pub enum EncoderError {
    #[error(transparent)]
    Decoder(#[from] super::VideoError),
    #[error("{program}: {error}")]
    Start { program: &'static str, error: std::io::Error },
    #[error("{program} cannot write the video: {said}")]
    Failed { program: &'static str, said: String },
    #[error("{}: cannot be written: {error}", path.display())]
    Write { path: std::path::PathBuf, error: std::io::Error },
}

/// The name of a frame's file in the folder that [`encode_video`] takes.
pub fn frame_name(index: usize) -> String {
    format!("{index:06}.png")
}

const PATTERN: &str = "%06d.png";
const MADE: &str = "video.mp4";

/// Writes an MP4 of the frames 0, 1, 2, … in a folder, in H.264 of high quality. `rate`: frames per second. Gives back
/// the program with its arguments.
pub fn encode_video(
    folder: &Path,
    rate: f64,
    video: &Path,
    choice: DecoderChoice,
) -> Result<String, EncoderError> {
    let mut failed = None;
    for decoder in choice.decoders()? {
        match run(decoder, folder, rate) {
            Ok(command) => {
                let (made, path) = (folder.join(MADE), video.to_path_buf());
                // Another disk takes a copy.
                std::fs::rename(&made, video)
                    .or_else(|_| std::fs::copy(&made, video).map(drop))
                    .map_err(|error| EncoderError::Write { path, error })?;
                return Ok(command);
            }
            Err(error) => failed = failed.or(Some(error)),
        }
    }
    Err(failed.unwrap_or(EncoderError::Decoder(super::VideoError::NoDecoder)))
}

fn run(decoder: Decoder, folder: &Path, rate: f64) -> Result<String, EncoderError> {
    let program = decoder.program();
    let mut command = Command::new(program);
    // Names without folders need no escaping.
    command.args(arguments(decoder, rate).split(' ')).current_dir(folder);
    let shown = child::shown(&command);
    let ended = child::run(command).map_err(|error| EncoderError::Start { program, error })?;
    ended.map(|()| shown).map_err(|said| EncoderError::Failed { program, said })
}

fn arguments(decoder: Decoder, rate: f64) -> String {
    // Thousandths, so that no rate is rounded to whole frames.
    let rate = format!("{}/1000", (1000.0 * rate).round() as u64);
    match decoder {
        Decoder::Ffmpeg => format!(
            "-nostdin -v error -y -framerate {rate} -i {PATTERN} -c:v libx264 -crf 16 -pix_fmt yuv420p {MADE}"
        ),
        Decoder::Gstreamer => format!(
            "-q multifilesrc location={PATTERN} index=0 caps=image/png,framerate={rate} ! pngdec ! videoconvert ! \
             video/x-raw,format=I420 ! x264enc pass=qual quantizer=16 ! mp4mux ! filesink location={MADE}"
        ),
    }
}

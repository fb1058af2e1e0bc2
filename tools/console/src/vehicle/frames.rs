//! The vehicle's frames: files, or raw pictures on standard input.

use std::io::Read;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

use anyhow::Context;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Camera, Picture};
use nvsprior_channel::forth_and_back;
use nvsprior_inputs::frame_file;
use nvsprior_inputs::input::{Input, InputArgs};

/// The size of raw frames: `WxH`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u32,
    height: u32,
}

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Size, String> {
        let side =
            |text: &str| text.parse().ok().filter(|side| (1..=Camera::MAX_SIDE).contains(side));
        let sides = text.split_once('x').map(|(width, height)| (side(width), side(height)));
        match sides {
            Some((Some(width), Some(height))) => Ok(Size { width, height }),
            _ => Err(format!("must be WxH, each from 1 to {}", Camera::MAX_SIDE)),
        }
    }
}

pub struct Frame {
    /// All camera frames count, those that were left out, too.
    pub number: usize,
    pub picture: Picture,
}

/// What there is of frames.
pub enum Next {
    Frame(Frame),
    /// None has come yet.
    Wait,
    End,
}

pub struct Frames {
    camera: Camera,
    first: FrameInfo,
    source: Source,
    /// Number of the next frame.
    next: usize,
}

enum Source {
    Files { inputs: Vec<Input>, forth_and_back: bool },
    Raw(Receiver<std::io::Result<Picture>>),
}

impl Frames {
    pub fn open(
        args: &InputArgs,
        raw: Option<Size>,
        forth_and_back: bool,
    ) -> anyhow::Result<Frames> {
        let inputs = args.frames()?;
        let (camera, first) = (inputs[0].camera, inputs[0].external);
        let of_others = inputs.iter().find(|input| input.camera != camera);
        if let Some(other) = of_others.filter(|_| raw.is_none()) {
            anyhow::bail!(
                "{}: not of the first frame's camera; choose a split of one camera",
                other.file
            );
        }
        let (camera, source) = match raw {
            None => (camera, Source::Files { inputs, forth_and_back }),
            Some(Size { width, height }) => {
                (camera.resized(width, height), Source::Raw(read_raw(width, height)))
            }
        };
        camera.check().context("--cameras, --raw")?;
        Ok(Frames { camera, first, source, next: 0 })
    }

    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// What is known of the first frame.
    pub fn first(&self) -> FrameInfo {
        FrameInfo { time: None, ..self.first }
    }

    /// The frame that is to be sent next, `now` seconds after the start. Those whose time went by are left out.
    pub fn next(&mut self, now: f64, frame_rate: f64) -> anyhow::Result<Next> {
        let due = (now * frame_rate) as usize;
        let Camera { width, height, .. } = self.camera;
        match &self.source {
            Source::Files { inputs, forth_and_back: endless } => {
                let number = self.next.max(due);
                if !endless && number >= inputs.len() {
                    return Ok(Next::End);
                }
                let input = &inputs[forth_and_back(number, inputs.len())];
                let picture = frame_file::read_frame(&input.path, width, height)?;
                self.next = number + 1;
                Ok(Next::Frame(Frame { number, picture }))
            }
            Source::Raw(pictures) => {
                let mut picture = match pictures.try_recv() {
                    Ok(picture) => picture,
                    Err(TryRecvError::Empty) => return Ok(Next::Wait),
                    Err(TryRecvError::Disconnected) => return Ok(Next::End),
                };
                // The newest one counts.
                while let Ok(newer) = pictures.try_recv() {
                    picture = newer;
                }
                let number = self.next.max(due);
                self.next = number + 1;
                Ok(Next::Frame(Frame { number, picture: picture.context("reading raw frames")? }))
            }
        }
    }
}

/// Reads frames on a thread of its own. The encoder is slower than a camera may be, so few are held.
fn read_raw(width: u32, height: u32) -> Receiver<std::io::Result<Picture>> {
    let (sender, pictures) = sync_channel(2);
    std::thread::spawn(move || {
        let mut input = std::io::stdin().lock();
        loop {
            let mut picture = Picture::new(width, height);
            let read = match input.read_exact(&mut picture.data) {
                // The input ends; a frame that is cut is none.
                Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => return,
                read => read.map(|()| picture),
            };
            let failed = read.is_err();
            if sender.send(read).is_err() || failed {
                return;
            }
        }
    });
    pictures
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_numbers() {
        assert_eq!("320x180".parse(), Ok(Size { width: 320, height: 180 }));
        for text in ["320", "320x", "0x180", "320x180x3", "5000x10", "axb"] {
            assert!(text.parse::<Size>().is_err(), "{text}");
        }
    }
}

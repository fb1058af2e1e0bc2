//! The frames that are encoded: those of a camera file, or those of a video.

use anyhow::Context;
use nvsprior::{Camera, Picture};
use nvsprior_inputs::input::Input;
use nvsprior_inputs::video_input::VideoFrames;

use super::{Args, check_times};

pub enum Frames {
    Files(std::vec::IntoIter<Input>),
    Video(Box<VideoFrames>),
}

impl Frames {
    pub fn open(args: &Args) -> anyhow::Result<Frames> {
        let lens = || {
            let file = args.prior.prior.display();
            let lens = args.prior.lens()?;
            lens.with_context(|| format!("{file}: it states no lens; give --cameras"))
        };
        if let Some(video) = args.video.frames(&args.input, lens)? {
            return Ok(Frames::Video(Box::new(video)));
        }
        let frames = args.input.frames()?;
        check_times(&frames)?;
        Ok(Frames::Files(frames.into_iter()))
    }

    /// The first frame's camera.
    pub fn camera(&self) -> Camera {
        match self {
            // There is at least one.
            Frames::Files(frames) => frames.as_slice()[0].camera,
            Frames::Video(frames) => *frames.camera(),
        }
    }

    /// About how many there are; 0: unknown.
    pub fn about(&self) -> usize {
        match self {
            Frames::Files(frames) => frames.len(),
            Frames::Video(frames) => frames.about().unwrap_or_default(),
        }
    }

    /// Whether the first frame has no pose from outside, unless the list of starts has one.
    pub fn begin_lost(&self, starts: &str) -> bool {
        match self {
            Frames::Files(_) => starts == "none",
            Frames::Video(_) => starts == "none" || starts == "first",
        }
    }

    pub fn next_frame(&mut self) -> anyhow::Result<Option<(Input, Picture)>> {
        match self {
            Frames::Files(frames) => {
                let Some(input) = frames.next() else { return Ok(None) };
                let picture = input.read()?;
                Ok(Some((input, picture)))
            }
            Frames::Video(frames) => frames.next_frame(),
        }
    }
}

//! The frames that are encoded: those of a camera file, or those of a video.

use anyhow::Context;
use nvsprior::{Camera, Picture};
use nvsprior_inputs::args::PriorArgs;
use nvsprior_inputs::input::{Input, InputArgs};
use nvsprior_inputs::video_input::{VideoFrames, VideoInputArgs};

pub enum Frames {
    Files(std::vec::IntoIter<Input>),
    Video(Box<VideoFrames>),
}

impl Frames {
    pub fn open(
        prior: &PriorArgs,
        input: &InputArgs,
        video: &VideoInputArgs,
    ) -> anyhow::Result<Frames> {
        let lens = || {
            let file = prior.prior.display();
            let lens = prior.lens()?;
            lens.with_context(|| format!("{file}: it states no lens; give --cameras"))
        };
        if let Some(frames) = video.frames(input, lens)? {
            return Ok(Frames::Video(Box::new(frames)));
        }
        let frames = input.frames()?;
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

/// Fails if a frame's time lies before that of an earlier one.
fn check_times(frames: &[Input]) -> anyhow::Result<()> {
    let times = frames.iter().filter_map(|frame| Some((&frame.file, frame.external.time?)));
    for ((before, earlier), (file, time)) in times.clone().zip(times.skip(1)) {
        anyhow::ensure!(
            time >= earlier,
            "{file}: its time, {time} s, lies before that of an earlier frame, {before}, {earlier} s; \
             the order of frames is that of \"index\", and --split takes one run of several"
        );
    }
    Ok(())
}

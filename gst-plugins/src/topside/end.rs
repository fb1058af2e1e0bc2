//! The topside with what its pictures are written in.

use std::time::Instant;

use gst::prelude::*;
use gst_video::VideoInfo;

use nvsprior::image::PixelFormat;
use nvsprior::{Decoded, Error};
use nvsprior_link::{Shown, Shows, Topside};

use crate::caps;
use crate::showing::{self, Complaint, Showing};

/// The topside, and what is agreed on downstream.
pub struct End {
    pub topside: Topside,
    /// What the caps state.
    frame_rate: Option<gst::Fraction>,
    output: Option<(VideoInfo, PixelFormat)>,
    complaint: Complaint,
    /// The pilot's region as the property had it last.
    pub region: Option<(String, u32)>,
}

/// A picture that goes on.
pub struct Picture {
    /// Those that come before it.
    pub caps: Option<gst::Caps>,
    pub buffer: gst::Buffer,
    pub figures: gst::Structure,
    pub truth: Option<gst::Structure>,
    pub is_own: bool,
    pub is_complete: bool,
    pub is_damaged: bool,
    pub taken: gst::ClockTime,
}

impl End {
    pub fn new(topside: Topside, frame_rate: Option<gst::Fraction>) -> End {
        let complaint = Complaint::default();
        End { topside, frame_rate, output: None, complaint, region: None }
    }

    /// The next picture that goes on at `now`, and what is to be said of packets that come.
    pub fn next(
        &mut self,
        now: f64,
        pad: &gst::Pad,
        showing: &Showing,
    ) -> Result<(Option<Picture>, Option<String>), NextError> {
        let End { topside, output, .. } = self;
        let since = Instant::now();
        let failed = |error: &dyn std::fmt::Display| {
            NextError::Failed(gst::error_msg!(gst::ResourceError::Failed, ("{error}")))
        };
        let has_picture = topside.picture(now).map_err(|error| failed(&error))?.is_some();
        let taken = gst::ClockTime::from_nseconds(since.elapsed().as_nanos() as u64);
        let Some((decoded, shown)) = topside.shown().filter(|_| has_picture) else {
            let said = say(&mut self.complaint, topside.refusal(), "packets are left out");
            return Ok((None, said));
        };
        let effect = "showing what the packet gives without it";
        let said = say(&mut self.complaint, decoded.damage.as_ref(), effect);
        let (width, height) = (decoded.picture.width, decoded.picture.height);
        let is_agreed = |(info, _): &(VideoInfo, PixelFormat)| {
            (info.width(), info.height()) == (width, height) && !pad.check_reconfigure()
        };
        let mut caps = None;
        let (info, format) = match output.as_mut().filter(|agreed| is_agreed(agreed)) {
            Some(agreed) => agreed,
            None => {
                let (video, format) = showing::choose_format(pad)?;
                let info = VideoInfo::builder(video, width, height);
                let rate = self.frame_rate.unwrap_or(gst::Fraction::new(0, 1));
                let info = info.fps(rate).build().map_err(|error| failed(&error))?;
                caps = Some(info.to_caps().map_err(|error| failed(&error))?);
                output.insert((info, format))
            }
        };
        let mut buffer = gst::Buffer::with_size(info.size()).map_err(|error| failed(&error))?;
        let fields = buffer.make_mut();
        fields.set_pts(gst::ClockTime::from_seconds_f64(shown.time.max(0.0)));
        fields.set_duration(
            self.frame_rate
                .map(|rate| gst::ClockTime::from_seconds_f64(1.0 / caps::per_second(rate))),
        );
        fields.set_offset(shown.frame.max(0) as u64);
        let is_own = shown.shows == Shows::Own;
        if shown.restarted {
            fields.set_flags(gst::BufferFlags::DISCONT);
        }
        if is_own && !shown.complete {
            fields.set_flags(gst::BufferFlags::CORRUPTED);
        }
        showing::write(decoded, showing.overlay, (info, *format), fields)
            .map_err(NextError::Failed)?;
        let has_truth = showing.truth_messages;
        let picture = Picture {
            caps,
            buffer,
            figures: figures(decoded, shown, taken),
            truth: has_truth.then(|| showing::truth("nvsptopside-truth", decoded)),
            is_own,
            is_complete: shown.complete,
            is_damaged: decoded.damage.is_some(),
            taken,
        };
        Ok((Some(picture), said))
    }
}

/// Why there is no next one.
pub enum NextError {
    Flow(gst::FlowError),
    Failed(gst::ErrorMessage),
}

impl From<gst::FlowError> for NextError {
    fn from(error: gst::FlowError) -> NextError {
        NextError::Flow(error)
    }
}

fn say(complaint: &mut Complaint, wrong: Option<&Error>, effect: &str) -> Option<String> {
    let is_new = complaint.is_new(wrong);
    wrong.filter(|_| is_new).map(|error| format!("{error}: {effect}"))
}

fn figures(decoded: &Decoded, shown: &Shown, taken: gst::ClockTime) -> gst::Structure {
    let mut figures = showing::figures("nvsptopside-frame", decoded, shown.bytes, taken);
    figures.set("between", shown.shows == Shows::Between);
    figures.set("complete", shown.complete);
    figures.set("shares", shown.shares.0 as u32);
    // Without the vehicle's clock it is not known how long packets were on their way.
    if shown.clock.is_some() {
        figures.set("age", shown.age);
        figures.set("old-above", shown.old);
    }
    figures
}

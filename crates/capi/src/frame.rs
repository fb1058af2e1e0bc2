//! What is known of a frame besides its image, as C hands it over.

use nvsprior::{Error, FrameInfo, Hint};

use super::image::{self, nvsp_pose};
use super::status::*;
use super::structs::{In, versioned};

/// For nvsp_frame_info.given: `time` is the frame's.
pub const NVSP_GIVEN_TIME: u32 = 1;

/// What is known of a frame besides its image; all zero: nothing. Read during the call only.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_frame_info {
    pub struct_size: u32,
    pub abi_version: u32,
    /// A pose from sensors or an estimator; NULL: none. It is used if there is no certain pose of the frame before, and
    /// if it disagrees with that one by more than a tenth of the scene's depth or 6 degrees; the picture decides. On
    /// the scenes of docs/poses.md it may be off by 40 degrees or 1.5 units: of 104 starts each all were found. What
    /// is farther off costs time, not certainty. Beyond a million spreads of the prior it is refused.
    pub hint: In<nvsp_pose>,
    /// How sure the hint is: the covariance of the small motion from the hint to the true pose. 36 values, row by row:
    /// translation along the camera's axes (the prior's unit), then turns about them (radians). Symmetric and positive
    /// semidefinite. An axis of which nothing is known has an infinite variance, and 0 beside it. NULL: not stated.
    pub hint_covariance: *const f64,
    /// Seconds from the time of the hint to the time of the frame; 0 or more.
    pub hint_age: f64,
    /// When the frame was taken, seconds on a clock of yours. Used if `given` has NVSP_GIVEN_TIME. A later frame must
    /// not have an earlier time. After nvsp_encoder_reset any time is allowed again.
    pub time: f64,
    /// NVSP_GIVEN_TIME, or 0.
    pub given: u32,
    /// Camera frames that were left out before this one: its number is as much greater. If numbers count all frames of
    /// the camera, the topside knows which it lacks, and can draw them at poses between (nvsp_decoder_draw).
    pub left_out: u32,
}
versioned!(nvsp_frame_info, 48);

/// What a caller states of a frame.
pub(super) struct Known {
    pub frame: FrameInfo,
    /// Camera frames left out before it.
    pub left_out: u32,
}

/// Reads what a caller states of a frame. Checks its fields as far as that needs no encoder.
pub(super) fn known(info: In<nvsp_frame_info>) -> Result<Known, Failure> {
    let info = info.read()?;
    let hint = hint(&info)?;
    if info.given & !NVSP_GIVEN_TIME != 0 {
        return Err(Failure::argument("nvsp_frame_info.given: unknown bits"));
    }
    let timed = info.given & NVSP_GIVEN_TIME != 0;
    if !timed && info.time != 0.0 {
        let what = "nvsp_frame_info.time: stated, but NVSP_GIVEN_TIME is not in `given`";
        return Err(Failure::argument(what));
    }
    let (frame, left_out) = (FrameInfo { hint, time: timed.then_some(info.time) }, info.left_out);
    Ok(Known { frame, left_out })
}

const NO_POSE: &str = "nvsp_frame_info.hint: no rigid motion";

fn hint(info: &nvsp_frame_info) -> Result<Option<Hint>, Failure> {
    let covariance = info.hint_covariance.cast::<[[f64; 6]; 6]>();
    // SAFETY: 36 numbers stand there if it is not NULL, as the structure's field says; they lie as six by six do.
    let covariance = (!covariance.is_null()).then(|| unsafe { covariance.read_unaligned() });
    let pose = image::pose(info.hint);
    let pose = pose.map_err(|failure| match failure.status() {
        NVSP_ERR_ARGUMENT => Failure::argument(NO_POSE),
        _ => failure,
    })?;
    let Some(pose) = pose else {
        return match covariance {
            Some(_) => Err(Failure::argument("nvsp_frame_info.hint_covariance: without a hint")),
            None if info.hint_age != 0.0 => {
                Err(Failure::argument("nvsp_frame_info.hint_age: without a hint"))
            }
            None => Ok(None),
        };
    };
    Ok(Some(Hint { pose, covariance, age: info.hint_age }))
}

/// The failure that names the field of nvsp_frame_info which the encoder refuses.
pub(super) fn refused(error: Error) -> Failure {
    Failure::argument(match error {
        Error::HintPose { .. } => NO_POSE,
        Error::HintFar { .. } => {
            "nvsp_frame_info.hint: farther from the prior than a million times its spread"
        }
        Error::HintCovariance { .. } => {
            "nvsp_frame_info.hint_covariance: not symmetric, positive semidefinite, and finite but for open axes"
        }
        Error::HintAge { .. } => "nvsp_frame_info.hint_age: negative or not finite",
        Error::FrameTime { .. } => "nvsp_frame_info.time: not finite",
        Error::FrameTimeBack { .. } => "nvsp_frame_info.time: before that of an earlier frame",
        other => return Failure::Library(other),
    })
}

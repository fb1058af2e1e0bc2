//! What coders of pictures code: frames beside renders.

use nvsprior::{Picture, Pose};
use nvsprior_paper::{Optimizer, POSE_LEN};

use super::estimator::Estimates;
use crate::bench::codecs::run::{Beside, Run};
use crate::bench::codecs::{FoundPoses, affine, found, found_by};
use crate::bench::context::Context;

/// Length of a pose in the paper: seven numbers as f32.
const POSE_BYTES: f64 = POSE_LEN as f64;

pub struct Runs {
    pub frames: Run,
    /// Beside renders at the poses of BFGS.
    pub invs: Run,
    /// PSNR of each frame's render, the better one of BFGS and the program's own search, dB.
    pub found_psnr: Vec<f64>,
    /// Beside warped renders at the relocaliser's poses; `None` without key frames.
    pub affine: Option<Run>,
    /// The same at the poses of a regressor outside; `None` if there are none.
    pub affine_cnn: Option<Run>,
}

impl Runs {
    pub fn new(
        context: &mut Context,
        estimates: Option<&Estimates>,
        regressed: Option<&Estimates>,
    ) -> anyhow::Result<Runs> {
        let frames: Vec<_> = context.shots.iter().map(|shot| shot.picture.clone()).collect();
        let mut papers = context.papers(Optimizer::Bfgs)?;
        let FoundPoses { poses, renders, psnr, ms } = found_by(context, &mut papers)?;
        let decode_ms = render_ms(context, &poses)?;
        let beside = Beside { bytes: POSE_BYTES, encode_ms: ms, decode_ms };
        let grey = frames.clone();
        let invs = Run::new(frames.clone(), renders, beside);
        let mut warped = |estimates: Option<&Estimates>| {
            estimates.map(|estimates| Self::affine(context, &frames, estimates)).transpose()
        };
        let (affine, affine_cnn) = (warped(estimates)?, warped(regressed)?);
        let frames = Run::new(frames, grey, Beside::default());
        let own = found(context)?.psnr;
        let found_psnr = psnr.iter().zip(own).map(|(a, b)| a.max(b)).collect();
        Ok(Runs { frames, invs, found_psnr, affine, affine_cnn })
    }

    /// The paper's affine baseline: no search, but a warp of the render at the estimate.
    fn affine(
        context: &mut Context,
        frames: &[Picture],
        estimates: &Estimates,
    ) -> anyhow::Result<Run> {
        let mut renders = Vec::new();
        for (index, pose) in estimates.poses.iter().enumerate() {
            let camera = context.shots[index].camera;
            renders.push(context.forward.picture(&camera, pose)?.clone());
        }
        let decode_ms = render_ms(context, &estimates.poses)?;
        let encode_ms = estimates.ms + decode_ms;
        let beside = Beside { bytes: POSE_BYTES, encode_ms, decode_ms };
        Ok(affine::warped(&Run::new(frames.to_vec(), renders, beside)))
    }
}

/// Mean time of a render at these poses, milliseconds.
fn render_ms(context: &mut Context, poses: &[Pose]) -> anyhow::Result<f64> {
    let mut ms = 0.0;
    for (index, pose) in poses.iter().enumerate() {
        let camera = context.shots[index].camera;
        ms += context.forward.measure(&camera, pose)? / poses.len() as f64;
    }
    Ok(ms)
}

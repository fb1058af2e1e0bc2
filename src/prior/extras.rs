//! What a prior holds that changes no picture.

use std::sync::Arc;

use super::error::PriorError;
use super::key_frames::KeyFrames;
use super::pose_trials::PoseTrials;
use crate::filter_weights::FilterWeights;
use crate::geometry::Lens;
use crate::image::Preprocessing;

/// What a prior holds that changes no picture: it is no part of the prior's identity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Extras {
    /// Where to look for a lost camera; possibly none. Encoders need them.
    pub key_frames: KeyFrames,
    /// How the pictures that it was trained on were treated. Encoders treat their frames in the same way.
    pub preprocessing: Preprocessing,
    /// The lens of the mapping run's camera.
    pub lens: Option<Lens>,
    /// The display filter's weights for the scene; `None`: the library's are used. Only topsides that filter need them.
    pub filter_weights: Option<Arc<FilterWeights>>,
    /// Doubt: how far the prior's picture may be off, splat by splat, in the prior's order. The error that a splat's
    /// part of a picture is expected to have, RMS, values of 0 to 255. Only topsides need it.
    pub doubt: Option<Vec<u8>>,
    /// Pictures that were held out of the training, and found: how far off the encoder's poses are. Possibly none.
    pub pose_trials: PoseTrials,
    /// The dives that the prior was trained on since it was mapped, as text.
    pub record: Option<String>,
}

impl Extras {
    /// Checks that they fit a prior of `splats` splats.
    pub(super) fn check(&self, splats: usize) -> Result<(), PriorError> {
        match &self.doubt {
            Some(doubt) if doubt.len() != splats => {
                let (found, expected) = (doubt.len(), splats);
                Err(PriorError::Shape { array: "doubt", found, expected })
            }
            _ => Ok(()),
        }
    }

    /// Those of a prior of the splats that `order` names, in that order.
    pub(super) fn reordered(&self, order: &[u32]) -> Extras {
        let of = |doubt: &Vec<u8>| order.iter().map(|index| doubt[*index as usize]).collect();
        Extras { doubt: self.doubt.as_ref().map(of), ..self.clone() }
    }
}

//! The parts that change no picture.

use std::sync::Arc;

use super::super::{Extras, KeyFrames, PriorError};
use super::file::Container;
use super::part::PartName;
use super::words::refusal;
use super::{key_frames, lens, pose_trials, preprocessing};
use crate::filter_weights::{FilterWeights, FilterWeightsError};
use crate::image::Preprocessing;

impl Extras {
    /// Reads those of a file.
    pub fn read(file: &Container) -> Result<Extras, PriorError> {
        let treated = file.read_part(PartName::PREPROCESSING, preprocessing::read)?;
        let keys = file.read_part(PartName::KEY_FRAMES, key_frames::read)?;
        Ok(Extras {
            key_frames: keys.unwrap_or(KeyFrames::NONE),
            preprocessing: treated.unwrap_or(Preprocessing::NONE),
            lens: file.read_part(PartName::LENS, lens::read)?,
            filter_weights: file.read_part(PartName::FILTER, filter)?,
            doubt: file.read_part(PartName::DOUBT, |content, _| Ok(content.to_vec()))?,
            pose_trials: file
                .read_part(PartName::POSE_TRIALS, pose_trials::read)?
                .unwrap_or_default(),
            record: file.read_part(PartName::RECORD, record)?,
        })
    }

    /// Puts them into a file, in place of its own.
    pub fn put(&self, file: &mut Container) {
        let Extras { key_frames: keys, preprocessing: treated, lens: own, .. } = self;
        let keys = (!keys.is_empty()).then(|| key_frames::to_bytes(keys));
        let treated = (!treated.is_none()).then(|| preprocessing::to_bytes(treated));
        file.set(PartName::KEY_FRAMES, keys);
        file.set(PartName::PREPROCESSING, treated);
        file.set(PartName::LENS, own.as_ref().map(lens::to_bytes));
        file.set(PartName::FILTER, self.filter_weights.as_ref().map(|weights| weights.write()));
        file.set(PartName::DOUBT, self.doubt.clone());
        let trials =
            (!self.pose_trials.is_empty()).then(|| pose_trials::to_bytes(&self.pose_trials));
        file.set(PartName::POSE_TRIALS, trials);
        file.set(PartName::RECORD, self.record.clone().map(String::into_bytes));
    }
}

fn filter(content: &[u8], at: usize) -> Result<Arc<FilterWeights>, PriorError> {
    let named = |error: FilterWeightsError| refusal("filter weights", at, error);
    FilterWeights::read(content).map(Arc::new).map_err(named)
}

fn record(content: &[u8], at: usize) -> Result<String, PriorError> {
    let text = str::from_utf8(content);
    let wrong =
        |error: std::str::Utf8Error| refusal("record", at + error.valid_up_to(), "no UTF-8 text");
    text.map(str::to_owned).map_err(wrong)
}

//! Learning, in a library that has the feature `training`; in others its calls fail.

pub(super) use imp::{adopt, begin, counts, drop_waiting, learn_more, take};

/// What a learner has done.
#[derive(Default)]
pub(super) struct Counts {
    pub updates: u32,
    pub refused: u32,
    pub update_bytes: u64,
}

#[cfg(feature = "training")]
mod imp {
    use crate::Encoder;
    use crate::learning::LearnOptions;

    use super::super::status::Failure;
    use super::Counts;

    pub fn begin(encoder: &mut Encoder, steps_per_frame: u32) -> Result<(), Failure> {
        let options = LearnOptions { steps_per_frame, ..LearnOptions::default() };
        Ok(encoder.learn(&options)?)
    }

    pub fn learn_more(encoder: &mut Encoder, price: f64) -> Result<(), Failure> {
        Ok(encoder.learn_more(price)?)
    }

    pub fn take(encoder: &mut Encoder) -> Result<Option<Vec<u8>>, Failure> {
        Ok(encoder.take_update())
    }

    pub fn adopt(encoder: &mut Encoder, number: u16) -> Result<bool, Failure> {
        Ok(encoder.adopt(number))
    }

    pub fn drop_waiting(encoder: &mut Encoder) -> Result<(), Failure> {
        encoder.drop_update();
        Ok(())
    }

    pub fn counts(encoder: &Encoder) -> Counts {
        let stats = encoder.learner_stats().unwrap_or_default();
        let (updates, refused) = (stats.updates, stats.refused);
        Counts { updates, refused, update_bytes: stats.update_bytes as u64 }
    }
}

#[cfg(not(feature = "training"))]
mod imp {
    use crate::Encoder;

    use super::super::status::{Failure, NVSP_ERR_UNSUPPORTED};
    use super::Counts;

    fn without<T>() -> Result<T, Failure> {
        let what = "learning: takes a library with the feature training";
        Err(Failure::at(NVSP_ERR_UNSUPPORTED, what))
    }

    pub fn begin(_: &mut Encoder, _: u32) -> Result<(), Failure> {
        without()
    }

    pub fn learn_more(_: &mut Encoder, _: f64) -> Result<(), Failure> {
        Ok(())
    }

    pub fn take(_: &mut Encoder) -> Result<Option<Vec<u8>>, Failure> {
        without()
    }

    pub fn adopt(_: &mut Encoder, _: u16) -> Result<bool, Failure> {
        without()
    }

    pub fn drop_waiting(_: &mut Encoder) -> Result<(), Failure> {
        without()
    }

    pub fn counts(_: &Encoder) -> Counts {
        Counts::default()
    }
}

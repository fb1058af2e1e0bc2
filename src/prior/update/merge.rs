//! A prior with what was learnt.

use super::super::prior::Prior;
use super::super::splats::Splats;
use super::UpdateError;
use super::learnt::Learnt;
use super::splat::LearntSplat;

/// Splats that fade to less than this are left out: no picture of 8 bits shows them.
const LEAST_OPACITY: f64 = 1.0 / 255.0;

impl Prior {
    /// A prior with what was learnt. It has an identity of its own. Splats that lie in a fade are fainter, or left out
    /// below an opacity of 1/255. The learnt ones follow the others, without higher coefficients. All else stays:
    /// options, key frames, preprocessing, coder tables.
    ///
    /// Fails if it was learnt on another prior, or if no splat is left.
    pub fn with_learnt(&self, learnt: &Learnt) -> Result<Prior, UpdateError> {
        if learnt.prior() != self.id() {
            return Err(UpdateError::Foreign { stated: learnt.prior(), prior: self.id() });
        }
        let mut splats = faded(self.splats(), learnt);
        append(&mut splats, learnt.splats());
        let tables = self.coder_tables().map(|tables| tables.as_ref().clone());
        Ok(Prior::from_splats(splats, *self.options())?
            .with_key_frames(self.key_frames().clone())
            .with_preprocessing(*self.preprocessing())
            .with_coder_tables(tables))
    }
}

/// The splats that can still be seen. Those outside of all fades keep their bits.
fn faded(splats: &Splats, learnt: &Learnt) -> Splats {
    let (mut kept, mut logits) = (Vec::new(), Vec::new());
    for (index, position) in splats.positions.iter().enumerate() {
        let factor = learnt.fade_of(*position);
        let opacity = splats.opacity(index) * f64::from(factor);
        let untouched = factor == 1.0;
        kept.push(untouched || opacity >= LEAST_OPACITY);
        if untouched {
            logits.push(splats.opacity_logits[index]);
        } else if opacity >= LEAST_OPACITY {
            logits.push(libm::log(opacity / (1.0 - opacity)) as f32);
        }
    }
    Splats { opacity_logits: logits, ..splats.filtered(&kept) }
}

/// Adds learnt splats behind others. Their higher coefficients are 0.
pub(crate) fn append(splats: &mut Splats, learnt: &[LearntSplat]) {
    let stride = splats.sh_stride();
    for splat in learnt {
        splats.positions.push(splat.position);
        splats.log_scales.push(splat.log_scale);
        splats.rotations.push(splat.rotation);
        splats.opacity_logits.push(splat.logit);
        splats.sh.extend(splat.colour);
        splats.sh.resize(splats.positions.len() * stride, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::sample_splats;
    use super::super::super::{KeyFrames, PartSource, PriorError, PriorId, RenderOptions};
    use super::super::tests::sample;
    use super::super::{Fade, Update, UpdateGrid};
    use super::*;
    use crate::coder_tables::Tables;
    use crate::geometry::Pose;
    use crate::image::{Preprocessing, WhiteBalance};

    fn prior(sh_degree: u32) -> Prior {
        let mut splats = sample_splats(4, sh_degree);
        splats.positions = vec![[0.5; 3], [9.5; 3], [20.0; 3], [-3.0; 3]];
        splats.opacity_logits = vec![0.0, 0.0, 3.0, -9.0];
        let preprocessing = Preprocessing { white_balance: WhiteBalance::GrayWorld, clahe: None };
        let key_frames = KeyFrames::new(vec![Pose::IDENTITY]).unwrap();
        Prior::from_splats(splats, RenderOptions::GSPLAT)
            .unwrap()
            .with_key_frames(key_frames)
            .with_preprocessing(preprocessing)
            .with_coder_tables(Some(Tables::generic()))
    }

    /// Half the opacity near [0.5; 3], next to none near [9.5; 3].
    fn update(prior: &Prior) -> Update {
        let grid = UpdateGrid { origin: [0.0; 3], exponent: -3 };
        let fades = vec![grid.fade([0.0; 3], [0.9; 3], 128), grid.fade([9.0; 3], [10.9; 3], 1)];
        let id = prior.id();
        Update { prior: id, before: id.into(), grid, fades, ..sample(1, 3) }
    }

    fn learnt(updates: &[&Update], prior: PriorId) -> Learnt {
        let mut learnt = Learnt::none(prior);
        for update in updates {
            learnt.add(update).unwrap();
        }
        learnt
    }

    #[test]
    fn splats_fade_go_and_come() {
        for degree in [0, 2] {
            let prior = prior(degree);
            let update = update(&prior);
            let with = prior.with_learnt(&learnt(&[&update], prior.id())).unwrap();
            let (splats, before) = (with.splats(), prior.splats());
            assert_eq!((with.len(), splats.sh_degree), (3 + 3, degree));
            assert_eq!(splats.positions[..3], [[0.5; 3], [20.0; 3], [-3.0; 3]]);
            assert!((splats.opacity(0) - 0.5 * 128.0 / 255.0).abs() < 1e-7);
            // Outside of all fades even what nobody sees stays as it is.
            assert_eq!(splats.opacity_logits[1..3], [3.0, -9.0]);
            let stride = splats.sh_stride();
            assert_eq!(splats.sh[..stride], before.sh[..stride]);
            for (index, new) in update.splats.iter().enumerate() {
                let (at, new) = (3 + index, new.learnt(&update.grid));
                assert_eq!(splats.positions[at], new.position);
                assert_eq!(splats.log_scales[at], new.log_scale);
                assert_eq!(splats.rotations[at], new.rotation);
                assert_eq!(splats.opacity_logits[at], new.logit);
                let sh = &splats.sh[at * stride..(at + 1) * stride];
                assert_eq!(sh[..3], new.colour);
                assert!(sh[3..].iter().all(|v| *v == 0.0));
            }
        }
    }

    #[test]
    fn all_else_stays() {
        let prior = prior(1);
        let with = prior.with_learnt(&learnt(&[&update(&prior)], prior.id())).unwrap();
        assert_ne!(with.id(), prior.id());
        assert_eq!(with.options(), prior.options());
        assert_eq!(with.key_frames(), prior.key_frames());
        assert_eq!(with.coder_tables(), prior.coder_tables());
        assert_eq!(with.preprocessing(), prior.preprocessing());
        assert_eq!(with.report().coder_tables, PartSource::Memory);
        let same = prior.with_learnt(&Learnt::none(prior.id())).unwrap();
        assert_eq!(same.id(), prior.id(), "nothing was learnt");
    }

    #[test]
    fn refuses_another_prior_and_an_empty_one() {
        let prior = prior(0);
        let error = prior.with_learnt(&Learnt::none(PriorId(1))).unwrap_err();
        assert!(matches!(error, UpdateError::Foreign { stated: PriorId(1), .. }), "{error}");
        let all = Fade { min: [-100; 3], max: [100; 3], factor: 0 };
        let gone = Update { splats: vec![], fades: vec![all], ..update(&prior) };
        let error = prior.with_learnt(&learnt(&[&gone], prior.id())).unwrap_err();
        assert!(matches!(error, UpdateError::Prior(PriorError::Empty)), "{error}");
    }
}

//! A learnt splat that changes by a few steps.

use std::array::from_fn;
use std::fmt::Display;

use super::splat::NewSplat;

/// How a learnt splat changes: differences in steps, which are added to the numbers of its [`NewSplat`]. Steps of the
/// position are those of the grid that came with the splat, not of the update's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Change {
    /// The splat's place in [`Learnt::splats`](super::Learnt::splats) before the update.
    pub ordinal: u16,
    /// What is added to [`NewSplat::position`].
    pub position: [i32; 3],
    /// What is added to [`NewSplat::log_scale`].
    pub log_scale: [i8; 3],
    /// What is added to [`NewSplat::rotation`].
    pub rotation: [i8; 3],
    /// What is added to [`NewSplat::opacity`].
    pub opacity: i8,
    /// What is added to [`NewSplat::colour`].
    pub colour: [i8; 3],
}

impl Change {
    /// The change that leads from one splat to another, or as far on the way there as a change can hold. `None` if they
    /// are the same.
    pub(super) fn between(ordinal: u16, from: &NewSplat, to: &NewSplat) -> Option<Change> {
        let small = |from: [i8; 3], to: [i8; 3]| from_fn(|i| to[i].saturating_sub(from[i]));
        let change = Change {
            ordinal,
            position: from_fn(|i| to.position[i].saturating_sub(from.position[i])),
            log_scale: small(from.log_scale, to.log_scale),
            rotation: small(from.rotation, to.rotation),
            opacity: to.opacity.saturating_sub(from.opacity),
            colour: small(from.colour, to.colour),
        };
        (!change.is_nothing()).then_some(change)
    }

    /// Whether it leaves a splat as it is.
    pub(super) fn is_nothing(&self) -> bool {
        *self == Change { ordinal: self.ordinal, ..Change::default() }
    }

    /// The splat after it; the reason, if that is none.
    pub(super) fn applied(&self, splat: &NewSplat) -> Result<NewSplat, String> {
        let small = |what, from: [i8; 3], by| sum(what, from, by, i8::checked_add);
        let [opacity] = sum("opacity", [splat.opacity], [self.opacity], i8::checked_add)?;
        let changed = NewSplat {
            position: sum("position", splat.position, self.position, i32::checked_add)?,
            log_scale: small("log scale", splat.log_scale, self.log_scale)?,
            rotation: small("rotation", splat.rotation, self.rotation)?,
            opacity,
            colour: small("colour", splat.colour, self.colour)?,
        };
        changed.fault().map_or(Ok(changed), Err)
    }
}

/// Sums of steps, unless one cannot be held.
fn sum<T: Copy + Display, const N: usize>(
    what: &str,
    from: [T; N],
    by: [T; N],
    add: fn(T, T) -> Option<T>,
) -> Result<[T; N], String> {
    let mut sums = from;
    for (sum, by) in sums.iter_mut().zip(by) {
        let before = *sum;
        *sum = add(before, by).ok_or_else(|| format!("{what} of {before} steps and {by} more"))?;
    }
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::splat;
    use super::*;

    proptest! {
        #[test]
        fn the_change_between_two_splats_leads_from_one_to_the_other(
            from in splat(), to in splat(), ordinal in any::<u16>(),
        ) {
            let found = Change::between(ordinal, &from, &to);
            prop_assert_eq!(found.is_none(), from == to);
            if let Some(change) = found {
                prop_assert_eq!(change.ordinal, ordinal);
                let reached = change.applied(&from).unwrap();
                // Two numbers may lie farther apart than a change can hold: it goes as far as it can.
                let far = |a: [i8; 3], b: [i8; 3]| (0..3).any(|i| b[i].checked_sub(a[i]).is_none());
                let far = far(from.log_scale, to.log_scale)
                    || far(from.colour, to.colour)
                    || (0..3).any(|i| to.position[i].checked_sub(from.position[i]).is_none());
                prop_assert!(far || reached == to);
                prop_assert_eq!((reached.rotation, reached.opacity), (to.rotation, to.opacity));
            }
        }
    }

    #[test]
    fn what_cannot_be_held_is_named() {
        let splat = NewSplat {
            position: [0, i32::MAX, 0],
            log_scale: [0, 0, -128],
            rotation: [12, 0, 0],
            opacity: 8,
            colour: [127, 0, 0],
        };
        let none = Change::default();
        assert_eq!(none.applied(&splat), Ok(splat));
        for (change, expected) in [
            (Change { position: [0, 1, 0], ..none }, "position of 2147483647 steps and 1 more"),
            (Change { log_scale: [0, 0, -1], ..none }, "log scale of -128 steps and -1 more"),
            (Change { rotation: [1, 0, 0], ..none }, "rotation of 13 steps: at most ±12"),
            (Change { rotation: [127, 0, 0], ..none }, "rotation of 12 steps and 127 more"),
            (Change { opacity: 1, ..none }, "opacity of 9 steps: -5 to 8"),
            (Change { opacity: 120, ..none }, "opacity of 8 steps and 120 more"),
            (Change { colour: [1, 0, 0], ..none }, "colour of 127 steps and 1 more"),
        ] {
            assert_eq!(change.applied(&splat), Err(expected.to_string()));
        }
    }
}

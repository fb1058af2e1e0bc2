//! Which numbers of a stream were taken.

use super::limits::NUMBER_BITS;

/// Numbers before the greatest one that may still come: a link may swap frames.
const BEHIND: u64 = 64;
/// Numbers of the same low bits lie so far apart.
const SPAN: u64 = 1 << NUMBER_BITS;
/// How many of them are tried beyond the greatest number: frames may have been lost.
const AHEAD: u64 = 4;
/// How many are tried if no number is known.
const AT_FIRST: u64 = 64;

/// The numbers of a stream by a key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    /// The greatest number that was taken; `None`: none was.
    greatest: Option<u64>,
    /// Bit k: the number k below it was taken.
    taken: u64,
}

impl Window {
    /// All numbers up to this one count as taken.
    pub fn after(greatest: u64) -> Window {
        Window { greatest: Some(greatest), taken: u64::MAX }
    }

    pub fn greatest(&self) -> Option<u64> {
        self.greatest
    }

    /// Numbers of these low bits that the next one may be, nearest first, then some that are long past.
    pub fn candidates(&self, low: u64) -> impl Iterator<Item = u64> + use<> {
        let (first, ahead, past) = match self.greatest {
            None => (low, AT_FIRST, 0),
            Some(greatest) => {
                let oldest = greatest.saturating_sub(BEHIND - 1);
                (oldest.saturating_add(low.wrapping_sub(oldest) % SPAN), AHEAD, AHEAD)
            }
        };
        let after = (0..ahead).filter_map(move |k| first.checked_add(k * SPAN));
        let before = (1..=past).filter_map(move |k| first.checked_sub(k * SPAN));
        after.chain(before)
    }

    /// Takes a number; `false`: it was taken before, or is too old to tell.
    pub fn take(&mut self, number: u64) -> bool {
        let Some(greatest) = self.greatest else {
            *self = Window { greatest: Some(number), taken: 1 };
            return true;
        };
        if number > greatest {
            let step = u32::try_from(number - greatest).unwrap_or(u32::MAX);
            self.taken = self.taken.checked_shl(step).unwrap_or(0) | 1;
            self.greatest = Some(number);
            return true;
        }
        let behind = greatest - number;
        let is_new = behind < BEHIND && self.taken >> behind & 1 == 0;
        if is_new {
            self.taken |= 1 << behind;
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_nearest_number_is_tried_first() {
        let mut window = Window::default();
        assert_eq!(window.candidates(5).take(2).collect::<Vec<_>>(), [5, 5 + SPAN]);
        assert_eq!(window.candidates(5).count(), 64);
        window.take(3 * SPAN + 10);
        let of = |low| window.candidates(low).collect::<Vec<_>>();
        assert_eq!(of(11)[0], 3 * SPAN + 11);
        assert_eq!(of(9)[0], 3 * SPAN + 9);
        assert_eq!(
            of(SPAN - 53)[0],
            3 * SPAN - 53,
            "within the window, before the low bits began anew"
        );
        assert_eq!(of(SPAN - 54)[0], 4 * SPAN - 54, "beyond it");
        assert_eq!(
            of(11)[3..],
            [6, 2, 1, 0].map(|k| k * SPAN + 11),
            "three before are all there are"
        );
        assert!(Window::after(u64::MAX).candidates(0).count() > 0);
    }

    #[test]
    fn what_was_known_before_a_start_counts_as_taken() {
        let mut window = Window::after(100);
        assert!(!window.take(100) && !window.take(99) && !window.take(0));
        assert!(window.take(101) && !window.take(101));
    }

    proptest! {
        /// Against a set of all numbers.
        #[test]
        fn no_number_is_taken_twice(steps in proptest::collection::vec(-70i64..70, 1..200)) {
            let (mut window, mut taken, mut at) = (Window::default(), BTreeSet::new(), 1000i64);
            for step in steps {
                at = (at + step).max(0);
                let number = at as u64;
                let greatest = taken.last().copied();
                let is_new = !taken.contains(&number)
                    && greatest.is_none_or(|greatest: u64| number + BEHIND > greatest);
                prop_assert_eq!(window.take(number), is_new, "{} of {:?}", number, window);
                if is_new {
                    taken.insert(number);
                }
            }
        }

        /// Whatever came before, the next numbers are among those that are tried, each once.
        #[test]
        fn the_true_number_is_tried(greatest in 0u64..1 << 40, step in 0..4 * SPAN - BEHIND) {
            let mut window = Window::default();
            window.take(greatest);
            let number = greatest + step;
            let tried: Vec<_> = window.candidates(number % SPAN).collect();
            prop_assert_eq!(tried.iter().filter(|tried| **tried == number).count(), 1);
        }
    }
}

//! The search for a payload of about a number of bytes. Choosing coefficients takes less time than writing them: so a
//! payload is written only if the coefficients that had to be weighed say that it is about as long.

use super::fineness::{Bracket, Fineness, MOST_TOLD};

/// Share of a budget that is used at least.
const USED: f64 = 0.95;
/// Bytes in all for each weighed one, beside the blocks (docs/decisions.md, 20).
const SHARE: f64 = 1.25;
/// A guess may be off by this share.
const OFF: f64 = 0.03;
/// It may also be off by so many bytes.
const OFF_BYTES: f64 = 2.0;
/// Fewer weighed bytes count as this many.
const LEAST: f64 = 0.1;

/// What the searches of earlier frames have shown: the next frame is much the same.
#[derive(Clone, Copy)]
pub struct Learnt {
    /// Bytes in all for each weighed one, beside the blocks.
    share: f64,
    /// How far the model of the weighed bytes is below them, as logarithms.
    off: f64,
}

impl Default for Learnt {
    fn default() -> Learnt {
        Learnt { share: SHARE, off: 0.0 }
    }
}

/// Coefficients that were chosen at a fineness.
#[derive(Clone, Copy)]
struct Try {
    at: Fineness,
    /// Bytes of those that had to be weighed.
    weighed: f64,
    /// The payload's length, if it was written.
    len: Option<usize>,
}

/// A search. Lengths are in bytes.
pub struct BudgetSearch<M> {
    bracket: Bracket<M>,
    /// The longest payload.
    max: usize,
    /// What the blocks take.
    blocks: f64,
    /// Bytes in all for each weighed one.
    share: f64,
    /// In their order.
    tries: [Option<Try>; MOST_TOLD],
}

impl<M: Fn(Fineness) -> f64> BudgetSearch<M> {
    /// `blocks`: what the blocks of the frame take. `model`: the natural logarithm of a payload's length at a fineness
    /// without them, roughly.
    pub fn new(max: usize, blocks: f64, learnt: Learnt, model: M) -> BudgetSearch<M> {
        let mut search = BudgetSearch {
            bracket: Bracket::new(0.0, learnt.off, model),
            max,
            blocks,
            share: learnt.share,
            tries: [None; MOST_TOLD],
        };
        search.aim();
        search
    }

    /// The length that is looked for.
    fn target(&self) -> f64 {
        (0.5 * (1.0 + USED) * self.max as f64).max(1.0)
    }

    /// The bracket searches weighed bytes, in the model's measure.
    fn aim(&mut self) {
        let weighed = ((self.target() - self.blocks) / self.share).max(LEAST);
        self.bracket.aim(libm::log(SHARE * weighed));
    }

    fn is_enough(&self, len: usize) -> bool {
        len <= self.max && len as f64 >= USED * self.max as f64
    }

    fn len(&self, of: &Try) -> f64 {
        of.len.map_or(self.blocks + self.share * of.weighed, |len| len as f64)
    }

    fn tries(&self) -> impl Iterator<Item = &Try> {
        self.tries.iter().flatten()
    }

    /// What to choose coefficients at next; `None`: no more is to be found.
    pub fn next(&self) -> Option<Fineness> {
        self.bracket.next()
    }

    /// Coefficients were chosen. `weighed`: see [`Try`]. Whether to write them.
    pub fn chosen(&mut self, at: Fineness, weighed: f64) -> bool {
        let weighed = weighed.max(LEAST);
        self.bracket.tell(at, libm::log(SHARE * weighed));
        // The same at the same step: these are the same coefficients.
        let is_same = |other: &&Try| other.weighed == weighed && other.at.step() == at.step();
        let len = self.tries().find(is_same).and_then(|other| other.len);
        let new = Try { at, weighed, len };
        let guess = self.len(&new);
        if let Some(place) = self.tries.iter_mut().find(|place| place.is_none()) {
            *place = Some(new);
        }
        len.is_none() && (guess - self.target()).abs() <= OFF * self.target() + OFF_BYTES
    }

    /// What was chosen last was written; if it is longer than the budget, `len` may be anything above it. Whether that
    /// ends the search.
    pub fn written(&mut self, len: usize) -> bool {
        let Some(last) = self.tries.iter_mut().flatten().last() else { return false };
        last.len = Some(len);
        self.share = (len as f64 - self.blocks).max(LEAST) / last.weighed;
        self.aim();
        self.is_enough(len)
    }

    /// What this search has shown, and those before it. Half each, since frames differ.
    pub fn learnt(&self, before: Learnt) -> Learnt {
        let is_written = self.tries().any(|of| of.len.is_some());
        match self.bracket.last_off().filter(|_| is_written) {
            Some(off) => {
                Learnt { share: 0.5 * (before.share + self.share), off: 0.5 * (before.off + off) }
            }
            None => before,
        }
    }

    /// The longest that was written and has room.
    fn longest(&self) -> usize {
        self.tries().filter_map(|of| of.len).filter(|len| *len <= self.max).max().unwrap_or(0)
    }

    /// At the end: what was not written, has room, and is longer than all that was.
    pub fn unwritten(&self) -> Option<Fineness> {
        let has_room = |of: &&Try| of.len.is_none() && self.len(of) <= self.max as f64;
        let best = self.tries().filter(has_room);
        let best = best.max_by(|a, b| self.len(a).total_cmp(&self.len(b)))?;
        (self.len(best) > self.longest() as f64).then_some(best.at)
    }

    /// At the end: the shortest that is too long, if all others leave room.
    pub fn too_long(&self) -> Option<Fineness> {
        if self.is_enough(self.longest()) {
            return None;
        }
        let too_long = self.tries().filter(|of| self.len(of) > self.max as f64);
        Some(too_long.min_by(|a, b| self.len(a).total_cmp(&self.len(b)))?.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of which payloads are known.
    struct Frame {
        blocks: f64,
        share: f64,
        /// Weighed bytes at a fineness.
        weighed: fn(f64) -> f64,
    }

    const FALLING: fn(f64) -> f64 = |at| 4000.0 * libm::exp2(-at / 3.0);

    impl Frame {
        fn weighed(&self, at: Fineness) -> f64 {
            // A fineness is its step and, between two of them, what a bit is worth.
            let between = f64::from(at.lambda() / crate::residual::wavelet::fineness::LAMBDA);
            (self.weighed)(f64::from(at.step().index()) + 0.5 + libm::log2(between) / 0.7)
        }

        /// The length of the payload that is found, if it has room; what is to be cut if none is long enough; and how
        /// many were written.
        fn search(&self, max: usize) -> (usize, Option<Fineness>, u32) {
            let model = |at| (1.25 * self.weighed(at) * 1.3).ln();
            let mut search = BudgetSearch::new(max, self.blocks, Learnt::default(), model);
            let (mut found, mut count) = (0, 0);
            let mut write = |search: &mut BudgetSearch<_>, weighed: f64| {
                count += 1;
                let len = (self.blocks + self.share * weighed) as usize;
                found = if len <= max { found.max(len) } else { found };
                search.written(len)
            };
            for _ in 0..10 {
                let Some(at) = search.next() else { break };
                let weighed = self.weighed(at);
                if search.chosen(at, weighed) && write(&mut search, weighed) {
                    return (found, None, count);
                }
            }
            if let Some(at) = search.unwritten() {
                search.chosen(at, self.weighed(at));
                write(&mut search, self.weighed(at));
            }
            let cut = search.too_long();
            (found, cut, count)
        }
    }

    #[test]
    fn a_payload_that_fills_the_budget_is_found_soon() {
        for max in [60, 95, 290, 1000, 3000] {
            for (blocks, share) in [(0.0, 1.25), (0.0, 1.4), (20.0, 1.25), (35.0, 1.15)] {
                let frame = Frame { blocks, share, weighed: FALLING };
                let (found, cut, count) = frame.search(max);
                assert!(found <= max && found as f64 >= USED * max as f64, "{max}: {found}");
                assert!(cut.is_none() && count <= 3, "{max} {blocks} {share}: {count} written");
            }
        }
    }

    #[test]
    fn a_wrong_share_of_the_first_guesses_is_put_right() {
        // By the first share all payloads would be 40 % shorter.
        let frame = Frame { blocks: 0.0, share: 2.0, weighed: FALLING };
        let (found, ..) = frame.search(1000);
        assert!(found <= 1000 && found as f64 >= USED * 1000.0, "{found}");
    }

    #[test]
    fn lengths_that_leap_over_the_budget_are_cut() {
        let leap = |at: f64| if at < 30.0 { 400.0 } else { 40.0 };
        let frame = Frame { blocks: 0.0, share: 1.25, weighed: leap };
        let (found, cut, count) = frame.search(300);
        assert_eq!((found, count), (50, 1));
        assert!(cut.is_some_and(|at| frame.weighed(at) == 400.0));
        // The same coefficients are not written again.
        let frame = Frame { blocks: 0.0, share: 1.25, weighed: |_| 236.0 };
        assert_eq!(frame.search(300), (295, None, 1));
        let frame = Frame { blocks: 0.0, share: 1.25, weighed: |_| 230.0 };
        let (found, cut, count) = frame.search(300);
        assert_eq!((found, cut, count), (287, None, 1));
    }
}

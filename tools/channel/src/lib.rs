//! The simulated link (`nvsprior link`), and what it shares with the programs of a working one (`nvsprior vehicle`,
//! `channel` and `console`): the channel, and the order of frames. The ends are [`nvsprior_link`].

// Not published: names that tell what they are need no comment.
#![allow(missing_docs)]

pub mod channel;
#[cfg(feature = "simulation")]
pub mod link;

/// Which of `count` frames comes at place `k`, if they are gone through forth and back.
pub fn forth_and_back(k: usize, count: usize) -> usize {
    let last = count.saturating_sub(1);
    let round = k % (2 * last).max(1);
    if round > last { 2 * last - round } else { round }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_go_forth_and_back() {
        let order: Vec<_> = (0..8).map(|k| forth_and_back(k, 4)).collect();
        assert_eq!(order, [0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!([forth_and_back(5, 1), forth_and_back(5, 0)], [0, 0]);
    }
}

//! Into how many pieces an update is cut, and how many of them are sent.

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_PIECES, MAX_SOURCES};
use crate::modem::wire::piece::{Cut, largest_chunk};
use crate::modem::wire::share::number_len;

use super::loss::Loss;

/// Chance that what is sent yields the update, if the loss is as assumed and no report asks for more.
pub const AIM: f64 = 0.99;
/// The same if reports do: what is missing then comes a little later.
pub const AIM_WITH_REPORTS: f64 = 0.9;
/// Sources up to which smaller pieces are tried: parity is then cut finer.
const TRIED: usize = 32;

/// So many pieces that `needed` of them arrive with a chance of `aim`; [`MAX_PIECES`] if none are enough.
pub fn pieces_for(needed: usize, loss: Loss, aim: f64) -> usize {
    let enough = |count: usize| loss.arrivals(count)[needed..].iter().sum::<f64>() >= aim;
    let (mut few, mut many) = (needed, MAX_PIECES);
    while few < many {
        let count = few.midpoint(many);
        match enough(count) {
            true => many = count,
            false => few = count + 1,
        }
    }
    many
}

/// The cut of an update of `len` bytes that takes fewest bytes on the link, `overhead` of each piece counted.
///
/// # Errors
/// If the MTU has no room for it.
pub fn cut(
    len: usize,
    mtu: usize,
    overhead: usize,
    loss: Loss,
    aim: f64,
) -> Result<Cut, ModemError> {
    let room = largest_chunk(mtu);
    let fits = |sources: usize| Some(Cut::new(len, sources)).filter(|cut| cut.chunk <= room);
    let fewest = (1..=MAX_SOURCES).find(|sources| fits(*sources).is_some());
    let too_long = || {
        let all = MAX_SOURCES * room;
        ModemError::UpdateTooLong { len, largest: all - number_len(all).min(all), mtu }
    };
    let fewest = fewest.ok_or_else(too_long)?;
    let cost = |cut: &Cut| {
        pieces_for(cut.sources, loss, aim).saturating_mul(cut.piece_len().saturating_add(overhead))
    };
    let tried = (fewest..=fewest.max(TRIED.min(len))).filter_map(fits);
    tried.min_by_key(cost).ok_or_else(too_long)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_are_sent_as_the_loss_asks_for() {
        let loss = |chance| Loss { chance, burst: 1.0 };
        assert_eq!(pieces_for(12, Loss::NONE, AIM), 12);
        // By the binomial distribution.
        assert_eq!(pieces_for(1, loss(0.2), AIM), 3);
        assert_eq!(pieces_for(12, loss(0.2), AIM), 20);
        assert_eq!(pieces_for(12, loss(0.2), AIM_WITH_REPORTS), 18);
        assert!(pieces_for(12, Loss { chance: 0.2, burst: 4.0 }, AIM) > 24);
        assert_eq!(pieces_for(224, loss(0.5), AIM), MAX_PIECES);
    }

    #[test]
    fn pieces_are_small_if_there_is_loss_and_large_if_there_is_none() {
        let loss = Loss { chance: 0.2, burst: 1.0 };
        assert_eq!(cut(850, 1024, 0, Loss::NONE, AIM).unwrap().sources, 1);
        let small = cut(850, 1024, 0, loss, AIM).unwrap();
        assert!((6..=32).contains(&small.sources), "{small:?}");
        // With what a frame costs besides, they are larger.
        assert!(cut(850, 1024, 60, loss, AIM).unwrap().sources < small.sources);
        for mtu in [16, 31, 64, 256, 65_535] {
            let cut = cut(1500, mtu, 0, loss, AIM).unwrap();
            assert!(cut.piece_len() <= mtu && cut.len() >= 1502, "{mtu} {cut:?}");
        }
        let refused = cut(1567, 16, 0, loss, AIM);
        assert_eq!(refused, Err(ModemError::UpdateTooLong { len: 1567, largest: 1566, mtu: 16 }));
        assert!(cut(1566, 16, 0, loss, AIM).is_ok());
    }
}

//! Shares of several packets between each other.

use std::collections::VecDeque;

use crate::modem::error::ModemError;
use crate::modem::memory::room;

use super::sharer::Sharer;

/// Puts off a packet's later shares, so that those of the next packets come between them. A burst of losses then takes
/// few shares of each packet.
///
/// It holds the shares that are not due yet: at most those of the packets that its spread covers. It keeps their memory
/// for later ones: it takes more only if more shares wait than ever before, and none if it was made [with
/// room](Interleaver::with_room) for as many.
#[derive(Clone, Debug)]
pub struct Interleaver {
    /// Seconds from a packet's first share to its last one.
    spread: f64,
    /// In the order in which they are due.
    waiting: VecDeque<Waiting>,
    sent: Waiting,
    /// Places of shares that were sent.
    spare: Vec<Vec<u8>>,
}

#[derive(Clone, Debug, Default)]
struct Waiting {
    due: f64,
    share: Vec<u8>,
}

impl Interleaver {
    /// `spread`: seconds from a packet's first share to its last one, 0 and more.
    ///
    /// # Errors
    /// If the spread is negative or not finite.
    pub fn new(spread: f64) -> Result<Interleaver, ModemError> {
        Interleaver::with_room(spread, 0, 0)
    }

    /// With room for so many shares, each of at most `mtu` bytes.
    ///
    /// # Errors
    /// If the spread is negative or not finite, or the system does not have the memory.
    pub fn with_room(spread: f64, shares: usize, mtu: usize) -> Result<Interleaver, ModemError> {
        if !(spread >= 0.0 && spread.is_finite()) {
            return Err(ModemError::RateControl { field: "spread", value: spread });
        }
        let mut waiting = VecDeque::new();
        let bytes = shares.saturating_mul(size_of::<Waiting>());
        waiting.try_reserve_exact(shares).map_err(|_| ModemError::Memory(bytes))?;
        let mut spare = room(shares.saturating_add(1))?;
        for _ in 0..shares {
            spare.push(room(mtu)?);
        }
        let sent = Waiting { due: 0.0, share: room(mtu)? };
        Ok(Interleaver { spread, waiting, sent, spare })
    }

    /// Shares that wait.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether no share waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Takes a packet's shares at `now`, seconds.
    pub fn push(&mut self, now: f64, shares: &Sharer) {
        let steps = shares.count().saturating_sub(1).max(1) as f64;
        for (index, share) in shares.shares().enumerate() {
            self.push_share(now + self.spread * index as f64 / steps, share);
        }
    }

    /// Takes a share by itself, and when it is due, seconds.
    pub fn push_share(&mut self, due: f64, bytes: &[u8]) {
        let at = self.waiting.partition_point(|waiting| waiting.due <= due);
        let mut share = self.spare.pop().unwrap_or_default();
        share.clear();
        share.extend(bytes);
        self.waiting.insert(at, Waiting { due, share });
    }

    /// The next share, if it is due at `now`: the time at which it was, and the share.
    pub fn next(&mut self, now: f64) -> Option<(f64, &[u8])> {
        self.next_len(now)?;
        let sent = std::mem::replace(&mut self.sent, self.waiting.pop_front()?);
        self.spare.push(sent.share);
        Some((self.sent.due, &self.sent.share))
    }

    /// Bytes of the next share, if it is due at `now`.
    pub fn next_len(&self, now: f64) -> Option<usize> {
        let next = self.waiting.front()?;
        (next.due <= now).then_some(next.share.len())
    }

    /// Bytes of each share that waits, with when it is due.
    pub fn waiting(&self) -> impl Iterator<Item = (f64, usize)> + '_ {
        self.waiting.iter().map(|waiting| (waiting.due, waiting.share.len()))
    }

    /// Drops the shares that are due later.
    pub fn drop_after(&mut self, due: f64) {
        let from = self.waiting.partition_point(|waiting| waiting.due <= due);
        self.spare.extend(self.waiting.drain(from..).map(|waiting| waiting.share));
    }

    /// When the next share is due, seconds.
    pub fn due(&self) -> Option<f64> {
        Some(self.waiting.front()?.due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modem::send::loss::Loss;
    use crate::modem::send::sharing::{Sharing, SharingOptions};
    use crate::modem::tests::{Recipe, packet_of};
    use nvsprior::packet::PoseProfile;

    fn shares(frame: u32) -> Sharer {
        let (profile, payload) = (PoseProfile::Short, Some(100));
        let packet = packet_of(Recipe { frame, profile, stated: false, payload });
        let sharing = Sharing::new(&SharingOptions {
            mtu: 32,
            overhead: 0,
            budget: 96,
            max_shares: 3,
            spread: 0,
            loss: Loss::NONE,
            picture: 19,
            packet: Some(packet.len()),
            whole: false,
            user: None,
        });
        let mut sharer = Sharer::default();
        sharer.share(&packet, &sharing.unwrap(), 0, None).unwrap();
        sharer
    }

    #[test]
    fn shares_of_packets_lie_between_each_other() {
        let mut interleaver = Interleaver::new(1.0).unwrap();
        let packets: Vec<_> = (0..4).map(shares).collect();
        let mut sent = Vec::new();
        for (k, packet) in packets.iter().enumerate() {
            interleaver.push(0.2 * k as f64, packet);
        }
        assert_eq!(interleaver.due(), Some(0.0));
        while let Some((due, share)) = interleaver.next(9.0) {
            let of = |packet: &Sharer| (0..3).position(|k| packet.get(k) == share);
            sent.push((due, packets.iter().position(|packet| of(packet).is_some()).unwrap()));
        }
        assert!(sent.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        let order: Vec<_> = sent.iter().map(|(_, packet)| *packet).collect();
        assert_eq!(order, [0, 1, 2, 0, 3, 1, 2, 0, 3, 1, 2, 3]);
    }

    #[test]
    fn what_is_not_due_waits() {
        let mut interleaver = Interleaver::new(0.5).unwrap();
        interleaver.push(2.0, &shares(1));
        assert!(interleaver.next(1.9).is_none());
        assert!(interleaver.next(2.0).is_some());
        assert!(interleaver.next(2.2).is_none());
        assert!(Interleaver::new(-1.0).is_err());
    }
}

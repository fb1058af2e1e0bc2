//! How many shares of an unprotected packet a budget holds.

use crate::modem::error::ModemError;
use crate::modem::wire::layout::Layout;
use nvsprior::packet::SHORT_LATENT_LEN;

use super::division::Division;
use super::rate_control::{LONGER, RateControlOptions};

/// A link that packets cross without protection.
#[derive(Clone, Copy, Debug)]
pub struct Unprotected {
    pub layout: Layout,
    /// What each modem frame costs on the link beside its bytes, as bytes.
    overhead: usize,
    /// Most shares of a packet.
    max_shares: usize,
}

impl Unprotected {
    /// # Errors
    /// If an option is outside its range: the MTU, the shares, or user bytes, for which these shares have no place.
    pub fn new(options: &RateControlOptions) -> Result<Unprotected, ModemError> {
        let RateControlOptions { mtu, overhead, max_shares, user, .. } = *options;
        let layout = Layout::new(mtu)?;
        let max = layout.max_shares();
        match user {
            Some(user) => Err(ModemError::UserBytes(user)),
            None if max_shares == 0 => Err(ModemError::UnprotectedCount { found: 0, max }),
            None => Ok(Unprotected { layout, overhead, max_shares: max_shares.min(max) }),
        }
    }

    /// How long a packet may be, bytes; `None`: the budget holds no picture.
    pub fn capacity(&self, budget: usize) -> Option<usize> {
        let full = self.full(budget);
        let frame = self.layout.mtu.saturating_add(self.overhead);
        let header = self.layout.header(full);
        let rest = budget.saturating_sub(full.saturating_mul(frame));
        let rest = match full < self.max_shares {
            true => rest.saturating_sub(self.overhead.saturating_add(header)),
            false => 0,
        };
        let capacity = self.layout.start(full) + rest + self.layout.travelling().least();
        (capacity >= SHORT_LATENT_LEN).then_some(capacity)
    }

    /// The longest packet of so many shares, bytes.
    pub fn longest(&self, shares: usize) -> usize {
        self.layout.start(shares) + self.layout.travelling().least()
    }

    /// Full shares that a budget holds.
    fn full(&self, budget: usize) -> usize {
        (budget / self.layout.mtu.saturating_add(self.overhead)).min(self.max_shares)
    }

    /// The division of a packet of `packet` bytes, whose first `picture` bytes make a picture. If the budget does not
    /// hold all of it, its end is not sent. A packet that also tells the camera takes up to three times the budget
    /// instead.
    ///
    /// # Errors
    /// If all shares together hold no picture.
    pub fn divide(
        &self,
        budget: usize,
        picture: usize,
        packet: usize,
    ) -> Result<Division, ModemError> {
        // A share that the budget holds in part is sent, too: the next packets pay for it.
        let of = |budget| {
            let all =
                self.division(self.layout.count(packet).min(self.max_shares), picture, packet);
            match all.link_bytes <= budget {
                true => all,
                false => self.division((self.full(budget) + 1).min(all.shares), picture, packet),
            }
        };
        let longer = picture > SHORT_LATENT_LEN;
        let first = of(budget);
        if first.packet_bytes == packet || !longer && first.packet_bytes >= picture {
            return Ok(first);
        }
        let others = [of(budget.saturating_mul(LONGER)), of(usize::MAX)];
        let mut enough = others.into_iter().filter(|division| division.packet_bytes >= picture);
        enough.next().ok_or(ModemError::Budget { budget, picture })
    }

    /// Of the first so many shares.
    fn division(&self, shares: usize, picture: usize, packet: usize) -> Division {
        let header_bytes = self.layout.headers(shares);
        let packet_bytes = self.layout.start(shares).min(packet);
        let bytes = packet_bytes + header_bytes;
        Division {
            shares,
            share_bytes: self.layout.mtu.min(packet_bytes + self.layout.header(0)),
            header_bytes,
            picture_shares: self.layout.count(picture),
            whole_shares: shares,
            packet_bytes,
            left_out: 0,
            link_bytes: self.overhead.saturating_mul(shares).saturating_add(bytes),
        }
    }

    /// The division of a packet that has the link to itself.
    ///
    /// # Errors
    /// If it takes more shares than a packet may have.
    pub fn whole(&self, picture: usize, packet: usize) -> Result<Division, ModemError> {
        let shares = self.layout.count_of(packet, self.max_shares)?;
        Ok(self.division(shares, picture, packet))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modem::send::loss::Loss;

    fn unprotected(mtu: usize, overhead: usize, max_shares: usize) -> Unprotected {
        let options = RateControlOptions {
            bit_rate: 1.0,
            mtu,
            overhead,
            latency: 1.0,
            delay: 0.0,
            spread: 0.0,
            frame_rate: 1.0,
            min_bytes: 0,
            max_shares,
            loss: Loss::NONE,
            user: None,
        };
        Unprotected::new(&options).unwrap()
    }

    #[test]
    fn a_budget_holds_as_much_as_it_says_and_no_more() {
        for (mtu, overhead) in [(16, 0), (31, 0), (31, 7), (64, 0), (256, 3)] {
            let link = unprotected(mtu, overhead, 4096);
            for budget in 0..1500 {
                let Some(capacity) = link.capacity(budget) else {
                    assert!(budget < SHORT_LATENT_LEN + 5 + 2 * overhead);
                    continue;
                };
                // The low byte of the frame number does not travel.
                let capacity = capacity - 1;
                let fits = link.divide(budget, SHORT_LATENT_LEN - 1, capacity).unwrap();
                assert_eq!(fits.packet_bytes, capacity, "{mtu} {overhead} {budget}");
                assert!(fits.link_bytes <= budget, "{mtu} {overhead} {budget}: {fits:?}");
                // Of a longer packet, the share in which the budget ends is the last one.
                let cut = link.divide(budget, SHORT_LATENT_LEN - 1, capacity + 500).unwrap();
                assert!((capacity..=capacity + mtu).contains(&cut.packet_bytes), "{cut:?}");
                assert!((budget..=budget + mtu + overhead).contains(&cut.link_bytes), "{cut:?}");
            }
        }
    }

    #[test]
    fn a_packet_that_tells_the_camera_takes_more() {
        let link = unprotected(64, 0, 8);
        assert_eq!(link.divide(128, 49, 400).unwrap().shares, 7);
        assert_eq!(link.divide(128, 19, 400).unwrap().shares, 3);
        assert_eq!(link.divide(10, 49, 60).unwrap().shares, 1);
        let refused = unprotected(31, 0, 1).divide(10, 49, 60);
        assert_eq!(refused, Err(ModemError::Budget { budget: 10, picture: 49 }));
        let (len, largest, mtu) = (500, 62 + 7 * 60, 64);
        assert_eq!(link.whole(19, 500), Err(ModemError::PacketTooLong { len, largest, mtu }));
    }
}

//! What a packet may cost on the link. The encoder says it to the payloader, beside each packet.

use nvsprior::modem::{Loss, ModemError, RateControl, RateControlOptions, Sharing, SharingOptions};

/// Name of the meta that carries a budget.
const META: &str = "NvspriorBudgetMeta";

/// What a division of a packet depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// What the link carries, bit/s.
    pub bit_rate: f64,
    pub mtu: u32,
    pub overhead: u32,
    pub shares: u32,
    /// Time from a packet's first share to its last one, seconds.
    pub spread: f64,
    pub loss: Loss,
    /// Bytes for all shares.
    pub bytes: u32,
    /// Bytes of each modem frame for number and tag. `mtu` has none of them, and `overhead` has them all.
    pub tag: u32,
}

/// Makes the meta known. Again does nothing.
pub fn register() {
    if !gst::meta::CustomMeta::is_registered(META) {
        gst::meta::CustomMeta::register_simple(META);
    }
}

impl Budget {
    /// The budget of a rate control for one packet.
    pub fn of(control: &RateControl, bytes: usize, tag: u32) -> Budget {
        let options = control.options();
        Budget {
            bit_rate: options.bit_rate,
            mtu: options.mtu as u32,
            overhead: options.overhead as u32,
            shares: options.max_shares as u32,
            spread: options.spread,
            loss: options.loss,
            bytes: u32::try_from(bytes).unwrap_or(u32::MAX),
            tag,
        }
    }

    /// How a packet is divided. Encoder and payloader both ask, and get the same.
    pub fn divide(&self, picture: usize, packet: usize) -> Result<Sharing, ModemError> {
        let control = RateControl::new(RateControlOptions {
            bit_rate: self.bit_rate,
            mtu: self.mtu as usize,
            overhead: self.overhead as usize,
            latency: self.spread + 1.0,
            delay: 0.0,
            spread: self.spread,
            frame_rate: 1.0,
            min_bytes: 0,
            max_shares: self.shares as usize,
            loss: self.loss,
            user: None,
        })?;
        control.divide(self.bytes as usize, picture, packet)
    }

    /// Bytes that a division takes on the link.
    pub fn cost(&self, sharing: &Sharing) -> usize {
        sharing.count() * (sharing.share_len() + self.overhead as usize)
    }

    /// Puts it beside a packet.
    pub fn attach(&self, buffer: &mut gst::BufferRef) -> Result<(), gst::glib::BoolError> {
        let mut meta = gst::meta::CustomMeta::add(buffer, META)?;
        let structure = meta.mut_structure();
        structure.set("bit-rate", self.bit_rate);
        structure.set("mtu", self.mtu);
        structure.set("overhead", self.overhead);
        structure.set("shares", self.shares);
        structure.set("spread", self.spread);
        structure.set("loss", self.loss.chance);
        structure.set("burst", self.loss.burst);
        structure.set("bytes", self.bytes);
        structure.set("tag", self.tag);
        Ok(())
    }

    /// The one beside a packet, if there is one.
    pub fn beside(buffer: &gst::BufferRef) -> Option<Budget> {
        let meta = gst::meta::CustomMeta::from_buffer(buffer, META).ok()?;
        let structure = meta.structure();
        let number = |name| structure.get::<f64>(name).ok();
        let count = |name| structure.get::<u32>(name).ok();
        Some(Budget {
            bit_rate: number("bit-rate")?,
            mtu: count("mtu")?,
            overhead: count("overhead")?,
            shares: count("shares")?,
            spread: number("spread")?,
            loss: Loss { chance: number("loss")?, burst: number("burst")? },
            bytes: count("bytes")?,
            tag: count("tag")?,
        })
    }

    /// The fewest bytes that protect a whole packet about as well as many would, in place of [`Budget::bytes`].
    pub fn fit(&mut self, picture: usize, packet: usize) -> Result<Sharing, ModemError> {
        let header = 8 + self.overhead as usize;
        let data = (self.mtu as usize).saturating_sub(8).max(1);
        let fewest = packet.div_ceil(data);
        let needed = packet + 16 + (fewest + 1) * header;
        let spread = (self.spread * self.bit_rate / 8.0) as usize;
        let of = |whole| {
            PARTS.map(|part| {
                Sharing::new(&SharingOptions {
                    mtu: self.mtu as usize,
                    overhead: self.overhead as usize,
                    budget: (part * needed as f64) as usize,
                    // All numbers of shares are tried. Beyond three times as many as are needed none is better.
                    max_shares: (self.shares as usize).min(3 * fewest + 4),
                    spread,
                    loss: self.loss,
                    picture,
                    packet: Some(packet),
                    whole,
                    user: None,
                })
            })
        };
        let whole = of(true);
        let all = if whole.iter().any(Result::is_ok) { whole } else { of(false) };
        let worths = all.iter().flatten().map(Sharing::worth);
        let enough = worths.fold(f64::NEG_INFINITY, f64::max) - THRIFT;
        if let Some(sharing) = all.iter().flatten().find(|sharing| sharing.worth() >= enough) {
            self.bytes = self.cost(sharing) as u32;
            return Ok(*sharing);
        }
        let [.., last] = all;
        last
    }
}

/// Budgets that are tried, of what the packet takes without any protection.
const PARTS: [f64; 8] = [1.0, 1.1, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0];
/// What fewer bytes may be worth less, dB; as in [`RateControl::divide`].
const THRIFT: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: Budget = Budget {
        bit_rate: 20_000.0,
        mtu: 64,
        overhead: 2,
        shares: 16,
        spread: 0.5,
        loss: Loss { chance: 0.1, burst: 2.0 },
        bytes: 200,
        tag: 0,
    };

    #[test]
    fn it_travels_with_a_buffer() {
        gst::init().unwrap();
        register();
        register();
        let mut buffer = gst::Buffer::from_slice([1, 2, 3]);
        assert_eq!(Budget::beside(&buffer), None);
        BUDGET.attach(buffer.make_mut()).unwrap();
        assert_eq!(Budget::beside(&buffer), Some(BUDGET));
        assert_eq!(Budget::beside(&buffer.copy()), Some(BUDGET));
    }

    #[test]
    fn both_sides_divide_alike_as_the_rate_control_does() {
        let control = RateControl::new(RateControlOptions {
            bit_rate: BUDGET.bit_rate,
            mtu: 64,
            overhead: 2,
            latency: 2.0,
            delay: 0.3,
            spread: BUDGET.spread,
            frame_rate: 10.0,
            min_bytes: 40,
            max_shares: 16,
            loss: BUDGET.loss,
            user: None,
        });
        let control = control.unwrap();
        let own = Budget::of(&control, 200, 0);
        assert_eq!(own, BUDGET);
        assert_eq!(own.divide(20, 150), control.divide(200, 20, 150));
        let sharing = own.divide(20, 150).unwrap();
        assert_eq!(own.cost(&sharing), control.cost(&sharing));
    }

    #[test]
    fn a_budget_that_fits_holds_the_packet() {
        for packet in [49, 150, 700] {
            for (loss, most) in [(0.0, 1.35), (0.1, 2.6), (0.3, 3.5)] {
                let loss = Loss { chance: loss, burst: 1.0 };
                let mut budget = Budget { loss, shares: 32, ..BUDGET };
                let sharing = budget.fit(20, packet).unwrap();
                assert!(sharing.capacity() >= packet, "{packet} {loss:?}");
                let least = packet as f64 + 25.0;
                assert!(f64::from(budget.bytes) <= most * least + 60.0, "{packet} {budget:?}");
            }
        }
        let mut few = Budget { shares: 2, ..BUDGET };
        assert!(few.fit(20, 700).is_ok_and(|sharing| sharing.capacity() < 700));
        let mut none = Budget { shares: 1, mtu: 16, ..BUDGET };
        assert!(none.fit(20, 700).is_err());
    }
}

//! A binary range coder with probabilities of 16 bits (carry-less, after Mahoney's lpaq).

/// Chance of a one, of 65,536: 1 to 65,535.
pub type Probability = u16;

/// Even odds.
pub const EVEN: Probability = 1 << 15;

/// The interval that the bits so far leave.
#[derive(Clone, Copy)]
struct Interval {
    low: u32,
    high: u32,
}

impl Interval {
    const ALL: Interval = Interval { low: 0, high: u32::MAX };

    /// The last number that stands for a one.
    fn split(self, one: Probability) -> u32 {
        let range = u64::from(self.high - self.low);
        self.low + ((range * u64::from(one)) >> 16) as u32
    }

    fn take(&mut self, bit: bool, split: u32) {
        if bit { self.high = split } else { self.low = split + 1 }
    }

    /// The first byte, if it is settled; the interval goes on behind it.
    fn settled(&mut self) -> Option<u8> {
        let settled = (self.low ^ self.high) >> 24 == 0;
        settled.then(|| {
            let byte = (self.high >> 24) as u8;
            (self.low, self.high) = (self.low << 8, self.high << 8 | 0xFF);
            byte
        })
    }
}

pub struct RangeEncoder<'a> {
    bytes: &'a mut Vec<u8>,
    /// Most bytes that are written.
    max: usize,
    /// More were due.
    over: bool,
    interval: Interval,
}

impl<'a> RangeEncoder<'a> {
    /// Appends to `bytes`, which must be empty; `max` of them at most.
    pub fn new(bytes: &'a mut Vec<u8>, max: usize) -> RangeEncoder<'a> {
        RangeEncoder { bytes, max, over: false, interval: Interval::ALL }
    }

    fn push(&mut self, byte: u8) {
        if self.bytes.len() < self.max {
            self.bytes.push(byte);
        } else {
            self.over = true;
        }
    }

    pub fn put(&mut self, bit: bool, one: Probability) {
        let split = self.interval.split(one);
        self.interval.take(bit, split);
        while let Some(byte) = self.interval.settled() {
            self.push(byte);
        }
    }

    /// Ends with as few bytes as tell the bits, if zeros follow. Whether all of them had room.
    pub fn finish(mut self) -> bool {
        let Interval { low, high } = self.interval;
        for count in 0..=4u32 {
            let below = u32::MAX.checked_shr(8 * count).unwrap_or(0);
            let value = low.checked_add(below).map(|v| v & !below);
            if let Some(value) = value.filter(|v| (low..=high).contains(v)) {
                for byte in &value.to_be_bytes()[..count as usize] {
                    self.push(*byte);
                }
                break;
            }
        }
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        !self.over
    }
}

/// What follows the bytes of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tail {
    /// Zeros: the stream is whole.
    Zeros,
    /// Bytes that are not known: the stream was cut.
    Unknown,
}

pub struct RangeDecoder<'a> {
    bytes: std::slice::Iter<'a, u8>,
    interval: Interval,
    /// The number read, if zeros follow; if the largest bytes follow.
    min: u32,
    max: u32,
    /// Bytes read beyond the end.
    beyond: u32,
    tail: Tail,
}

impl<'a> RangeDecoder<'a> {
    /// Reads from the start of a stream.
    pub fn new(bytes: &'a [u8], tail: Tail) -> RangeDecoder<'a> {
        let (interval, bytes) = (Interval::ALL, bytes.iter());
        let mut decoder = RangeDecoder { bytes, interval, min: 0, max: 0, beyond: 0, tail };
        for _ in 0..4 {
            decoder.next_byte();
        }
        decoder
    }

    /// What follows the bytes is not known, from here on.
    pub fn cut(&mut self) {
        self.tail = Tail::Unknown;
        self.max = self.min | u32::MAX.checked_shr(32 - 8 * self.beyond).unwrap_or(0);
    }

    fn next_byte(&mut self) {
        let (min, max) = match self.bytes.next() {
            Some(byte) => (*byte, *byte),
            None => {
                self.beyond = (self.beyond + 1).min(4);
                (0, if self.tail == Tail::Zeros { 0 } else { 0xFF })
            }
        };
        self.min = self.min << 8 | u32::from(min);
        self.max = self.max << 8 | u32::from(max);
    }

    /// The next bit; `None` if the bytes at hand do not tell it.
    pub fn get(&mut self, one: Probability) -> Option<bool> {
        let split = self.interval.split(one);
        let bit = self.min <= split;
        if bit != (self.max <= split) {
            return None;
        }
        self.interval.take(bit, split);
        while self.interval.settled().is_some() {
            self.next_byte();
        }
        Some(bit)
    }
}

/// Codes a bit, and returns it. A reader does not look at the bit that it is given.
pub trait Bits {
    fn bit(&mut self, one: Probability, bit: bool) -> bool;
}

impl Bits for RangeEncoder<'_> {
    fn bit(&mut self, one: Probability, bit: bool) -> bool {
        self.put(bit, one);
        bit
    }
}

/// Reads a stream that is whole: zeros follow it.
pub struct WholeReader<'a>(RangeDecoder<'a>);

impl<'a> WholeReader<'a> {
    pub fn new(bytes: &'a [u8]) -> WholeReader<'a> {
        WholeReader(RangeDecoder::new(bytes, Tail::Zeros))
    }
}

impl Bits for WholeReader<'_> {
    fn bit(&mut self, one: Probability, _: bool) -> bool {
        // If zeros follow, every bit can be told.
        self.0.get(one).unwrap_or(false)
    }
}

/// Reads a stream that may be cut. What its bytes do not tell reads as zeros.
pub struct StartReader<'a, 'b> {
    decoder: &'a mut RangeDecoder<'b>,
    /// Something was not told.
    pub has_ended: bool,
}

impl<'a, 'b> StartReader<'a, 'b> {
    pub fn new(decoder: &'a mut RangeDecoder<'b>) -> StartReader<'a, 'b> {
        StartReader { decoder, has_ended: false }
    }
}

impl Bits for StartReader<'_, '_> {
    fn bit(&mut self, one: Probability, _: bool) -> bool {
        let bit = if self.has_ended { None } else { self.decoder.get(one) };
        self.has_ended = bit.is_none();
        bit.unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn encode(bits: &[(bool, Probability)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = RangeEncoder::new(&mut bytes, usize::MAX);
        for (bit, one) in bits {
            encoder.put(*bit, *one);
        }
        assert!(encoder.finish());
        bytes
    }

    fn bits() -> impl Strategy<Value = Vec<(bool, Probability)>> {
        proptest::collection::vec((any::<bool>(), 1..=u16::MAX), 0..400)
    }

    proptest! {
        #[test]
        fn bits_come_back(bits in bits()) {
            let bytes = encode(&bits);
            let mut decoder = RangeDecoder::new(&bytes, Tail::Zeros);
            for (bit, one) in bits {
                prop_assert_eq!(decoder.get(one), Some(bit));
            }
        }

        #[test]
        fn a_cut_stream_gives_true_bits_or_none(bits in bits(), cut in any::<prop::sample::Index>()) {
            let bytes = encode(&bits);
            let bytes = &bytes[..cut.index(bytes.len() + 1)];
            let mut decoder = RangeDecoder::new(bytes, Tail::Unknown);
            for (bit, one) in bits {
                match decoder.get(one) {
                    Some(found) => prop_assert_eq!(found, bit),
                    None => break,
                }
            }
        }

        #[test]
        fn bits_cost_what_their_chances_say(bits in bits()) {
            let cost = |(bit, one): &(bool, Probability)| {
                let one = f64::from(*one) / 65_536.0;
                -(if *bit { one } else { 1.0 - one }).log2()
            };
            let bytes = encode(&bits).len() as f64;
            let ideal = bits.iter().map(cost).sum::<f64>() / 8.0;
            prop_assert!(bytes < ideal * 1.002 + 4.0, "{} bytes for {}", bytes, ideal);
        }
    }
}

//! An adaptive binary range coder. Integer arithmetic only: the same bytes on every machine.

/// Fraction bits of a probability.
const PROBABILITY_BITS: u32 = 16;

/// Below this range a byte goes out, or comes in.
const LEAST_RANGE: u32 = 1 << 24;

/// How likely the next bit of a context is a zero: the mean of a fast and a slow estimate.
#[derive(Clone, Copy)]
pub struct Bit {
    fast: u16,
    slow: u16,
}

impl Bit {
    /// Nothing known yet.
    pub const NEW: Bit = Bit { fast: 1 << 15, slow: 1 << 15 };

    /// The part of `range` that a zero takes; neither part is empty.
    fn split(self, range: u32) -> u32 {
        let zero = (u32::from(self.fast) + u32::from(self.slow)) >> 1;
        (range >> PROBABILITY_BITS) * zero.clamp(64, (1 << PROBABILITY_BITS) - 64)
    }

    fn learn(&mut self, bit: bool) {
        let step = |p: &mut u16, rate: u32| {
            let target = if bit { 0 } else { u16::MAX };
            if target > *p { *p += (target - *p) >> rate } else { *p -= (*p - target) >> rate }
        };
        step(&mut self.fast, 4);
        step(&mut self.slow, 7);
    }
}

/// One side of the coder: models say what is coded, whichever side it is, so that the two sides
/// cannot disagree.
pub trait Coder {
    /// Codes one bit. The writer takes `bit`, the reader takes no notice of it; both return the bit.
    fn bit(&mut self, context: &mut Bit, bit: bool) -> bool;

    /// Codes the low `count` bits of `value`, at most 32, without a model.
    fn raw(&mut self, count: u32, value: u32) -> u32;
}

/// The writing side.
pub struct Writer {
    low: u64,
    range: u32,
    /// The byte held back until it is known whether a carry reaches it, and how many 0xff follow it.
    held: u8,
    followers: usize,
    bytes: Vec<u8>,
}

impl Writer {
    /// Nothing written yet.
    pub fn new() -> Writer {
        Writer { low: 0, range: u32::MAX, held: 0, followers: 0, bytes: Vec::new() }
    }

    /// All that was written.
    pub fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        self.bytes
    }

    /// Moves the top byte of `low` out.
    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        let top = (self.low >> 24) as u8;
        if carry == 1 || top != 0xff {
            self.bytes.push(self.held.wrapping_add(carry));
            let follower = 0xff_u8.wrapping_add(carry);
            self.bytes.extend(std::iter::repeat_n(follower, self.followers));
            (self.held, self.followers) = (top, 0);
        } else {
            self.followers += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    fn narrow(&mut self, start: u32, range: u32) {
        self.low += u64::from(start);
        self.range = range;
        while self.range < LEAST_RANGE {
            self.range <<= 8;
            self.shift();
        }
    }
}

impl Coder for Writer {
    fn bit(&mut self, context: &mut Bit, bit: bool) -> bool {
        let split = context.split(self.range);
        if bit {
            self.narrow(split, self.range - split)
        } else {
            self.narrow(0, split)
        }
        context.learn(bit);
        bit
    }

    fn raw(&mut self, count: u32, value: u32) -> u32 {
        for place in (0..count).rev() {
            let half = self.range >> 1;
            if value >> place & 1 == 1 { self.narrow(half, half) } else { self.narrow(0, half) }
        }
        value
    }
}

/// The reading side. Behind the end of its bytes it reads zeros, and counts them.
pub struct Reader<'a> {
    bytes: &'a [u8],
    next: usize,
    range: u32,
    code: u32,
}

impl<'a> Reader<'a> {
    /// Reads what a [`Writer`] wrote.
    pub fn new(bytes: &'a [u8]) -> Reader<'a> {
        let mut reader = Reader { bytes, next: 1, range: u32::MAX, code: 0 };
        for _ in 0..4 {
            reader.code = reader.code << 8 | reader.byte();
        }
        reader
    }

    /// Bytes taken so far; more than there are where they ended too early.
    pub fn taken(&self) -> usize {
        self.next
    }

    fn byte(&mut self) -> u32 {
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.next = self.next.saturating_add(1);
        u32::from(byte)
    }

    fn narrow(&mut self, start: u32, range: u32) {
        self.code -= start;
        self.range = range;
        while self.range < LEAST_RANGE {
            self.range <<= 8;
            self.code = self.code << 8 | self.byte();
        }
    }
}

impl Coder for Reader<'_> {
    fn bit(&mut self, context: &mut Bit, _: bool) -> bool {
        let split = context.split(self.range);
        let bit = self.code >= split;
        if bit {
            self.narrow(split, self.range - split)
        } else {
            self.narrow(0, split)
        }
        context.learn(bit);
        bit
    }

    fn raw(&mut self, count: u32, _: u32) -> u32 {
        let mut value = 0;
        for _ in 0..count {
            let half = self.range >> 1;
            let bit = self.code >= half;
            if bit {
                self.narrow(half, half)
            } else {
                self.narrow(0, half)
            }
            value = value << 1 | u32::from(bit);
        }
        value
    }
}

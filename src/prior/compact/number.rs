//! Models of the numbers in a compact prior: how long a number is, which sign it has, and its top
//! bits are learnt, by context; the bits below are written as they are.

use super::coder::{Bit, Coder};

/// Bits below the leading one that are learnt.
const LEARNT_BITS: u32 = 2;

/// A tree of `LEAVES` numbers, coded bit by bit from the top.
#[derive(Clone)]
struct Tree<const LEAVES: usize>([Bit; LEAVES]);

impl<const LEAVES: usize> Tree<LEAVES> {
    const NEW: Tree<LEAVES> = Tree([Bit::NEW; LEAVES]);

    fn code(&mut self, coder: &mut impl Coder, value: u32) -> u32 {
        let mut node = 1;
        for place in (0..LEAVES.ilog2()).rev() {
            let bit = coder.bit(&mut self.0[node], value >> place & 1 == 1);
            node = 2 * node + usize::from(bit);
        }
        (node - LEAVES) as u32
    }
}

/// A model of signed numbers of up to 31 bits, in one context.
#[derive(Clone)]
pub struct Signed {
    length: Tree<32>,
    top: [Tree<4>; 32],
    sign: [Bit; 32],
}

impl Signed {
    /// Nothing known yet.
    pub const NEW: Signed =
        Signed { length: Tree::NEW, top: [Tree::NEW; 32], sign: [Bit::NEW; 32] };

    /// Codes a number; returns it.
    pub fn code(&mut self, coder: &mut impl Coder, value: i32) -> i32 {
        let magnitude = value.unsigned_abs();
        let length = self.length.code(coder, 32 - magnitude.leading_zeros());
        if length == 0 {
            return 0;
        }
        let magnitude = code_tail(coder, &mut self.top[length as usize], length, magnitude);
        let negative = coder.bit(&mut self.sign[length as usize], value < 0);
        if negative { -(magnitude as i32) } else { magnitude as i32 }
    }
}

/// Codes what follows the leading one of a number of `length` bits, 1 to 31; returns the number.
fn code_tail(coder: &mut impl Coder, top: &mut Tree<4>, length: u32, value: u32) -> u32 {
    let below = length - 1;
    let learnt = below.min(LEARNT_BITS);
    let rest = below - learnt;
    // Short numbers use a corner of the tree: their missing bits are zeros, and cost nothing.
    let pad = LEARNT_BITS - learnt;
    let bits = top.code(coder, (value >> rest & ((1 << learnt) - 1)) << pad) >> pad;
    let low = coder.raw(rest, value & ((1 << rest) - 1));
    (1 << learnt | bits) << rest | low
}

/// A model of rising numbers of up to 96 bits: of the steps between them.
pub struct Rising {
    length: Vec<Tree<128>>,
    top: Vec<Tree<4>>,
    previous: u128,
    previous_length: u32,
}

impl Rising {
    /// Nothing known yet.
    pub fn new() -> Rising {
        Rising {
            length: vec![Tree::NEW; 128],
            top: vec![Tree::NEW; 128],
            previous: 0,
            previous_length: 0,
        }
    }

    /// Codes a number not less than the last; returns it. What a reader gives is not less than the
    /// last, whatever the bytes.
    pub fn code(&mut self, coder: &mut impl Coder, value: u128) -> u128 {
        let step = value.wrapping_sub(self.previous);
        let context = &mut self.length[self.previous_length as usize];
        let length = context.code(coder, 128 - step.leading_zeros());
        self.previous_length = length;
        let step = self.code_step(coder, length, step);
        self.previous = self.previous.saturating_add(step);
        self.previous
    }

    fn code_step(&mut self, coder: &mut impl Coder, length: u32, step: u128) -> u128 {
        if length == 0 {
            return 0;
        }
        // The upper bits as a number of their own, the rest in words.
        let rest = (length - 1).saturating_sub(LEARNT_BITS);
        let upper = (step >> rest) as u32;
        let top = &mut self.top[length as usize];
        let mut value = u128::from(code_tail(coder, top, length - rest, upper));
        for word in (0..rest.div_ceil(32)).rev() {
            let bits = (rest - 32 * word).min(32);
            let mask = u32::MAX >> (32 - bits);
            let low = coder.raw(bits, (step >> (32 * word)) as u32 & mask);
            value = value << bits | u128::from(low);
        }
        value
    }
}

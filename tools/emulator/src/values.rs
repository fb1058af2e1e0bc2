//! Operations on words. Floats are rounded after each operation; nothing is contracted.

/// Operations on one word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum One {
    Same,
    FNegate,
    SNegate,
    Not,
    LogicalNot,
    BitCount,
    FToU,
    FToS,
    UToF,
    SToF,
    FAbs,
    Floor,
    Ceil,
    Sin,
    Cos,
    Exp,
    Log,
    Exp2,
    Sqrt,
    FindUMsb,
}

/// Operations on two words.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Two {
    IAdd,
    ISub,
    IMul,
    UDiv,
    UMod,
    And,
    Or,
    Xor,
    ShiftLeft,
    ShiftRight,
    ShiftRightSigned,
    IEqual,
    INotEqual,
    ULess,
    ULessEqual,
    SLess,
    SLessEqual,
    FAdd,
    FSub,
    FMul,
    FDiv,
    FMin,
    FMax,
    FEqual,
    FNotEqual,
    FLess,
    FLessEqual,
    /// True if the operands are unordered, or as the name says.
    UnorderedEqual,
    UnorderedNotEqual,
    UnorderedLess,
    UnorderedLessEqual,
}

fn of_float(f: impl Fn(f32) -> f32, word: u32) -> u32 {
    f(f32::from_bits(word)).to_bits()
}

pub fn one(op: One, a: u32) -> u32 {
    match op {
        One::Same => a,
        One::FNegate => a ^ 0x8000_0000,
        One::SNegate => a.wrapping_neg(),
        One::Not => !a,
        One::LogicalNot => a ^ 1,
        One::BitCount => a.count_ones(),
        One::FToU => f32::from_bits(a) as u32,
        One::FToS => f32::from_bits(a) as i32 as u32,
        One::UToF => (a as f32).to_bits(),
        One::SToF => (a as i32 as f32).to_bits(),
        One::FAbs => a & 0x7fff_ffff,
        One::Floor => of_float(f32::floor, a),
        One::Ceil => of_float(f32::ceil, a),
        One::Sin => of_float(f32::sin, a),
        One::Cos => of_float(f32::cos, a),
        One::Exp => of_float(f32::exp, a),
        One::Log => of_float(f32::ln, a),
        One::Exp2 => of_float(f32::exp2, a),
        One::Sqrt => of_float(f32::sqrt, a),
        One::FindUMsb => 31_u32.wrapping_sub(a.leading_zeros()),
    }
}

/// `None` if it divides by zero. Shifts take the lower five bits of their distance.
pub fn two(op: Two, a: u32, b: u32) -> Option<u32> {
    let (x, y) = (f32::from_bits(a), f32::from_bits(b));
    Some(match op {
        Two::IAdd => a.wrapping_add(b),
        Two::ISub => a.wrapping_sub(b),
        Two::IMul => a.wrapping_mul(b),
        Two::UDiv => a.checked_div(b)?,
        Two::UMod => a.checked_rem(b)?,
        Two::And => a & b,
        Two::Or => a | b,
        Two::Xor => a ^ b,
        Two::ShiftLeft => a.wrapping_shl(b),
        Two::ShiftRight => a.wrapping_shr(b),
        Two::ShiftRightSigned => (a as i32).wrapping_shr(b) as u32,
        Two::IEqual => (a == b).into(),
        Two::INotEqual => (a != b).into(),
        Two::ULess => (a < b).into(),
        Two::ULessEqual => (a <= b).into(),
        Two::SLess => ((a as i32) < b as i32).into(),
        Two::SLessEqual => (a as i32 <= b as i32).into(),
        Two::FAdd => (x + y).to_bits(),
        Two::FSub => (x - y).to_bits(),
        Two::FMul => (x * y).to_bits(),
        Two::FDiv => (x / y).to_bits(),
        Two::FMin => x.min(y).to_bits(),
        Two::FMax => x.max(y).to_bits(),
        Two::FEqual => (x == y).into(),
        Two::FNotEqual => x.partial_cmp(&y).is_some_and(|order| order.is_ne()).into(),
        Two::FLess => (x < y).into(),
        Two::FLessEqual => (x <= y).into(),
        Two::UnorderedEqual => x.partial_cmp(&y).is_none_or(|order| order.is_eq()).into(),
        Two::UnorderedNotEqual => (x != y).into(),
        Two::UnorderedLess => (!(x >= y)).into(),
        Two::UnorderedLessEqual => (!(x > y)).into(),
    })
}

/// `a b + c`, rounded once.
pub fn fma(a: u32, b: u32, c: u32) -> u32 {
    f32::from_bits(a).mul_add(f32::from_bits(b), f32::from_bits(c)).to_bits()
}

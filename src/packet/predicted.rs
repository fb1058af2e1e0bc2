//! The predicted form of a latent part: the pose as what it differs by from one that both sides compute from poses that
//! the topside holds. All in integers, so that both sides have the same bits.

use super::bytes::crc16;
use super::error::{PacketError, Part};
use super::form::{Follows, PREDICTED_FRAMES, WHOLE};
use super::pose::{QuantisedPose, ShortCode};
use super::residual;
use crate::search::{SHORT_CENTRE_MAX, SHORT_SMALL_MAX, SHORT_SMALL_STEPS, SMALL_ZERO};

/// High four bits of the first byte. It differs in two bits from that of the other forms, and a share begins with it
/// as with theirs.
const MAGIC: u8 = 0x8;
/// Bytes in front of the pose.
const HEAD: usize = 2;
/// Bytes of the check.
const CHECK: usize = 2;

/// Frames between a frame and its reference at most.
pub(crate) const FARTHEST: u32 = 1 << DISTANCE_BITS;
const DISTANCE_BITS: u32 = 6;
/// Frames between the reference and the frame before it that tells the motion.
pub(crate) const LONGEST_BASE: u32 = (1 << BASE_BITS) - 1;
const BASE_BITS: u32 = 3;
/// Bits that select the Rice parameter of three numbers, and the least parameter.
const SCALE_BITS: u32 = 3;
const LEAST_PARAMETER: u32 = 2;
/// Most bytes of a pose. A longer one has the short form, which then has no more bytes.
const LONGEST: usize = 14;

/// A pose as the predicted form writes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    code: PoseBits,
    /// Check of all that both sides must agree in.
    context: u32,
}

impl Prediction {
    /// Bytes of the latent part.
    pub(super) fn latent_len(&self) -> usize {
        HEAD + self.code.len() + CHECK
    }

    /// Appends the latent part.
    pub(super) fn write(&self, follows: &Follows, frame: u32, bytes: &mut Vec<u8>) {
        let first = MAGIC << 4 | follows.residual;
        let number = WHOLE | (frame % PREDICTED_FRAMES) as u8;
        bytes.extend_from_slice(&[first, number]);
        bytes.extend(self.code.bytes());
        let check = check(self.context, first, &bytes[HEAD..]);
        bytes.extend_from_slice(&check.to_le_bytes());
    }

    /// How a pose is stated as what it differs by from its prediction; `None`: it takes more than the short form.
    pub(super) fn of(pose: &ShortCode, from: &From) -> Option<Prediction> {
        let predicted = from.predict()?;
        if predicted.largest != pose.largest {
            return None;
        }
        let Offsets(offsets) = Offsets::between(pose, &predicted);
        let code = PoseBits::write(from.distance, from.base, &offsets)?;
        Some(Prediction { code, context: from.context })
    }

    /// Bits of the pose.
    pub(super) fn bits(&self) -> u32 {
        self.code.count
    }
}

/// Where a pose is predicted from.
pub(super) struct From {
    /// How many frames before it the reference came.
    pub distance: u32,
    pub reference: ShortCode,
    /// How many frames before the reference the other one came that tells the motion; 0: none does.
    pub base: u32,
    pub before: Option<ShortCode>,
    /// Check of all that both sides must agree in.
    pub context: u32,
}

impl From {
    /// The pose if the motion goes on. `None`: the other frame's rotation lies far off.
    fn predict(&self) -> Option<ShortCode> {
        let reference = self.reference;
        let Some(before) = self.before else { return Some(reference) };
        let (ahead, base) = (i64::from(self.distance), i64::from(self.base));
        let centre = [0, 1, 2].map(|i| {
            let moved = i64::from(reference.centre[i] - before.centre[i]) * ahead;
            let to = i64::from(reference.centre[i]) + rounded(moved, base);
            to.clamp((-SHORT_CENTRE_MAX - 1).into(), SHORT_CENTRE_MAX.into()) as i32
        });
        let (now, then) = (quaternion(&reference), quaternion(&before));
        let along: i64 = now.iter().zip(then).map(|(a, b)| a * b).sum();
        let sign = if along < 0 { -1 } else { 1 };
        let turned: [i64; 4] =
            std::array::from_fn(|i| now[i] * base + (now[i] - sign * then[i]) * ahead);
        let largest = reference.largest;
        let length = turned.iter().map(|v| v * v).sum::<i64>().isqrt();
        if turned[largest] <= 0 || length == 0 {
            return None;
        }
        let others = [0, 1, 2].map(|i| if i < largest { i } else { i + 1 });
        let small = others.map(|i| {
            let steps = rounded(turned[i] * UNIT, length * i64::from(SHORT_SMALL_STEPS));
            steps.clamp((-SHORT_SMALL_MAX - 1).into(), SHORT_SMALL_MAX.into()) as i32
        });
        Some(ShortCode { centre, largest, small })
    }
}

/// Square of a quaternion's length, in compact steps.
const UNIT_SQUARED: i64 = {
    let most = SMALL_ZERO as i64 - 1;
    2 * most * most
};
/// A quaternion's length in compact steps.
const UNIT: i64 = UNIT_SQUARED.isqrt();

/// A rotation in compact steps, w first; its largest component is positive.
fn quaternion(pose: &ShortCode) -> [i64; 4] {
    let small = pose.small.map(|v| i64::from(v) * i64::from(SHORT_SMALL_STEPS));
    let rest = UNIT_SQUARED - small.iter().map(|v| v * v).sum::<i64>();
    let mut all = [rest.max(0).isqrt(); 4];
    for (i, v) in small.into_iter().enumerate() {
        all[if i < pose.largest { i } else { i + 1 }] = v;
    }
    all
}

/// A quotient, rounded to the nearest number, halves up. The divisor is positive.
fn rounded(value: i64, by: i64) -> i64 {
    (2 * value + by).div_euclid(2 * by)
}

/// What a pose differs by from its prediction: centre, then rotation.
struct Offsets([i32; 6]);

impl Offsets {
    fn between(pose: &ShortCode, predicted: &ShortCode) -> Offsets {
        let part = |a: [i32; 3], b: [i32; 3], i: usize| a[i % 3] - b[i % 3];
        Offsets(std::array::from_fn(|i| match i {
            0..3 => part(pose.centre, predicted.centre, i),
            _ => part(pose.small, predicted.small, i),
        }))
    }

    fn add_to(&self, predicted: &ShortCode) -> ShortCode {
        let [x, y, z, a, b, c] = self.0;
        let sum = |v: [i32; 3], by: [i32; 3]| [0, 1, 2].map(|i| v[i] + by[i]);
        ShortCode {
            centre: sum(predicted.centre, [x, y, z]),
            largest: predicted.largest,
            small: sum(predicted.small, [a, b, c]),
        }
    }
}

/// The bits of a pose, the first one highest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PoseBits {
    bits: u128,
    count: u32,
}

impl PoseBits {
    /// Bytes that they take.
    fn len(&self) -> usize {
        self.count.div_ceil(8) as usize
    }

    fn bytes(&self) -> impl Iterator<Item = u8> {
        self.bits.to_be_bytes().into_iter().take(self.len())
    }

    fn put(&mut self, value: u32, bits: u32) -> Option<()> {
        self.count += bits;
        if self.count > 8 * LONGEST as u32 {
            return None;
        }
        self.bits |= u128::from(value) << (u128::BITS - self.count);
        Some(())
    }

    fn write(distance: u32, base: u32, offsets: &[i32; 6]) -> Option<PoseBits> {
        let mut bits = PoseBits { bits: 0, count: 0 };
        bits.put(distance - 1, DISTANCE_BITS)?;
        bits.put(base, BASE_BITS)?;
        let parts = [&offsets[..3], &offsets[3..]];
        let scales = parts.map(best_scale);
        scales.iter().try_for_each(|scale| bits.put(*scale, SCALE_BITS))?;
        for (part, scale) in parts.into_iter().zip(scales) {
            for offset in part {
                let (value, parameter) = (folded(*offset), scale + LEAST_PARAMETER);
                let ones = value >> parameter;
                if ones >= 8 * LONGEST as u32 {
                    return None;
                }
                (0..ones).try_for_each(|_| bits.put(1, 1))?;
                bits.put(0, 1)?;
                bits.put(value & ((1 << parameter) - 1), parameter)?;
            }
        }
        Some(bits)
    }
}

/// Numbers by size: 0, −1, 1, −2, …
fn folded(offset: i32) -> u32 {
    (offset << 1 ^ offset >> 31) as u32
}

fn unfolded(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

/// The scale that takes fewest bits.
fn best_scale(part: &[i32]) -> u32 {
    let cost = |scale: &u32| {
        let parameter = scale + LEAST_PARAMETER;
        part.iter().map(|offset| (folded(*offset) >> parameter) + parameter).sum::<u32>()
    };
    (0..1 << SCALE_BITS).min_by_key(cost).unwrap_or(0)
}

/// A latent part in the predicted form, as far as it can be read without the poses that are held.
pub(super) struct Stated {
    /// The frame number, modulo 2⁷.
    pub frame: u32,
    pub distance: u32,
    pub base: u32,
    offsets: Offsets,
    pub follows: Follows,
    /// Length of the part, bytes.
    pub len: usize,
    /// First byte, pose and check.
    first: u8,
    code: PoseBits,
    check: u16,
}

/// Whether bytes begin as a packet in the predicted form.
pub(crate) fn is_predicted(bytes: &[u8]) -> bool {
    bytes.first().is_some_and(|first| first >> 4 == MAGIC)
}

/// Marks a packet in the predicted form: it ends where its bytes end.
pub(crate) fn mark_whole(packet: &mut [u8]) {
    packet[1] |= WHOLE;
}

impl Stated {
    /// Reads the part at the start of a packet.
    pub fn read(bytes: &[u8]) -> Result<Stated, PacketError> {
        let found = bytes.len();
        let short = |needed| PacketError::TooShort { part: Part::Latent, needed, found };
        let [first, number, ..] = *bytes else { return Err(short(HEAD + CHECK)) };
        if first >> 4 != MAGIC {
            return Err(PacketError::Magic(first));
        }
        let follows = Follows { camera: false, render: false, residual: first & 0xF };
        if !residual::may_be_predicted(follows.residual) {
            // Nothing vouches for the byte: it may be of anything.
            return Err(PacketError::Magic(first));
        }
        let mut reader = BitReader { bytes: &bytes[HEAD..], at: 0 };
        let distance = reader.take(DISTANCE_BITS)? + 1;
        let base = reader.take(BASE_BITS)?;
        let scales = [reader.take(SCALE_BITS)?, reader.take(SCALE_BITS)?];
        let mut offsets = [0; 6];
        for (i, offset) in offsets.iter_mut().enumerate() {
            *offset = reader.take_number(scales[i / 3] + LEAST_PARAMETER)?;
        }
        let end = HEAD + reader.at.div_ceil(8) as usize;
        // Padding is zero: each pose has one code.
        if reader.take_padding()? != 0 {
            return Err(PacketError::Check(Part::Latent));
        }
        let code = PoseBits::write(distance, base, &offsets).ok_or(PacketError::Pose)?;
        let check = bytes.get(end..end + CHECK).ok_or(short(end + CHECK))?;
        Ok(Stated {
            frame: u32::from(number) % PREDICTED_FRAMES,
            distance,
            base,
            offsets: Offsets(offsets),
            follows,
            len: end + CHECK,
            first,
            code,
            check: u16::from_le_bytes([check[0], check[1]]),
        })
    }

    /// The pose, if the check matches.
    pub fn pose(&self, from: &From) -> Result<QuantisedPose, PacketError> {
        let code: [u8; 16] = self.code.bits.to_be_bytes();
        if check(from.context, self.first, &code[..self.code.len()]) != self.check {
            return Err(PacketError::Check(Part::Latent));
        }
        let predicted = from.predict().ok_or(PacketError::Pose)?;
        QuantisedPose::of_short(&self.offsets.add_to(&predicted))
    }
}

/// The check of a latent part.
fn check(context: u32, first: u8, code: &[u8]) -> u16 {
    crc16(&[&context.to_le_bytes(), &[first], code])
}

/// Takes bits, the highest of each byte first.
struct BitReader<'a> {
    bytes: &'a [u8],
    at: u32,
}

impl BitReader<'_> {
    fn take(&mut self, bits: u32) -> Result<u32, PacketError> {
        (0..bits).try_fold(0, |value, _| Ok(value << 1 | self.bit()?))
    }

    fn bit(&mut self) -> Result<u32, PacketError> {
        if self.at >= 8 * LONGEST as u32 {
            return Err(PacketError::Pose);
        }
        let (needed, found) = (HEAD + self.at as usize / 8 + 1, HEAD + self.bytes.len());
        let short = PacketError::TooShort { part: Part::Latent, needed, found };
        let byte = self.bytes.get(self.at as usize / 8).ok_or(short)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Ok(bit.into())
    }

    fn take_number(&mut self, parameter: u32) -> Result<i32, PacketError> {
        let mut ones = 0;
        while self.bit()? == 1 {
            ones += 1;
        }
        Ok(unfolded(ones << parameter | self.take(parameter)?))
    }

    fn take_padding(&mut self) -> Result<u32, PacketError> {
        self.take(self.at.wrapping_neg() % 8)
    }
}

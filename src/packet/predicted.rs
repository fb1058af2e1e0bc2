//! A predicted pose: what it differs by from one that both sides compute from poses that the topside holds. All in
//! integers, so that both sides have the same bits.

use super::error::{PacketError, Part};
use super::pose::{QuantisedPose, ShortCode};
use crate::search::{SHORT_CENTRE_MAX, SHORT_SMALL_MAX, SHORT_SMALL_STEPS, SMALL_ZERO};

/// Frames between a frame and its reference at most.
pub(crate) const FARTHEST: u32 = 1 << DISTANCE_BITS;
const DISTANCE_BITS: u32 = 6;
/// Frames between the reference and the frame before it that tells the motion.
pub(crate) const LONGEST_BASE: u32 = (1 << BASE_BITS) - 1;
const BASE_BITS: u32 = 3;
/// Bits that select the Rice parameter of three numbers, and the least parameter.
const SCALE_BITS: u32 = 3;
const LEAST_PARAMETER: u32 = 2;
/// Most bytes of a pose. A longer one is stated by itself, which then takes no more bytes.
const LONGEST: usize = 14;

/// A predicted pose as it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    code: PoseBits,
    /// Check of all that both sides must agree in.
    pub(super) context: u32,
}

impl Prediction {
    /// Bytes of the pose.
    pub(super) fn len(&self) -> usize {
        self.code.len()
    }

    /// These bytes.
    pub(super) fn bytes(&self) -> impl Iterator<Item = u8> {
        self.code.bytes()
    }

    /// How a pose is stated as what it differs by from its prediction; `None`: it takes more than by itself.
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

/// A predicted pose as a packet states it. It can be read without the poses that are held.
pub(super) struct Stated {
    pub distance: u32,
    pub base: u32,
    offsets: Offsets,
    /// Where it ends in the packet.
    pub end: usize,
}

impl Stated {
    /// Reads the pose that begins at byte `at` of a packet.
    pub fn read(packet: &[u8], at: usize) -> Result<Stated, PacketError> {
        let mut reader = BitReader { bytes: packet, from: at, at: 0 };
        let distance = reader.take(DISTANCE_BITS)? + 1;
        let base = reader.take(BASE_BITS)?;
        let scales = [reader.take(SCALE_BITS)?, reader.take(SCALE_BITS)?];
        let mut offsets = [0; 6];
        for (i, offset) in offsets.iter_mut().enumerate() {
            *offset = reader.take_number(scales[i / 3] + LEAST_PARAMETER)?;
        }
        // Padding is zero: each pose has one code.
        if reader.take_padding()? != 0 {
            return Err(PacketError::Check(Part::Latent));
        }
        let end = at + reader.at as usize / 8;
        Ok(Stated { distance, base, offsets: Offsets(offsets), end })
    }

    /// The pose.
    pub fn pose(&self, from: &From) -> Result<QuantisedPose, PacketError> {
        let predicted = from.predict().ok_or(PacketError::Pose)?;
        QuantisedPose::of_short(&self.offsets.add_to(&predicted))
    }
}

/// Takes bits, the highest of each byte first.
struct BitReader<'a> {
    bytes: &'a [u8],
    /// The byte with which they begin.
    from: usize,
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
        let (place, found) = (self.from + self.at as usize / 8, self.bytes.len());
        let short = PacketError::TooShort { part: Part::Latent, needed: place + 1, found };
        let byte = self.bytes.get(place).ok_or(short)?;
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

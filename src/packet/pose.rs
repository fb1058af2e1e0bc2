//! Poses as packets carry them.
//!
//! **Compact**, 16 bytes. The camera's centre is stated in the prior's frame ([`PriorFrame`]):
//! three signed 24-bit numbers of steps of 2⁻¹⁷ of its unit, which reaches 64 units to either side.
//! Then the rotation as "smallest three" in 56 bits: from the top, two bits that name the
//! quaternion's largest component, then the other three in order, 18 bits each:
//! `131072 + round(131071 √2 q)`, with the sign of the quaternion such that the largest is
//! positive. A rotation is off by at most 2·10⁻⁵ rad, a centre by half a step per axis.
//!
//! **Paper**, 28 bytes: translation (x, y, z) and quaternion (w, x, y, z) as f32, as in the paper.
//! Also taken for a pose whose centre lies beyond the compact one's reach.

use std::f64::consts::SQRT_2;

use glam::{DQuat, DVec3};

use crate::Pose;
use crate::prior::PriorFrame;
use crate::search::{COMPACT, PAPER, PoseCode, SMALL_ZERO};

use super::PacketError;
use super::bytes::{Reader, from_u24, to_u24};

/// Range of the compact centre, steps: 24 bits, two's complement.
const CENTRE_STEPS: std::ops::Range<f64> = -8_388_608.0..8_388_608.0;
/// Bits of a small quaternion component.
const SMALL_BITS: u32 = SMALL_ZERO.ilog2() + 1;
/// Code steps per unit of a small component: the largest magnitude, 1/√2, takes the last step.
const SMALL_STEPS: f64 = (SMALL_ZERO - 1) as f64 * SQRT_2;
/// Bytes of the longer profile.
pub(super) const LONGEST: usize = 28;
/// Rounds after which quantisation has settled, with room; see [`QuantisedPose::quantise`].
const MAX_SETTLING: usize = 16;

/// How a pose is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseProfile {
    /// 16 bytes, relative to the prior.
    #[default]
    Compact,
    /// 28 bytes: seven f32.
    Paper,
}

impl PoseProfile {
    /// The profile's number in the flags. One flipped bit does not make one of the other, which
    /// matters as the length of what the check covers hangs on it.
    pub(super) fn code(self) -> u8 {
        match self {
            PoseProfile::Compact => 0b01,
            PoseProfile::Paper => 0b10,
        }
    }

    pub(super) fn of_code(code: u8) -> Result<PoseProfile, PacketError> {
        [PoseProfile::Compact, PoseProfile::Paper]
            .into_iter()
            .find(|profile| profile.code() == code)
            .ok_or(PacketError::Profile(code))
    }

    /// The profile as the device knows it.
    pub fn word(self) -> u32 {
        match self {
            PoseProfile::Compact => COMPACT,
            PoseProfile::Paper => PAPER,
        }
    }

    /// Bytes that a pose takes.
    pub fn encoded_len(self) -> usize {
        match self {
            PoseProfile::Compact => 16,
            PoseProfile::Paper => LONGEST,
        }
    }
}

/// A pose as a packet holds it; always one that can be rendered at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuantisedPose(Code);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Code {
    Compact { centre: [i32; 3], largest: usize, small: [i32; 3] },
    Paper { translation: [f32; 3], wxyz: [f32; 4] },
}

impl QuantisedPose {
    /// Quantises a pose. If its centre is beyond the reach of [`PoseProfile::Compact`], the
    /// other profile is taken.
    ///
    /// Quantising what [`QuantisedPose::dequantise`] gives returns the same code. Plain rounding
    /// would not do: where two components of a quaternion are nearly equally large, rounding may
    /// exchange them. So rounding is repeated until it settles (once or twice), or goes in a
    /// circle, of which the least code then stands for all.
    ///
    /// # Errors
    /// [`PacketError::Pose`] where a component is not finite or beyond f32, or the quaternion zero.
    pub fn quantise(
        pose: &Pose,
        frame: &PriorFrame,
        profile: PoseProfile,
    ) -> Result<QuantisedPose, PacketError> {
        Pose::from_wxyz(pose.wxyz(), pose.translation.into()).ok_or(PacketError::Pose)?;
        let mut codes = [round(pose, frame, profile)?; MAX_SETTLING + 1];
        for count in 1..=MAX_SETTLING {
            let last = codes[count - 1];
            let next = round(&last.dequantise(frame), frame, last.profile())?;
            if let Some(start) = codes[..count].iter().position(|code| *code == next) {
                return Ok(least(&codes[start..count]));
            }
            codes[count] = next;
        }
        Ok(least(&codes))
    }

    /// The pose, to the same bits wherever it is computed.
    pub fn dequantise(&self, frame: &PriorFrame) -> Pose {
        match self.0 {
            Code::Compact { centre, largest, small } => {
                let step = frame.step();
                let origin = DVec3::from(frame.centre.map(f64::from));
                let centre = origin + DVec3::from(centre.map(f64::from)) * step;
                Pose::from_centre(rotation_of(largest, small), centre)
            }
            Code::Paper { translation, wxyz: [w, x, y, z] } => {
                let q = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into());
                Pose { rotation: unit(q), translation: DVec3::from(translation.map(f64::from)) }
            }
        }
    }

    /// In words, as the device has it.
    pub fn words(&self) -> PoseCode {
        match self.0 {
            Code::Compact { centre: [x, y, z], largest, small: [a, b, c] } => {
                PoseCode { profile: COMPACT, words: [x, y, z, largest as i32, a, b, c] }
            }
            Code::Paper { translation: [x, y, z], wxyz: [a, b, c, d] } => PoseCode {
                profile: PAPER,
                words: [x, y, z, a, b, c, d].map(|v: f32| v.to_bits() as i32),
            },
        }
    }

    /// From the device's words.
    ///
    /// # Errors
    /// [`PacketError::Pose`] where they are no pose's, or no packet can hold them.
    pub fn of_words(code: &PoseCode) -> Result<QuantisedPose, PacketError> {
        let w = code.words;
        let code = if code.profile == COMPACT {
            let centre = [w[0], w[1], w[2]];
            let small = [w[4], w[5], w[6]];
            let reach = |v: &i32| CENTRE_STEPS.contains(&f64::from(*v));
            let small_fits = small.iter().all(|v| (-SMALL_ZERO..SMALL_ZERO).contains(v));
            if !(centre.iter().all(reach) && small_fits && (0..4).contains(&w[3])) {
                return Err(PacketError::Pose);
            }
            Code::Compact { centre, largest: w[3] as usize, small }
        } else {
            let float = |i: usize| f32::from_bits(w[i] as u32);
            Code::Paper { translation: [0, 1, 2].map(float), wxyz: [3, 4, 5, 6].map(float) }
        };
        if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
    }

    /// How it is written.
    pub fn profile(&self) -> PoseProfile {
        match self.0 {
            Code::Compact { .. } => PoseProfile::Compact,
            Code::Paper { .. } => PoseProfile::Paper,
        }
    }

    pub(super) fn write(&self, bytes: &mut Vec<u8>) {
        bytes.extend_from_slice(&self.bytes()[..self.profile().encoded_len()]);
    }

    /// The bytes of the longest profile, zeros after those of a shorter one.
    fn bytes(&self) -> [u8; LONGEST] {
        let mut bytes = [0; LONGEST];
        match self.0 {
            Code::Compact { centre, largest, small } => {
                for (to, value) in bytes.chunks_exact_mut(3).zip(centre) {
                    to.copy_from_slice(&to_u24(value as u32));
                }
                let rotation = small
                    .iter()
                    .fold(largest as u64, |bits, v| bits << SMALL_BITS | (v + SMALL_ZERO) as u64);
                bytes[9..16].copy_from_slice(&rotation.to_le_bytes()[..7]);
            }
            Code::Paper { translation, wxyz } => {
                for (to, value) in bytes.chunks_exact_mut(4).zip(translation.iter().chain(&wxyz)) {
                    to.copy_from_slice(&value.to_le_bytes());
                }
            }
        }
        bytes
    }

    /// Takes a pose's bytes, all of them also where they are refused.
    pub(super) fn read(
        reader: &mut Reader,
        profile: PoseProfile,
    ) -> Result<QuantisedPose, PacketError> {
        let code = match profile {
            PoseProfile::Compact => {
                // Shifting up and down again extends the sign of 24 bits.
                let centre = [(); 3].map(|()| (from_u24(reader.take()) as i32) << 8 >> 8);
                let [a, b, c, d, e, f, g] = reader.take();
                let bits = u64::from_le_bytes([a, b, c, d, e, f, g, 0]);
                let mask = (1 << SMALL_BITS) - 1;
                let small =
                    [2, 1, 0].map(|i| (bits >> (i * SMALL_BITS) & mask) as i32 - SMALL_ZERO);
                let largest = (bits >> (3 * SMALL_BITS)) as usize;
                Code::Compact { centre, largest, small }
            }
            PoseProfile::Paper => Code::Paper {
                translation: [(); 3].map(|()| f32::from_le_bytes(reader.take())),
                wxyz: [(); 4].map(|()| f32::from_le_bytes(reader.take())),
            },
        };
        if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
    }
}

impl Code {
    fn is_pose(&self) -> bool {
        match self {
            Code::Compact { small, .. } => rest_of_square(small) > 0.0,
            Code::Paper { translation, wxyz } => {
                Pose::from_wxyz(wxyz.map(f64::from), translation.map(f64::from)).is_some()
            }
        }
    }
}

/// A quaternion at unit length; one that is there but for f32 rounding stays as it is. (Normalised
/// again and again, its small components would creep while the large ones round back.)
fn unit(q: DQuat) -> DQuat {
    let length = q.length();
    if (length - 1.0).abs() < 1e-6 { q } else { q * (1.0 / length) }
}

/// The least of some codes, by their bytes.
fn least(codes: &[QuantisedPose]) -> QuantisedPose {
    let less = |a: QuantisedPose, b: &QuantisedPose| if b.bytes() < a.bytes() { *b } else { a };
    codes[1..].iter().fold(codes[0], less)
}

/// One rounding of a pose, in the profile that can hold it.
fn round(
    pose: &Pose,
    frame: &PriorFrame,
    profile: PoseProfile,
) -> Result<QuantisedPose, PacketError> {
    let pose = &Pose { rotation: unit(pose.rotation), ..*pose };
    if profile == PoseProfile::Compact
        && let Some(code) = round_compact(pose, frame)
    {
        return Ok(QuantisedPose(code));
    }
    let wxyz = pose.wxyz().map(|v| v as f32);
    let code = Code::Paper { translation: pose.translation.as_vec3().into(), wxyz };
    if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
}

/// `None` where the centre is out of reach.
fn round_compact(pose: &Pose, frame: &PriorFrame) -> Option<Code> {
    let step = frame.step();
    let offset = pose.centre() - DVec3::from(frame.centre.map(f64::from));
    let steps = (offset / step).round();
    if !steps.to_array().iter().all(|v| CENTRE_STEPS.contains(v)) {
        return None;
    }
    let centre = steps.to_array().map(|v| v as i32);
    let q = pose.wxyz();
    let largest = (0..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
    let sign = q[largest].signum();
    let small = others(largest).map(|i| (sign * q[i] * SMALL_STEPS).round() as i32);
    Some(Code::Compact { centre, largest, small })
}

/// The quaternion whose component `largest` is left out.
fn rotation_of(largest: usize, small: [i32; 3]) -> DQuat {
    let mut q = [0.0; 4];
    for (i, v) in others(largest).into_iter().zip(small) {
        q[i] = f64::from(v) / SMALL_STEPS;
    }
    q[largest] = rest_of_square(&small).sqrt();
    let [w, x, y, z] = q;
    DQuat::from_xyzw(x, y, z, w)
}

/// Square of the component left out; not positive where the others are those of no rotation.
fn rest_of_square(small: &[i32; 3]) -> f64 {
    1.0 - small.iter().map(|v| (f64::from(*v) / SMALL_STEPS).powi(2)).sum::<f64>()
}

/// Indices of the components other than one.
fn others(largest: usize) -> [usize; 3] {
    [0, 1, 2].map(|i| if i < largest { i } else { i + 1 })
}

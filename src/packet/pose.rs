//! Poses as packets carry them.
//!
//! **Compact**, 16 bytes. First the camera's centre in the prior's frame ([`CoordinateFrame`]): three
//! signed 24-bit numbers in steps of 2⁻¹⁷ of its unit. They reach 64 units to either side. Then the
//! rotation as "smallest three" in 56 bits. From the top: two bits name the quaternion's largest
//! component; the other three follow in order, 18 bits each, as `131072 + round(131071 √2 q)`. The
//! quaternion's sign makes the largest component positive. A rotation is off by at most 2·10⁻⁵ rad,
//! a centre by half a step per axis.
//!
//! **Short**, 12 bytes: the compact code on a coarser grid.
//! First the centre: three signed 16-bit numbers in steps of 32 compact steps. They reach 8 units. Then the rotation in
//! 48 bits: the top bit is zero, two bits name the largest component, and the others follow, 15 bits each, in steps of
//! 8 compact steps, as `16384 + k`, at most 32767. It costs the render less than 0.01 dB. A pose beyond its reach takes
//! the compact code.
//!
//! **Free**: translation (x, y, z) and quaternion (w, x, y, z) as f32. A pose beyond the reach of the compact code has
//! it. It can be drawn, but no packet holds it.

use std::f64::consts::SQRT_2;

use glam::{DQuat, DVec3};

use crate::Pose;
use crate::prior::CoordinateFrame;
use crate::search::{
    COMPACT, PAPER, PoseCode, SHORT, SHORT_CENTRE_MAX, SHORT_CENTRE_STEPS, SHORT_SMALL_MAX,
    SHORT_SMALL_STEPS, SMALL_ZERO,
};

use super::PacketError;
use super::bytes::{Reader, from_u24, to_u24};

/// Range of the compact centre, steps: 24 bits, two's complement.
const CENTRE_STEPS: std::ops::Range<f64> = -8_388_608.0..8_388_608.0;
/// Bits of a small quaternion component.
const SMALL_BITS: u32 = SMALL_ZERO.ilog2() + 1;
/// Code steps per unit of a small component: the largest magnitude, 1/√2, takes the last step.
const SMALL_STEPS: f64 = (SMALL_ZERO - 1) as f64 * SQRT_2;
/// Range of a short centre, in its own steps: 16 bits, two's complement.
const SHORT_CENTRE: std::ops::RangeInclusive<i32> = -SHORT_CENTRE_MAX - 1..=SHORT_CENTRE_MAX;
/// Range of a small component of the short code, in its own steps.
const SHORT_SMALL: std::ops::RangeInclusive<i32> = -SHORT_SMALL_MAX - 1..=SHORT_SMALL_MAX;
const SHORT_SMALL_BITS: u32 = SHORT_SMALL_MAX.ilog2() + 2;
/// Bytes of the short code.
pub(super) const SHORT_LEN: usize = 12;
/// Bytes of the compact code.
pub(super) const COMPACT_LEN: usize = 16;
/// Bytes of a free pose; no packet has them.
const FREE_LEN: usize = 28;
/// More rounds than quantisation needs to settle; see [`QuantisedPose::quantise`].
const MAX_SETTLING: usize = 16;

/// How a pose is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseProfile {
    /// 16 bytes, relative to the prior.
    #[default]
    Compact,
    /// Seven f32. No packet holds it.
    Free,
    /// 12 bytes, relative to the prior.
    Short,
}

impl PoseProfile {
    /// The profile as the device knows it.
    pub fn word(self) -> u32 {
        match self {
            PoseProfile::Compact => COMPACT,
            PoseProfile::Free => PAPER,
            PoseProfile::Short => SHORT,
        }
    }

    /// Bytes that a pose takes.
    pub fn encoded_len(self) -> usize {
        match self {
            PoseProfile::Compact => COMPACT_LEN,
            PoseProfile::Free => FREE_LEN,
            PoseProfile::Short => SHORT_LEN,
        }
    }
}

/// A pose as a packet holds it. The prior can always be rendered at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuantisedPose(Code);

/// A pose in the steps of the short code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ShortCode {
    pub centre: [i32; 3],
    /// Index of the rotation's largest component.
    pub largest: usize,
    /// The other components.
    pub small: [i32; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Code {
    Compact { centre: [i32; 3], largest: usize, small: [i32; 3] },
    Free { translation: [f32; 3], wxyz: [f32; 4] },
}

impl QuantisedPose {
    /// Quantises a pose. If its centre is beyond the reach of [`PoseProfile::Short`], takes [`PoseProfile::Compact`];
    /// if it is beyond the reach of that, takes [`PoseProfile::Free`], which no packet holds.
    ///
    /// Quantising what [`QuantisedPose::dequantise`] gives returns the same code. Plain rounding
    /// does not guarantee that: if two components of a quaternion are nearly equal, rounding may
    /// change which is larger. So rounding is repeated until it settles (once or twice) or runs in
    /// a circle. The least code of the circle then stands for all of it.
    ///
    /// # Errors
    /// [`PacketError::Pose`] if a component is not finite or beyond f32, or the quaternion is zero.
    pub fn quantise(
        pose: &Pose,
        frame: &CoordinateFrame,
        profile: PoseProfile,
    ) -> Result<QuantisedPose, PacketError> {
        Pose::from_wxyz(pose.wxyz(), pose.translation.into()).ok_or(PacketError::Pose)?;
        let first = round(pose, frame, profile)?;
        let profile = match profile {
            PoseProfile::Short if first.is_short() => profile,
            _ => first.profile(),
        };
        let mut codes = [first; MAX_SETTLING + 1];
        for count in 1..=MAX_SETTLING {
            let last = codes[count - 1];
            let next = round(&last.dequantise(frame), frame, profile)?;
            if let Some(start) = codes[..count].iter().position(|code| *code == next) {
                return Ok(min_code(&codes[start..count]));
            }
            codes[count] = next;
        }
        Ok(min_code(&codes))
    }

    /// The pose, with the same bits on every machine.
    pub fn dequantise(&self, frame: &CoordinateFrame) -> Pose {
        match self.0 {
            Code::Compact { centre, largest, small } => {
                let step = frame.step();
                let origin = DVec3::from(frame.centre.map(f64::from));
                let centre = origin + DVec3::from(centre.map(f64::from)) * step;
                Pose::from_centre(rotation_of(largest, small), centre)
            }
            Code::Free { translation, wxyz: [w, x, y, z] } => {
                let q = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into());
                Pose { rotation: unit(q), translation: DVec3::from(translation.map(f64::from)) }
            }
        }
    }

    /// The code in the words that the device uses.
    pub fn words(&self) -> PoseCode {
        match self.0 {
            Code::Compact { centre: [x, y, z], largest, small: [a, b, c] } => {
                PoseCode { profile: COMPACT, words: [x, y, z, largest as i32, a, b, c] }
            }
            Code::Free { translation: [x, y, z], wxyz: [a, b, c, d] } => PoseCode {
                profile: PAPER,
                words: [x, y, z, a, b, c, d].map(|v: f32| v.to_bits() as i32),
            },
        }
    }

    /// Reads the device's words.
    ///
    /// # Errors
    /// [`PacketError::Pose`] if they are no pose, or no packet can hold them.
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
            Code::Free { translation: [0, 1, 2].map(float), wxyz: [3, 4, 5, 6].map(float) }
        };
        if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
    }

    /// Whether [`PoseProfile::Short`] can hold it: it lies on the grid of that, within its reach.
    pub fn is_short(&self) -> bool {
        self.short().is_some()
    }

    /// In the short code's steps.
    pub(super) fn short(&self) -> Option<ShortCode> {
        let Code::Compact { centre, largest, small } = self.0 else { return None };
        let on_grid = |v: [i32; 3], step| v.iter().all(|v| v % step == 0);
        if !on_grid(centre, SHORT_CENTRE_STEPS) || !on_grid(small, SHORT_SMALL_STEPS) {
            return None;
        }
        let centre = centre.map(|v| v / SHORT_CENTRE_STEPS);
        let small = small.map(|v| v / SHORT_SMALL_STEPS);
        let reached = centre.iter().all(|v| SHORT_CENTRE.contains(v));
        reached.then_some(ShortCode { centre, largest, small })
    }

    /// The profile that a packet states it in: the short one, if it can hold it.
    pub fn written_as(&self) -> PoseProfile {
        if self.is_short() { PoseProfile::Short } else { self.profile() }
    }

    /// [`PoseProfile::Compact`] or [`PoseProfile::Free`].
    pub fn profile(&self) -> PoseProfile {
        match self.0 {
            Code::Compact { .. } => PoseProfile::Compact,
            Code::Free { .. } => PoseProfile::Free,
        }
    }

    fn write_short(short: &ShortCode, bytes: &mut Vec<u8>) {
        let ShortCode { centre, largest, small } = *short;
        centre.iter().for_each(|v| bytes.extend_from_slice(&(*v as i16).to_le_bytes()));
        let zero = SHORT_SMALL_MAX + 1;
        let rotation = small
            .iter()
            .fold(largest as u64, |bits, v| bits << SHORT_SMALL_BITS | (v + zero) as u64);
        bytes.extend_from_slice(&rotation.to_le_bytes()[..SHORT_LEN - 6]);
    }

    /// Takes the short code's bytes. All of them are taken, even if they are refused.
    fn read_short(reader: &mut Reader) -> Result<QuantisedPose, PacketError> {
        let centre = [(); 3].map(|()| i32::from(i16::from_le_bytes(reader.take())));
        let [a, b, c, d, e, f] = reader.take();
        let bits = u64::from_le_bytes([a, b, c, d, e, f, 0, 0]);
        let mask = (1 << SHORT_SMALL_BITS) - 1;
        let zero = SHORT_SMALL_MAX + 1;
        let small = [2, 1, 0].map(|i| (bits >> (i * SHORT_SMALL_BITS) & mask) as i32 - zero);
        let largest = (bits >> (3 * SHORT_SMALL_BITS)) as usize;
        QuantisedPose::of_short(&ShortCode { centre, largest, small })
    }

    /// Variances of what rounding to the code's steps brings, along an axis of the camera, in the prior's unit, and
    /// about one, radians: those of an even distribution over a step.
    pub(crate) fn rounding(&self, frame: &CoordinateFrame) -> [f64; 2] {
        let [centre, small] = match self.written_as() {
            PoseProfile::Short => [SHORT_CENTRE_STEPS, SHORT_SMALL_STEPS].map(f64::from),
            PoseProfile::Compact => [1.0, 1.0],
            PoseProfile::Free => [0.0, 0.0],
        };
        // A turn is twice what its quaternion's component is.
        [centre * frame.step(), 2.0 * small / SMALL_STEPS].map(|step| step * step / 12.0)
    }

    /// From the short code's steps.
    ///
    /// # Errors
    /// [`PacketError::Pose`] if they are no pose, or beyond the code's reach.
    pub(super) fn of_short(short: &ShortCode) -> Result<QuantisedPose, PacketError> {
        let ShortCode { centre, largest, small } = *short;
        let reached = centre.iter().all(|v| SHORT_CENTRE.contains(v))
            && small.iter().all(|v| SHORT_SMALL.contains(v));
        if !reached || largest >= 4 {
            return Err(PacketError::Pose);
        }
        let code = Code::Compact {
            centre: centre.map(|v| v * SHORT_CENTRE_STEPS),
            largest,
            small: small.map(|v| v * SHORT_SMALL_STEPS),
        };
        if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
    }

    /// Appends its bytes, as [`QuantisedPose::written_as`] says.
    pub(super) fn write(&self, bytes: &mut Vec<u8>) {
        if let Some(short) = self.short() {
            return QuantisedPose::write_short(&short, bytes);
        }
        bytes.extend_from_slice(&self.bytes()[..self.profile().encoded_len()]);
    }

    /// The bytes of the longest profile, zeros after those of a shorter one.
    fn bytes(&self) -> [u8; FREE_LEN] {
        let mut bytes = [0; FREE_LEN];
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
            Code::Free { translation, wxyz } => {
                for (to, value) in bytes.chunks_exact_mut(4).zip(translation.iter().chain(&wxyz)) {
                    to.copy_from_slice(&value.to_le_bytes());
                }
            }
        }
        bytes
    }

    /// Takes a pose's bytes. All of them are taken, even if they are refused.
    pub(super) fn read(
        reader: &mut Reader,
        profile: PoseProfile,
    ) -> Result<QuantisedPose, PacketError> {
        let code = match profile {
            PoseProfile::Short => return QuantisedPose::read_short(reader),
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
            PoseProfile::Free => return Err(PacketError::Pose),
        };
        if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
    }
}

impl Code {
    fn is_pose(&self) -> bool {
        match self {
            Code::Compact { small, .. } => rest_of_square(small) > 0.0,
            Code::Free { translation, wxyz } => {
                Pose::from_wxyz(wxyz.map(f64::from), translation.map(f64::from)).is_some()
            }
        }
    }
}

/// A quaternion at unit length. One whose length is 1 up to f32 rounding stays as it is. (If it
/// were normalised again and again, its small components would drift while the large ones round
/// back.)
fn unit(q: DQuat) -> DQuat {
    let length = q.length();
    if (length - 1.0).abs() < 1e-6 { q } else { q * (1.0 / length) }
}

/// The least of some codes, by their bytes.
fn min_code(codes: &[QuantisedPose]) -> QuantisedPose {
    let less = |a: QuantisedPose, b: &QuantisedPose| if b.bytes() < a.bytes() { *b } else { a };
    codes[1..].iter().fold(codes[0], less)
}

/// One rounding of a pose, in the profile that can hold it.
fn round(
    pose: &Pose,
    frame: &CoordinateFrame,
    profile: PoseProfile,
) -> Result<QuantisedPose, PacketError> {
    let pose = &Pose { rotation: unit(pose.rotation), ..*pose };
    let near = match profile {
        PoseProfile::Short => round_short(pose, frame).or_else(|| round_compact(pose, frame)),
        PoseProfile::Compact => round_compact(pose, frame),
        PoseProfile::Free => None,
    };
    if let Some(code) = near {
        return Ok(QuantisedPose(code));
    }
    let wxyz = pose.wxyz().map(|v| v as f32);
    let code = Code::Free { translation: pose.translation.as_vec3().into(), wxyz };
    if code.is_pose() { Ok(QuantisedPose(code)) } else { Err(PacketError::Pose) }
}

/// `None` if the centre is out of reach.
fn round_compact(pose: &Pose, frame: &CoordinateFrame) -> Option<Code> {
    let steps = steps_from(frame, pose).round().to_array();
    let reached = steps.iter().all(|v| CENTRE_STEPS.contains(v));
    let (largest, small) = small_steps(pose);
    let small = small.map(|v| v.round() as i32);
    reached.then_some(Code::Compact { centre: steps.map(|v| v as i32), largest, small })
}

/// Rounds to the short code's grid. `None` if the centre is out of its reach.
fn round_short(pose: &Pose, frame: &CoordinateFrame) -> Option<Code> {
    let steps = (steps_from(frame, pose) / f64::from(SHORT_CENTRE_STEPS)).round().to_array();
    let reach = f64::from(*SHORT_CENTRE.start())..=f64::from(*SHORT_CENTRE.end());
    let reached = steps.iter().all(|v| reach.contains(v));
    let (largest, small) = small_steps(pose);
    // A component as large as the largest would round beyond the code.
    let small = small.map(|v| {
        let steps = (v / f64::from(SHORT_SMALL_STEPS)).round() as i32;
        steps.clamp(*SHORT_SMALL.start(), *SHORT_SMALL.end()) * SHORT_SMALL_STEPS
    });
    let centre = steps.map(|v| v as i32).map(|v| v.saturating_mul(SHORT_CENTRE_STEPS));
    reached.then_some(Code::Compact { centre, largest, small })
}

/// Compact steps from the prior's centre to a camera's.
fn steps_from(frame: &CoordinateFrame, pose: &Pose) -> DVec3 {
    (pose.centre() - DVec3::from(frame.centre.map(f64::from))) / frame.step()
}

/// Index of a rotation's largest component, and the others in compact steps.
fn small_steps(pose: &Pose) -> (usize, [f64; 3]) {
    let q = pose.wxyz();
    let largest = (0..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
    let sign = q[largest].signum();
    (largest, others(largest).map(|i| sign * q[i] * SMALL_STEPS))
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

/// Square of the component left out; not positive if the others belong to no rotation.
fn rest_of_square(small: &[i32; 3]) -> f64 {
    1.0 - small.iter().map(|v| (f64::from(*v) / SMALL_STEPS).powi(2)).sum::<f64>()
}

/// Indices of the components other than one.
fn others(largest: usize) -> [usize; 3] {
    [0, 1, 2].map(|i| if i < largest { i } else { i + 1 })
}

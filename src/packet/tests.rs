mod predicted;

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;
use crate::Pose;
use crate::prior::{CoordinateFrame, PriorId};

const FRAME: CoordinateFrame = CoordinateFrame { centre: [-3.5, 2.25, 24.0], spread: 8.25 };
const PRIOR: PriorId = PriorId(0xd4a5_d0ed);
const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 274.5, fy: 274.25, cx: 160.0, cy: 90.0 };

fn pose() -> Pose {
    Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, 2.0, 3.0]).unwrap()
}

fn latent(profile: PoseProfile) -> Latent {
    let pose = QuantisedPose::quantise(&pose(), &FRAME, profile).unwrap();
    let latent = Latent::new(0x0102_0304, PRIOR, &CAMERA, pose, true).unwrap();
    if profile == PoseProfile::Short { latent.shortened(PRIOR, &CAMERA).unwrap() } else { latent }
}

fn packet(profile: PoseProfile, camera: bool, residual: Residual<'_>) -> Packet<'_> {
    let (latent, camera) = (latent(profile), camera.then_some(CAMERA));
    Packet { latent, camera, render: None, residual, truth: None }
}

fn coded(payload: &[u8]) -> Residual<'_> {
    Residual::Coded { coder: Coder::Vp8, payload }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn inter(payload: &[u8]) -> Residual<'_> {
    let reference = Some(Reference { distance: 7, tag: 0x0201 });
    Residual::Stream { reference, small_blocks: false, payload }
}

fn intra(payload: &[u8]) -> Residual<'_> {
    Residual::Stream { reference: None, small_blocks: false, payload }
}

#[test]
fn a_stream_names_its_references() {
    for residual in [inter(b"difference"), intra(b"")] {
        let bytes = packet(PoseProfile::Short, false, residual).encode().unwrap();
        // The part's length counts the reference.
        let Residual::Stream { reference, payload, .. } = residual else { unreachable!() };
        let front = Reference::encoded_len(reference);
        assert_eq!(usize::from(bytes[SHORT_LATENT_LEN]), front + payload.len());
        // Without its end the start is there, and its reference, as soon as that has come.
        for len in SHORT_LATENT_LEN..bytes.len() {
            let start = Packet::salvage(&bytes[..len]).unwrap().residual_start;
            let come = len.saturating_sub(SHORT_LATENT_LEN + 1);
            assert_eq!(start.is_some(), come >= front);
            if let Some(start) = start {
                assert_eq!((start.coder, start.reference), (Coder::Wavelet, reference));
                assert_eq!(start.payload, &payload[..(come - front).min(payload.len())]);
            }
        }
    }
    // A part that ends before it has named its reference.
    let none = packet(PoseProfile::Short, false, intra(b"")).encode().unwrap();
    for part in [&[][..], &[3], &[3, 1]] {
        let mut bytes = none[..SHORT_LATENT_LEN].to_vec();
        let as_coded = Residual::Coded { coder: Coder::Wavelet, payload: part };
        residual::write(&as_coded, None, SHORT_LATENT_LEN, Check::Crc16, &mut bytes).unwrap();
        let found = Packet::salvage(&bytes).unwrap().residual;
        assert_eq!(found, Err(PacketError::Reference(part.len())));
        assert_eq!(found.unwrap_err().part(), Some(Part::Residual));
    }
}

/// As another residual, with small blocks.
fn small(residual: Residual<'_>) -> Residual<'_> {
    match residual {
        Residual::Coded { payload, .. } => Residual::Coded { coder: Coder::SmallBlocks, payload },
        Residual::Stream { reference, payload, .. } => {
            Residual::Stream { reference, small_blocks: true, payload }
        }
        other => other,
    }
}

#[test]
fn small_blocks_travel_in_the_short_form_alone() {
    let map = &[0b0001_0100, 0x13, 5, 6, 7][..];
    for plain in [coded(b"difference"), inter(b"difference"), intra(b"")] {
        let residual = small(plain);
        for truth in [None, Some(map)] {
            let packet = Packet { truth, ..packet(PoseProfile::Short, false, residual) };
            let bytes = packet.encode().unwrap();
            assert_eq!(bytes.len(), packet.encoded_len());
            // Only the profile tells them: not a byte more.
            assert_eq!(bytes[1] & 0b11, 0);
            let found = Packet::decode(&bytes).unwrap();
            assert_eq!((found.residual, found.truth.is_some()), (residual, truth.is_some()));
            assert_eq!(Extent::read(&bytes).unwrap().total, Some(bytes.len()));
            assert_eq!(valid_len(&bytes), bytes.len());
            // So does the start of one.
            let start = Packet::salvage(&bytes[..bytes.len() - 1]).unwrap().residual_start;
            assert_eq!(start.unwrap().coder, Coder::SmallBlocks);
        }
        for profile in [PoseProfile::Compact, PoseProfile::Paper] {
            let found = packet(profile, false, residual).encode();
            assert_eq!(found, Err(PacketError::SmallBlocks));
        }
    }
    // Codes that nothing has yet.
    for code in [8, 9, 10, 11, 15] {
        let mut bytes = Vec::new();
        let follows = Follows { camera: false, render: false, residual: code };
        latent(PoseProfile::Short).write(&follows, &mut bytes).unwrap();
        let found = Packet::salvage(&bytes).unwrap().residual;
        assert_eq!(found, Err(PacketError::Coder(code)));
    }
}

/// Pins the wire format: a change here is a new version of it.
#[test]
fn golden_packets() {
    use PoseProfile::{Compact, Paper, Short};
    let cases = [
        (
            packet(Compact, false, Residual::None),
            "b105040302edd0a5d43f310b451300fc14ff6be3f994948e84a4a424a8d961",
        ),
        (
            packet(Paper, false, Residual::None),
            concat!(
                "b106040302edd0a5d43f310b0000803f0000004000004040aa626c3fd01ed2",
                "3d1c979dbed01e523ea87bab"
            ),
        ),
        (
            packet(Compact, true, Residual::None),
            concat!(
                "b10d040302edd0a5d43f310b451300fc14ff6be3f994948e84a4a424a85855",
                "0040894300208943000020430000b442a819"
            ),
        ),
        (
            packet(Compact, false, coded(b"difference")),
            concat!(
                "b125040302edd0a5d43f310b451300fc14ff6be3f994948e84a4a424a8ddb3",
                "0a646966666572656e6365b22b072c"
            ),
        ),
        (
            packet(Compact, false, Residual::Omitted),
            "b115040302edd0a5d43f310b451300fc14ff6be3f994948e84a4a424a8db08",
        ),
        (packet(Short, false, Residual::None), "b40704039d9a00a8f81bcf9252125252124b75"),
        (
            packet(Short, false, small(coded(b"abc"))),
            "b44404039d9a00a8f81bcf9252125252122e11036162637d16",
        ),
        (
            packet(Short, false, small(inter(b"abc"))),
            "b45404039d9a00a8f81bcf925212525212243206070102616263fdc1",
        ),
        (
            packet(Short, false, coded(b"difference")),
            "b42704039d9a00a8f81bcf9252125252125f330a646966666572656e6365a1b7",
        ),
        (
            packet(Short, false, inter(b"difference")),
            "b45704039d9a00a8f81bcf92521252521269da0d070102646966666572656e63651b93",
        ),
        (
            packet(Compact, false, intra(b"difference")),
            concat!(
                "b155040302edd0a5d43f310b451300fc14ff6be3f994948e84a4a424a8f2bc",
                "0b00646966666572656e63658c950d2a"
            ),
        ),
    ];
    for (packet, expected) in cases {
        let bytes = packet.encode().unwrap();
        assert_eq!(hex(&bytes), expected);
        assert_eq!(Packet::decode(&bytes), Ok(packet));
    }
}

#[test]
fn golden_render_part() {
    let bare = packet(PoseProfile::Compact, true, coded(b"difference"));
    let told = Packet { render: Some(RenderCheck(0x0403_0201)), ..bare };
    let bytes = told.encode().unwrap();
    assert_eq!(bytes.len(), bare.encoded_len() + RENDER_PART_LEN);
    assert_eq!(bytes[1], bare.encode().unwrap()[1] | 0x80);
    assert_eq!(bytes[49..53], [1, 2, 3, 4]);
    assert_eq!(bytes[53..55], bytes::crc16(&[&bytes[..31], &[1, 2, 3, 4]]).to_le_bytes());
    assert_eq!(Packet::decode(&bytes), Ok(told));
    // Damage in it does not affect the other parts. If it is cut off, all that follows is lost too.
    let mut damaged = bytes.clone();
    damaged[50] ^= 1;
    let salvage = Packet::salvage(&damaged).unwrap();
    assert_eq!(salvage.render, Err(PacketError::Check(Part::Render)));
    assert_eq!((salvage.camera, salvage.residual), (Ok(Some(CAMERA)), Ok(told.residual)));
    assert_eq!(valid_len(&damaged), 49);
    assert_eq!(valid_len(&bytes[..60]), 55);
    assert_eq!(Extent::read(&bytes[..56]).unwrap().total, Some(bytes.len()));
}

#[test]
fn the_latent_part_fits_the_smallest_modem_frame() {
    assert_eq!(latent(PoseProfile::Compact).encoded_len(), 31);
    assert_eq!(latent(PoseProfile::Paper).encoded_len(), 43);
    assert_eq!(latent(PoseProfile::Short).encoded_len(), SHORT_LATENT_LEN);
    assert_eq!(SHORT_LATENT_LEN, 19);
    assert_eq!(packet(PoseProfile::Short, false, coded(&[7; 100])).encoded_len(), 19 + 1 + 100 + 2);
    assert_eq!(CAMERA_PART_LEN, 18);
    assert_eq!(residual_part_len(0), 5);
    assert_eq!(residual_part_len(127), 132);
    assert_eq!(residual_part_len(128), 134);
    assert_eq!(residual_part_len(1 << 14), (1 << 14) + 7);
}

#[test]
fn a_frame_drawn_with_updates_names_the_newest() {
    let full = latent(PoseProfile::Compact).with_update(0x1_02);
    let short = latent(PoseProfile::Short).with_update(3);
    assert_eq!((full.encoded_len(), short.encoded_len()), (31, LEARNT_SHORT_LEN));
    assert_eq!((full.version(), short.version()), (8, 13));
    for (latent, start) in [(full, "b8050403 02"), (short, "bd070403 03")] {
        let packet =
            Packet { latent, camera: None, render: None, residual: Residual::None, truth: None };
        let bytes = packet.encode().unwrap();
        assert_eq!(hex(&bytes[..5]), start.replace(' ', ""));
        assert_eq!(Packet::decode(&bytes), Ok(packet));
        let extent = Extent::read(&bytes).unwrap();
        assert_eq!((extent.frame, extent.frames, extent.latent), (0x0304, 1 << 16, bytes.len()));
        // Sixteen bits of the frame number travel.
        assert_eq!(Latent::decode(&bytes).unwrap().frame_near(Some(0x02_0300)), 0x02_0304);
        let other = Latent { portable: false, ..latent };
        assert_eq!(other.version(), if latent.is_short() { 14 } else { 11 });
    }
    // Any two versions differ in two bits or more: one flipped bit makes no form read as another.
    let versions: [u8; 8] = [1, 2, 4, 7, 8, 11, 13, 14];
    assert!(versions.iter().all(|version| version.count_ones() % 2 == 1));
}

#[test]
fn a_truncated_packet_still_yields_its_latent() {
    let packet = packet(PoseProfile::Compact, true, coded(&[7; 300]));
    let bytes = packet.encode().unwrap();
    for len in 0..bytes.len() {
        let salvage = Packet::salvage(&bytes[..len]);
        assert!(Packet::decode(&bytes[..len]).is_err());
        if len < 31 {
            assert_eq!(salvage.err().map(|e| part_of(&e)), Some(Some(Part::Latent)));
            continue;
        }
        let salvage = salvage.unwrap();
        assert_eq!(salvage.latent, packet.latent);
        assert_eq!(salvage.camera.is_ok(), len >= 31 + 18);
        assert_eq!(salvage.residual.map_err(|e| part_of(&e)), Err(Some(Part::Residual)));
        let start = salvage.residual_start;
        assert_eq!(start.is_some(), len >= 31 + 18 + 2, "the length has two bytes");
        let Some(start) = start else { continue };
        assert_eq!((start.coder, start.payload_len), (Coder::Vp8, 300));
        assert_eq!(start.payload, &[7; 300][..(len - 51).min(300)]);
    }
}

fn part_of(error: &PacketError) -> Option<Part> {
    match error {
        PacketError::TooShort { part, .. } | PacketError::Check(part) => Some(*part),
        _ => None,
    }
}

#[test]
fn a_damaged_part_does_not_spoil_the_others() {
    let packet = packet(PoseProfile::Compact, true, coded(&[7; 300]));
    let mut bytes = packet.encode().unwrap();
    bytes[31] ^= 1;
    let salvage = Packet::salvage(&bytes).unwrap();
    assert_eq!(salvage.camera, Err(PacketError::Check(Part::Camera)));
    assert_eq!(salvage.residual.as_ref(), Ok(&packet.residual));
    bytes[31] ^= 1;
    bytes[100] ^= 1;
    let salvage = Packet::salvage(&bytes).unwrap();
    assert_eq!(salvage.camera, Ok(Some(CAMERA)));
    assert_eq!(salvage.residual, Err(PacketError::Check(Part::Residual)));
}

#[test]
fn a_residual_belongs_to_its_latent() {
    let mut packet = packet(PoseProfile::Compact, false, coded(b"difference"));
    let mut bytes = packet.encode().unwrap();
    packet.latent.frame += 1;
    bytes[..31].copy_from_slice(&packet.encode().unwrap()[..31]);
    assert_eq!(Packet::decode(&bytes), Err(PacketError::Check(Part::Residual)));
}

#[test]
fn padding_is_passed_over() {
    for residual in [Residual::None, coded(b"difference")] {
        let packet = packet(PoseProfile::Compact, true, residual);
        let mut bytes = packet.encode().unwrap();
        assert_eq!(bytes.len(), packet.encoded_len());
        bytes.resize(256, 0);
        assert_eq!(Packet::decode(&bytes), Ok(packet));
    }
}

#[test]
fn the_extent_is_known_from_the_start() {
    for profile in [PoseProfile::Compact, PoseProfile::Paper] {
        for (camera, residual) in [(false, Residual::Omitted), (true, coded(&[7; 300]))] {
            let has_part = residual != Residual::Omitted;
            let bytes = packet(profile, camera, residual).encode().unwrap();
            let latent = latent(profile).encoded_len();
            let head = latent + if camera { CAMERA_PART_LEN } else { 0 };
            // Two bytes of length, if there is one.
            let known = if has_part { head + 2 } else { 0 };
            for len in 31..=bytes.len() {
                let total = (len >= known).then_some(bytes.len());
                let (frame, frames) = (0x02_0304, Latent::FRAMES);
                let (is_open, told_by_shares) = (false, 0);
                // The length, and the check of the full form.
                let framing = if has_part && len >= known { 2 + 4 } else { 0 };
                let extent = Extent {
                    frame,
                    frames,
                    latent,
                    head,
                    told: 0,
                    total,
                    framing,
                    is_open,
                    told_by_shares,
                };
                assert_eq!(Extent::read(&bytes[..len]), Ok(extent));
                let ends = [bytes.len(), head, latent, 0];
                let valid = ends.into_iter().find(|end| *end <= len).unwrap();
                assert_eq!(valid_len(&bytes[..len]), valid, "{len} of {}", bytes.len());
            }
        }
    }
}

#[test]
fn the_extent_of_what_is_no_packet() {
    let bytes = packet(PoseProfile::Compact, true, coded(&[7; 300])).encode().unwrap();
    let with = |index: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[index] = value;
        (Extent::read(&bytes).map(|extent| extent.total), valid_len(&bytes))
    };
    assert!(matches!(Extent::read(&bytes[..30]), Err(PacketError::TooShort { .. })));
    assert_eq!(with(0, 0x52), (Err(PacketError::Magic(0x52)), 0));
    assert_eq!(with(1, 0), (Err(PacketError::Profile(0)), 0));
    assert_eq!(with(5, 0), (Err(PacketError::Check(Part::Latent)), 0));
    // The latent part says what follows. The check of the next part finds out if that is wrong.
    assert_eq!(with(31, 1), (Ok(Some(bytes.len())), 31));
    assert_eq!(with(50, 0x7F), (Ok(Some(49 + 2 + 16_300 + 4)), 49));
    assert_eq!(with(100, 0), (Ok(Some(bytes.len())), 49));
    let mut endless = bytes.clone();
    endless[49..53].fill(0xFF);
    assert_eq!(Extent::read(&endless), Err(PacketError::PayloadLength));
    // A truth map has a part of the same form.
    let mut latent = Vec::new();
    let follows = Follows { camera: false, render: false, residual: 6 };
    self::latent(PoseProfile::Compact).write(&follows, &mut latent).unwrap();
    assert_eq!(Extent::read(&latent).map(|extent| extent.total), Ok(None));
    assert_eq!(Extent::read(&[&latent[..], &[9]].concat()).unwrap().total, Some(31 + 14));
}

#[test]
fn names_what_is_wrong() {
    let bytes = packet(PoseProfile::Compact, false, Residual::None).encode().unwrap();
    let with = |index: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[index] = value;
        Packet::decode(&bytes).unwrap_err()
    };
    assert_eq!(with(0, 0x52), PacketError::Magic(0x52));
    assert_eq!(with(0, 0xB3), PacketError::Check(Part::Latent));
    let mut later = bytes.clone();
    later[0] = 0xB3;
    let check = super::bytes::crc16(&[&later[..29]]).to_le_bytes();
    later[29..31].copy_from_slice(&check);
    assert_eq!(Packet::decode(&later).unwrap_err(), PacketError::Version(3));
    assert_eq!(with(0, 0xB4), PacketError::Profile(1));
    assert_eq!(with(1, 0), PacketError::Profile(0));
    assert_eq!(with(5, 0), PacketError::Check(Part::Latent));
    let latent = latent(PoseProfile::Compact);
    assert_eq!(latent.check_prior(PRIOR), Ok(()));
    let (packet, held) = (PRIOR, PriorId(1));
    assert_eq!(latent.check_prior(held), Err(PacketError::Prior { packet, held }));
}

#[test]
fn truth_maps_come_back() {
    let map = &[0b0001_0100, 0x13, 5, 6, 7][..];
    let all_seen = &[0b0010_0000][..];
    let coded = Residual::Coded { coder: Coder::Wavelet, payload: b"abc" };
    for residual in [Residual::None, Residual::Omitted, coded, intra(b""), intra(b"abc")] {
        for map in [super::truth::ALL_SEEN, all_seen, map] {
            let packet = Packet { truth: Some(map), ..packet(PoseProfile::Short, false, residual) };
            let bytes = packet.encode().unwrap();
            assert_eq!(bytes.len(), packet.encoded_len());
            let found = Packet::decode(&bytes).unwrap();
            assert_eq!(found.residual, residual);
            let mut truth = found.truth.unwrap().to_vec();
            truth[0] &= !0b11;
            assert_eq!(truth, map);
            // It is no longer than it may be.
            let bare = Packet { truth: None, ..packet };
            assert_eq!(bare.truth_room(bytes.len()).min(map.len()), map.len(), "{residual:?}");
            let told = Extent::read(&bytes).unwrap().told;
            let in_flags = bytes.len() == SHORT_LATENT_LEN;
            assert_eq!(told, if in_flags { 0 } else { 1 + map.len() }, "{residual:?}");
            // Of a packet that is cut, a map that is whole is left.
            let parsed = Parsed::of(&bytes).unwrap();
            assert_eq!(parsed.salvage(&bytes).truth, found.truth);
            for len in SHORT_LATENT_LEN..bytes.len() {
                let salvage = Packet::salvage(&bytes[..len]).unwrap();
                let is_whole = len >= SHORT_LATENT_LEN + 1 + map.len();
                assert_eq!(salvage.truth.is_some(), is_whole, "{residual:?}, {len}");
                assert!(salvage.residual.is_err());
            }
        }
    }
    let none = packet(PoseProfile::Short, false, Residual::None);
    let all_seen = Packet { truth: Some(super::truth::ALL_SEEN), ..none };
    assert_eq!(all_seen.encoded_len(), none.encoded_len(), "it takes no byte");
    let vp8 = Residual::Coded { coder: Coder::Vp8, payload: b"abc" };
    let vp8 = Packet { truth: Some(map), ..packet(PoseProfile::Short, false, vp8) };
    assert_eq!(vp8.encode(), Err(PacketError::TruthCoder(2)));
    let empty = Packet { truth: Some(&[]), ..none };
    assert_eq!(empty.encode(), Err(PacketError::Truth));
}

#[test]
fn only_the_camera_meant_is_sent_or_taken() {
    let mut packet = packet(PoseProfile::Compact, true, Residual::None);
    let other = Camera { fx: 300.0, ..CAMERA };
    packet.camera = Some(other);
    assert!(matches!(packet.encode(), Err(PacketError::CameraTag { .. })));
    let session = packet.latent.session;
    assert!(matches!(session.check(PRIOR, &other), Err(PacketError::CameraTag { .. })));
    assert_eq!(session.check(PRIOR, &CAMERA), Ok(()));
    let held = PriorId(1);
    assert_eq!(session.check(held, &CAMERA), Err(PacketError::Prior { packet: PRIOR, held }));
    let large = Camera { width: 4097, ..CAMERA };
    let size = Err(PacketError::Size { width: 4097, height: 180 });
    assert_eq!(session.check(PRIOR, &large), size);
}

#[test]
fn an_extreme_pose_takes_the_wide_profile() {
    let quantise = |t| {
        let pose = Pose::from_wxyz([1.0, 0.0, 0.0, 0.0], t).unwrap();
        QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Compact)
    };
    let reach = f64::from(FRAME.spread) * 64.0;
    let inside = quantise([3.5 - reach + 0.01, 0.0, 0.0]).unwrap();
    assert_eq!(inside.profile(), PoseProfile::Compact);
    let outside = quantise([3.5 - reach - 0.01, 0.0, 0.0]).unwrap();
    assert_eq!(outside.profile(), PoseProfile::Paper);
    assert_eq!(quantise([1e300, 0.0, 0.0]), Err(PacketError::Pose));
    let nan = Pose { rotation: DQuat::IDENTITY, translation: DVec3::new(0.0, f64::NAN, 0.0) };
    let refused = QuantisedPose::quantise(&nan, &FRAME, PoseProfile::Paper);
    assert_eq!(refused, Err(PacketError::Pose));
}

#[test]
fn quantising_settles_where_components_tie() {
    for k in 0..20_000_u32 {
        // Quaternions whose components differ by less than a step, around every possible tie.
        let jitter = |salt: u32| f64::from(k.wrapping_mul(salt) >> 8 & 0xFFFF) * 1e-10;
        let q = [1.0, jitter(40_503), jitter(30_011), jitter(52_361)];
        let signs = [k & 1, k & 2, k & 4, k & 8].map(|bit| if bit == 0 { 1.0 } else { -1.0 });
        let wxyz =
            [0, 1, 2, 3].map(|i| signs[i] * if k & 16 << i == 0 { 1.0 + q[i] } else { 1e-3 });
        let pose = Pose::from_wxyz(wxyz, [0.1, 0.2, 0.3]).unwrap();
        let code = QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Compact).unwrap();
        let back = code.dequantise(&FRAME);
        assert!(back.angle_to(&pose) < 2e-5, "{wxyz:?}: {}", back.angle_to(&pose));
        assert_eq!(QuantisedPose::quantise(&back, &FRAME, PoseProfile::Compact), Ok(code));
    }
}

/// A pose whose float32 quaternion has a length that its normalised form rounds differently from:
/// found by the property test below.
#[test]
fn quantising_settles_in_the_paper_profile() {
    let wxyz = [
        0.667_865_603_208_103_8,
        0.006_764_864_739_636_958,
        -0.732_187_603_347_517_4,
        -0.133_458_156_821_396_45,
    ];
    let pose = Pose::from_wxyz(wxyz, [0.0; 3]).unwrap();
    let code = QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Paper).unwrap();
    let again = QuantisedPose::quantise(&code.dequantise(&FRAME), &FRAME, PoseProfile::Paper);
    assert_eq!(again, Ok(code));
}

/// Every error of two bits in the latent part, of one bit too; an odd number of bits is found
/// because the polynomial has the factor x + 1.
#[test]
fn two_flipped_bits_are_detected() {
    for profile in [PoseProfile::Compact, PoseProfile::Paper, PoseProfile::Short] {
        let bytes = packet(profile, false, Residual::None).encode().unwrap();
        let bits = 8 * bytes.len();
        for (i, j) in (0..bits).flat_map(|i| (i..bits).map(move |j| (i, j))) {
            let mut damaged = bytes.clone();
            damaged[i / 8] ^= 1 << (i % 8);
            if i != j {
                damaged[j / 8] ^= 1 << (j % 8);
            }
            assert!(Packet::decode(&damaged).is_err(), "bits {i} and {j}");
        }
    }
}

/// Payloads are leaked until the end of the tests, so that they need no owner.
fn any_residual() -> impl Strategy<Value = Residual<'static>> {
    let payload = proptest::collection::vec(any::<u8>(), 0..400);
    prop_oneof![
        Just(Residual::None),
        Just(Residual::Omitted),
        (payload, prop_oneof![Just(Coder::Vp8), Just(Coder::WebP)])
            .prop_map(|(payload, coder)| Residual::Coded { coder, payload: payload.leak() }),
        (proptest::collection::vec(any::<u8>(), 0..400), any_reference()).prop_map(
            |(payload, reference)| Residual::Stream {
                reference,
                small_blocks: false,
                payload: payload.leak()
            }
        ),
    ]
}

fn any_reference() -> impl Strategy<Value = Option<Reference>> {
    let reference = (1u8.., any::<u16>());
    prop::option::of(reference.prop_map(|(distance, tag)| Reference { distance, tag }))
}

fn any_profile() -> impl Strategy<Value = PoseProfile> {
    prop_oneof![Just(PoseProfile::Compact), Just(PoseProfile::Paper), Just(PoseProfile::Short)]
}

fn any_pose() -> impl Strategy<Value = Pose> {
    let q = prop::array::uniform4(-1.0..1.0);
    let t = prop::array::uniform3(-290.0..290.0);
    (q, t).prop_filter_map("quaternion too short", |(q, t)| Pose::from_wxyz(q, t))
}

prop_compose! {
    fn any_packet()(
        pose in any_pose(),
        profile in any_profile(),
        (width, height) in (1_u32..=4096, 1_u32..=4096),
        (fx, cx) in (1e-3_f32..1e6, -1e5_f32..1e5),
        (frame, prior, uncertain) in (0..Latent::FRAMES, any::<u32>(), any::<bool>()),
        (with_camera, with_check, portable) in any::<(bool, bool, bool)>(),
        update in any::<Option<u16>>(),
        (residual, small_blocks) in (any_residual(), any::<bool>()),
    ) -> Packet<'static> {
        let camera = Camera { width, height, fx, fy: fx * 1.01, cx, cy: -cx };
        let pose = QuantisedPose::quantise(&pose, &FRAME, profile).unwrap();
        let latent = Latent::new(frame, PriorId(prior), &camera, pose, uncertain).unwrap();
        let render = with_check.then_some(RenderCheck(latent.frame));
        let latent = Latent { portable, ..latent };
        let latent = match profile {
            PoseProfile::Short => latent.shortened(PriorId(prior), &camera).unwrap(),
            _ => latent,
        };
        let latent = update.map_or(latent, |number| latent.with_update(number));
        let camera = (with_camera && !latent.is_short()).then_some(camera);
        let residual = if small_blocks && latent.is_short() { small(residual) } else { residual };
        Packet { latent, camera, render, residual, truth: None }
    }
}

proptest! {
    #[test]
    fn packets_round_trip(packet in any_packet()) {
        let bytes = packet.encode().unwrap();
        prop_assert_eq!(bytes.len(), packet.encoded_len());
        prop_assert_eq!(Latent::decode(&bytes), Ok(packet.latent));
        prop_assert_eq!(Packet::decode(&bytes), Ok(packet));
    }

    #[test]
    fn a_flipped_bit_is_detected(packet in any_packet(), bit in any::<prop::sample::Index>()) {
        let mut bytes = packet.encode().unwrap();
        let bit = bit.index(8 * bytes.len());
        bytes[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(Packet::decode(&bytes).is_err());
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..120)) {
        let _ = Packet::salvage(&bytes);
        for version in [0xB1, 0xB4, 0xB7, 0xB8, 0xBB, 0xBD, 0xBE] {
            let start = [version, bytes.first().copied().unwrap_or(0)];
            let bytes = [&start, &bytes[..]].concat();
            let (salvage, parsed) = (Packet::salvage(&bytes), Parsed::of(&bytes));
            prop_assert_eq!(salvage.map(|s| format!("{s:?}")), parsed.map(|p| format!("{:?}", p.salvage(&bytes))));
            let _ = Extent::read(&bytes);
            prop_assert!(valid_len(&bytes) <= bytes.len());
        }
    }

    #[test]
    fn arbitrary_later_parts_never_panic(
        tail in proptest::collection::vec(any::<u8>(), 0..60),
        (camera, render) in any::<(bool, bool)>(),
        residual in 0_u8..16,
    ) {
        let mut bytes = Vec::new();
        let profile = if residual < 8 { PoseProfile::Compact } else { PoseProfile::Short };
        let camera = camera && residual < 8;
        let follows = Follows { camera, render, residual };
        latent(profile).write(&follows, &mut bytes).unwrap();
        let latent = bytes.len();
        bytes.extend(tail);
        let salvage = format!("{:?}", Packet::salvage(&bytes).unwrap());
        let parsed = Parsed::of(&bytes).unwrap();
        prop_assert_eq!(salvage, format!("{:?}", parsed.salvage(&bytes)));
        let _ = parsed.salvage(&bytes[..latent]);
        let _ = Extent::read(&bytes);
        prop_assert!((latent..=bytes.len()).contains(&valid_len(&bytes)));
    }

    #[test]
    fn quantising_is_close_and_settled(pose in any_pose(), profile in any_profile()) {
        let code = QuantisedPose::quantise(&pose, &FRAME, profile).unwrap();
        let near = (pose.centre() - DVec3::from(FRAME.centre.map(f64::from))).abs().max_element();
        let short = profile == PoseProfile::Short && near < 7.999 * FRAME.unit();
        prop_assert!(!short || code.is_short());
        let written = if profile == PoseProfile::Short { PoseProfile::Compact } else { profile };
        prop_assert_eq!(code.profile(), written);
        let back = code.dequantise(&FRAME);
        let miss = back.centre() - pose.centre();
        let (angle, length) = match profile {
            PoseProfile::Compact => (2e-5, 0.5001 * FRAME.unit() / 131_072.0),
            PoseProfile::Paper => (3e-7, 3e-4),
            PoseProfile::Short => (2e-4, 0.5001 * FRAME.unit() / 4096.0),
        };
        prop_assert!(back.angle_to(&pose) < angle);
        prop_assert!(miss.abs().max_element() <= length);
        prop_assert_eq!(QuantisedPose::quantise(&back, &FRAME, profile), Ok(code));
    }

    #[test]
    fn quantising_settles_in_any_frame(
        pose in any_pose(),
        centre in prop::array::uniform3(-1e6_f32..1e6),
        exponent in -40..20,
        profile in any_profile(),
    ) {
        let frame = CoordinateFrame { centre, spread: 2_f32.powi(exponent) };
        let pose = Pose::from_centre(pose.rotation, DVec3::from(centre.map(f64::from)));
        let code = QuantisedPose::quantise(&pose, &frame, profile).unwrap();
        let again = QuantisedPose::quantise(&code.dequantise(&frame), &frame, profile);
        prop_assert_eq!(again, Ok(code));
    }
}

/// What a topside does with short packets: it knows the prior and some cameras.
#[test]
fn a_session_is_told_by_its_tag() {
    let latent = latent(PoseProfile::Short);
    let Session::Tagged(packet) = latent.session else { panic!("{:?}", latent.session) };
    assert_eq!(session_tag(PRIOR, &CAMERA), Ok(packet));
    assert_eq!(latent.session.check(PRIOR, &CAMERA), Ok(()));
    let found = |prior, camera: &Camera| match latent.session.check(prior, camera) {
        Err(PacketError::SessionTag { packet: named, found }) if named == packet => found,
        other => panic!("{other:?}"),
    };
    assert_ne!(found(PriorId(1), &CAMERA), packet);
    assert_ne!(found(PRIOR, &Camera { fx: 300.0, ..CAMERA }), packet);
    assert_ne!(found(PRIOR, &Camera { width: 321, ..CAMERA }), packet);
}

#[test]
fn the_short_form_refuses_what_it_cannot_hold() {
    let short =
        Packet { camera: Some(CAMERA), ..packet(PoseProfile::Short, false, Residual::None) };
    assert_eq!(short.encode(), Err(PacketError::ShortCamera));
    let fine = latent(PoseProfile::Compact);
    assert_eq!(fine.shortened(PRIOR, &CAMERA), Ok(fine), "its pose is too fine");
    let latent = Latent { session: Session::Tagged(1), ..fine };
    let forced =
        Packet { latent, camera: None, render: None, residual: Residual::None, truth: None };
    assert_eq!(forced.encode(), Err(PacketError::ShortPose));
    let mut bytes = packet(PoseProfile::Short, false, Residual::None).encode().unwrap();
    bytes[1] |= 8;
    assert_eq!(Packet::decode(&bytes), Err(PacketError::ShortCamera));
}

#[test]
fn a_pose_beyond_the_short_reach_takes_the_compact_code() {
    let quantise = |units: f64| {
        let centre = DVec3::from(FRAME.centre.map(f64::from)) + DVec3::X * units * FRAME.unit();
        let pose = Pose::from_centre(pose().rotation, centre);
        QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Short).unwrap()
    };
    assert!(quantise(7.999).is_short() && quantise(-8.0).is_short());
    for (units, profile) in [(8.01, PoseProfile::Compact), (64.1, PoseProfile::Paper)] {
        let pose = quantise(units);
        assert_eq!((pose.is_short(), pose.profile()), (false, profile));
    }
}

/// Equal components round to the last step of the code, not beyond.
#[test]
fn quarter_turns_fit_the_short_form() {
    for wxyz in [[1.0, 1.0, 0.0, 0.0], [1.0, 0.0, -1.0, 0.0], [0.0, -1.0, 0.0, 1.0]] {
        let pose = Pose::from_wxyz(wxyz, [0.1, 0.2, 0.3]).unwrap();
        let code = QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Short).unwrap();
        assert!(code.is_short());
        assert!(code.dequantise(&FRAME).angle_to(&pose) < 3e-4);
        let latent = Latent::new(7, PRIOR, &CAMERA, code, false).unwrap();
        let latent = latent.shortened(PRIOR, &CAMERA).unwrap();
        let packet =
            Packet { latent, camera: None, render: None, residual: Residual::None, truth: None };
        assert_eq!(Packet::decode(&packet.encode().unwrap()), Ok(packet));
    }
}

#[test]
fn a_short_frame_number_is_the_nearest() {
    let latent = |frame| Latent { frame, ..latent(PoseProfile::Short) };
    assert_eq!(latent(7).frame_near(None), 7);
    for (low, last, frame) in [
        (7, 7, 7),
        (8, 7, 8),
        (6, 7, 6),
        (3, 0xFFFF, 0x1_0003),
        (0xFFFE, 0x1_0001, 0xFFFE),
        (0x0304, 0x02_0300, 0x02_0304),
        (1, 0xFF_FFFF, 1),
        (0xFFFF, 0, 0xFF_FFFF),
        (0x8000, 0, 0x8000),
        (0x8001, 0, 0xFF_8001),
    ] {
        assert_eq!(latent(low).frame_near(Some(last)), frame, "{low:#x} near {last:#x}");
    }
    let full = self::latent(PoseProfile::Compact);
    assert_eq!(full.frame_near(Some(0)), full.frame);
}

/// Measures what the documentation says about the short form's checks: random bytes in place of the latent part, then
/// in place of the residual part; then the residual part of another packet.
#[test]
fn checks_of_the_short_form_miss_what_is_said() {
    let payload = [7; 60];
    let valid = packet(PoseProfile::Short, false, coded(&payload)).encode().unwrap();
    let mut state = 1_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 33) as u8
    };
    const TRIALS: u32 = 1 << 19;
    let (mut latents, mut residuals, mut both) = (0, 0, 0);
    for _ in 0..TRIALS {
        let mut bytes = valid.clone();
        bytes[2..19].fill_with(&mut random);
        let salvage = Packet::salvage(&bytes);
        latents += u32::from(salvage.is_ok());
        both += u32::from(salvage.is_ok_and(|s| s.residual.is_ok()));
        let mut bytes = valid.clone();
        bytes[20..].fill_with(&mut random);
        residuals += u32::from(Packet::decode(&bytes).is_ok());
    }
    // One in 131,072 makes 4, one in 65,536 makes 8; five standard deviations of that are 14.
    assert!(latents < 23 && residuals < 23, "{latents} latents, {residuals} residuals");
    assert_eq!(both, 0, "both checks miss one in 2³² only");
}

/// A residual fits no latent part but its own: tries other frame numbers, poses and tags.
#[test]
fn a_short_residual_belongs_to_its_latent() {
    let valid = packet(PoseProfile::Short, false, coded(b"difference"));
    let bytes = valid.encode().unwrap();
    let mut taken = 0;
    for frame in 0..u32::from(u16::MAX) {
        let latent = Latent { frame, ..valid.latent };
        let other = Packet { latent, ..valid }.encode().unwrap();
        let mixed = [&other[..SHORT_LATENT_LEN], &bytes[SHORT_LATENT_LEN..]].concat();
        taken += u32::from(Packet::decode(&mixed).is_ok() && mixed != bytes);
    }
    assert!(taken < 8, "{taken} of 65,535");
}

/// The same test if other bytes follow the part. No flip of two bits gives it another length, which the check could
/// miss.
#[test]
fn no_two_flipped_bits_change_the_form() {
    let cases = [
        (PoseProfile::Compact, Residual::None, 31),
        (PoseProfile::Short, Residual::None, SHORT_LATENT_LEN),
        (PoseProfile::Short, small(coded(b"")), SHORT_LATENT_LEN),
    ];
    for (profile, residual, len) in cases {
        let mut bytes = packet(profile, false, residual).encode().unwrap()[..len].to_vec();
        let bits = 8 * bytes.len();
        bytes.extend((0..40).map(|i: u8| i.wrapping_mul(151)));
        for (i, j) in (0..bits).flat_map(|i| (i..bits).map(move |j| (i, j))) {
            let mut damaged = bytes.clone();
            damaged[i / 8] ^= 1 << (i % 8);
            if i != j {
                damaged[j / 8] ^= 1 << (j % 8);
            }
            assert!(Latent::decode(&damaged).is_err(), "bits {i} and {j}");
        }
    }
}

mod predicted;

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;
use crate::prior::{CoordinateFrame, PriorId};
use crate::{Camera, Pose};

const FRAME: CoordinateFrame = CoordinateFrame { centre: [-3.5, 2.25, 24.0], spread: 8.25 };
const PRIOR: PriorId = PriorId(0xd4a5_d0ed);
const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 274.5, fy: 274.25, cx: 160.0, cy: 90.0 };
const SESSION: Session = Session { prior: PRIOR, camera: CAMERA };

fn pose() -> Pose {
    Pose::from_wxyz([0.9, 0.1, -0.3, 0.2], [1.0, 2.0, 3.0]).unwrap()
}

fn latent(profile: PoseProfile) -> Latent {
    let pose = QuantisedPose::quantise(&pose(), &FRAME, profile).unwrap();
    let tag = SESSION.tag().unwrap();
    Latent {
        frame: 0x0304,
        tag,
        pose,
        uncertain: false,
        known: None,
        portable: true,
        predicted: None,
    }
}

/// A packet that holds every part that a packet may.
fn packet(profile: PoseProfile, stated: bool, residual: Residual<'_>) -> Packet<'_> {
    let session = stated.then_some(SESSION);
    Packet { latent: latent(profile), session, render: None, residual, truth: None }
}

fn short(residual: Residual<'_>) -> Packet<'_> {
    packet(PoseProfile::Short, false, residual)
}

fn coded(payload: &[u8]) -> Residual<'_> {
    Residual::Coded { small_blocks: false, payload }
}

fn small(payload: &[u8]) -> Residual<'_> {
    Residual::Coded { small_blocks: true, payload }
}

fn inter(payload: &[u8]) -> Residual<'_> {
    let reference = Some(Reference { distance: 7, tag: 0x0201 });
    Residual::Stream { reference, small_blocks: true, payload }
}

fn intra(payload: &[u8]) -> Residual<'_> {
    Residual::Stream { reference: None, small_blocks: false, payload }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// With this bit flipped.
fn flipped(bytes: &[u8], bits: &[usize]) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    bits.iter().for_each(|bit| damaged[bit / 8] ^= 1 << (bit % 8));
    damaged
}

/// Pins the wire format: a change here is a new version of it.
#[test]
fn golden_packets() {
    use PoseProfile::{Compact, Short};
    let uncertain = Latent { uncertain: true, portable: false, ..latent(Short) };
    let map = &[0b0000_0101, 0x13, 5, 6, 7][..];
    let told = Packet { truth: Some(map), ..short(inter(b"abc")) };
    let all_seen = Packet { truth: Some(truth::ALL_SEEN), ..short(Residual::None) };
    let checked = Packet { render: Some(RenderCheck(0x0403_0201)), ..short(Residual::Omitted) };
    let cases = [
        (short(Residual::None), "0000040374499a00a8f81bcf925212525212bd0a"),
        (
            Packet { latent: uncertain, ..short(Residual::Omitted) },
            "2030040374499a00a8f81bcf92521252521261dd",
        ),
        (
            packet(Compact, true, Residual::None),
            concat!(
                "070404037449451300fc14ff6be3f994948e84a4a424958bedd0a5d43f310b00408943002089",
                "43000020430000b4429d96"
            ),
        ),
        (checked, "2008040374499a00a8f81bcf925212525212727801020304afcd"),
        (all_seen, "4000040374499a00a8f81bcf92521252521222f1"),
        (
            short(coded(b"difference")),
            "6000040374499a00a8f81bcf925212525212fd047dd0646966666572656e6365",
        ),
        (
            packet(Compact, true, small(b"abc")),
            concat!(
                "670504037449451300fc14ff6be3f994948e84a4a42494e1edd0a5d43f310b00408943002089",
                "43000020430000b4429d96d3d3616263"
            ),
        ),
        (short(intra(b"abc")), "8000040374499a00a8f81bcf925212525212a2edf6c2616263"),
        (told, "a003040374499a00a8f81bcf9252125252125b29660a0701020513050607616263"),
    ];
    for (packet, expected) in cases {
        let bytes = packet.encode().unwrap();
        assert_eq!(hex(&bytes), expected);
        assert_eq!(Packet::decode(&bytes), Ok(packet));
        assert_eq!(bytes.len(), packet.encoded_len());
    }
}

#[test]
fn parts_have_the_lengths_that_are_said() {
    assert_eq!((SHORT_LATENT_LEN, SESSION_PART_LEN, RENDER_PART_LEN), (20, 25, 6));
    assert_eq!(latent(PoseProfile::Short).encoded_len(), SHORT_LATENT_LEN);
    assert_eq!(latent(PoseProfile::Compact).encoded_len(), SHORT_LATENT_LEN + 4);
    assert_eq!(residual_part_len(100), 102);
    assert_eq!(short(coded(&[7; 100])).encoded_len(), 20 + 2 + 100);
    assert_eq!(short(intra(b"abc")).encoded_len(), short(coded(b"abc")).encoded_len());
    assert_eq!(short(inter(b"abc")).encoded_len(), short(coded(b"abc")).encoded_len() + 3);
    assert_eq!(short(small(b"abc")).encoded_len(), short(coded(b"abc")).encoded_len());
}

#[test]
fn damage_in_one_part_leaves_the_others() {
    let packet = Packet {
        render: Some(RenderCheck(0x0403_0201)),
        ..packet(PoseProfile::Compact, true, coded(b"difference"))
    };
    let bytes = packet.encode().unwrap();
    let read = |at: usize| {
        let damaged = flipped(&bytes, &[8 * at]);
        let parsed = Parsed::of(&damaged).unwrap();
        assert_eq!(parsed.latent(), &packet.latent);
        let session = parsed.session() == &Err(PacketError::Check(Part::Session));
        let render = parsed.render() == &Err(PacketError::Check(Part::Render));
        let residual = parsed.residual(&damaged) == Err(PacketError::Check(Part::Residual));
        [session, render, residual]
    };
    let latent = packet.latent.encoded_len();
    assert_eq!(read(latent), [true, false, false]);
    assert_eq!(read(latent + 24), [true, false, false]);
    assert_eq!(read(latent + 25), [false, true, false]);
    assert_eq!(read(latent + 31), [false, false, true]);
    assert_eq!(read(bytes.len() - 1), [false, false, true]);
    assert!(Parsed::of(&flipped(&bytes, &[8 * latent - 1])).is_err());
}

#[test]
fn a_truncated_packet_still_yields_its_latent() {
    let packet = packet(PoseProfile::Short, true, inter(&[7; 300]));
    let bytes = packet.encode().unwrap();
    let (latent, head) = (SHORT_LATENT_LEN, SHORT_LATENT_LEN + SESSION_PART_LEN);
    for len in 0..bytes.len() {
        let start = &bytes[..len];
        assert!(Packet::decode(start).is_err());
        let Ok(parsed) = Parsed::of(start) else {
            assert!(len < latent);
            continue;
        };
        assert!(len >= latent && parsed.latent() == &packet.latent);
        assert_eq!(parsed.session().is_ok(), len >= head);
        assert_eq!(parsed.residual(start).unwrap_err().part(), Some(Part::Residual));
        // Behind check and reference lies what there is of the payload.
        let there = len.checked_sub(head + 5);
        let found = parsed.start(start);
        assert_eq!(found.map(|start| start.payload.len()), there);
        if let Some(found) = found {
            assert_eq!((found.small_blocks, found.reference.unwrap().distance), (true, 7));
        }
        let extent = Extent::read(start).unwrap();
        assert_eq!((extent.latent, extent.head, extent.whole), (latent, head, None));
        assert_eq!(extent.valid, if len >= head { head } else { latent });
    }
    let extent = Extent::read(&bytes).unwrap();
    assert_eq!((extent.valid, extent.whole), (bytes.len(), Some(bytes.len())));
}

#[test]
fn zeros_behind_a_packet_are_padding() {
    let map = Some(&[0b0000_0101, 0x10][..]);
    let bare = short(Residual::Omitted);
    let packets = [
        short(Residual::None),
        short(coded(b"difference")),
        short(coded(b"")),
        packet(PoseProfile::Compact, true, intra(b"")),
        Packet { truth: map, ..bare },
        Packet { truth: map, ..short(inter(b"")) },
    ];
    for packet in packets {
        let mut bytes = packet.encode().unwrap();
        let len = bytes.len();
        for padded in [len + 1, len + 2, 256] {
            bytes.resize(padded, 0);
            assert_eq!(Packet::decode(&bytes), Ok(packet), "{packet:?}");
            assert_eq!(Extent::read(&bytes).unwrap().whole, Some(len));
        }
    }
    // Other bytes are damage, if a residual comes before them; else nobody looks at them.
    let noise = [short(coded(b"abc")).encode().unwrap(), vec![9]].concat();
    assert_eq!(Packet::decode(&noise), Err(PacketError::Check(Part::Residual)));
}

#[test]
fn truth_maps_come_back() {
    let map = &[0b0000_0101, 0x13, 5, 6, 7][..];
    let mended = &[0b0000_1000][..];
    for residual in [Residual::None, Residual::Omitted, coded(b"abc"), intra(b""), inter(b"abc")] {
        for map in [truth::ALL_SEEN, mended, map] {
            let packet = Packet { truth: Some(map), ..short(residual) };
            let bytes = packet.encode().unwrap();
            assert_eq!(bytes.len(), packet.encoded_len());
            assert_eq!(Packet::decode(&bytes), Ok(packet));
            // It is no longer than it may be.
            let bare = Packet { truth: None, ..packet };
            assert!(bare.truth_room(bytes.len()) >= map.len(), "{residual:?}");
            let front = 2 + if residual == inter(b"abc") { Reference::LEN } else { 0 };
            let told = Extent::read(&bytes).unwrap().told;
            let in_head = bytes.len() == SHORT_LATENT_LEN;
            assert_eq!(told, if in_head { 0 } else { front + map.len() }, "{residual:?}");
            // Of a packet that is cut, a map that is whole is left.
            for len in SHORT_LATENT_LEN..bytes.len() {
                let parsed = Parsed::of(&bytes[..len]).unwrap();
                let is_whole = len >= SHORT_LATENT_LEN + front + map.len();
                assert_eq!(parsed.truth(&bytes[..len]).is_some(), is_whole, "{residual:?}, {len}");
                assert!(parsed.residual(&bytes[..len]).is_err());
            }
        }
    }
    let none = short(Residual::None);
    let all_seen = Packet { truth: Some(truth::ALL_SEEN), ..none };
    assert_eq!(all_seen.encoded_len(), none.encoded_len(), "it takes no byte");
    for bad in [&[][..], &[0b0000_0101], &[0b0000_0000, 1]] {
        assert_eq!(Packet { truth: Some(bad), ..none }.encode(), Err(PacketError::Truth));
    }
}

#[test]
fn what_this_version_does_not_know_is_refused_by_name() {
    let seal = |bytes: &mut Vec<u8>| {
        let end = bytes.len() - 2;
        let check = bytes::crc16(&[&bytes[..end]]).to_le_bytes();
        bytes[end..].copy_from_slice(&check);
    };
    // A pose of another kind; its part ends where later versions promise it.
    let mut later = [&[0b1_1110][..], &[7; 17]].concat();
    assert_eq!(Packet::decode(&later), Err(PacketError::Check(Part::Latent)), "garbage");
    seal(&mut later);
    assert_eq!(Packet::decode(&later), Err(PacketError::Version));
    // Residuals that do not fit their other bits: the render is there.
    for (kind, second) in [(0_u8, 1), (1, 1), (2, 1), (2, 2)] {
        let mut bytes = short(Residual::None).encode().unwrap();
        (bytes[0], bytes[1]) = (kind << 5, second);
        seal(&mut bytes);
        let parsed = Parsed::of(&bytes).unwrap();
        assert_eq!(parsed.residual(&bytes), Err(PacketError::Coder(kind)));
        assert_eq!(parsed.truth(&bytes), None);
    }
    // The words of the pose's kind that nothing has.
    let known = [0b0_0000, 0b0_0111, 0b1_1001, 0b1_1110];
    for word in (0..32).filter(|word| !known.contains(word)) {
        let bytes = [&[word][..], &[0; 60]].concat();
        assert_eq!(Packet::decode(&bytes), Err(PacketError::Check(Part::Latent)));
    }
}

#[test]
fn a_session_part_is_that_of_the_tag() {
    let other = Session { camera: Camera { fx: 300.0, ..CAMERA }, ..SESSION };
    let wrong = Packet { session: Some(other), ..short(Residual::None) };
    assert!(matches!(wrong.encode(), Err(PacketError::SessionTag { .. })));
    // One that belongs to another packet: its own check matches.
    let bytes = packet(PoseProfile::Short, true, Residual::None).encode().unwrap();
    let latent = Latent { tag: other.tag().unwrap(), ..latent(PoseProfile::Short) };
    let foreign = Packet { latent, session: Some(other), ..short(Residual::None) };
    let foreign = foreign.encode().unwrap();
    let mixed = [&bytes[..SHORT_LATENT_LEN], &foreign[SHORT_LATENT_LEN..]].concat();
    let parsed = Parsed::of(&mixed).unwrap();
    assert!(matches!(parsed.session(), Err(PacketError::SessionTag { .. })));
    assert_ne!(Session { prior: PriorId(1), ..SESSION }.tag(), SESSION.tag());
    let large = Session { camera: Camera { width: 4097, ..CAMERA }, ..SESSION };
    assert_eq!(large.tag(), Err(PacketError::Size { width: 4097, height: 180 }));
    let flat = Session { camera: Camera { fx: 0.0, ..CAMERA }, ..SESSION };
    let latent = Latent { tag: flat.tag().unwrap(), ..latent };
    let flat = Packet { latent, session: Some(flat), ..short(Residual::None) };
    assert!(matches!(flat.encode(), Err(PacketError::Camera(_))));
}

#[test]
fn an_extreme_pose_has_no_packet() {
    let quantise = |t| {
        let pose = Pose::from_wxyz([1.0, 0.0, 0.0, 0.0], t).unwrap();
        QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Compact)
    };
    let reach = f64::from(FRAME.spread) * 64.0;
    let inside = quantise([3.5 - reach + 0.01, 0.0, 0.0]).unwrap();
    assert_eq!(inside.profile(), PoseProfile::Compact);
    let outside = quantise([3.5 - reach - 0.01, 0.0, 0.0]).unwrap();
    assert_eq!(outside.profile(), PoseProfile::Free);
    let latent = Latent { pose: outside, ..latent(PoseProfile::Short) };
    let written = Packet { latent, ..short(Residual::None) }.encode();
    assert_eq!(written, Err(PacketError::Pose));
    assert_eq!(quantise([1e300, 0.0, 0.0]), Err(PacketError::Pose));
    let nan = Pose { rotation: DQuat::IDENTITY, translation: DVec3::new(0.0, f64::NAN, 0.0) };
    let refused = QuantisedPose::quantise(&nan, &FRAME, PoseProfile::Free);
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
fn quantising_settles_in_the_free_profile() {
    let wxyz = [
        0.667_865_603_208_103_8,
        0.006_764_864_739_636_958,
        -0.732_187_603_347_517_4,
        -0.133_458_156_821_396_45,
    ];
    let pose = Pose::from_wxyz(wxyz, [0.0; 3]).unwrap();
    let code = QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Free).unwrap();
    let again = QuantisedPose::quantise(&code.dequantise(&FRAME), &FRAME, PoseProfile::Free);
    assert_eq!(again, Ok(code));
}

/// Every error of one or two bits in the latent part, of any odd number too: the polynomial has the factor x + 1, and
/// no two flipped bits give the part another length.
#[test]
fn two_flipped_bits_are_detected() {
    for profile in [PoseProfile::Short, PoseProfile::Compact] {
        for residual in [Residual::None, coded(&[0x97; 40])] {
            let mut bytes = packet(profile, false, residual).encode().unwrap();
            let bits = 8 * latent(profile).encoded_len();
            bytes.extend((0..40).map(|i: u8| i.wrapping_mul(151)));
            for (i, j) in (0..bits).flat_map(|i| (i..bits).map(move |j| (i, j))) {
                let bits = if i == j { vec![i] } else { vec![i, j] };
                assert!(Latent::decode(&flipped(&bytes, &bits)).is_err(), "bits {i} and {j}");
            }
        }
    }
}

/// Measures what the documentation says of the checks: random bytes in place of the latent part, then in place of the
/// residual part; then the residual part of another packet.
#[test]
fn checks_miss_what_is_said() {
    let valid = short(coded(&[7; 60])).encode().unwrap();
    let mut random = crate::random::Random::new(1);
    const TRIALS: u32 = 1 << 19;
    let (mut latents, mut residuals, mut both) = (0, 0, 0);
    for _ in 0..TRIALS {
        let mut bytes = valid.clone();
        bytes[2..SHORT_LATENT_LEN].fill_with(|| random.bits() as u8);
        latents += u32::from(Parsed::of(&bytes).is_ok());
        both += u32::from(Packet::decode(&bytes).is_ok());
        let mut bytes = valid.clone();
        bytes[SHORT_LATENT_LEN..].fill_with(|| random.bits() as u8);
        residuals += u32::from(Packet::decode(&bytes).is_ok());
    }
    // One in 131,072 makes 4, one in 65,536 makes 8; five standard deviations of that are 14.
    assert!(latents < 23 && residuals < 23, "{latents} latents, {residuals} residuals");
    assert_eq!(both, 0, "both checks miss one in 2³² only");
}

/// A residual fits no latent part but its own: tries other frame numbers.
#[test]
fn a_residual_belongs_to_its_latent() {
    let valid = short(coded(b"difference"));
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

#[test]
fn a_frame_number_is_the_nearest() {
    let latent = |frame| Latent { frame, ..latent(PoseProfile::Short) };
    assert_eq!(latent(7).frame_near(None), 7);
    for (low, last, frame) in [
        (7, 7, 7),
        (8, 7, 8),
        (6, 7, 6),
        (3, 0xFFFF, 0x1_0003),
        (0xFFFE, 0x1_0001, 0xFFFE),
        (0x0304, 0x0A02_0300, 0x0A02_0304),
        (1, u32::MAX, 1),
        (0xFFFF, 0, u32::MAX),
        (0x8000, 0, 0x8000),
        (0x8001, 0, 0xFFFF_8001),
    ] {
        assert_eq!(latent(low).frame_near(Some(last)), frame, "{low:#x} near {last:#x}");
    }
}

/// Payloads are leaked until the end of the tests, so that they need no owner. None ends with a zero.
fn any_residual() -> impl Strategy<Value = Residual<'static>> {
    let payload = proptest::collection::vec(any::<u8>(), 0..400);
    let payload = payload.prop_map(|payload| without_zeros(payload.leak()));
    let reference = (1u8.., any::<u16>());
    let reference = reference.prop_map(|(distance, tag)| Reference { distance, tag });
    (0..4, prop::option::of(reference), any::<bool>(), payload).prop_map(
        |(kind, reference, small_blocks, payload)| match kind {
            0 => Residual::None,
            1 => Residual::Omitted,
            2 => Residual::Coded { small_blocks, payload },
            _ => Residual::Stream { reference, small_blocks, payload },
        },
    )
}

fn any_profile() -> impl Strategy<Value = PoseProfile> {
    prop_oneof![Just(PoseProfile::Compact), Just(PoseProfile::Free), Just(PoseProfile::Short)]
}

fn any_pose() -> impl Strategy<Value = Pose> {
    let q = prop::array::uniform4(-1.0..1.0);
    let t = prop::array::uniform3(-290.0..290.0);
    (q, t).prop_filter_map("quaternion too short", |(q, t)| Pose::from_wxyz(q, t))
}

prop_compose! {
    fn any_packet()(
        pose in any_pose(),
        compact in any::<bool>(),
        (width, height) in (1_u32..=4096, 1_u32..=4096),
        (fx, cx) in (1e-3_f32..1e6, -1e5_f32..1e5),
        (frame, prior, code) in (0..Latent::FRAMES, any::<u32>(), 0u8..8),
        (stated, checked, portable) in any::<(bool, bool, bool)>(),
        residual in any_residual(),
    ) -> Packet<'static> {
        let camera = Camera { width, height, fx, fy: fx * 1.01, cx, cy: -cx };
        let session = Session { prior: PriorId(prior), camera };
        let profile = if compact { PoseProfile::Compact } else { PoseProfile::Short };
        let pose = QuantisedPose::quantise(&pose, &FRAME, profile).unwrap();
        let tag = session.tag().unwrap();
        let confidence = Confidence::of_code(code);
        let (uncertain, known) = (confidence.is_uncertain(), confidence.known());
        let latent = Latent { frame, tag, pose, uncertain, known, portable, predicted: None };
        let render = checked.then_some(RenderCheck(latent.frame));
        Packet { latent, session: stated.then_some(session), render, residual, truth: None }
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
        let bytes = packet.encode().unwrap();
        let bit = bit.index(8 * bytes.len());
        prop_assert!(Packet::decode(&flipped(&bytes, &[bit])).is_err());
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..120)) {
        for word in 0..32 {
            let mut bytes = bytes.clone();
            if let Some(first) = bytes.first_mut() {
                *first = *first & 0xE0 | word;
            }
            let _ = Parsed::of(&bytes);
            if let Ok(extent) = Extent::read(&bytes) {
                prop_assert!(extent.valid <= bytes.len());
                prop_assert!(extent.whole.is_none_or(|whole| whole <= bytes.len()));
            }
        }
    }

    #[test]
    fn arbitrary_later_parts_never_panic(
        tail in proptest::collection::vec(any::<u8>(), 0..60),
        kind in 0_u8..8,
        second in 0_u8..64,
    ) {
        let mut bytes = short(Residual::None).encode().unwrap();
        (bytes[0], bytes[1]) = (kind << 5, second);
        let check = bytes::crc16(&[&bytes[..SHORT_LATENT_LEN - 2]]).to_le_bytes();
        bytes[SHORT_LATENT_LEN - 2..].copy_from_slice(&check);
        bytes.extend(tail);
        let parsed = Parsed::of(&bytes).unwrap();
        for end in [bytes.len(), SHORT_LATENT_LEN, 0] {
            let some = &bytes[..end];
            let _ = (parsed.residual(some), parsed.start(some), parsed.truth(some));
        }
        let extent = Extent::read(&bytes).unwrap();
        prop_assert!((SHORT_LATENT_LEN..=bytes.len()).contains(&extent.valid));
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
            PoseProfile::Free => (3e-7, 3e-4),
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

#[test]
fn a_pose_beyond_the_short_reach_takes_the_compact_code() {
    let quantise = |units: f64| {
        let centre = DVec3::from(FRAME.centre.map(f64::from)) + DVec3::X * units * FRAME.unit();
        let pose = Pose::from_centre(pose().rotation, centre);
        QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Short).unwrap()
    };
    assert!(quantise(7.999).is_short() && quantise(-8.0).is_short());
    for (units, profile) in [(8.01, PoseProfile::Compact), (64.1, PoseProfile::Free)] {
        let pose = quantise(units);
        assert_eq!((pose.is_short(), pose.profile()), (false, profile));
    }
}

/// Equal components round to the last step of the code, not beyond.
#[test]
fn quarter_turns_fit_the_short_code() {
    for wxyz in [[1.0, 1.0, 0.0, 0.0], [1.0, 0.0, -1.0, 0.0], [0.0, -1.0, 0.0, 1.0]] {
        let pose = Pose::from_wxyz(wxyz, [0.1, 0.2, 0.3]).unwrap();
        let code = QuantisedPose::quantise(&pose, &FRAME, PoseProfile::Short).unwrap();
        assert!(code.is_short());
        assert!(code.dequantise(&FRAME).angle_to(&pose) < 3e-4);
        let latent = Latent { pose: code, ..latent(PoseProfile::Short) };
        let packet = Packet { latent, ..short(Residual::None) };
        assert_eq!(Packet::decode(&packet.encode().unwrap()), Ok(packet));
    }
}

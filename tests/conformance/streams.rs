//! Vectors of frames that depend on others: streams, truth maps, predicted poses.

use nvsprior::packet::{Latent, Parsed, PoseProfile, Residual};
use nvsprior::{
    Camera, Encoder, EncoderOptions, Mode, Picture, Prior, Rate, RenderChecks, Structure, Trust,
};

use crate::common::engine;
use crate::dive::{CAMERA, Dive, packet, pose};
use crate::vector::{Kind, Vector};

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    [streams(&dive), truths(&dive), poses(&dive)].into_iter().flatten().collect()
}

fn encoded(dive: &Dive, rate: Rate, mode: Mode, truth: bool, count: u32) -> Vec<Vec<u8>> {
    let options = EncoderOptions { rate: Some(rate), mode, truth, ..EncoderOptions::default() };
    dive.encoded(options, count).into_iter().map(|encoded| encoded.packet).collect()
}

fn without(packets: &[Vec<u8>], lost: &[usize]) -> Vec<Vec<u8>> {
    let stays = packets.iter().enumerate().filter(|(place, _)| !lost.contains(place));
    stays.map(|(_, packet)| packet.clone()).collect()
}

fn streams(dive: &Dive) -> Vec<Vector> {
    let chain = Mode::Stream(Structure::Chain { key_every: 5 });
    let layers = Mode::Stream(Structure::Layers { key_every: 0 });
    let rate = Rate::Quality(55.0);
    let chained = encoded(dive, rate, chain, false, 8);
    let layered = encoded(dive, rate, layers, false, 9);
    let mapped = encoded(dive, Rate::Quality(30.0), chain, true, 6);
    let other = encoded(dive, Rate::Quality(70.0), chain, false, 2);
    // The first frame of another stream, under the same number.
    let mixed = vec![other[0].clone(), chained[1].clone(), chained[2].clone()];
    let cut: Vec<Vec<u8>> = chained
        .iter()
        .enumerate()
        .map(|(t, packet)| packet[..packet.len() - if t == 2 { 9 } else { 0 }].to_vec())
        .collect();
    // Those with a short pose, without a session part.
    let foreign = |packet: &Vec<u8>| match (packet[0] & 0x1F, packet[1] & 4) {
        (0, 0) => {
            crate::bad::rechecked([&[packet[0], packet[1] | 0x20][..], &packet[2..]].concat())
        }
        _ => packet.clone(),
    };
    let displaced = displaced(dive);
    let starts = displaced.iter().skip(1).zip([24, 28, 33, 62]);
    let starts = starts.map(|(packet, len)| packet[..len.min(packet.len())].to_vec());
    let cut_displaced = displaced.iter().cloned().chain(starts).collect();
    let late = [0, 2, 1, 3].map(|place| layered[place].clone()).to_vec();
    vec![
        Vector::packets("stream-chain", "a chain: each frame from the one before", chained.clone()),
        Vector::packets(
            "stream-layers",
            "layers: references up to four frames back",
            layered.clone(),
        ),
        Vector::packets(
            "stream-twice",
            "each packet of a chain comes twice",
            chained.iter().flat_map(|packet| [packet.clone(), packet.clone()]).collect(),
        ),
        Vector::packets(
            "stream-losses",
            "a chain with losses: no frame is predicted from what is missing",
            without(&chained, &[2, 3, 6]),
        ),
        Vector::packets(
            "stream-layers-losses",
            "layers with losses",
            without(&layered, &[1, 3, 6]),
        ),
        Vector::packets("stream-order", "layers out of order", late),
        Vector::packets(
            "stream-other",
            "a reference of the right number and another stream",
            mixed,
        ),
        Vector {
            kind: Kind::Packets { trust: Trust::Start },
            ..Vector::packets("stream-cut", "a chain; one packet is cut, and so no reference", cut)
        },
        Vector::packets(
            "stream-not-portable",
            "a chain of a device that is not portable",
            chained.iter().map(foreign).collect(),
        ),
        Vector::packets("stream-displaced", "frames with displaced blocks", displaced.clone()),
        Vector {
            kind: Kind::Packets { trust: Trust::Start },
            ..Vector::packets(
                "stream-displaced-cut",
                "starts of packets with displaced blocks",
                cut_displaced,
            )
        },
        Vector::packets("stream-truth", "a chain with truth maps", mapped),
    ]
}

/// Objects in many blocks, of which some differ and some are wrong.
fn littered(mut picture: Picture) -> Picture {
    let width = picture.width as usize;
    for (i, value) in picture.data.iter_mut().enumerate() {
        let (x, y) = (i / 3 % width / 16, i / 3 / width / 16);
        let off = [0, 0, 25, 0, 90, 0, 0, 60, 0, 30, 0][(7 * x + 5 * y + x * y) % 11];
        *value = if i / 3 % 7 < 4 { value.saturating_add(off) } else { value.saturating_sub(off) };
    }
    picture
}

/// Truth maps of many blocks, which change little: most are predicted from a key map.
fn littered_packets(dive: &Dive, rate: Rate, count: u32) -> Vec<Vec<u8>> {
    let camera = Camera { width: 176, height: 100, fx: 140.0, fy: 141.0, cx: 88.0, cy: 50.5 };
    let options = EncoderOptions { rate: Some(rate), truth: true, ..EncoderOptions::default() };
    let frames = dive.encoded_as(&camera, options, count, littered);
    let packets: Vec<_> = frames.into_iter().map(|encoded| encoded.packet).collect();
    assert!(packets.iter().any(|packet| has_predicted_map(packet)), "a map is predicted");
    packets
}

fn has_predicted_map(packet: &[u8]) -> bool {
    let parsed = Parsed::of(packet).unwrap();
    parsed.truth(packet).is_some_and(|map| map[0] & 0b100 != 0)
}

/// A textured object that the prior does not know: it stands far in front of the wall, so it moves much.
fn passing(dive: &Dive, camera: &Camera, t: u32) -> Picture {
    let mut picture = dive.seen(camera, t);
    let width = picture.width as usize;
    for (i, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = ((i % width) as u32 + 5 * t, (i / width) as u32 + t);
        if (70..140).contains(&x) && (20..80).contains(&y) {
            let light = 60 + (x * x * 3 + y * 7 * x + y * y * 11) / 8 % 120;
            rgb.copy_from_slice(&[light as u8, (light / 2 + x) as u8, (200 - light) as u8]);
        }
    }
    picture
}

/// A stream whose frames have displaced blocks.
fn displaced(dive: &Dive) -> Vec<Vec<u8>> {
    let camera = Camera { width: 150, height: 90, fx: 120.0, fy: 121.0, cx: 75.0, cy: 45.5 };
    let mode = Mode::Stream(Structure::Chain { key_every: 0 });
    let rate = Some(Rate::Quality(45.0));
    let options = EncoderOptions { rate, mode, truth: true, ..EncoderOptions::default() };
    dive.encoded_of(&camera, options, 6, |t| passing(dive, &camera, t))
        .into_iter()
        .map(|encoded| encoded.packet)
        .collect()
}

fn truths(dive: &Dive) -> Vec<Vector> {
    let coarse = encoded(dive, Rate::Bytes(75), Mode::Intra, true, 6);
    let middle = encoded(dive, Rate::Bytes(150), Mode::Intra, true, 10);
    let fine = encoded(dive, Rate::Quality(70.0), Mode::Intra, true, 3);
    let littered = littered_packets(dive, Rate::Bytes(130), 12);
    let shorter = littered.iter().map(|packet| packet[..packet.len() - 20].to_vec()).collect();
    let cuts = middle.iter().flat_map(|packet| {
        let len = packet.len();
        [len, len - 5, len / 2 + 10, 26].map(|len| packet[..len.min(packet.len())].to_vec())
    });
    vec![
        Vector::packets("truth-coarse", "truth maps at few bytes", coarse),
        Vector::packets("truth-fine", "truth maps of pictures that are right", fine),
        Vector {
            cameras: vec![CAMERA],
            ..Vector::packets(
                "truth-losses",
                "truth maps whose key map is lost",
                without(&middle, &[0, 3]),
            )
        },
        Vector {
            kind: Kind::Packets { trust: Trust::Start },
            cameras: vec![CAMERA],
            ..Vector::packets("truth-cut", "starts of packets with truth maps", cuts.collect())
        },
        Vector::packets("truth", "truth maps of a dive at a budget", middle),
        Vector::packets(
            "truth-predicted",
            "truth maps that are predicted from a key map",
            littered.clone(),
        ),
        Vector::packets("truth-key-lost", "the key map is lost", without(&littered, &[4, 8])),
        Vector {
            kind: Kind::Packets { trust: Trust::Start },
            ..Vector::packets(
                "truth-predicted-cut",
                "starts of packets with predicted maps",
                shorter,
            )
        },
    ]
}

pub fn is_predicted(packet: &[u8]) -> bool {
    packet[0] & 0x1F == 0b1_1001
}

/// Packets of which some state their poses as what they differ by from earlier ones. Some have a render part.
pub fn predicted(dive: &Dive, rate: Option<Rate>, count: u32) -> Vec<Vec<u8>> {
    let options = EncoderOptions {
        rate,
        truth: true,
        predict_poses: true,
        render_checks: RenderChecks::Every(3),
        ..EncoderOptions::default()
    };
    let mut encoder = Encoder::new(&engine(), &dive.scene(), &CAMERA, options).unwrap();
    let mut packets = Vec::new();
    for t in 0..count {
        packets.push(encoder.encode(&dive.seen(&CAMERA, t), pose(t)).unwrap().packet);
        // What came before is held once two frames have gone by.
        if t > 0 {
            encoder.acknowledge_pose(t - 1, true);
        }
    }
    assert!(packets.iter().filter(|packet| is_predicted(packet)).count() > 1);
    packets
}

fn poses(dive: &Dive) -> Vec<Vector> {
    let packets = predicted(dive, Some(Rate::Quality(25.0)), 8);
    let first = packets.iter().position(|packet| is_predicted(packet)).unwrap();
    let damaged = |place: usize, bit: usize| {
        let mut packet = packets[place].clone();
        packet[bit / 8] ^= 1 << (bit % 8);
        packet
    };
    let bits = [0, 3, 5, 8, 15, 17, 30, 35, 50, 70, 90];
    let spoiled = bits.map(|bit| damaged(first, bit)).to_vec();
    let before = packets[..first].to_vec();
    let cuts: Vec<Vec<u8>> =
        (0..packets[first].len()).step_by(3).map(|n| packets[first][..n].to_vec()).collect();
    // No pose is predicted from one that is far away.
    let far = nvsprior::Pose::from_wxyz([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 40.0]).unwrap();
    let far = Latent {
        pose: dive.quantised(&far, PoseProfile::Short),
        ..dive.short(&CAMERA, first as u32 - 2)
    };
    let far = packet(far, None, None, Residual::None);
    vec![
        Vector::packets("predicted", "poses that are predicted from those before", packets.clone()),
        Vector::packets(
            "predicted-losses",
            "poses whose reference is lost",
            without(&packets, &[1, 4]),
        ),
        Vector::packets(
            "predicted-damaged",
            "damaged packets with predicted poses",
            spoiled
                .into_iter()
                .flat_map(|bad| [before.clone(), vec![bad, packets[first].clone()]].concat())
                .collect(),
        ),
        Vector::packets(
            "predicted-cut",
            "starts of a packet with a predicted pose",
            [before.clone(), cuts].concat(),
        ),
        Vector::packets(
            "predicted-far",
            "a reference whose pose is not on the short grid",
            [before, vec![far, packets[first].clone()]].concat(),
        ),
    ]
}

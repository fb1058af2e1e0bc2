//! Vectors of single frames: parts of packets, renders, and residuals.

use nvsprior::packet::{Latent, PoseBound, PoseProfile, RenderCheck, Residual, SHORT_LATENT_LEN};
use nvsprior::{Camera, Picture, Prior, Rate, Trust};

use crate::dive::{CAMERA, Dive, How, packet, pose};
use crate::vector::{Kind, Vector};

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    let mut all = poses(&dive);
    all.extend(parts(&dive));
    all.extend(renders(prior));
    all.extend(residuals(&dive));
    all.extend(starts(&dive));
    all.extend(sizes(&dive));
    all
}

fn none(latent: Latent) -> Vec<u8> {
    packet(latent, None, None, Residual::None)
}

fn poses(dive: &Dive) -> Vec<Vector> {
    let short = |t| dive.short(&CAMERA, t);
    let key = dive.key(&CAMERA, 0);
    let far = nvsprior::Pose::from_wxyz([1.0, 0.0, 0.0, 0.01], [0.0, 0.0, 40.0]).unwrap();
    let far = Latent { pose: dive.quantised(&far, PoseProfile::Short), ..short(9) };
    assert_eq!(far.pose.written_as(), PoseProfile::Compact, "it is beyond the short one's reach");
    let compact = dive.latent(&CAMERA, 1, PoseProfile::Compact);
    let session = Some(dive.session(&CAMERA));
    let numbers = [65_520_u32, 65_530, 65_540, 200_000, 7, 32_775, 7, 32_774]
        .map(|frame| packet(Latent { frame, ..short(4) }, session, None, Residual::None));
    let unsure = Latent { uncertain: true, ..short(7) };
    let bounds = [1e-4, 1e-3, 2e-3, 5e-3, 0.02, 0.1, 0.5].map(|d| PoseBound::of(&[d; 6], 1.0));
    let known = (1..).zip(bounds).map(|(t, known)| none(Latent { known, ..short(t) }));
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    vec![
        Vector::packets("session", "a packet with the session part", vec![key.clone()]),
        Vector::packets(
            "compact",
            "compact poses: one near, one beyond the short one's reach",
            many(vec![none(compact), none(far)]),
        ),
        Vector::packets("short", "short poses", many(vec![none(short(1)), none(short(2))])),
        Vector::packets(
            "uncertain",
            "the pose is not certain; the budget held no residual",
            many(vec![packet(unsure, None, None, Residual::Omitted)]),
        ),
        Vector::packets(
            "known",
            "within how much the position is known: all classes, and not at all",
            many(known.collect()),
        ),
        Vector::packets("numbers", "frame numbers of 16 bits are completed", numbers.into()),
        Vector {
            cameras: vec![CAMERA],
            ..Vector::packets(
                "known-camera",
                "a short packet alone, the camera is known",
                vec![none(short(3))],
            )
        },
    ]
}

fn parts(dive: &Dive) -> Vec<Vector> {
    let short = |t| dive.short(&CAMERA, t);
    let key = dive.key(&CAMERA, 0);
    let session = Some(dive.session(&CAMERA));
    let check = Some(RenderCheck::of(&dive.render(&CAMERA, &short(3).pose)));
    let wrong = check.map(|check| RenderCheck(check.0 ^ 1));
    let foreign = |latent: Latent| Latent { portable: false, ..latent };
    let checked = |latent, check| packet(latent, None, check, Residual::None);
    let mut damaged = checked(short(3), check);
    damaged[SHORT_LATENT_LEN + 2] ^= 8;
    let coded = dive.coded(short(8), None, 8, &How::at(Rate::Bytes(80)));
    let padding = [
        [&none(short(8))[..], &[0xB4; 40]].concat(),
        [&none(short(8))[..], &[0; 7]].concat(),
        [&coded[..], &[0; 13]].concat(),
        [&coded[..], &[0; 13], &[1]].concat(),
    ];
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    vec![
        Vector::packets(
            "render-check",
            "render parts: right, damaged, wrong; then none is shown until one states this prior",
            many(vec![
                checked(short(3), check),
                damaged,
                checked(short(3), wrong),
                none(short(4)),
                packet(short(5), session, None, Residual::None),
                none(short(6)),
            ]),
        ),
        Vector::packets(
            "not-portable",
            "vehicles whose device is not portable: a wrong render estranges nobody",
            many(vec![
                none(foreign(dive.latent(&CAMERA, 5, PoseProfile::Compact))),
                none(foreign(short(6))),
                checked(foreign(short(3)), wrong),
                none(short(7)),
            ]),
        ),
        Vector::packets("padding", "zeros behind packets; other bytes, too", many(padding.into())),
    ]
}

fn renders(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let of = |name: &'static str, vector: &str, description| {
        let dive = Dive::of(prior(name));
        let near = nvsprior::Pose::from_wxyz([1.0, 0.1, -0.2, 0.05], [0.3, 0.1, -2.5]).unwrap();
        let latent = |t, pose| {
            let pose = dive.quantised(pose, PoseProfile::Compact);
            Latent { pose, ..dive.latent(&CAMERA, t, PoseProfile::Compact) }
        };
        let records = vec![
            dive.key(&CAMERA, 0),
            packet(latent(1, &near), None, None, Residual::None),
            dive.coded(latent(2, &pose(2)), None, 2, &How::at(Rate::Quality(45.0))),
        ];
        Vector { prior: name, ..Vector::packets(vector, description, records) }
    };
    let sizes = {
        let dive = Dive::of(prior("focal.ply"));
        [1, 2, 4].map(|by| dive.key(&CAMERA.resized(48 * by, 27 * by), by))
    };
    vec![
        of("odd.ply", "prior-odd", "a prior of degree 3, anti-aliased, with a background, clamped"),
        of("prior.nvsg", "prior-compact", "a compact prior"),
        of("tables.nvsg", "prior-tables", "a compact prior with coder tables of its own"),
        of(
            "blocked.nvsb",
            "prior-blocked",
            "a blocked prior with coder tables and a trained focal length",
        ),
        Vector {
            prior: "focal.ply",
            ..Vector::packets(
                "prior-focal",
                "a prior with a trained focal length, at half of its size, at it, and at twice",
                sizes.to_vec(),
            )
        },
    ]
}

/// The first of some ways of coding that gives small blocks.
fn first(dive: &Dive, change: fn(Picture) -> Picture) -> Vec<u8> {
    let coded = |quality| {
        let how = How { change, ..How::at(Rate::Quality(quality)) };
        dive.coded(dive.short(&CAMERA, 3), None, 3, &how)
    };
    let has_small_blocks = |packet: &Vec<u8>| packet[1] & 1 != 0;
    [30.0, 40.0, 50.0, 20.0, 60.0, 75.0].map(coded).into_iter().find(has_small_blocks).unwrap()
}

/// A large smooth object: it hides the texture of the wall.
fn hidden(mut picture: Picture) -> Picture {
    for (i, rgb) in picture.data.chunks_exact_mut(3).enumerate() {
        if (30..80).contains(&(i % 96)) && (6..48).contains(&(i / 96)) {
            rgb.copy_from_slice(&[150, 140, (60 + i % 96) as u8]);
        }
    }
    picture
}

fn noisy(mut picture: Picture) -> Picture {
    for (i, value) in picture.data.iter_mut().enumerate() {
        *value = (i * i % 251) as u8;
    }
    picture
}

fn residuals(dive: &Dive) -> Vec<Vector> {
    let key = dive.key(&CAMERA, 0);
    let short = dive.short(&CAMERA, 3);
    let coded = |how: &How| dive.coded(short, None, 3, how);
    let at = |rate| coded(&How::at(rate));
    let first_of_all = |t, how: &How| {
        dive.coded(dive.latent(&CAMERA, t, PoseProfile::Compact), Some(&CAMERA), t, how)
    };
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    let blind = How { portable: false, ..How::at(Rate::Quality(40.0)) };
    let foreign = Latent { portable: false, ..short };
    let with = |rate, change| How { change, ..How::at(rate) };
    let blocks = |t, change| first_of_all(t, &with(Rate::Quality(35.0), change));
    vec![
        Vector::packets(
            "wavelet-first",
            "wavelet payload behind a session part",
            vec![first_of_all(0, &How::at(Rate::Quality(40.0)))],
        ),
        Vector::packets(
            "wavelet",
            "wavelet payloads, from coarse to fine",
            many([5.0, 30.0, 60.0].map(|q| at(Rate::Quality(q))).to_vec()),
        ),
        Vector::packets(
            "wavelet-fine",
            "steps so fine that magnitudes go beyond unary",
            many(vec![coded(&with(Rate::Quality(92.0), noisy))]),
        ),
        Vector::packets(
            "wavelet-budget",
            "budgets: payloads that the encoder has cut",
            many([45, 60, 90, 180].map(|bytes| at(Rate::Bytes(bytes))).to_vec()),
        ),
        Vector::packets(
            "small-blocks",
            "small blocks",
            vec![
                blocks(0, hidden),
                blocks(1, noisy),
                first(dive, hidden),
                first(dive, |picture| picture),
            ],
        ),
        Vector::packets(
            "small-blocks-budget",
            "small blocks at a budget",
            many([70, 120, 200].map(|n| coded(&with(Rate::Bytes(n), hidden))).to_vec()),
        ),
        Vector::packets(
            "wavelet-blind",
            "contexts that do not look at the render, from a device that is not portable",
            many(vec![dive.coded(foreign, None, 3, &blind), coded(&blind)]),
        ),
        Vector::packets(
            "wavelet-other-render",
            "contexts need the render, but the device is not portable",
            many(vec![dive.coded(foreign, None, 3, &How::at(Rate::Quality(40.0)))]),
        ),
        Vector::packets("wavelet-any-bytes", "any bytes are a payload", many(any_bytes(dive))),
    ]
}

fn starts(dive: &Dive) -> Vec<Vector> {
    let how = How::at(Rate::Quality(60.0));
    let whole = dive.coded(dive.short(&CAMERA, 3), None, 3, &how);
    let small = first(dive, hidden);
    let cuts = |packet: &[u8]| {
        let lens = [20, 21, 22, 23, 24, 27, 31, 40, 60, packet.len() - 3, packet.len() - 1];
        let starts = lens.iter().map(|len| packet[..*len].to_vec());
        [dive.key(&CAMERA, 0)].into_iter().chain(starts).collect()
    };
    let starts = |name: &str, description, records| Vector {
        kind: Kind::Packets { trust: Trust::Start },
        ..Vector::packets(name, description, records)
    };
    vec![
        starts("wavelet-cut", "the starts of a packet, known to be undamaged", cuts(&whole)),
        Vector::packets(
            "wavelet-cut-unknown",
            "the same starts, of which nothing is known",
            cuts(&whole),
        ),
        starts("small-blocks-cut", "the starts of a packet with small blocks", cuts(&small)),
    ]
}

fn any_bytes(dive: &Dive) -> Vec<Vec<u8>> {
    let mut random = crate::common::Random::new(17);
    let mut payload =
        |len: usize| -> Vec<u8> { (0..len).map(|_| (random.bits() >> 3) as u8).collect() };
    let packet = |t, small_blocks, bytes: &[u8]| {
        let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        let residual = Residual::Coded { small_blocks, payload: &bytes[..end] };
        packet(dive.short(&CAMERA, t), None, None, residual)
    };
    let lens = [0, 1, 2, 7, 40, 300, 900];
    let mut packets: Vec<Vec<u8>> = Vec::new();
    for (i, len) in lens.into_iter().enumerate() {
        let bytes = payload(len);
        packets.extend([false, true].map(|small_blocks| packet(i as u32, small_blocks, &bytes)));
    }
    // All ones, and every second bit: the extremes of every number.
    packets.extend([0xFF, 0x55].map(|value| packet(2, false, &[value; 200])));
    packets
}

fn sizes(dive: &Dive) -> Vec<Vector> {
    let of = |width: u32, height: u32| {
        let (w, h) = (width as f32, height as f32);
        let camera =
            Camera { width, height, fx: 0.8 * w, fy: 0.9 * w, cx: 0.5 * w + 0.3, cy: 0.5 * h };
        let how = How { camera, ..How::at(Rate::Quality(50.0)) };
        let key = dive.latent(&camera, 0, PoseProfile::Compact);
        vec![
            dive.coded(key, Some(&camera), 0, &how),
            dive.coded(
                dive.short(&camera, 1),
                None,
                1,
                &How { camera, ..How::at(Rate::Quality(40.0)) },
            ),
        ]
    };
    let all = [(1, 1), (1, 9), (5, 4), (6, 2), (37, 23), (64, 64), (7, 65)];
    vec![Vector::packets(
        "sizes",
        "pictures of odd and small sizes, each with a camera of its own",
        all.into_iter().flat_map(|(width, height)| of(width, height)).collect(),
    )]
}

//! Vectors of single frames: forms of packets, renders, and residuals.

use nvsprior::packet::{Coder, Latent, PoseProfile, RenderCheck, Residual};
use nvsprior::residual::ResidualCoder;
use nvsprior::{Camera, Picture, Prior, Rate, Trust};

use crate::dive::{CAMERA, Dive, How, packet, pose};
use crate::vector::{Kind, Vector};

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let mut all = forms(&Dive::of(prior("prior.ply")));
    all.extend(renders(prior));
    all.extend(residuals(&Dive::of(prior("prior.ply"))));
    all.extend(sizes(&Dive::of(prior("prior.ply"))));
    all
}

fn forms(dive: &Dive) -> Vec<Vector> {
    let full = |t, profile| dive.latent(&CAMERA, t, profile);
    let none = |latent| packet(latent, None, None, Residual::None);
    let key = dive.key(&CAMERA, 0);
    let render = dive.render(&CAMERA, &dive.short(&CAMERA, 3).pose);
    let check = Some(RenderCheck::of(&render));
    let wrong = check.map(|check| RenderCheck(check.0 ^ 1));
    let foreign = |latent: Latent| Latent { portable: false, ..latent };
    let short = |t| dive.short(&CAMERA, t);
    let far = nvsprior::Pose::from_wxyz([1.0, 0.0, 0.0, 0.01], [0.0, 0.0, 900.0]).unwrap();
    let far =
        Latent { pose: dive.quantised(&far, PoseProfile::Compact), ..full(9, PoseProfile::Paper) };
    let padded = [&none(short(8))[..], &[0xB4; 40]].concat();
    let late = [65_530_u32, 65_540, 200_000, 7].map(|frame| {
        let latent = Latent { frame: frame % (1 << 16), ..short(4) };
        none(latent)
    });
    let numbered = Latent { frame: 65_520, ..full(4, PoseProfile::Compact) };
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    vec![
        Vector::packets("full", "full form with the camera, no residual", vec![key.clone()]),
        Vector::packets(
            "full-paper",
            "full form, paper's pose; one far from the prior",
            many(vec![none(full(1, PoseProfile::Paper)), none(far)]),
        ),
        Vector::packets(
            "full-short-grid",
            "full form, pose on the short grid",
            many(vec![none(full(2, PoseProfile::Short))]),
        ),
        Vector::packets(
            "short",
            "short form after the full one",
            many(vec![none(short(1)), none(short(2))]),
        ),
        Vector::packets(
            "render-check",
            "render parts: one that fits, one of another render",
            many(vec![
                packet(short(3), None, check, Residual::None),
                packet(short(3), None, wrong, Residual::None),
            ]),
        ),
        Vector::packets(
            "not-portable",
            "vehicles whose device is not portable, full and short form",
            many(vec![none(foreign(full(5, PoseProfile::Compact))), none(foreign(short(6)))]),
        ),
        Vector::packets(
            "uncertain",
            "the pose is not certain; the budget held no residual",
            many(vec![packet(
                Latent { uncertain: true, ..short(7) },
                None,
                None,
                Residual::Omitted,
            )]),
        ),
        Vector::packets("padding", "bytes after the last part are ignored", many(vec![padded])),
        Vector::packets(
            "numbers",
            "frame numbers of 16 bits are completed",
            [vec![packet(numbered, Some(&CAMERA), None, Residual::None)], late.to_vec()].concat(),
        ),
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

/// The first of some ways of coding that gives what is wanted.
fn first(dive: &Dive, wanted: impl Fn(&[u8]) -> bool, ways: Vec<How>) -> Vec<u8> {
    let coded = |how: How| dive.coded(dive.short(&CAMERA, 3), None, 3, &how);
    ways.into_iter().map(coded).find(|packet| wanted(packet)).expect("one of the ways")
}

fn with_small_blocks(rate: Rate, change: fn(Picture) -> Picture) -> How {
    How { small_blocks: true, change, ..How::at(rate) }
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
    let full = |t, how: &How| {
        dive.coded(dive.latent(&CAMERA, t, PoseProfile::Compact), Some(&CAMERA), t, how)
    };
    let many = |packets: Vec<Vec<u8>>| [vec![key.clone()], packets].concat();
    let is_small = |packet: &[u8]| packet[1] & 3 == 0;
    let small = |change| {
        let rates = [30.0, 40.0, 50.0, 20.0, 60.0, 75.0];
        rates.map(|q| with_small_blocks(Rate::Quality(q), change)).into()
    };
    let blind = How { portable: false, ..How::at(Rate::Quality(40.0)) };
    let foreign = Latent { portable: false, ..short };
    let whole = at(Rate::Quality(60.0));
    let cuts = |packet: &[u8]| {
        let lens = [19, 20, 21, 22, 24, 27, 31, 40, 60, packet.len() - 3, packet.len() - 1];
        many(lens.iter().map(|len| packet[..*len].to_vec()).collect())
    };
    let blocks = |t| full(t, &How { change: hidden, ..How::at(Rate::Quality(35.0)) });
    let small_packet = first(dive, is_small, small(hidden));
    let webp = How { coder: ResidualCoder::Webp, ..How::at(Rate::Quality(30.0)) };
    let starts = |name: &str, description, records| Vector {
        kind: Kind::Packets { trust: Trust::Start },
        ..Vector::packets(name, description, records)
    };
    vec![
        Vector::packets(
            "wavelet-full",
            "wavelet payload in the full form",
            vec![full(0, &How::at(Rate::Quality(40.0)))],
        ),
        Vector::packets(
            "wavelet-short",
            "wavelet payloads in the short form, from coarse to fine",
            many([5.0, 30.0, 60.0].map(|q| at(Rate::Quality(q))).to_vec()),
        ),
        Vector::packets(
            "wavelet-fine",
            "steps so fine that magnitudes go beyond unary",
            many(vec![coded(&How { change: noisy, ..How::at(Rate::Quality(92.0)) })]),
        ),
        Vector::packets(
            "wavelet-budget",
            "budgets: payloads that the encoder has cut",
            many([45, 60, 90, 180].map(|bytes| at(Rate::Bytes(bytes))).to_vec()),
        ),
        Vector::packets(
            "wavelet-blocks",
            "blocks of 64×64 that are not predicted from the render",
            vec![blocks(0), full(1, &How { change: noisy, ..How::at(Rate::Quality(30.0)) })],
        ),
        Vector::packets(
            "small-blocks",
            "small blocks",
            many(vec![small_packet.clone(), first(dive, is_small, small(|picture| picture))]),
        ),
        Vector::packets(
            "small-blocks-budget",
            "small blocks at a budget",
            many(
                [70, 120, 200].map(|n| coded(&with_small_blocks(Rate::Bytes(n), hidden))).to_vec(),
            ),
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
        starts("wavelet-cut", "the starts of a packet, known to be undamaged", cuts(&whole)),
        Vector::packets(
            "wavelet-cut-unknown",
            "the same starts, of which nothing is known",
            cuts(&whole),
        ),
        starts("small-blocks-cut", "the starts of a packet with small blocks", cuts(&small_packet)),
        Vector::packets("wavelet-any-bytes", "any bytes are a payload", many(any_bytes(dive))),
        Vector {
            needs: &["webp"],
            ..Vector::packets(
                "webp",
                "VP8 and WebP payloads",
                many(vec![coded(&webp), webp_file(dive, &webp)]),
            )
        },
    ]
}

/// A whole WebP file in place of the payload.
fn webp_file(dive: &Dive, how: &How) -> Vec<u8> {
    let short = dive.short(&CAMERA, 4);
    let (seen, render) = (dive.seen(&CAMERA, 4), dive.render(&CAMERA, &short.pose));
    let difference = nvsprior::residual::difference(&seen, &render);
    let mut webp = nvsprior::residual::Webp::new(CAMERA.width, CAMERA.height);
    let Rate::Quality(quality) = how.rate else { unreachable!("a quality is given") };
    let payload = webp.encode_file(&difference, quality, 1).unwrap();
    packet(short, None, None, Residual::Coded { coder: Coder::WebP, payload })
}

fn any_bytes(dive: &Dive) -> Vec<Vec<u8>> {
    let mut random = crate::common::Random::new(17);
    let mut payload =
        |len: usize| -> Vec<u8> { (0..len).map(|_| (random.bits() >> 3) as u8).collect() };
    let lens = [0, 1, 2, 7, 40, 300, 900];
    let mut packets: Vec<Vec<u8>> = Vec::new();
    for (i, len) in lens.into_iter().enumerate() {
        let (latent, bytes) = (dive.short(&CAMERA, i as u32), payload(len));
        for coder in [Coder::Wavelet, Coder::SmallBlocks] {
            packets.push(packet(latent, None, None, Residual::Coded { coder, payload: &bytes }));
        }
    }
    // All ones and all zeros: the extremes of every number.
    for value in [0, 0xFF, 0x55] {
        let bytes = vec![value; 200];
        let residual = Residual::Coded { coder: Coder::Wavelet, payload: &bytes };
        packets.push(packet(dive.short(&CAMERA, 2), None, None, residual));
    }
    packets
}

fn sizes(dive: &Dive) -> Vec<Vector> {
    let of = |width: u32, height: u32| {
        let (w, h) = (width as f32, height as f32);
        let camera =
            Camera { width, height, fx: 0.8 * w, fy: 0.9 * w, cx: 0.5 * w + 0.3, cy: 0.5 * h };
        let how = How { camera, ..How::at(Rate::Quality(50.0)) };
        let key = dive.latent(&camera, 0, PoseProfile::Compact);
        let small = How { small_blocks: true, change: |p| p, ..How::at(Rate::Quality(40.0)) };
        vec![
            dive.coded(key, Some(&camera), 0, &how),
            dive.coded(dive.short(&camera, 1), None, 1, &How { camera, ..small }),
        ]
    };
    let all = [(1, 1), (1, 9), (5, 4), (6, 2), (37, 23), (64, 64), (7, 65)];
    vec![Vector::packets(
        "sizes",
        "pictures of odd and small sizes, each with a camera of its own",
        all.into_iter().flat_map(|(width, height)| of(width, height)).collect(),
    )]
}

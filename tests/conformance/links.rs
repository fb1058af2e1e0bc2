//! Vectors of modem frames: shares of packets, pieces of updates, reports.

use nvsprior::modem::{
    ArrivedShares, CollectorOptions, Loss, PacketState, Protection, RateControlOptions, Report,
    ReportedPacket, Sender, SenderOptions, Sharer, Sharing, SharingOptions, UpdateOptions,
};
use nvsprior::packet::Extent;
use nvsprior::prior::StateId;
use nvsprior::{Prior, Rate};

use crate::dive::{CAMERA, Dive, How};
use crate::vector::{Kind, Vector};

/// Frame numbers of all packets of links.
pub const FRAMES: std::ops::Range<u32> = 0..12;

pub fn kind(mtu: usize, streams: usize, shares: usize) -> Kind {
    let options =
        CollectorOptions { streams, shares, update_bytes: 4000, ..CollectorOptions::new(mtu) };
    Kind::Link { options, mtu }
}

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    [plain(&dive), protected(&dive), predicted(&dive), updates(&dive), reports()]
        .into_iter()
        .flatten()
        .collect()
}

fn link(name: &str, description: &'static str, kind: Kind, records: Vec<Vec<u8>>) -> Vector {
    Vector { kind, frames: FRAMES, ..Vector::packets(name, description, records) }
}

fn split(packet: &[u8], mtu: usize) -> Vec<Vec<u8>> {
    let mut sharer = Sharer::default();
    sharer.split(packet, mtu).unwrap();
    sharer.shares().map(<[u8]>::to_vec).collect()
}

struct Protected {
    mtu: usize,
    budget: usize,
    max_shares: usize,
    loss: f64,
    stream: u8,
    user: Option<&'static [u8]>,
}

const USUAL: Protected =
    Protected { mtu: 64, budget: 700, max_shares: 16, loss: 0.25, stream: 0, user: None };

fn shared(packet: &[u8], how: &Protected) -> Vec<Vec<u8>> {
    let extent = Extent::read(packet).unwrap();
    let sharing = Sharing::new(&SharingOptions {
        mtu: how.mtu,
        overhead: 0,
        budget: how.budget,
        max_shares: how.max_shares,
        spread: 0,
        loss: Loss { chance: how.loss, burst: 1.0 },
        picture: extent.head - extent.told_by_shares,
        packet: Some(packet.len() - extent.told_by_shares),
        whole: false,
        user: how.user.map(<[u8]>::len),
    })
    .unwrap();
    let mut sharer = Sharer::default();
    sharer.share(packet, &sharing, how.stream, how.user).unwrap();
    sharer.shares().map(<[u8]>::to_vec).collect()
}

/// Shares as those of most vectors.
pub fn usual(packet: &[u8]) -> Vec<Vec<u8>> {
    shared(packet, &USUAL)
}

fn coded(dive: &Dive, t: u32, quality: f32) -> Vec<u8> {
    dive.coded(dive.short(&CAMERA, t), None, t, &How::at(Rate::Quality(quality)))
}

fn damaged(share: &[u8], at: usize) -> Vec<u8> {
    let mut share = share.to_vec();
    share[at] ^= 4;
    share
}

fn plain(dive: &Dive) -> Vec<Vector> {
    let kind = || kind(48, 1, 64);
    let key = split(&dive.key(&CAMERA, 0), 48);
    let shares = split(&coded(dive, 1, 50.0), 48);
    let last = shares.len() - 1;
    let padded = |share: &Vec<u8>| {
        let mut share = share.clone();
        share.resize(48, 0xEE);
        share
    };
    let reversed: Vec<Vec<u8>> = shares.iter().rev().map(padded).collect();
    let lossy = shares.iter().enumerate().filter(|(place, _)| *place != 2);
    let lossy: Vec<Vec<u8>> = lossy.map(|(_, share)| share.clone()).collect();
    let spoiled: Vec<Vec<u8>> = [
        damaged(&shares[0], 5),
        shares[0].clone(),
        damaged(&shares[1], 9),
        shares[1].clone(),
        shares[1].clone(),
        vec![0x00, 1, 2],
        vec![0xC0, 0, 1, 2, 3],
        shares[last].clone(),
    ]
    .into();
    vec![
        link(
            "shares-plain",
            "unprotected shares in order",
            kind(),
            [key.clone(), shares.clone()].concat(),
        ),
        link(
            "shares-plain-order",
            "unprotected shares backwards, padded, twice",
            kind(),
            [key.clone(), reversed.clone(), reversed].concat(),
        ),
        link(
            "shares-plain-lost",
            "one unprotected share is lost",
            kind(),
            [key.clone(), lossy].concat(),
        ),
        link(
            "shares-plain-damaged",
            "damaged shares and other frames",
            kind(),
            [key, spoiled].concat(),
        ),
    ]
}

fn protected(dive: &Dive) -> Vec<Vector> {
    let kind = || kind(64, 4, 64);
    let key = shared(&dive.key(&CAMERA, 0), &USUAL);
    let shares = shared(&coded(dive, 1, 50.0), &USUAL);
    let keep = |every: usize, from: usize| {
        let kept = shares.iter().enumerate().filter(|(place, _)| place % every != from);
        kept.map(|(_, share)| share.clone()).collect::<Vec<_>>()
    };
    let few: Vec<Vec<u8>> = shares.iter().rev().take(shares.len() / 2).cloned().collect();
    let user = Protected { stream: 2, user: Some(b"depth 31.4 m"), ..USUAL };
    let spoken = [dive.key(&CAMERA, 2), coded(dive, 3, 30.0)].map(|packet| shared(&packet, &user));
    let wide = Protected { mtu: 40, budget: 1600, max_shares: 40, ..USUAL };
    let wide = shared(&coded(dive, 4, 60.0), &wide);
    let many: Vec<Vec<u8>> = wide
        .iter()
        .enumerate()
        .filter(|(place, _)| place % 5 != 1)
        .map(|(_, s)| s.clone())
        .collect();
    let bad: Vec<Vec<u8>> = shares
        .iter()
        .enumerate()
        .map(
            |(place, share)| {
                if place % 3 == 0 { damaged(share, place % share.len()) } else { share.clone() }
            },
        )
        .chain([shares[0][..5].to_vec(), vec![0x7F; 30]])
        .collect();
    let padded = shares.iter().map(|share| [&share[..], &[0x33; 9]].concat()).collect::<Vec<_>>();
    vec![
        link(
            "shares",
            "protected shares, all of them, padded",
            kind(),
            [key.clone(), padded].concat(),
        ),
        link(
            "shares-repaired",
            "protected shares, some are lost: chunks are computed",
            kind(),
            [key.clone(), keep(4, 0)].concat(),
        ),
        link(
            "shares-part",
            "too many protected shares are lost: the first layers yield a picture",
            kind(),
            [key.clone(), few].concat(),
        ),
        link("shares-user", "user bytes, on another stream", kind(), spoken.concat()),
        link("shares-wide", "more than 16 shares", kind(), [key.clone(), many].concat()),
        link("shares-damaged", "damaged and cut shares", kind(), [key, bad].concat()),
    ]
}

fn predicted(dive: &Dive) -> Vec<Vector> {
    let packets = crate::streams::predicted(dive, Some(Rate::Quality(25.0)), 7);
    let bare = crate::streams::predicted(dive, None, 7);
    let bare = bare.iter().flat_map(|packet| shared(packet, &USUAL)).collect();
    let frames = |budget| -> Vec<Vec<u8>> {
        let of = |packet: &Vec<u8>| shared(packet, &Protected { budget, ..USUAL });
        packets.iter().flat_map(of).collect()
    };
    let kind = || kind(64, 1, 64);
    vec![
        link(
            "shares-predicted",
            "packets in the predicted form, in protected shares",
            kind(),
            frames(700),
        ),
        link(
            "shares-predicted-bare",
            "packets in the predicted form without a residual",
            kind(),
            bare,
        ),
        link("shares-predicted-cut", "their ends are not sent", kind(), frames(110)),
    ]
}

fn updates(dive: &Dive) -> Vec<Vector> {
    let steps = crate::states::chain(&dive.prior);
    let mut frames = shared(&dive.key(&CAMERA, 0), &USUAL);
    let control = RateControlOptions {
        bit_rate: 20_000.0,
        mtu: 64,
        overhead: 0,
        latency: 1.5,
        delay: 0.2,
        spread: 0.3,
        frame_rate: 10.0,
        min_bytes: 40,
        max_shares: 16,
        loss: Loss { chance: 0.2, burst: 1.0 },
        user: None,
    };
    let options = SenderOptions {
        control,
        stream: 0,
        protection: Protection::Layers,
        expect_reports: false,
        updates: Some(UpdateOptions::default()),
    };
    let mut sender = Sender::new(options).unwrap();
    let mut pieces = Vec::new();
    for (bytes, _) in &steps[..2] {
        sender.push_update(0.0, bytes).unwrap();
    }
    for tick in 0..400 {
        while let Some((_, piece)) = sender.next(f64::from(tick) * 0.05) {
            pieces.push(piece.to_vec());
        }
    }
    pieces.truncate(24);
    // The first ones are lost: others stand for them.
    let spoiled = damaged(&pieces[3], 12);
    frames.extend(pieces.into_iter().skip(2));
    frames.push(spoiled);
    vec![link("pieces", "pieces of updates, some lost, one damaged", kind(64, 1, 64), frames)]
}

/// Reports without user bytes and with them, of updates, and of poses.
pub fn some_reports() -> Vec<Vec<u8>> {
    let of = |state, arrived| ReportedPacket { state, arrived, ..Default::default() };
    let part = ReportedPacket {
        shares: ArrivedShares::new(9, [0, 8].into_iter()),
        ..of(PacketState::Part, 2)
    };
    let told =
        [part, of(PacketState::Kept, 9), of(PacketState::Nothing, 0), of(PacketState::Whole, 8)];
    let mut full = Report::new(2, 0x1_0001, told.into_iter()).unwrap();
    let written = |report: &Report, user: Option<&[u8]>| {
        let mut bytes = vec![0; 80];
        let len = report.write(user, &mut bytes).unwrap();
        bytes.truncate(len);
        bytes
    };
    let plain = written(&full, None);
    let user = written(&full, Some(b"depth"));
    full.tell_states([(258, StateId(77)), (257, StateId(78))].into_iter());
    let states = written(&full, Some(b""));
    full.tell_poses(|frame| frame % 3 == 1);
    let poses = written(&full, Some(b"all"));
    vec![plain, user, states, poses]
}

fn reports() -> Vec<Vector> {
    let all = some_reports();
    let [plain, user, states, poses] = &all[..] else { panic!("four reports") };
    let padded = [&plain[..], &[0; 12]].concat();
    let cut = |bytes: &[u8], by| bytes[..bytes.len() - by].to_vec();
    let bad = vec![
        damaged(plain, 3),
        cut(plain, 1),
        cut(user, 4),
        vec![],
        vec![0x08, 1, 2, 3],
        damaged(states, 12),
        damaged(poses, poses.len() - 1),
        vec![0x04, 0, 0, 33],
    ];
    let of = |name: &str, description, records| Vector {
        kind: Kind::Reports,
        ..Vector::packets(name, description, records)
    };
    vec![
        of("reports", "reports", [all, vec![padded]].concat()),
        of("reports-bad", "damaged reports; the last but one only lacks the poses", bad),
    ]
}

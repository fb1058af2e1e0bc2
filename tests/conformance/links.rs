//! Vectors of modem frames: shares of packets, reports.

use nvsprior::packet::{Extent, Residual};
use nvsprior::{Prior, Rate};
use nvsprior_link::modem::{
    ArrivedShares, CollectorOptions, Loss, PacketState, Report, ReportedPacket, Sharer, Sharing,
    SharingOptions,
};

use crate::dive::{CAMERA, Dive, How, packet};
use crate::vector::{Kind, Vector};

/// Frame numbers of all packets of links.
pub const FRAMES: std::ops::Range<u32> = 0..12;

pub fn kind(mtu: usize, streams: usize, shares: usize) -> Kind {
    let options = CollectorOptions { streams, shares, ..CollectorOptions::new(mtu) };
    Kind::Link { options, mtu }
}

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let dive = Dive::of(prior("prior.ply"));
    [plain(&dive), other_plain(&dive), small(&dive), protected(&dive), predicted(&dive), reports()]
        .into_iter()
        .flatten()
        .collect()
}

fn link(name: &str, description: &'static str, kind: Kind, records: Vec<Vec<u8>>) -> Vector {
    Vector { kind, frames: FRAMES, ..Vector::packets(name, description, records) }
}

fn split(packet: &[u8], mtu: usize) -> Vec<Vec<u8>> {
    split_all(&[packet.to_vec()], mtu).concat()
}

/// The shares of each packet, one after another: small ones count packets.
pub fn split_all(packets: &[Vec<u8>], mtu: usize) -> Vec<Vec<Vec<u8>>> {
    let mut sharer = Sharer::default();
    let mut of = |packet: &Vec<u8>| {
        sharer.split(packet, mtu).unwrap();
        sharer.shares().map(<[u8]>::to_vec).collect()
    };
    packets.iter().map(&mut of).collect()
}

fn padded(share: &[u8], mtu: usize) -> Vec<u8> {
    let mut share = share.to_vec();
    share.resize(mtu, 0);
    share
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
        picture: extent.head,
        packet: Some(packet.len()),
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
    // Zeros up to the MTU; beyond it anything may be.
    let filled = |share: &Vec<u8>| [&padded(share, 48)[..], &[0xEE; 5]].concat();
    let reversed: Vec<Vec<u8>> = shares.iter().rev().map(filled).collect();
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
        vec![0x91; 48],
        shares[0][..20].to_vec(),
        shares[1][..47].to_vec(),
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

fn other_plain(dive: &Dive) -> Vec<Vector> {
    // The latent part takes two shares.
    let narrow = split_all(&[dive.key(&CAMERA, 0), coded(dive, 1, 20.0)], 16).concat();
    let predicted = crate::streams::predicted(dive, Some(Rate::Quality(25.0)), 7);
    let predicted = split_all(&predicted, 40).concat();
    vec![
        link(
            "shares-plain-narrow",
            "unprotected shares of 16 bytes, those of each packet backwards",
            kind(16, 1, 64),
            narrow.iter().rev().cloned().collect(),
        ),
        link(
            "shares-plain-predicted",
            "packets with predicted poses, in unprotected shares",
            kind(40, 1, 64),
            predicted,
        ),
    ]
}

/// Modem frames of 8 bytes.
fn small(dive: &Dive) -> Vec<Vector> {
    const MTU: usize = 8;
    let kind = || kind(MTU, 1, 8);
    let short = |t| packet(dive.short(&CAMERA, t), None, None, Residual::None);
    let little = dive.coded(dive.short(&CAMERA, 2), None, 2, &How::at(Rate::Bytes(36)));
    let packets = [dive.key(&CAMERA, 0), short(1), little, short(3)];
    let shares = split_all(&packets, MTU);
    let full = shares.concat().iter().map(|share| padded(share, MTU)).collect();
    let backwards = shares.iter().flat_map(|shares| shares.iter().rev().cloned());
    let twice = backwards.flat_map(|share| [share.clone(), share]).collect();
    let mut lost = shares.clone();
    lost[2].remove(1);
    let mut spoiled = shares.clone();
    spoiled[1][1] = damaged(&spoiled[1][1], 3);
    spoiled[2][0] = spoiled[2][0][..7].to_vec();
    spoiled[3].extend([vec![0x05; 8], vec![0x41; 8], vec![]]);
    // Once all shares of a packet are there and its checks do not match, they come again.
    spoiled[3].extend(shares[1].clone());
    let predicted = crate::streams::predicted(dive, None, 6);
    let predicted = split_all(&predicted[1..5], MTU).concat();
    vec![
        link("shares-small", "modem frames of 8 bytes, padded", kind(), full),
        link("shares-small-order", "the same backwards, each twice", kind(), twice),
        link("shares-small-lost", "one of them is lost", kind(), lost.concat()),
        link(
            "shares-small-damaged",
            "damaged, cut and other frames; a packet's shares once more",
            kind(),
            spoiled.concat(),
        ),
        Vector {
            cameras: vec![CAMERA],
            ..link(
                "shares-small-predicted",
                "predicted poses in modem frames of 8 bytes",
                kind(),
                predicted,
            )
        },
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
            "packets with predicted poses, in protected shares",
            kind(),
            frames(700),
        ),
        link("shares-predicted-bare", "the same without a residual", kind(), bare),
        link("shares-predicted-cut", "their ends are not sent", kind(), frames(110)),
    ]
}

/// Reports without user bytes and with them, and of poses.
pub fn some_reports() -> Vec<Vec<u8>> {
    let of = |state, arrived| ReportedPacket { state, arrived, ..Default::default() };
    let part = ReportedPacket {
        shares: ArrivedShares::new(9, [0, 8].into_iter()),
        ..of(PacketState::Part, 2)
    };
    let told =
        [part, of(PacketState::Kept, 9), of(PacketState::Nothing, 0), of(PacketState::Whole, 8)];
    let mut full = Report::new(2, 0x1_0001, told.into_iter()).unwrap();
    let written = |report: &Report, user: Option<&[u8]>, mtu: usize| {
        let mut bytes = vec![0; mtu];
        let len = report.write(user, &mut bytes).unwrap();
        bytes.truncate(len);
        bytes
    };
    let plain = written(&full, None, 80);
    let user = written(&full, Some(b"depth"), 80);
    let none = written(&full, Some(b""), 80);
    full.tell_poses(|frame| frame % 3 == 1);
    let poses = written(&full, Some(b"all"), 80);
    vec![plain, user, none, poses, written(&full, None, 8), written(&full, None, 15)]
}

fn reports() -> Vec<Vector> {
    let all = some_reports();
    let [plain, user, none, poses, ..] = &all[..] else { panic!("four reports") };
    let padded = [&plain[..], &[0; 12]].concat();
    let cut = |bytes: &[u8], by| bytes[..bytes.len() - by].to_vec();
    let bad = vec![
        damaged(plain, 3),
        cut(plain, 1),
        cut(user, 4),
        vec![],
        vec![0x08, 1, 2, 3],
        damaged(none, 2),
        damaged(poses, poses.len() - 1),
        vec![0x04, 0, 0, 33],
        [&[0x04, 0, 0, 33][..], &[0; 40]].concat(),
        vec![0x04, 0, 0, 0x40, 0, 0],
        cut(poses, 2),
    ];
    let of = |name: &str, description, records| Vector {
        kind: Kind::Reports,
        ..Vector::packets(name, description, records)
    };
    vec![
        of("reports", "reports", [all, vec![padded]].concat()),
        of("reports-bad", "damaged reports", bad),
    ]
}

//! Vectors of what a topside holds: files of priors, and updates.

use nvsprior::packet::{Latent, PoseProfile, Residual};
use nvsprior::prior::update::{Change, Fade, Learnt, NewSplat, Update, UpdateGrid};
use nvsprior::{Prior, Rate};

use crate::bad::resealed;
use crate::dive::{CAMERA, Dive, How, packet};
use crate::vector::{Kind, Vector};

pub fn vectors(prior: &dyn Fn(&str) -> Prior) -> Vec<Vector> {
    let mut all = files();
    all.extend(updates(&Dive::of(prior("prior.ply"))));
    all
}

fn with(bytes: &[u8], at: usize, by: u8) -> Vec<u8> {
    let mut other = bytes.to_vec();
    other[at] ^= by;
    other
}

/// The check at the end made right again.
fn checked(mut bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len() - 4;
    let check = crc32fast::hash(&bytes[..end]);
    bytes[end..].copy_from_slice(&check.to_le_bytes());
    bytes
}

fn files() -> Vec<Vector> {
    let all = crate::priors();
    let file = |name: &str| all.iter().find(|(own, _)| *own == name).unwrap().1.clone();
    let [packed, tables, blocked] = ["prior.nvsg", "tables.nvsg", "blocked.nvsb"].map(file);
    let edited = |at, by| checked(with(&packed, at, by));
    let bad = vec![
        with(&packed, 0, 1),
        with(&packed, 300, 1),
        packed[..60].to_vec(),
        packed[..packed.len() - 1].to_vec(),
        edited(4, 2),
        edited(5, 4),
        edited(6, 2),
        edited(7, 8),
        edited(12, 1),
        edited(16, 1),
        edited(51, 0x40),
        edited(55, 0x80),
        checked(with(&tables, 200, 1)),
        edited(76, 0xFF),
    ];
    let bad = [bad, bad_blocks(&blocked)].concat();
    let of = |name: &str, description, records| Vector {
        kind: Kind::Priors,
        ..Vector::packets(name, description, records)
    };
    vec![
        of("priors", "files of priors and their identities", vec![packed, tables, blocked]),
        of("priors-bad", "files of priors that must be refused", bad),
    ]
}

/// Blocked priors whose heads or blocks are not right.
fn bad_blocks(blocked: &[u8]) -> Vec<Vec<u8>> {
    let size = u32::from_le_bytes([8, 9, 10, 11].map(|at| blocked[at])) as usize;
    // The head's check made right again.
    let edited = |at: usize, by: u8| {
        let mut bytes = with(blocked, at, by);
        let check = crc32fast::hash(&bytes[..size - 4]);
        bytes[size - 4..size].copy_from_slice(&check.to_le_bytes());
        bytes
    };
    vec![
        with(blocked, 20, 1),
        blocked[..11].to_vec(),
        blocked[..size - 1].to_vec(),
        blocked[..blocked.len() - 1].to_vec(),
        with(blocked, size + 300, 1),
        edited(4, 2),
        edited(5, 4),
        edited(6, 4),
        edited(7, 16),
        edited(12, 1),
        edited(16, 1),
        // A block's box, then its longest splat, a quarter or less of what it was.
        edited(68 + 8 + 3, 0x80),
        edited(68 + 32 + 3, 0x02),
    ]
}

fn ball(k: i32) -> NewSplat {
    NewSplat {
        position: [3 * k - 9, 2 * k - 6, k % 3 - 8],
        log_scale: [-7, -8 + (k % 2) as i8, -9],
        rotation: [k as i8 % 4, -2, 3],
        opacity: 5 - (k % 2) as i8,
        colour: [12 - 4 * k as i8, 3, (2 * k) as i8 - 6],
    }
}

/// A chain of three updates, of all that updates can do.
pub fn chain(prior: &Prior) -> Vec<(Vec<u8>, Learnt)> {
    let grid = UpdateGrid { origin: [0.1, -0.2, 4.0], exponent: -4 };
    let first = |learnt: &Learnt| Update {
        prior: learnt.prior(),
        number: learnt.number() + 1,
        before: learnt.state(),
        grid,
        splats: (0..7).map(ball).collect(),
        removed: vec![],
        changed: vec![],
        fades: vec![grid.fade([-1.0, -0.6, 3.0], [0.2, 0.4, 5.0], 60)],
        frames: [3, 9],
    };
    let change = Change { ordinal: 2, position: [2, -1, 0], opacity: -2, ..Change::default() };
    let turned = Change { ordinal: 5, rotation: [1, 1, -2], colour: [-9, 0, 4], ..change };
    let second = |learnt: &Learnt| Update {
        splats: vec![],
        removed: vec![0, 3],
        changed: vec![change, turned],
        fades: vec![],
        ..first(learnt)
    };
    let third = |learnt: &Learnt| Update {
        splats: vec![NewSplat { log_scale: [-5; 3], rotation: [0; 3], ..ball(20) }],
        fades: vec![Fade { min: [-2, -2, -9], max: [3, 1, 9], factor: 0 }],
        ..first(learnt)
    };
    let mut learnt = Learnt::none(prior.id());
    let steps: [&dyn Fn(&Learnt) -> Update; 3] = [&first, &second, &third];
    let steps = steps.map(|make| {
        let update = make(&learnt);
        learnt.add(&update).unwrap();
        (update.to_bytes().unwrap(), learnt.clone())
    });
    steps.into()
}

fn updates(dive: &Dive) -> Vec<Vector> {
    let steps = chain(&dive.prior);
    let drawn = |t: u32, (_, learnt): &(Vec<u8>, Learnt), short: bool| {
        let pose = dive.short(&CAMERA, t).pose;
        let latent = Latent::new(t, learnt.state().into(), &CAMERA, pose, false)
            .unwrap()
            .with_update(learnt.number());
        let latent =
            if short { latent.shortened(learnt.state().into(), &CAMERA).unwrap() } else { latent };
        packet(latent, None, None, Residual::None)
    };
    let coded = {
        let (_, learnt) = &steps[0];
        let own = Dive::of(dive.prior.with_learnt(learnt).unwrap());
        let pose = dive.short(&CAMERA, 2).pose;
        let latent =
            Latent::new(2, learnt.state().into(), &CAMERA, pose, false).unwrap().with_update(1);
        own.coded(latent, None, 2, &How { portable: false, ..How::at(Rate::Quality(40.0)) })
    };
    let key = dive.key(&CAMERA, 0);
    let plain = packet(dive.latent(&CAMERA, 1, PoseProfile::Compact), None, None, Residual::None);
    let mut good = vec![key.clone()];
    for (t, step) in (1..).zip(&steps) {
        good.extend([step.0.clone(), drawn(2 * t, step, false), drawn(2 * t + 1, step, true)]);
    }
    // Late packets of earlier states.
    good.extend([drawn(8, &steps[0], true), drawn(9, &steps[1], false), plain.clone(), coded]);
    let first = &steps[0].0;
    let bad = vec![
        key.clone(),
        with(first, 0, 1),
        with(first, 40, 1),
        first[..17].to_vec(),
        checked(with(first, 4, 2)),
        checked(with(first, 5, 1)),
        steps[1].0.clone(),
        checked(with(first, 30, 0x10)),
        checked([&first[..first.len() - 4], &[1, 0, 0, 0, 0]].concat()),
        first.clone(),
        first.clone(),
        steps[2].0.clone(),
        drawn(3, &steps[0], true),
    ];
    let missing = vec![
        key,
        drawn(1, &steps[0], false),
        drawn(2, &steps[0], true),
        steps[0].0.clone(),
        drawn(3, &steps[0], true),
        drawn(4, &steps[1], true),
        resealed(drawn(5, &steps[1], true), 4, 1),
    ];
    vec![
        Vector::packets("updates", "a chain of updates, and frames that are drawn with them", good),
        Vector::packets("updates-bad", "updates that must be refused", bad),
        Vector::packets(
            "updates-missing",
            "frames that are drawn with updates that are not there",
            missing,
        ),
    ]
}

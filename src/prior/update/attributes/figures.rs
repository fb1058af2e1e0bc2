//! What an update costs, by part: the figures of the module's documentation. To print them:
//! `cargo test -p nvsprior --lib prior::update::attributes::figures -- --nocapture`

use glam::{DQuat, DVec3};

use super::super::super::id::PriorId;
use super::super::places;
use super::super::{LearntSplat, NewSplat, StateId, Update, UpdateGrid};
use super::Attributes;
use crate::random::Random;
use crate::range_coder::Bits;
use crate::range_coder::Probability;

/// Adds up what bits cost.
#[derive(Default)]
struct Cost(f64);

impl Bits for Cost {
    fn bit(&mut self, one: Probability, bit: bool) -> bool {
        let one = f64::from(one) / 65_536.0;
        self.0 -= (if bit { one } else { 1.0 - one }).log2();
        bit
    }
}

/// Bell-shaped, of deviation 1.
fn bell(random: &mut Random) -> f64 {
    (0..12).map(|_| random.even()).sum::<f64>() / 2.0
}

fn direction(random: &mut Random) -> DQuat {
    let [x, y, z, w] = [(); 4].map(|()| bell(random));
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// Splats on the sides of a box of so many steps, turned anyhow. Each side has one of three colours, with specks of the
/// others; scales are about exp(−3), and splats lie in all directions.
fn object(seed: u64, count: usize, size: DVec3) -> Update {
    let random = &mut Random::new(seed);
    let turn = direction(random);
    let colours = [(); 3].map(|()| [(); 3].map(|()| 1.2 * random.even()));
    let grid = UpdateGrid { origin: [3.0, -1.0, 12.0], exponent: -7 };
    let areas = DVec3::new(size.y * size.z, size.x * size.z, size.x * size.y);
    let splat = |random: &mut Random| {
        let place = (random.even() + 1.0) / 2.0 * areas.element_sum();
        let side = usize::from(place >= areas.x) + usize::from(place >= areas.x + areas.y);
        let mut within = DVec3::from([(); 3].map(|()| random.even())) * size / 2.0;
        within[side] = (size[side] / 2.0).copysign(random.even()) + bell(random);
        let position = (turn * within) * grid.step();
        let size = 0.5 * bell(random);
        let colour = if random.even().abs() < 0.7 { side } else { (random.bits() % 3) as usize };
        let rotation = direction(random);
        let splat = LearntSplat {
            position: [0, 1, 2].map(|axis| grid.origin[axis] + position[axis] as f32),
            log_scale: [(); 3].map(|()| (-3.0 + size + 0.5 * bell(random)) as f32),
            rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32),
            logit: (1.5 + 1.5 * bell(random)) as f32,
            colour: colours[colour].map(|c| (c + 0.15 * bell(random)) as f32),
        };
        NewSplat::nearest(&splat, &grid)
    };
    let splats = (0..count).map(|_| splat(random)).collect();
    let (removed, changed, fades) = (Vec::new(), Vec::new(), Vec::new());
    let (prior, before) = (PriorId(1), StateId(1));
    let mut update =
        Update { prior, number: 1, before, grid, splats, removed, changed, fades, frames: [0, 90] };
    update.splats = update.ordered();
    update
}

/// Bits of positions, scales, rotations, opacities, colours.
fn costs(splats: &[NewSplat]) -> [f64; 5] {
    let mut costs: [Cost; 5] = Default::default();
    let mut positions: Vec<_> = splats.iter().map(|splat| splat.position).collect();
    places::code(&mut costs[0], &mut positions);
    let mut attributes = Attributes::new();
    for splat in splats {
        let scales = splat.log_scale.map(i32::from);
        attributes.log_scale(&mut costs[1], scales);
        attributes.rotation(&mut costs[2], scales, splat.rotation.map(i32::from));
        attributes.opacity(&mut costs[3], splat.opacity);
        attributes.colour(&mut costs[4], splat.colour.map(i32::from));
    }
    costs.map(|cost| cost.0)
}

#[test]
fn splats_of_an_object_take_seven_bytes() {
    let sizes = [DVec3::new(200.0, 120.0, 80.0), DVec3::new(400.0, 60.0, 60.0)];
    for (count, most) in [(60, 8.0), (150, 7.0), (400, 6.4)] {
        let (mut parts, mut whole) = ([0.0; 5], 0.0);
        for (seed, size) in (0..8).flat_map(|seed| sizes.map(|size| (seed, size))) {
            let update = object(seed, count, size);
            let mut bytes = Vec::new();
            update.write(&mut bytes).unwrap();
            assert_eq!(Update::read(&bytes).unwrap(), update);
            whole += bytes.len() as f64 / 16.0;
            for (sum, bits) in parts.iter_mut().zip(costs(&update.splats)) {
                *sum += bits / 8.0 / 16.0;
            }
        }
        let count = count as f64;
        let splat = parts.map(|part| format!("{:.2}", part / count)).join(" | ");
        let besides = whole - parts.iter().sum::<f64>();
        println!("| {count} | {splat} | {besides:.0} | {whole:.0} | {:.2} |", whole / count);
        assert!(whole / count < most, "{} bytes", whole / count);
        assert!((30.0..50.0).contains(&besides), "{besides} bytes besides the splats");
    }
}

//! The definition of the final picture gives the same bits on every host. Also run for 64-bit ARM under QEMU.

mod common;

use common::{Random, camera, random_splats};
use nvsprior::packet::{PoseProfile, QuantisedPose};
use nvsprior::render::definition::{Definition, Drawn};
use nvsprior::{Pose, Prior, RenderOptions};

/// CRC-32 of what is drawn of each scene: floats and bytes, at a pose and at a packet's pose.
const EXPECTED: [u32; 8] = [
    0x5bce_cf27,
    0xbd1f_036b,
    0x3c77_03ad,
    0xb78d_9ba7,
    0x240d_433e,
    0x68d8_ccc7,
    0x2d07_b207,
    0xb099_8129,
];

/// A pose of sums and products alone: hosts' sines differ.
fn pose(seed: u64) -> Pose {
    let mut random = Random::new(seed);
    let [x, y, z] = random.triple(-0.1, 0.1).map(f64::from);
    Pose::from_wxyz([1.0, x, y, z], random.triple(-0.3, 0.3).map(f64::from)).unwrap()
}

fn check_sum(drawn: &[Drawn]) -> u32 {
    let mut check = crc32fast::Hasher::new();
    for picture in drawn {
        picture.image.iter().for_each(|v| check.update(&v.to_bits().to_le_bytes()));
        check.update(&picture.rgb8);
    }
    check.finalize()
}

#[test]
fn every_host_draws_the_same() {
    let found: Vec<u32> = (0..EXPECTED.len() as u64)
        .map(|seed| {
            let options = RenderOptions { antialiased: seed % 2 == 1, ..RenderOptions::GSPLAT };
            let splats = random_splats(seed, 2_000, seed as u32 % 4);
            let prior = Prior::from_splats(splats, options).unwrap();
            let (camera, pose) = (camera(112, 63), pose(seed));
            let code =
                QuantisedPose::quantise(&pose, &prior.coordinate_frame(), PoseProfile::Compact)
                    .unwrap();
            let definition = Definition::new(&prior);
            check_sum(&[
                definition.draw(&camera, &pose),
                definition.draw_coded(&camera, &code.words()),
            ])
        })
        .collect();
    assert_eq!(found, EXPECTED, "{found:#010x?}");
}

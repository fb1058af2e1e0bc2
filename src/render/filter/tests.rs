use super::*;
use crate::Engine;
use crate::filter_weights::tests::random_weights;
use crate::random::Random;

fn random_picture(random: &mut Random, width: u32, height: u32) -> Picture {
    let mut picture = Picture::new(width, height);
    picture.data.iter_mut().for_each(|byte| *byte = random.bits() as u8);
    picture
}

#[test]
fn the_device_gives_the_definitions_bytes() {
    let engine = Engine::new(&Default::default()).unwrap();
    let kernels = FilterKernels::new(engine.vulkan()).unwrap();
    let mut random = Random::new(7);
    for (seed, [width, height]) in
        [[1, 1], [2, 3], [17, 9], [64, 36], [33, 70]].into_iter().enumerate()
    {
        let weights = random_weights(seed as u64);
        let mut filter =
            DisplayFilter::new(engine.vulkan(), &kernels, &weights, width, height).unwrap();
        for step in [0, 30, 63] {
            let render = random_picture(&mut random, width, height);
            let picture = random_picture(&mut random, width, height);
            let expected = definition::filtered(&weights, step, &render, &picture);
            let mut found = picture.clone();
            filter.apply(step, &render.data, &mut found).unwrap();
            assert!(width < 17 || expected != picture, "{width}×{height}: nothing to see");
            assert_eq!(found, expected, "{width}×{height}, step {step}");
        }
    }
}

#[test]
fn weights_of_zero_change_nothing() {
    let mut random = Random::new(8);
    let (render, picture) =
        (random_picture(&mut random, 20, 11), random_picture(&mut random, 20, 11));
    assert_eq!(definition::filtered(&FilterWeights::zero(), 40, &render, &picture), picture);
}

use super::*;
use crate::random::Random;

/// Weights as they might be.
pub(crate) fn random_weights(seed: u64) -> FilterWeights {
    let mut random = Random::new(seed);
    let layer = |number| {
        let outputs = Convolution::outputs(number);
        let mut within = |most: i64| (random.bits() % (2 * most as u64 + 1)) as i64 - most;
        Convolution {
            weights: (0..outputs * Convolution::fan_in(number))
                .map(|_| within(127) as i8)
                .collect(),
            biases: (0..outputs)
                .map(|_| [within(300_000), within(3000)].map(|bias| bias as i32))
                .collect(),
            shifts: (0..outputs).map(|_| 9 + (within(2) + 2) as u8).collect(),
        }
    };
    FilterWeights::new((0..LAYERS).map(layer).collect()).unwrap()
}

#[test]
fn weights_are_read_as_they_were_written() {
    for weights in [FilterWeights::zero(), random_weights(1), random_weights(2)] {
        let bytes = weights.write();
        assert_eq!(bytes.len(), FilterWeights::encoded_len());
        assert_eq!(FilterWeights::read(&bytes), Ok(weights));
    }
}

#[test]
fn the_librarys_weights_are_whole() {
    let bytes = include_bytes!("generic.nvf");
    assert_eq!(FilterWeights::read(bytes).unwrap().write(), bytes);
}

#[test]
fn damage_is_told() {
    let bytes = random_weights(3).write();
    assert_eq!(FilterWeights::read(b"NVT1"), Err(FilterWeightsError::Magic));
    let short = &bytes[..bytes.len() - 1];
    let (expected, found) = (bytes.len(), short.len());
    assert_eq!(FilterWeights::read(short), Err(FilterWeightsError::Length { expected, found }));
    for at in (4..bytes.len()).step_by(101) {
        let mut other = bytes.clone();
        other[at] ^= 1 << (at % 8);
        assert_eq!(FilterWeights::read(&other), Err(FilterWeightsError::Check), "byte {at}");
    }
}

#[test]
fn sums_that_may_round_are_refused() {
    let refused = |change: &dyn Fn(&mut Vec<Convolution>)| {
        let mut layers = FilterWeights::zero().layers;
        change(&mut layers);
        FilterWeights::new(layers).unwrap_err()
    };
    let range = |layer, output| FilterWeightsError::Range { layer, output };
    assert_eq!(refused(&|layers| layers[2].biases[7][0] = 1 << 24), range(2, 7));
    assert_eq!(refused(&|layers| layers[0].biases[3][1] = 66_000), range(0, 3));
    assert_eq!(refused(&|layers| layers[6].shifts[11] = 21), range(6, 11));
    let short = refused(&|layers| layers[1].shifts.truncate(3));
    assert!(matches!(short, FilterWeightsError::Length { .. }), "{short}");
}

//! Adam (Kingma and Ba 2015) with a learning rate that falls by a cosine.

use super::network::Network;

const PEAK_RATE: f32 = 1e-3;
/// Share of the training in which the rate rises.
const WARM: f32 = 0.05;
const MOMENTS: (f32, f32) = (0.9, 0.999);

pub struct Adam {
    moments: Vec<[f32; 2]>,
    steps: i32,
}

fn rate(part: f32) -> f32 {
    let fall = 0.5 + 0.5 * (std::f32::consts::PI * part).cos();
    PEAK_RATE * (fall * (part / WARM).min(1.0) + 0.005)
}

impl Adam {
    pub fn new(len: usize) -> Adam {
        Adam { moments: vec![[0.0; 2]; len], steps: 0 }
    }

    /// Takes a step against a sum of `count` gradients; `part` of the training is done.
    pub fn step(&mut self, network: &mut Network, gradient: &Network, count: usize, part: f32) {
        self.steps += 1;
        let unbiased = |moment: f32| 1.0 - moment.powi(self.steps);
        let (first, second) = (unbiased(MOMENTS.0), unbiased(MOMENTS.1));
        let rate = rate(part);
        let values = network.values_mut().zip(gradient.values());
        for ((value, gradient), [m, v]) in values.zip(&mut self.moments) {
            let gradient = gradient / count as f32;
            *m = MOMENTS.0 * *m + (1.0 - MOMENTS.0) * gradient;
            *v = MOMENTS.1 * *v + (1.0 - MOMENTS.1) * gradient * gradient;
            *value -= rate * (*m / first) / ((*v / second).sqrt() + 1e-8);
        }
    }
}

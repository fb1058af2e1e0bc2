//! What f32 loses, by stage, by storage, by the width of keys, by the way of summing.

mod stages;
mod storage;
mod sums;
mod which;

use super::case::{Bench, Case, Group};
use which::Which;

pub const GROUP: Group = Group {
    name: "precision",
    about: "The device's f32 against the twin's f64, at 160×90, on 3,000 random splats, the same a \
            million units from the origin, and the prior given by `--prior`, seen from three times its \
            spread away.",
    cases,
};

fn cases(bench: &Bench) -> Vec<Case> {
    let mut which = vec![Which::Random, Which::Moved];
    which.extend(bench.prior.is_some().then_some(Which::Given));
    let mut all = Vec::new();
    for which in which {
        all.push(Case::new(
            format!("stages, {}", which.name()),
            "medians of 16 bits right and more in every stage, 12 of the picture's worst pixel but for \
             close decisions",
            move |bench| stages::measure(bench, which),
        ));
        all.push(Case::new(
            format!("f16 storage, {}", which.name()),
            "coefficients and axes in f16 leave 45 dB and more; positions are not asked for any",
            move |bench| storage::measure(bench, which),
        ));
        all.push(Case::new(
            format!("key width, {}", which.name()),
            "two digits of three leave 35 dB and more",
            move |bench| storage::keys(bench, which),
        ));
        all.push(Case::new(
            format!("sums, {}", which.name()),
            "summing tiles in f32 in a fixed order changes the step by less than 1e-3 of it",
            move |bench| sums::measure(bench, which),
        ));
    }
    all
}

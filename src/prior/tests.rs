use std::sync::LazyLock;

use super::*;
use crate::coder_tables::Tables;
use crate::random::Random;

/// `count` valid splats of the degree, every parameter a different number.
pub(crate) fn sample_splats(count: usize, sh_degree: u32) -> Splats {
    let mut next = 0.0;
    let mut value = || {
        next += 0.0625;
        next
    };
    let mut splats = Splats { sh_degree, ..Splats::default() };
    for _ in 0..count {
        splats.positions.push(std::array::from_fn(|_| value()));
        splats.log_scales.push(std::array::from_fn(|_| -value() / 100.0));
        splats.rotations.push(std::array::from_fn(|_| value()));
        splats.opacity_logits.push(value());
        let stride = splats.sh_stride();
        splats.sh.extend(std::iter::repeat_with(&mut value).take(stride));
    }
    splats
}

pub(crate) fn sample_tables(seed: u64) -> Tables {
    let mut random = Random::new(seed);
    let mut bytes = Tables::zero().write();
    bytes[4..].iter_mut().for_each(|byte| *byte = random.bits() as u8);
    Tables::read(&bytes).unwrap()
}

/// Options, and nothing else.
pub(crate) fn bare(options: &RenderOptions) -> Besides<'_> {
    static NONE: LazyLock<Extras> = LazyLock::new(Extras::default);
    Besides { options, frame: None, coder_tables: None, extras: &NONE }
}

#[test]
fn refuses_options_that_cannot_render() {
    let splats = sample_splats(1, 0);
    for options in [
        RenderOptions { near: 0.0, ..RenderOptions::INRIA },
        RenderOptions { near: f32::NAN, ..RenderOptions::INRIA },
        RenderOptions { alpha_max: 1.0, ..RenderOptions::INRIA },
        RenderOptions { background: [0.0, f32::NAN, 0.0], ..RenderOptions::INRIA },
    ] {
        let refused = Prior::from_splats(splats.clone(), options);
        assert!(matches!(refused, Err(PriorError::Option { .. })), "{options:?}");
    }
}

#[test]
fn refuses_arrays_that_disagree() {
    let mut splats = sample_splats(3, 1);
    splats.sh.pop();
    let refused = Prior::from_splats(splats, RenderOptions::INRIA);
    assert!(matches!(refused, Err(PriorError::Shape { array: "sh", found: 35, expected: 36 })));
    let splats = Splats { sh_degree: 4, ..sample_splats(1, 0) };
    assert!(matches!(
        Prior::from_splats(splats, RenderOptions::INRIA),
        Err(PriorError::ShDegree { degree: 4 })
    ));
    assert!(matches!(
        Prior::from_splats(Splats::default(), RenderOptions::INRIA),
        Err(PriorError::Empty)
    ));
}

#[test]
fn overrides_replace_only_what_they_name() {
    let overrides = RenderOverrides { near: Some(0.5), ..RenderOverrides::default() };
    let expected = RenderOptions { near: 0.5, ..RenderOptions::GSPLAT };
    assert_eq!(overrides.over(RenderOptions::GSPLAT), expected);
}

#[test]
fn unit_rotation_has_unit_length_at_any_magnitude() {
    let mut splats = sample_splats(1, 0);
    for scale in [1e-5, 1.0, 1e30] {
        splats.rotations[0] = [0.0, 3.0 * scale, 0.0, -4.0 * scale];
        let unit = splats.unit_rotation(0);
        let error = unit.iter().zip([0.0, 0.6, 0.0, -0.8]).map(|(a, b)| (a - b).abs());
        assert!(error.fold(0.0, f32::max) < 1e-6, "{unit:?}");
    }
}

#[test]
fn opening_what_is_no_prior_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("absent.ply");
    let error = Prior::open(&path, &RenderOverrides::default()).unwrap_err();
    let PriorError::InFile { error: inner, .. } = &error else { panic!("{error:?}") };
    assert!(matches!(**inner, PriorError::Read(_)));
    assert!(error.to_string().contains("absent.ply"));
    let path = folder.path().join("empty.ply");
    std::fs::write(&path, b"").unwrap();
    let error = Prior::open(&path, &RenderOverrides::default()).unwrap_err();
    assert!(error.to_string().contains("empty.ply"), "{error}");
}

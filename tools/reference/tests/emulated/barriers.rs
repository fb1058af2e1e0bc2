//! What the modules of the forms for waves lose with a barrier, the emulator misses. So its silence about them as they
//! ship means something.

use nvsprior::{Prior, RenderOptions};
use nvsprior_emulator::{Error, without_barrier};
use nvsprior_kernels::modules::{self, Module};

use crate::chain::{Chain, FORMS, Form, Settings, View};
use crate::common::{camera, random_frame, random_pose, random_splats};

/// Many splats of low opacity: lists are longer than a subgroup takes at once.
fn prior() -> Prior {
    let mut splats = random_splats(170, 1_000, 0);
    splats.opacity_logits.iter_mut().for_each(|logit| *logit = logit.min(-2.0));
    Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap()
}

/// The first fault of a chain with this module.
fn fault(view: &View, form: Form, module: &Module, spirv: Vec<u8>) -> Option<Error> {
    let mut chain = Chain::new(view, Settings::new(form, 1));
    chain.broken = Some((module.entry, spirv));
    chain.set("frame", &random_frame(170, &view.camera));
    // What comes after a fault works on anything.
    let stages = [
        |chain: &mut Chain| chain.project(),
        |chain: &mut Chain| chain.sort(true),
        |chain: &mut Chain| chain.bin(),
        |chain: &mut Chain| chain.splat(),
        |chain: &mut Chain| _ = chain.equations(),
    ];
    for stage in stages {
        if chain.faults.is_empty() {
            stage(&mut chain);
        }
    }
    chain.faults.into_iter().next()
}

fn assert_missed(view: &View, form: Form, module: &Module, spirv: Vec<u8>, what: &str) {
    let fault = fault(view, form, module, spirv);
    let is_race = matches!(fault, Some(Error::Race { .. } | Error::Unwritten { .. }));
    assert!(is_race, "{} without {what}: {fault:?}", module.entry);
}

/// The barriers that are needed by themselves: of the others, one without the rest.
#[test]
fn a_barrier_that_is_taken_is_missed() {
    let prior = prior();
    let view = View::new(&prior, camera(24, 17), random_pose(170));
    for form in FORMS.into_iter().filter(|form| form.wave) {
        let forms = form.modules();
        for (module, needed) in [
            (modules::radix_count, &[0, 1][..]),
            (forms.radix_scatter, &[0, 1, 2]),
            (forms.bin_scan, &[0]),
            (forms.bin_emit, &[3, 4]),
            (forms.splat, &[0, 1]),
            (forms.splat_flow, &[0, 1]),
        ] {
            for nth in needed {
                let spirv = without_barrier(module.spirv, *nth).expect("a barrier");
                assert_missed(&view, form, &module, spirv, &format!("barrier {nth}"));
            }
        }
        let mut spirv = forms.bin_count.spirv.to_vec();
        while let Some(fewer) = without_barrier(&spirv, 0) {
            spirv = fewer;
        }
        assert_missed(&view, form, &forms.bin_count, spirv, "all barriers");
    }
}

//! Training splats behind those of a scene.

use glam::DVec3;

use super::{CAMERA, assert_silent, engine, pose, splats};
use crate::prior::{Learnt, LearntSplat, NewSplat, Splats, Update, UpdateGrid};
use crate::render::training::{
    FADING, Trainer, Training, TrainingFrame, TrainingPlan, TrainingState, TrainingView,
};
use crate::render::{Plan, Scene};
use crate::shared::sh_coefficients;
use crate::training::{LOG_SCALE, OPACITY, POSITION, ROTATION, SH, planes};
use crate::{Engine, Picture, Pose, Prior, RenderOptions};

const DEGREE: u32 = 1;
/// Splats of the scene: more than a workgroup's.
const OWN: usize = 330;
/// Those that are trained behind them.
const TRAINED: usize = 50;

/// Parameters of splats `from..`, as planes.
fn planes_of(splats: &Splats, from: usize, centre: DVec3) -> Vec<f32> {
    let (all, stride) = (splats.positions.len(), splats.sh_stride());
    let n = all - from;
    let mut parameters = vec![0.0; n * planes(DEGREE) as usize];
    for i in from..all {
        let mut put = |plane: u32, value: f32| parameters[plane as usize * n + i - from] = value;
        let position = (DVec3::from(splats.positions[i].map(f64::from)) - centre).as_vec3();
        (0..3).for_each(|k| put(POSITION + k, position[k as usize]));
        (0..3).for_each(|k| put(LOG_SCALE + k, splats.log_scales[i][k as usize]));
        (0..4).for_each(|k| put(ROTATION + k, splats.rotations[i][k as usize]));
        put(OPACITY, splats.opacity_logits[i]);
        (0..stride).for_each(|k| put(SH + k as u32, splats.sh[i * stride + k]));
    }
    parameters
}

fn state(parameters: Vec<f32>) -> TrainingState {
    let zero = vec![0.0; parameters.len()];
    TrainingState { parameters, first: zero.clone(), second: zero }
}

fn training() -> Training {
    Training {
        sh_coefficients: sh_coefficients(DEGREE),
        sh_trained: sh_coefficients(DEGREE),
        per_value: 1.0 / (3 * CAMERA.pixels()) as f32,
        knee: 0.1,
        rates: [1e-3; 6],
        unbias: FADING.map(|fading| 1.0 / (1.0 - fading)),
        ..Training::default()
    }
}

/// A frame that no picture looks like.
fn frame() -> TrainingFrame {
    let byte = |i: usize| ((i * 7919) % 251) as f32 / 255.0;
    TrainingFrame::from_fn(CAMERA.pixels(), |i| {
        Some([byte(3 * i), byte(3 * i + 1), byte(3 * i + 2)])
    })
}

/// A scene of the first splats, and all splats.
struct Case {
    engine: Engine,
    all: Splats,
    prior: Prior,
    scene: std::sync::Arc<Scene>,
}

impl Case {
    fn new(seed: u64) -> Case {
        let engine = engine();
        let mut all = splats(seed, OWN + TRAINED, DEGREE);
        // So all of them are on the device.
        all.opacity_logits.iter_mut().for_each(|logit| *logit = logit.max(-2.5));
        let own: Vec<bool> = (0..OWN + TRAINED).map(|i| i < OWN).collect();
        let prior = Prior::from_splats(all.filtered(&own), RenderOptions::GSPLAT).unwrap();
        let scene = engine.upload_for_updates(&prior).unwrap();
        assert_eq!(scene.analysis().splats.len(), OWN);
        Case { engine, all, prior, scene }
    }

    fn plan(&self, splats: usize) -> TrainingPlan {
        TrainingPlan {
            size: [CAMERA.width, CAMERA.height],
            options: RenderOptions::GSPLAT,
            sh_degree: DEGREE,
            splats: splats as u32,
            centre: self.scene.centre(),
            ssim: false,
            profiled: false,
        }
    }

    /// A trainer of the last splats behind the scene's.
    fn behind(&self) -> Trainer {
        let mut trainer = self.engine.trainer_behind(&self.scene, &self.plan(TRAINED)).unwrap();
        trainer.set(&state(planes_of(&self.all, OWN, self.scene.centre()))).unwrap();
        trainer
    }

    /// A trainer of splats alone.
    fn whole(&self, splats: &Splats) -> Trainer {
        let mut trainer = self.engine.trainer(&self.plan(splats.positions.len())).unwrap();
        trainer.set(&state(planes_of(splats, 0, self.scene.centre()))).unwrap();
        trainer
    }

    fn picture(&self, pose: &Pose) -> Vec<u8> {
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        let mut renderer = self.engine.renderer(&self.scene, &CAMERA, Plan::picture()).unwrap();
        renderer.picture(pose, &mut picture).unwrap();
        picture.data
    }
}

fn gradients(trainer: &mut Trainer, pose: &Pose) -> Vec<f32> {
    let view = TrainingView { camera: &CAMERA, pose, frame: &frame(), factor: 1 };
    trainer.gradients(&view, &training()).unwrap()
}

/// The gradients of the last splats agree with those of a training of all. The scene activates its splats in f64, the
/// trainer in f32: so the two differ in the last bits.
fn assert_agree(what: &str, own: &[f32], all: &[f32]) {
    let n = all.len() / planes(DEGREE) as usize;
    for (plane, (own, all)) in own.chunks_exact(TRAINED).zip(all.chunks_exact(n)).enumerate() {
        let all = &all[n - TRAINED..];
        let largest = all.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
        assert!(largest > 0.0, "{what}, plane {plane}");
        for (i, (own, all)) in own.iter().zip(all).enumerate() {
            let error = (own - all).abs() / largest;
            assert!(error < 1e-3, "{what}, plane {plane}, splat {i}: {own}, all {all}");
        }
    }
}

#[test]
fn gradients_behind_a_scene_are_those_of_the_training_of_all() {
    for seed in 0..3 {
        let case = Case::new(20 + seed);
        let pose = pose(20 + seed);
        let own = gradients(&mut case.behind(), &pose);
        assert_agree("all", &own, &gradients(&mut case.whole(&case.all), &pose));
        assert_silent(&case.engine);
    }
}

/// Learnt splats lie between the scene's own and those that are trained.
/// The first `count` of some splats, learnt by one update.
fn learnt(none: &Learnt, splats: &Splats, count: usize) -> Learnt {
    let (stride, grid) = (splats.sh_stride(), UpdateGrid { origin: [0.0; 3], exponent: -8 });
    let splat = |i: usize| LearntSplat {
        position: splats.positions[i],
        log_scale: splats.log_scales[i],
        rotation: splats.rotations[i],
        logit: splats.opacity_logits[i],
        colour: [0, 1, 2].map(|k| splats.sh[i * stride + k]),
    };
    let update = Update {
        prior: none.prior(),
        number: 1,
        before: none.state(),
        grid,
        splats: (0..count).map(|i| NewSplat::nearest(&splat(i), &grid)).collect(),
        changed: Vec::new(),
        removed: Vec::new(),
        fades: Vec::new(),
        frames: [0, 0],
    };
    let mut learnt = none.clone();
    learnt.add(&update).unwrap();
    learnt
}

#[test]
fn learnt_splats_stay_before_those_that_are_trained() {
    let (case, pose) = (Case::new(30), pose(30));
    let none = Learnt::none(case.prior.id());
    let learnt = learnt(&none, &Case::new(31).all, 40);
    let tried = learnt.splats();
    let between = tried.len();
    let mut trainer = case.behind();
    let before = gradients(&mut trainer, &pose);
    case.scene.show(&learnt).unwrap();
    trainer.set_first(case.scene.first_tried(between).unwrap());
    let own = gradients(&mut trainer, &pose);
    assert_ne!(own, before);

    let mut all = case.prior.splats().clone();
    crate::prior::update::append(&mut all, tried);
    let trained: Vec<bool> = (0..OWN + TRAINED).map(|i| i >= OWN).collect();
    let last = case.all.filtered(&trained);
    all.positions.extend(last.positions);
    all.log_scales.extend(last.log_scales);
    all.rotations.extend(last.rotations);
    all.opacity_logits.extend(last.opacity_logits);
    all.sh.extend(last.sh);
    assert_agree("behind learnt ones", &own, &gradients(&mut case.whole(&all), &pose));

    case.scene.show(&none).unwrap();
    trainer.set_first(case.scene.first_tried(0).unwrap());
    assert_eq!(gradients(&mut trainer, &pose), before, "the same bits again");
    assert_silent(&case.engine);
}

/// What is trained shows in the trainer's picture alone, and only it moves.
#[test]
fn training_behind_a_scene_leaves_its_picture_alone() {
    let (case, pose) = (Case::new(40), pose(40));
    let before = case.picture(&pose);
    let (mut trainer, frame) = (case.behind(), frame());
    let view = TrainingView { camera: &CAMERA, pose: &pose, frame: &frame, factor: 1 };
    let mut shown = Picture::new(CAMERA.width, CAMERA.height);
    trainer.picture(&CAMERA, &pose, &mut shown).unwrap();
    let first = trainer.state().unwrap().parameters;
    let mut last = first.clone();
    for step in 0..3 {
        trainer.step(&view, &Training { step, ..training() }).unwrap();
        let after = trainer.state().unwrap().parameters;
        let moved = after.iter().zip(&last).filter(|(a, b)| a != b).count();
        assert!(moved > after.len() / 2, "step {step}: {moved} of {}", after.len());
        assert!(case.picture(&pose) == before, "step {step}");
        last = after;
    }
    let mut moved = Picture::new(CAMERA.width, CAMERA.height);
    trainer.picture(&CAMERA, &pose, &mut moved).unwrap();
    assert!(moved != shown && shown.data != before);
    trainer.set(&state(first)).unwrap();
    trainer.picture(&CAMERA, &pose, &mut moved).unwrap();
    assert!(moved == shown, "the scene's own splats are as they were");
    assert_silent(&case.engine);
}

/// The trainer draws what the scene draws once its splats are learnt: by splats in f32, so not to every byte.
#[test]
fn a_trainer_draws_the_scene_with_its_splats() {
    let (case, pose) = (Case::new(50), pose(50));
    let mut shown = [0, 1].map(|_| Picture::new(CAMERA.width, CAMERA.height));
    let [own, all] = &mut shown;
    case.behind().picture(&CAMERA, &pose, own).unwrap();
    case.whole(&case.all).picture(&CAMERA, &pose, all).unwrap();
    let [own, all] = shown.map(|picture| picture.data);
    let others = own.iter().zip(&all).filter(|(a, b)| a != b).count();
    assert!(own.iter().zip(&all).all(|(a, b)| a.abs_diff(*b) <= 1));
    assert!(others * 100 < own.len(), "{others} of {} bytes", own.len());
    assert_silent(&case.engine);
}

//! Holds the gradients of training against differences of the twin's loss.

#[path = "../../../tests/common/mod.rs"]
mod common;

use glam::DVec3;

use nvsprior::prior::Splats;
use nvsprior::random::Random;
use nvsprior::{Camera, Engine, Picture, Pose, Prior, RenderOptions};
use nvsprior_kernels::shared::sh_coefficients;
use nvsprior_kernels::training::{
    LOG_SCALE, OPACITY, POSITION, ROTATION, ROUNDED_LOGITS, SH, planes,
};
use nvsprior_reference::Twin;
use nvsprior_reference::loss::loss;
use nvsprior_train::trainer::{
    FADING, Trainer, Training, TrainingFrame, TrainingPlan, TrainingState, TrainingView,
};

const CAMERA: Camera = Camera { width: 44, height: 37, fx: 40.0, fy: 44.0, cx: 21.0, cy: 19.0 };
const SHARE: f32 = 0.2;

/// The splats' parameters as planes.
fn planes_of(splats: &Splats) -> Vec<f32> {
    let n = splats.positions.len();
    let mut all = vec![0.0; n * planes(splats.sh_degree) as usize];
    let stride = splats.sh_stride();
    for i in 0..n {
        let mut put = |plane: u32, value: f32| all[plane as usize * n + i] = value;
        (0..3).for_each(|k| put(POSITION + k, splats.positions[i][k as usize]));
        (0..3).for_each(|k| put(LOG_SCALE + k, splats.log_scales[i][k as usize]));
        (0..4).for_each(|k| put(ROTATION + k, splats.rotations[i][k as usize]));
        put(OPACITY, splats.opacity_logits[i]);
        (0..stride).for_each(|k| put(SH + k as u32, splats.sh[i * stride + k]));
    }
    all
}

fn number(splats: &mut Splats, plane: u32, i: usize) -> &mut f32 {
    let stride = splats.sh_stride();
    match plane {
        LOG_SCALE.. if plane < ROTATION => &mut splats.log_scales[i][(plane - LOG_SCALE) as usize],
        ROTATION.. if plane < OPACITY => &mut splats.rotations[i][(plane - ROTATION) as usize],
        OPACITY => &mut splats.opacity_logits[i],
        SH.. => &mut splats.sh[i * stride + (plane - SH) as usize],
        _ => &mut splats.positions[i][plane as usize],
    }
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Ordinary,
    /// Needles and discs.
    Stiff,
    /// As large as the picture and more, and partly behind the camera's margin.
    Large,
}

fn cloud(count: usize, sh_degree: u32, kind: Kind) -> Splats {
    let mut random = Random::new(7 + u64::from(sh_degree));
    let mut splats = Splats { sh_degree, ..Splats::default() };
    for _ in 0..count {
        let [x, y, z]: [f32; 3] = random.triple(-1.0, 1.0);
        splats.positions.push([1.1 * x, 0.9 * y, 3.0 + 1.2 * z]);
        let [a, b, c]: [f32; 3] = random.triple(-0.5, 0.5);
        splats.log_scales.push(match kind {
            Kind::Ordinary => [a - 2.2, b - 2.4, c - 2.6],
            Kind::Stiff if a > 0.0 => [a - 1.5, b - 7.0, c - 7.0],
            Kind::Stiff => [a - 1.8, b - 2.0, c - 8.0],
            Kind::Large => [a + 0.3, b - 0.5, c - 1.0],
        });
        let [w, x, y]: [f32; 3] = random.triple(-1.0, 1.0);
        splats.rotations.push([w, x, y, random.within(0.2, 1.5)]);
        splats.opacity_logits.push(random.within(-2.0, 1.0));
        for k in 0..sh_coefficients(sh_degree) {
            let size = if k == 0 { 1.0 } else { 0.25 };
            splats.sh.extend(random.triple(-size, size));
        }
    }
    splats
}

fn frame(camera: &Camera) -> Picture {
    let mut frame = Picture::new(camera.width, camera.height);
    for (i, byte) in frame.data.iter_mut().enumerate() {
        *byte = ((i * 7919) % 251) as u8;
    }
    frame
}

/// Which pixels count: not those of a rectangle in the middle, nor some single ones.
fn counts(pixel: usize) -> bool {
    let (x, y) = (pixel % CAMERA.width as usize, pixel / CAMERA.width as usize);
    let hidden = (12..20).contains(&x) && (8..22).contains(&y);
    !(hidden || pixel.is_multiple_of(97))
}

/// What is rendered how, and compared with which frame.
struct Case {
    splats: Splats,
    options: RenderOptions,
    pose: Pose,
    frame: Picture,
    knee: f32,
    /// By how much views are reduced.
    factor: u32,
}

impl Case {
    fn new(kind: Kind, sh_degree: u32, options: RenderOptions, knee: f32) -> Case {
        let pose = Pose {
            rotation: glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.05, -0.08, 0.1),
            translation: DVec3::new(0.05, -0.1, 0.2),
        };
        let splats = cloud(20, sh_degree, kind);
        Case { splats, options, pose, frame: frame(&CAMERA), knee, factor: 1 }
    }

    /// The same in views that are reduced.
    fn reduced(self, factor: u32) -> Case {
        Case { frame: frame(&CAMERA.reduced(factor)), factor, ..self }
    }

    fn camera(&self) -> Camera {
        CAMERA.reduced(self.factor)
    }

    fn twin_loss(&self, splats: &Splats) -> f64 {
        let prior = Prior::from_splats(splats.clone(), self.options).unwrap();
        let rendered = Twin::new(&prior).reduced(self.factor).render(&self.camera(), &self.pose);
        let rgb: Vec<_> = rendered.pixels.iter().map(|[r, g, b, ..]| [*r, *g, *b]).collect();
        loss(&rgb, &self.frame, counts, SHARE.into(), self.knee.into())
    }

    /// Relative errors of a plane's gradients, sorted.
    fn errors(&self, plane: u32, gradients: &[f32]) -> Vec<f64> {
        let min = gradients.iter().map(|g| f64::from(g.abs())).fold(0.0, f64::max) * 1e-3;
        let of = |i: usize| {
            let moved = |by: f32| {
                let mut splats = self.splats.clone();
                let value = number(&mut splats, plane, i);
                *value += by;
                let value = f64::from(*value);
                (value, self.twin_loss(&splats))
            };
            let (high, low) = (moved(2e-4), moved(-2e-4));
            let difference = (high.1 - low.1) / (high.0 - low.0);
            (f64::from(gradients[i]) - difference).abs() / difference.abs().max(min)
        };
        let mut errors: Vec<f64> = (0..gradients.len()).map(of).collect();
        errors.sort_by(f64::total_cmp);
        errors
    }

    /// A trainer of the splats as they are.
    fn trainer(&self, engine: &Engine) -> Trainer {
        let plan = TrainingPlan {
            size: [CAMERA.width, CAMERA.height],
            options: self.options,
            sh_degree: self.splats.sh_degree,
            splats: self.splats.positions.len() as u32,
            centre: DVec3::ZERO,
            ssim: true,
            profiled: false,
        };
        let mut trainer = Trainer::new(engine, &plan).unwrap();
        let parameters = planes_of(&self.splats);
        let zero = vec![0.0; parameters.len()];
        let (first, second) = (zero.clone(), zero);
        trainer.set(&TrainingState { parameters, first, second }).unwrap();
        trainer
    }

    fn training(&self) -> Training {
        let coefficients = sh_coefficients(self.splats.sh_degree);
        Training {
            sh_coefficients: coefficients,
            sh_trained: coefficients,
            ssim: SHARE,
            knee: self.knee,
            per_value: 1.0 / (3 * self.camera().pixels()) as f32,
            ..Training::default()
        }
    }

    fn counted(&self) -> TrainingFrame {
        let rgb = |pixel: usize| {
            let own = &self.frame.data[3 * pixel..3 * pixel + 3];
            counts(pixel).then(|| [0, 1, 2].map(|c| f32::from(own[c]) / 255.0))
        };
        TrainingFrame::from_fn(self.camera().pixels(), rgb)
    }
}

/// Medians, since cuts and stops make jumps that no gradient sees.
fn agree(kind: Kind, sh_degree: u32, options: RenderOptions, knee: f32) {
    agree_in(&Case::new(kind, sh_degree, options, knee), &format!("{kind:?}, knee {knee}"));
}

fn agree_in(case: &Case, what: &str) {
    let engine = common::engine();
    let (frame, camera, factor) = (case.counted(), case.camera(), case.factor);
    let view = TrainingView { camera: &camera, pose: &case.pose, frame: &frame, factor };
    let gradients = case.trainer(&engine).gradients(&view, &case.training()).unwrap();
    let n = case.splats.positions.len();
    for (plane, gradients) in gradients.chunks_exact(n).enumerate() {
        let errors = case.errors(plane as u32, gradients);
        let median = errors[n / 2];
        assert!(
            median < 1e-4,
            "{what}, degree {}, plane {plane}: {median} of {errors:?}",
            case.splats.sh_degree
        );
    }
    common::assert_silent(&engine);
}

/// The first two steps of Adam along the gradients that the device gives, in f64.
#[test]
fn steps_are_adams_along_the_gradients() {
    let engine = common::engine();
    let case = Case::new(Kind::Ordinary, 1, RenderOptions::INRIA, 0.3);
    let mut trainer = case.trainer(&engine);
    let frame = case.counted();
    let view = TrainingView { camera: &CAMERA, pose: &case.pose, frame: &frame, factor: 1 };
    let n = case.splats.positions.len();
    let rates = [1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3];
    let rate = |plane: u32| match plane {
        LOG_SCALE.. if plane < ROTATION => rates[1],
        ROTATION.. if plane < OPACITY => rates[2],
        OPACITY => rates[3],
        SH.. if plane < SH + 3 => rates[4],
        SH.. => rates[5],
        _ => rates[0],
    };
    let mut means = vec![[0.0; 2]; planes_of(&case.splats).len()];
    for step in 0..2 {
        let fading = FADING.map(f64::from);
        let unbias = fading.map(|fading| 1.0 / (1.0 - fading.powi(step + 1)));
        let training = Training {
            step: step as u32,
            rates,
            unbias: unbias.map(|unbias| unbias as f32),
            ..case.training()
        };
        let gradients = trainer.gradients(&view, &training).unwrap();
        let before = trainer.state().unwrap().parameters;
        trainer.step(&view, &training).unwrap();
        let after = trainer.state().unwrap().parameters;
        for (k, means) in means.iter_mut().enumerate() {
            let gradient = f64::from(gradients[k]);
            means[0] = fading[0] * means[0] + (1.0 - fading[0]) * gradient;
            means[1] = fading[1] * means[1] + (1.0 - fading[1]) * gradient * gradient;
            let spread = (means[1] * unbias[1]).sqrt() + 1e-15;
            let rate = f64::from(rate((k / n) as u32));
            let due = f64::from(before[k]) - rate * means[0] * unbias[0] / spread;
            let error = (f64::from(after[k]) - due).abs();
            assert!(error < 1e-3 * rate, "step {step}, number {k}: {} for {due}", after[k]);
        }
    }
    common::assert_silent(&engine);
}

#[test]
fn gradients_agree_with_differences_of_the_twins_loss() {
    agree(Kind::Ordinary, 1, RenderOptions::INRIA, 0.0);
    let options = RenderOptions { background: [0.2, 0.5, 0.9], ..RenderOptions::INRIA };
    agree(Kind::Ordinary, 3, options, 0.3);
}

#[test]
fn gradients_agree_for_anti_aliased_priors() {
    let options = RenderOptions { antialiased: true, ..RenderOptions::INRIA };
    agree(Kind::Ordinary, 0, options, 0.3);
}

#[test]
fn gradients_agree_for_needles_discs_and_giants() {
    agree(Kind::Stiff, 1, RenderOptions::INRIA, 0.3);
    agree(Kind::Large, 2, RenderOptions::INRIA, 0.0);
}

#[test]
fn gradients_agree_in_views_that_are_reduced() {
    agree_in(&Case::new(Kind::Ordinary, 1, RenderOptions::INRIA, 0.3).reduced(2), "reduced by 2");
    let options = RenderOptions { antialiased: true, ..RenderOptions::INRIA };
    agree_in(&Case::new(Kind::Ordinary, 0, options, 0.3).reduced(3), "reduced by 3");
}

/// A picture says nothing of splats that it does not show, nor do those that are not in use show.
#[test]
fn only_splats_in_view_and_in_use_move() {
    const IN_USE: usize = 15;
    let engine = common::engine();
    let mut case = Case::new(Kind::Ordinary, 1, RenderOptions::INRIA, 0.3);
    let n = case.splats.positions.len();
    // Behind the camera.
    case.splats.positions[4] = [0.0, 0.0, -5.0];
    let mut trainer = case.trainer(&engine);
    trainer.set_in_use(IN_USE as u32);
    let mut before = trainer.state().unwrap();
    before.first.fill(1e-3);
    before.second.fill(1e-6);
    trainer.set(&before).unwrap();
    let frame = case.counted();
    let view = TrainingView { camera: &CAMERA, pose: &case.pose, frame: &frame, factor: 1 };
    let (rates, unbias) = ([1e-2; 6], [1.0; 2]);
    let pulls = Training { opacity_pull: 0.1, scale_pull: 0.1, noise: 1.0, ..case.training() };
    trainer.step(&view, &Training { rates, unbias, ..pulls }).unwrap();
    let after = trainer.state().unwrap();
    let numbers = |state: &TrainingState, i: usize| -> Vec<f32> {
        let all = [&state.parameters, &state.first, &state.second];
        all.iter().flat_map(|planes| planes.iter().skip(i).step_by(n)).copied().collect()
    };
    let moved: Vec<usize> =
        (0..n).filter(|i| numbers(&before, *i) != numbers(&after, *i)).collect();
    assert!(!moved.contains(&4) && moved.iter().all(|i| *i < IN_USE), "{moved:?}");
    assert!(moved.len() > IN_USE / 2, "{moved:?}");
    let [all, some] = [n, IN_USE].map(|count| {
        let mut splats = case.splats.clone();
        splats.opacity_logits[count..].fill(-20.0);
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        let own = Case { splats, frame: case.frame.clone(), ..case };
        own.trainer(&engine).picture(&CAMERA, &case.pose, &mut picture).unwrap();
        picture
    });
    let mut picture = all.clone();
    trainer.set(&before).unwrap();
    trainer.picture(&CAMERA, &case.pose, &mut picture).unwrap();
    assert!(picture == some && picture != all, "splats that are not in use show nowhere");
    common::assert_silent(&engine);
}

/// Steps of positions, log scales, rotations, opacity logits, colours.
const ROUNDING: [f32; 5] = [1.0 / 32.0, 0.25, 1.0 / 6.0, 0.5, 0.125];

/// The twin of the device's rounding.
fn rounded(value: f32, step: f32) -> f32 {
    ((f64::from(value) / f64::from(step) + 0.5).floor() * f64::from(step)) as f32
}

/// A quaternion of the same length and the sign that it is trained with, in the rounded direction.
fn rounded_rotation(q: [f32; 4], step: f32) -> [f32; 4] {
    let [w, x, y, z] = q.map(f64::from);
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let signed = length * if w < 0.0 { -1.0 } else { 1.0 };
    let [x, y, z] = [x, y, z].map(|v| f64::from(rounded((v / signed) as f32, step)));
    let square = x * x + y * y + z * z;
    let shortened = square.max(1.0).sqrt();
    [(1.0 - square).max(0.0).sqrt(), x, y, z].map(|v| (v / shortened * signed) as f32)
}

/// Splats as a training that rounds them draws them.
fn rounded_splats(splats: &Splats) -> Splats {
    let [position, log_scale, rotation, logit, colour] = ROUNDING;
    let mut splats = splats.clone();
    let stride = splats.sh_stride();
    splats.positions.as_flattened_mut().iter_mut().for_each(|v| *v = rounded(*v, position));
    splats.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v = rounded(*v, log_scale));
    splats.rotations.iter_mut().for_each(|q| *q = rounded_rotation(*q, rotation));
    let [least, most] = ROUNDED_LOGITS.map(|steps| steps * logit);
    splats.opacity_logits.iter_mut().for_each(|v| *v = rounded(v.clamp(least, most), logit));
    let of_splats = splats.sh.chunks_exact_mut(stride);
    of_splats.for_each(|sh| sh[..3].iter_mut().for_each(|v| *v = rounded(*v, colour)));
    splats
}

/// Pictures and gradients of a training that rounds its splats are those of one whose splats are round.
fn assert_rounds(what: &str, case: &Case) {
    let engine = common::engine();
    let frame = case.counted();
    let view = TrainingView { camera: &CAMERA, pose: &case.pose, frame: &frame, factor: 1 };
    let other = Case { splats: rounded_splats(&case.splats), frame: case.frame.clone(), ..*case };
    let mut trainers = [case.trainer(&engine), other.trainer(&engine)];
    let plain = trainers[0].gradients(&view, &case.training()).unwrap();
    let training = Training { rounding: ROUNDING, ..case.training() };
    let by_device = trainers[0].gradients(&view, &training).unwrap();
    let by_host = trainers[1].gradients(&view, &case.training()).unwrap();
    let n = case.splats.positions.len();
    let planes = by_device.chunks_exact(n).zip(by_host.chunks_exact(n));
    for (plane, (device, host)) in planes.enumerate() {
        let largest = host.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
        for (i, (device, host)) in device.iter().zip(host).enumerate() {
            let error = (device - host).abs() / largest;
            assert!(error < 1e-3, "{what}, plane {plane}, splat {i}: {device}, twin {host}");
        }
    }
    let (far, size) = by_device
        .iter()
        .zip(&plain)
        .fold((0.0, 0.0), |(far, size), (a, b)| (far + (a - b).abs(), size + b.abs()));
    assert!(far > 0.1 * size, "{what}: rounding changes the gradients");
    common::assert_silent(&engine);
}

#[test]
fn rounded_splats_have_the_gradients_of_round_ones() {
    for (kind, degree) in [(Kind::Ordinary, 1), (Kind::Ordinary, 0), (Kind::Large, 2)] {
        let mut case = Case::new(kind, degree, RenderOptions::INRIA, 0.3);
        // Half a turn and more: no w of 0 or more is left, and some x, y and z are longer than 1.
        case.splats.rotations.iter_mut().step_by(3).for_each(|q| *q = q.map(|v| -v));
        case.splats.rotations[1] = [-0.02, 0.7, -0.6, 0.5];
        case.splats.opacity_logits[..2].copy_from_slice(&[-9.0, 9.0]);
        assert!(case.splats.rotations.iter().any(|q| q[0] < 0.0));
        assert_rounds(&format!("{kind:?}, degree {degree}"), &case);
    }
}

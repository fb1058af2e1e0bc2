//! Trimming through the public API, on pictures that the device drew.

#[path = "../../../tests/common/mod.rs"]
mod common;

use nvsprior::prior::{RenderOptions, Splats};
use nvsprior::render::Plan;
use nvsprior::{Camera, Picture, Pose, Prior};
use nvsprior_reference::Twin;
use nvsprior_train::PosedPicture;
use nvsprior_train::removal::removals;
use nvsprior_train::trim::{Judge, Round, TrimError, TrimOptions, TrimStep, trim};

const CAMERA: Camera = Camera { width: 48, height: 40, fx: 40.0, fy: 40.0, cx: 24.0, cy: 20.0 };
const RENDER: RenderOptions = RenderOptions::INRIA;

/// Splats about z = 3, some of them beside the picture.
fn cloud(count: usize, sh_degree: u32) -> Splats {
    let wave = |i: usize, f: f32| (i as f32 * f + 0.7).sin();
    let each = |f: &dyn Fn(usize) -> [f32; 3]| (0..count).map(f).collect::<Vec<_>>();
    let mut splats = Splats {
        origin: [0.0; 3],
        positions: each(&|i| [2.4 * wave(i, 1.7), 1.4 * wave(i, 2.9), 3.0 + wave(i, 0.3)]),
        log_scales: each(&|i| [-2.2 + 0.4 * wave(i, 0.7), -2.0, -2.6]),
        rotations: (0..count).map(|i| [1.0, wave(i, 0.2), wave(i, 0.9), 0.3]).collect(),
        opacity_logits: (0..count).map(|i| 1.0 + 2.0 * wave(i, 1.3)).collect(),
        sh: Vec::new(),
        sh_degree,
    };
    splats.sh = (0..count * splats.sh_stride()).map(|i| 0.3 * wave(i, 0.77)).collect();
    splats
}

fn poses() -> Vec<Pose> {
    let step = |t: f64| [0.1 * t, -0.05 * t, 0.0, 0.02 * t, 0.03 * t, 0.0];
    (0..3).map(|t| Pose::exp(&step(f64::from(t)))).collect()
}

fn prior(splats: &Splats, render: RenderOptions) -> Prior {
    Prior::from_splats(splats.clone(), render).unwrap()
}

fn pictures(splats: &Splats) -> Vec<Picture> {
    let scene = common::engine().upload(&prior(splats, RENDER)).unwrap();
    let mut renderer = common::engine().renderer(&scene, &CAMERA, Plan::picture()).unwrap();
    let mut picture = |pose: &Pose| {
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        renderer.picture(pose, &mut picture).unwrap();
        picture
    };
    poses().iter().map(&mut picture).collect()
}

fn views(splats: &Splats) -> Vec<PosedPicture> {
    let all = std::iter::zip(poses(), pictures(splats));
    all.map(|(pose, picture)| PosedPicture::new(CAMERA, pose, picture)).collect()
}

/// The least PSNR of the splats' pictures against others.
fn worst(splats: &Splats, whole: &[Picture]) -> f64 {
    let all = std::iter::zip(pictures(splats), whole);
    all.map(|(a, b)| a.psnr(b)).fold(f64::INFINITY, f64::min)
}

/// Finds how far pictures are below a PSNR.
struct Floor {
    whole: Vec<Picture>,
    psnr: f64,
    rounds: Vec<Round>,
}

impl Judge for Floor {
    type Error = TrimError;

    fn loss(&mut self, splats: &Splats) -> Result<f64, TrimError> {
        Ok(self.psnr - worst(splats, &self.whole))
    }

    fn told(&mut self, round: &Round, splats: &Splats) -> Result<(), TrimError> {
        assert_eq!(round.splats, splats.len());
        self.rounds.push(*round);
        Ok(())
    }

    fn fitted(&mut self, done: u32, all: u32) {
        assert!(done <= all);
    }
}

/// The splats trimmed to a PSNR in `views`.
fn trimmed_in(
    views: &[PosedPicture],
    splats: &Splats,
    psnr: f64,
    change: fn(&mut TrimOptions),
) -> (Splats, Vec<Round>) {
    let mut floor = Floor { whole: pictures(splats), psnr, rounds: Vec::new() };
    let mut options = TrimOptions { steps: 30, ..TrimOptions::new(RENDER, 0.0) };
    change(&mut options);
    let kept = trim(&common::engine(), splats, views, &options, &mut floor).unwrap();
    common::assert_silent(&common::engine());
    (kept, floor.rounds)
}

fn trimmed(splats: &Splats, psnr: f64, change: fn(&mut TrimOptions)) -> (Splats, Vec<Round>) {
    trimmed_in(&views(splats), splats, psnr, change)
}

/// Held against the f64 twin's pictures with and without each splat.
#[test]
fn removals_are_what_leaving_one_splat_out_does() {
    let splats = cloud(60, 1);
    let place = [(CAMERA, poses()[1])];
    let render = RenderOptions { background: [0.1, 0.5, 0.9], ..RENDER };
    let picture =
        |splats: &Splats| Twin::new(&prior(splats, render)).render(&CAMERA, &place[0].1).pixels;
    let whole = picture(&splats);
    let removals = removals(&common::engine(), &prior(&splats, render), &place).unwrap();
    assert_eq!(removals.len(), 60);
    for (i, removal) in removals.iter().enumerate() {
        let kept: Vec<bool> = (0..60).map(|k| k != i).collect();
        let changes = std::iter::zip(&whole, picture(&splats.filtered(&kept)));
        let square =
            |(a, b): (&[f64; 5], [f64; 5])| -> f64 { (0..3).map(|c| (a[c] - b[c]).powi(2)).sum() };
        let error: f64 = changes.map(square).sum();
        let off = (f64::from(removal.error) - error).abs();
        assert!(off <= 2e-3 * error + 1e-6, "{i}: {removal:?} {error}");
        assert_eq!(removal.pixels > 0, error > 0.0, "{i}");
    }
    assert!(removals.iter().any(|removal| removal.pixels == 0), "some are beside the picture");
}

#[test]
fn splats_go_until_the_floor_and_no_further() {
    let splats = cloud(300, 1);
    let (kept, rounds) = trimmed(&splats, 38.0, |_| ());
    assert!(kept.len() < 200, "{} splats, {rounds:?}", kept.len());
    assert!(worst(&kept, &pictures(&splats)) >= 38.0);
    assert_eq!(rounds[0].step, TrimStep::Unseen);
    assert!(rounds.iter().all(|round| round.kept == (round.loss <= 0.0)), "{rounds:?}");
    assert!(rounds.iter().any(|round| !round.kept));
}

#[test]
fn fitting_saves_what_leaving_out_costs() {
    let splats = cloud(300, 1);
    let (fitted, _) = trimmed(&splats, 38.0, |_| ());
    let (bare, _) = trimmed(&splats, 38.0, |options| options.steps = 0);
    assert!(fitted.len() < bare.len(), "{} against {}", fitted.len(), bare.len());
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let splats = cloud(120, 1);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trimmed(&splats, 36.0, |_| ()).0)
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn views_of_several_sizes_are_fitted_to() {
    let splats = cloud(300, 1);
    let mut views = views(&splats);
    let half = CAMERA.reduced(2);
    let scene = common::engine().upload(&prior(&splats, RENDER)).unwrap();
    let mut picture = Picture::new(half.width, half.height);
    let mut renderer = common::engine().renderer(&scene, &half, Plan::picture()).unwrap();
    renderer.picture(&views[1].pose, &mut picture).unwrap();
    views[1] = PosedPicture::new(half, views[1].pose, picture);
    let (fitted, rounds) = trimmed_in(&views, &splats, 38.0, |_| ());
    let (bare, _) = trimmed(&splats, 38.0, |options| options.steps = 0);
    assert!(fitted.len() < bare.len(), "{} against {}, {rounds:?}", fitted.len(), bare.len());
}

#[test]
fn a_loss_that_is_not_a_number_keeps_everything() {
    let splats = cloud(40, 2);
    assert_eq!(trimmed(&splats, f64::NAN, |_| ()).0, splats);
    let far = |options: &mut TrimOptions| options.range = Some(0.1);
    assert_eq!(trimmed(&splats, f64::INFINITY, far).0, splats);
}

#[test]
fn bands_that_say_nothing_go() {
    let mut splats = cloud(80, 3);
    for own in splats.sh.chunks_exact_mut(48) {
        own[3..12].iter_mut().for_each(|v| *v *= 4.0);
        own[12..].fill(0.0);
    }
    let (kept, rounds) = trimmed(&splats, 45.0, |options| options.share = 0.0);
    assert_eq!(kept.sh_degree, 1, "{rounds:?}");
}

#[test]
fn what_is_out_of_range_goes_where_it_is_not_needed() {
    let mut splats = cloud(60, 0);
    splats.positions[7] = [0.0, 0.0, 500.0];
    let near = |options: &mut TrimOptions| (options.range, options.share) = (Some(20.0), 0.0);
    let (kept, rounds) = trimmed(&splats, 40.0, near);
    assert_eq!(rounds[0].step, TrimStep::OutOfRange);
    assert!(rounds[0].kept && rounds[0].splats == 59, "{rounds:?}");
    assert!(kept.positions.iter().all(|p| p[2] < 20.0));
}

#[test]
fn views_that_cannot_be_fitted_to_are_refused() {
    let splats = cloud(20, 0);
    let good = views(&splats);
    let refused = |views: &[PosedPicture]| {
        let mut floor = Floor { whole: Vec::new(), psnr: 0.0, rounds: Vec::new() };
        let options = TrimOptions::new(RENDER, 0.0);
        let refused = trim(&common::engine(), &splats, views, &options, &mut floor);
        refused.unwrap_err().to_string()
    };
    assert_eq!(refused(&[]), "no views");
    let small = PosedPicture { picture: Picture::new(48, 39), ..good[0].clone() };
    assert_eq!(refused(&[small]), "view 0: a picture of 48×39 for another camera");
    let mut lost = good[0].clone();
    lost.pose.translation.x = f64::NAN;
    assert_eq!(refused(&[good[0].clone(), lost]), "view 1: its pose is not finite");
}

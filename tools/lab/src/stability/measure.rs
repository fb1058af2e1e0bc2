//! A scene on every path: two Jacobians, the coarse sort, the twin.

use std::time::Instant;

use nvsprior::image::psnr_of_mse;
use nvsprior::prior::Splats;
use nvsprior::render::{Jacobian, NormalEquations, Plan, Renderer, SortPrecision, to_byte};
use nvsprior::tracking::{GaussNewtonOptions, Objective, RefineOptions, Tracker};
use nvsprior::vulkan::Error;
use nvsprior::{Camera, Picture, Pose, Prior};
use nvsprior_kernels::search::{self, COMPACT, Placement, Program, Search};
use nvsprior_kernels::shared::SUMS;
use nvsprior_reference::{Rendered, Twin};

use super::case::{Bench, Descent, PictureError, Row};
use super::explained::{Explained, ROUNDINGS, nudged, rounded};
use super::scenes;

/// Reduction factors of the pyramid.
const FACTORS: [u32; 4] = [1, 2, 4, 8];
/// An error that nobody sees: 50 dB.
const UNSEEN: f64 = 1e-5;
/// Share of an error that the rounding of a pose in its packet may add.
const ROUNDED: f64 = 1e-3;

/// Largest change of gradient and JᵀJ by the coarse sort, which draws splats of nearly the same depth in the order of
/// the file.
const COARSE: f64 = 0.1;

/// A scene to be drawn, differentiated and searched.
pub struct Scenario {
    pub prior: Prior,
    pub camera: Camera,
    pub pose: Pose,
    /// Where the search starts, from the pose.
    pub offset: [f64; 6],
    pub limits: Limits,
    /// The frame; if `None`, the prior's own picture.
    pub frame: Option<Picture>,
}

#[derive(Clone, Copy)]
pub struct Limits {
    /// Largest error of a channel beyond what rounding and close decisions explain.
    pub picture: f64,
    /// Largest error of gradient and JᵀJ.
    pub equations: f64,
    /// Whether the twin searches too; slow for large scenes.
    pub twin_searches: bool,
    /// Whether the search must end no worse than it began.
    pub descends: bool,
    /// Whether the device may refuse the scene for too many pairs.
    pub may_refuse: bool,
}

impl Default for Limits {
    fn default() -> Limits {
        // An eighth of an 8-bit step; ten times what random scenes show on llvmpipe.
        Limits {
            picture: 5e-4,
            equations: 1e-3,
            twin_searches: true,
            descends: true,
            may_refuse: false,
        }
    }
}

impl Scenario {
    pub fn new(splats: Splats) -> anyhow::Result<Scenario> {
        Ok(Scenario {
            prior: scenes::prior(splats)?,
            camera: scenes::camera(64, 48),
            pose: scenes::pose(),
            offset: [0.01, -0.015, 0.02, 0.01, -0.008, 0.012],
            limits: Limits::default(),
            frame: None,
        })
    }

    pub fn run(&self, bench: &Bench) -> anyhow::Result<Vec<Row>> {
        let twin = Reference::new(self)?;
        let mut rows = Vec::new();
        for (path, jacobian, sort_precision) in [
            ("flow", Jacobian::Flow, SortPrecision::Exact),
            ("exact", Jacobian::Exact, SortPrecision::Exact),
            ("coarse", Jacobian::Flow, SortPrecision::Coarse),
        ] {
            let since = Instant::now();
            let row = match self.on_device(bench, &twin, path, jacobian, sort_precision) {
                Err(Error::TooManyPairs) if self.limits.may_refuse => Row {
                    note: format!("refused: {}", Error::TooManyPairs),
                    ..Row::of(path, since)
                },
                row => row?,
            };
            rows.push(row);
        }
        rows.push(twin.row);
        Ok(rows)
    }

    fn on_device(
        &self,
        bench: &Bench,
        twin: &Reference,
        path: &'static str,
        jacobian: Jacobian,
        sort_precision: SortPrecision,
    ) -> Result<Row, Error> {
        let since = Instant::now();
        let scene = bench.engine.upload(&self.prior)?;
        let plan = Plan {
            factors: FACTORS.to_vec(),
            jacobians: vec![jacobian],
            search: Some(jacobian),
            sort_precision,
            depths: false,
            profiled: false,
        };
        let mut renderer = bench.engine.renderer(&scene, &self.camera, plan)?;
        let drawn = renderer.draw(&self.pose)?.to_vec();
        renderer.set_picture(&twin.frame);
        renderer.reduce_picture()?;
        let start = self.pose.stepped(&self.offset);
        let equations = match sort_precision {
            SortPrecision::Exact => renderer.normal_equations(0, jacobian, &start)?,
            SortPrecision::Coarse => evaluated(&mut renderer, &self.prior, &start)?,
        };
        let before = renderer.normal_equations(0, jacobian, &start)?.mse();
        let seen_before = seen(&mut renderer, &start, &twin.frame)?;
        let refine = RefineOptions { jacobian, sort_precision, ..RefineOptions::default() };
        let mut tracker = Tracker::new(Objective::new(renderer), refine, 1e-3, COMPACT);
        let found = tracker.track(&twin.frame, &start.into())?;
        let mut row = Row::of(path, since);
        twin.compare_picture(self, &drawn, &mut row);
        let limit = match sort_precision {
            SortPrecision::Exact => self.limits.equations,
            SortPrecision::Coarse => self.limits.equations.max(COARSE),
        };
        twin.compare_equations(limit, jacobian, &equations, &mut row);
        if let Some(found) = found {
            let evaluations = tracker.trace().len();
            let renderer = tracker.objective().renderer();
            let end = renderer.normal_equations(0, jacobian, &found.outcome.pose)?.mse();
            let stop = found.outcome.stop;
            row.descent = Some(Descent { start: before, end, stop, evaluations });
            row.expect(found.outcome.pose.is_finite(), || "the pose found is no number".into());
            // Judged by the sums that it minimises, or by what is seen: colours beyond white look the same.
            let no_worse = end <= (1.0 + ROUNDED) * before.max(UNSEEN)
                || seen(renderer, &found.outcome.pose, &twin.frame)? <= seen_before.max(UNSEEN);
            let fine = !self.limits.descends || no_worse;
            row.expect(fine, || format!("the search went from {before:.3e} up to {end:.3e}"));
        }
        Ok(row)
    }
}

/// Mean squared error of the 8-bit picture from a pose.
fn seen(renderer: &mut Renderer, pose: &Pose, frame: &Picture) -> Result<f64, Error> {
    let mut picture = Picture::new(frame.width, frame.height);
    renderer.picture(pose, &mut picture)?;
    Ok(picture.mse(frame))
}

/// The sums of one evaluation as a search makes them.
pub fn evaluated(
    renderer: &mut Renderer,
    prior: &Prior,
    at: &Pose,
) -> Result<NormalEquations, Error> {
    let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let program = Program {
        renders: 1,
        first_level: 0,
        follow_level: 0,
        levels: 1,
        leap: 0.0,
        tolerance: 0.0,
        ..program(renderer.levels(), placement(at, centre))
    };
    let residuals = renderer.camera(0).pixels() * 3;
    let searched = renderer.search(&program)?;
    let sums = searched.search.place_sums.map(f64::from);
    Ok(NormalEquations::from_sums(&sums, residuals))
}

/// A search through the pyramid, as a cold start's.
fn program(levels: usize, start: Placement) -> Program {
    let GaussNewtonOptions { cold, damping, .. } = GaussNewtonOptions::default();
    cold.program(levels, [start], damping, COMPACT)
}

/// A pose as searches hold it.
fn placement(pose: &Pose, centre: glam::DVec3) -> Placement {
    let translation = pose.translation + pose.rotation * centre;
    Placement {
        rotation: pose.wxyz().map(|v| v as f32),
        translation: translation.to_array().map(|v| v as f32),
    }
}

fn pose_of(placement: &Placement, centre: glam::DVec3) -> Option<Pose> {
    let translation = placement.translation.map(f64::from);
    let pose = Pose::from_wxyz(placement.rotation.map(f64::from), translation)?;
    Some(Pose { translation: pose.translation - pose.rotation * centre, ..pose })
}

/// The twin's result for a scene, and how far rounding moves it.
struct Reference {
    frame: Picture,
    picture: Explained,
    equations: [Both; 2],
    row: Row,
}

/// Normal equations, and those of rounded inputs.
struct Both {
    exact: NormalEquations,
    rounded: NormalEquations,
}

impl Reference {
    fn new(scenario: &Scenario) -> anyhow::Result<Reference> {
        let Scenario { prior, camera, pose, .. } = scenario;
        let since = Instant::now();
        let picture = Explained::new(prior, camera, pose)?;
        let frame = match &scenario.frame {
            Some(frame) => frame.clone(),
            None => eight_bit(&picture.picture, camera),
        };
        let floats: Vec<f32> = frame.data.iter().map(|v| f32::from(*v) / 255.0).collect();
        let start = pose.stepped(&scenario.offset);
        let (twin, near) = (Twin::new(prior), rounded(prior)?);
        let other = Twin::new(&near);
        let both = |jacobian| Both {
            exact: twin.normal_equations(camera, &start, &floats, jacobian),
            rounded: other.normal_equations(camera, &nudged(prior, &start), &floats, jacobian),
        };
        let equations = [both(Jacobian::Flow), both(Jacobian::Exact)];
        let mut row = Row::of("twin", since);
        let numbers = picture.picture.pixels.iter().flatten().all(|v| v.is_finite());
        row.expect(numbers, || "the twin's picture is no number".into());
        if scenario.limits.twin_searches {
            row.descent = Some(descend(scenario, &frame)?);
            row.milliseconds = since.elapsed().as_secs_f64() * 1e3;
        }
        Ok(Reference { frame, picture, equations, row })
    }

    /// Notes how far a picture of the device is off.
    fn compare_picture(&self, scenario: &Scenario, drawn: &[f32], row: &mut Row) {
        let difference = self.picture.compare(drawn);
        let (max, mean, rounding) = (difference.max, difference.mean, difference.rounding);
        row.picture = Some(PictureError { max, mean, rounding });
        row.expect(difference.excess <= scenario.limits.picture, || difference.worst);
    }

    /// Notes how far normal equations of the device are off.
    fn compare_equations(
        &self,
        limit: f64,
        jacobian: Jacobian,
        got: &NormalEquations,
        row: &mut Row,
    ) {
        let Both { exact, rounded } = &self.equations[(jacobian == Jacobian::Exact) as usize];
        let (gradient, jtj) = (gradient_error(got, exact), jtj_error(got, exact));
        row.gradient = Some(gradient);
        row.jtj = Some(jtj);
        let slack = |by_rounding: f64| limit + ROUNDINGS * by_rounding;
        row.expect(gradient <= slack(gradient_error(rounded, exact)), || {
            format!("gradient off by {gradient:.1e}")
        });
        row.expect(jtj <= slack(jtj_error(rounded, exact)), || format!("JᵀJ off by {jtj:.1e}"));
    }
}

/// The search on the twin, led by the host.
fn descend(scenario: &Scenario, frame: &Picture) -> anyhow::Result<Descent> {
    let Scenario { prior, camera, .. } = scenario;
    let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let cameras: Vec<(u32, Camera)> = FACTORS
        .iter()
        .map(|factor| (*factor, camera.reduced(*factor)))
        .filter(|(_, camera)| camera.pixels() > 0)
        .collect();
    let used: Vec<u32> = cameras.iter().map(|(factor, _)| *factor).collect();
    let mut pyramid = nvsprior::tracking::Pyramid::new(camera, &used);
    pyramid.set(frame);
    let start = scenario.pose.stepped(&scenario.offset);
    let mut s: Search = bytemuck::Zeroable::zeroed();
    s.program = program(cameras.len(), placement(&start, centre));
    search::begin(&mut s);
    while s.phase == search::SEARCHING {
        let level = s.level as usize;
        let (factor, camera) = &cameras[level];
        let at = pose_of(&s.trial, centre).unwrap_or(start);
        let twin = Twin::new(prior).reduced(*factor);
        let e = twin.normal_equations(camera, &at, pyramid.level(level), Jacobian::Flow);
        s.sums = sums(&e).map(|v| v as f32);
        search::advance(&mut s);
    }
    let twin = Twin::new(prior);
    let floats = pyramid.level(0);
    let mse = |pose: &Pose| twin.normal_equations(camera, pose, floats, Jacobian::Flow).mse();
    let stop = match s.stop {
        search::STOP_PROGRESS => nvsprior::tracking::Stop::Progress,
        search::STOP_NO_DESCENT => nvsprior::tracking::Stop::NoDescent,
        _ => nvsprior::tracking::Stop::Iterations,
    };
    let end = pose_of(&s.found, centre).unwrap_or(start);
    Ok(Descent { start: mse(&start), end: mse(&end), stop, evaluations: s.evaluations as usize })
}

/// Rows and columns of the upper triangle, in order.
pub fn upper() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i..6).map(move |j| (i, j)))
}

/// The 28 sums of normal equations.
pub fn sums(e: &NormalEquations) -> [f64; SUMS as usize] {
    let upper = upper().map(|(i, j)| e.jtj[i][j]);
    let mut out = [0.0; SUMS as usize];
    let values = upper.chain(e.jtr).chain([e.square]);
    out.iter_mut().zip(values).for_each(|(to, from)| *to = from);
    out
}

/// A twin's picture as bytes.
pub fn eight_bit(rendered: &Rendered, camera: &Camera) -> Picture {
    let bytes = rendered.pixels.iter().flat_map(|p| [p[0], p[1], p[2]]);
    let data = bytes.map(|v| to_byte(v as f32)).collect();
    Picture { width: camera.width, height: camera.height, data }
}

/// PSNR of linear RGB, clamped to [0, 1], of a picture of five floats per pixel.
pub fn psnr(got: &[f32], expected: &[f32]) -> f64 {
    let rgb = |pixels: &[f32]| -> Vec<f64> {
        let colours = pixels.chunks_exact(5).flat_map(|p| [p[0], p[1], p[2]]);
        colours.map(|v| f64::from(v).clamp(0.0, 1.0)).collect()
    };
    let (a, b) = (rgb(got), rgb(expected));
    let square: f64 = std::iter::zip(&a, &b).map(|(a, b)| (a - b).powi(2)).sum();
    psnr_of_mse(square / a.len() as f64)
}

/// Lengths of the columns of J. They count as at least a ten-thousandth of the longest: some motions, such as a roll
/// about the only pixel, hardly move the picture.
fn lengths(e: &NormalEquations) -> [f64; 6] {
    let own = [0, 1, 2, 3, 4, 5].map(|k: usize| e.jtj[k][k].sqrt());
    let min = 1e-4 * own.iter().copied().fold(0.0, f64::max);
    own.map(|length| length.max(min))
}

/// Largest error of an entry of JᵀJ, by Cauchy–Schwarz.
pub fn jtj_error(got: &NormalEquations, twin: &NormalEquations) -> f64 {
    let length = lengths(twin);
    let entries = (0..6).flat_map(|row| (0..6).map(move |column| (row, column)));
    largest(entries.map(|(row, column)| {
        let off = (got.jtj[row][column] - twin.jtj[row][column]).abs();
        share(off, length[row] * length[column])
    }))
}

/// Largest error of a component of the gradient, by Cauchy–Schwarz. Residuals count as at least half an 8-bit step,
/// since a render that fits has nearly none.
pub fn gradient_error(got: &NormalEquations, twin: &NormalEquations) -> f64 {
    let min = twin.residuals as f64 * (0.5_f64 / 255.0).powi(2);
    let residual = twin.square.max(min).sqrt();
    let length = lengths(twin);
    largest((0..6).map(|k| share((got.jtr[k] - twin.jtr[k]).abs(), length[k] * residual)))
}

/// An error as a share of its bound; 0 if there is no error, whatever the bound.
fn share(off: f64, bound: f64) -> f64 {
    if off == 0.0 { 0.0 } else { off / bound }
}

/// The largest; a NaN counts as infinite.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |m, v| if v.is_nan() { f64::INFINITY } else { m.max(v) })
}

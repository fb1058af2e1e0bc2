//! The vehicle in the prior: on the plan view, in the chase view, and its path in the picture.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;
use nvsprior::render::Scene;
use nvsprior::{Engine, Picture, Pose, Prior};
use nvsprior_runs::png_of;

use super::chase_view::ChaseView;
use super::pictures::Shown;
use super::plan_view::{self, PlanView};
use super::projection::{self, Pixel};
use super::state::{ChaseState, PathState, PlanState, Sleeper};
use super::track::Track;

/// Least time between two chase views: they take the device's time from pictures.
const CHASE_EVERY: Duration = Duration::from_millis(300);
/// How far the path is told, beyond now, and in all at most; seconds.
const AHEAD: f64 = 3.0;
const FARTHEST: f64 = 12.0;
/// Seconds between points of the path.
const STEP: f64 = 0.25;
/// The rails lie so far below the camera, and so far to each side: in view units.
const BELOW: f64 = 0.16;
const ASIDE: f64 = 0.16;

pub struct SceneViews {
    plan: PlanView,
    plan_picture: Arc<[u8]>,
    chase: ChaseView,
    chase_number: u64,
    chase_drawn: Option<Instant>,
    /// The vehicle's pose in the chase view.
    chased: Option<PosedCamera>,
    up: DVec3,
    track: Track,
}

/// A camera in the scene.
#[derive(Clone, Copy)]
struct PosedCamera {
    camera: nvsprior::Camera,
    pose: Pose,
    exposed: f64,
}

pub struct ViewsState {
    pub plan: PlanState,
    pub chase: ChaseState,
    pub path: Option<PathState>,
}

impl SceneViews {
    pub fn new(engine: &Engine, prior: &Prior, scene: &Arc<Scene>) -> anyhow::Result<SceneViews> {
        let up = plan_view::up(prior);
        let plan = PlanView::draw(engine, prior, up)?;
        let spread = f64::from(prior.coordinate_frame().spread);
        Ok(SceneViews {
            plan_picture: png_of(&plan.picture)?.into(),
            plan,
            chase: ChaseView::new(engine, scene, up, spread)?,
            chase_number: 0,
            chase_drawn: None,
            chased: None,
            up,
            track: Track::default(),
        })
    }

    pub fn plan_picture(&self) -> Arc<[u8]> {
        self.plan_picture.clone()
    }

    /// Takes the pose of a picture.
    pub fn take(&mut self, shown: &Shown) {
        if !shown.decoded.uncertain {
            self.track.add(shown.exposed, shown.decoded.pose);
        }
    }

    /// Draws the chase view, unless it was drawn just before.
    pub fn draw_chase(&mut self, shown: &Shown) -> anyhow::Result<Option<&Picture>> {
        if self.chase_drawn.is_some_and(|drawn| drawn.elapsed() < CHASE_EVERY) {
            return Ok(None);
        }
        self.chase.draw(&shown.decoded.pose)?;
        let (camera, pose, exposed) = (shown.camera, shown.decoded.pose, shown.exposed);
        self.chased = Some(PosedCamera { camera, pose, exposed });
        self.chase_drawn = Some(Instant::now());
        self.chase_number += 1;
        Ok(Some(&self.chase.picture))
    }

    pub fn state(&self, now: f64, shown: Option<&Shown>) -> ViewsState {
        let age = shown.map_or(0.0, |shown| (now - shown.exposed).max(0.0));
        let last = (age + AHEAD).min(FARTHEST);
        let times = (0..=(last / STEP) as usize).map(|k| k as f64 * STEP);
        // Where an uncertain picture was taken is not known; so its path is not.
        let certain = shown.filter(|shown| !shown.decoded.uncertain);
        let predicted =
            certain.and_then(|shown| self.track.predicted(shown.exposed, times.clone()));
        let centres = || predicted.iter().flatten().map(Pose::centre);
        ViewsState {
            plan: self.plan_state(shown, centres()),
            chase: ChaseState {
                number: self.chase_number,
                age: self.chased.map(|at| (now - at.exposed).max(0.0)),
                vehicle: self
                    .chased
                    .map_or(Vec::new(), |at| self.chase.vehicle(&at.camera, &at.pose)),
                track: self.chase.lines(self.track.places()),
                predicted: self.chase.lines(centres()),
            },
            path: certain.zip(predicted.as_ref()).map(|(shown, poses)| {
                let times: Vec<f64> = times.collect();
                self.path(shown, poses, &times, age)
            }),
        }
    }

    fn plan_state(
        &self,
        shown: Option<&Shown>,
        predicted: impl Iterator<Item = DVec3>,
    ) -> PlanState {
        let place = |point| self.plan.place(point);
        let cone = |shown: &Shown| {
            let pose = &shown.decoded.pose;
            let [top_left, top_right, lower_right, lower_left] =
                projection::corners(&shown.camera, pose, 2.0 * self.chase.unit);
            // At half of the picture's height: the cone is seen from above.
            let sides = [(top_left + lower_left) / 2.0, (top_right + lower_right) / 2.0];
            sides.into_iter().filter_map(place).collect()
        };
        PlanState {
            vehicle: shown.and_then(|shown| place(shown.decoded.pose.centre())),
            known: shown
                .map_or(Vec::new(), |shown| self.outline(shown).filter_map(place).collect()),
            cone: shown.map_or(Vec::new(), cone),
            heading: shown.and_then(|shown| self.plan.heading(&shown.decoded.pose)),
            pixels_per_unit: self.plan.pixels_per_unit,
            track: self.track.places().filter_map(place).collect(),
            predicted: predicted.filter_map(place).collect(),
        }
    }

    /// A level circle around the vehicle: two of the position's stated deviations.
    fn outline(&self, shown: &Shown) -> impl Iterator<Item = DVec3> {
        const POINTS: usize = 32;
        let (centre, up) = (shown.decoded.pose.centre(), self.up);
        let (x, y) = up.any_orthonormal_pair();
        shown.decoded.known.into_iter().flat_map(move |known| {
            (0..POINTS).map(move |k| {
                let (sine, cosine) = (std::f64::consts::TAU * k as f64 / POINTS as f64).sin_cos();
                centre + (x * cosine + y * sine) * (2.0 * known.position)
            })
        })
    }

    /// The rails that the vehicle goes along, in the picture.
    fn path(&self, shown: &Shown, poses: &[Pose], times: &[f64], age: f64) -> PathState {
        let unit = self.chase.unit;
        let ends = |pose: &Pose| {
            let right = pose.rotation.inverse() * DVec3::X;
            let below = pose.centre() - self.up * (BELOW * unit);
            [below - right * (ASIDE * unit), below + right * (ASIDE * unit)]
        };
        let (camera, seen_from) = (&shown.camera, &shown.decoded.pose);
        let near = 0.02 * unit;
        let see = |point| projection::project(camera, seen_from, point, near);
        let sleeper = |pose: &Pose| -> Option<[Pixel; 2]> {
            let [left, right] = ends(pose);
            Some([see(left)?, see(right)?])
        };
        let rail = |side: usize| {
            projection::lines(camera, seen_from, poses.iter().map(|pose| ends(pose)[side]), near)
        };
        let whole = times.iter().zip(poses).filter(|(time, _)| **time > 0.0 && time.fract() == 0.0);
        let now = (age / STEP).round() as usize;
        PathState {
            rails: [rail(0), rail(1)].concat(),
            sleepers: whole
                .filter_map(|(time, pose)| Some(Sleeper { seconds: *time, line: sleeper(pose)? }))
                .collect(),
            now: poses.get(now).and_then(sleeper),
        }
    }
}

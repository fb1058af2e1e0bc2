//! The learner: a slice of work per frame.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::DVec3;

use crate::image::Mask;
use crate::prior::update::{LearntSplat, MAX_LEARNT};
use crate::prior::{Learnt, NewSplat, UpdateGrid};
use crate::random::Random;
use crate::render::training::{Trainer, TrainingFrame, TrainingPlan, TrainingView};
use crate::render::{Plan, Renderer, Scene, TRIED};
use crate::residual::ResidualSetup;
use crate::{Camera, Engine, Error, Picture, Pose, Rate};

use super::LearnOptions;
use super::cells::{Shown, Start, add_starts};
use super::crop::{camera_of, corner_around, part_size};
use super::draft::Draft;
use super::harm::Harms;
use super::held_out::{HeldOut, HeldOuts};
use super::judge::{Judge, pays};
use super::key_frame::KeyFrame;
use super::refine::Course;
use super::trial::{FEWEST, Proven, Trial};
use super::worth::{Part, worths};

/// New key frames between two episodes.
const FRESH: usize = 4;
/// Newest key frames by which learnt splats are taken back.
const COMPARED: usize = 3;
/// Key frames that are kept beside the newest ones.
const OLDER: usize = 8;
/// Key frames redrawn per frame after an update.
const REDRAWN: usize = 2;
/// Most frames that count as a key frame and those before the next: a camera that hovers moves on some day.
const MOST_BETWEEN: f64 = 30.0;

/// What a learner did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LearnerStats {
    /// Updates given out.
    pub updates: u32,
    /// Updates that did not pay, and were dropped.
    pub refused: u32,
    /// Splats that were learnt and are still there.
    pub splats: usize,
    /// Bytes of all updates.
    pub update_bytes: usize,
}

/// A frame as its encoder has found it.
#[derive(Default)]
pub struct Found {
    pub number: u32,
    /// As it was treated. Masked pixels show the render.
    pub frame: Picture,
    /// The scene's render at the pose.
    pub render: Picture,
    pub pose: Pose,
    /// The picture confirms the pose.
    pub certain: bool,
    pub mask: Option<Arc<Mask>>,
    pub rate: Option<Rate>,
}

/// A key frame with what the scene shows there; `None` if an update came since.
struct Kept {
    frame: Arc<KeyFrame>,
    shown: Option<Shown>,
}

/// What an episode is at.
enum Work {
    Training(Draft),
    Judging(Trial),
}

/// Learns beside an encoder, on the encoder's scene, which must have been uploaded for updates.
pub struct Learner {
    scene: Arc<Scene>,
    options: LearnOptions,
    camera: Camera,
    renderer: Renderer,
    trainer: Trainer,
    judge: Judge,
    learnt: Learnt,
    kept: VecDeque<Kept>,
    /// Key frames before those.
    older: Vec<Arc<KeyFrame>>,
    /// Key frames since the last episode began.
    fresh: usize,
    held_out: HeldOuts,
    work: Option<Work>,
    random: Random,
    stats: LearnerStats,
    /// Bytes of pictures that a byte of an update costs.
    price: f64,
}

impl Learner {
    /// Makes a learner for frames of a camera. `learnt`: what the scene shows already.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        setup: &ResidualSetup,
        learnt: Learnt,
        options: &LearnOptions,
    ) -> Result<Learner, Error> {
        let plan = TrainingPlan {
            size: part_size([camera.width, camera.height]),
            options: scene.splats.options,
            sh_degree: scene.analysis().sh_degree,
            splats: TRIED as u32,
            centre: scene.centre(),
            ssim: false,
            profiled: false,
        };
        Ok(Learner {
            scene: scene.clone(),
            options: options.in_range(),
            camera: *camera,
            renderer: engine.renderer(scene, camera, Plan::picture())?,
            trainer: engine.trainer_behind(scene, &plan)?,
            judge: Judge::new(setup),
            learnt,
            kept: VecDeque::new(),
            older: Vec::new(),
            fresh: 0,
            held_out: HeldOuts::default(),
            work: None,
            random: Random::new(1),
            stats: LearnerStats::default(),
            price: 1.0,
        })
    }

    /// What is learnt so far.
    pub fn learnt(&self) -> &Learnt {
        &self.learnt
    }

    /// What it did.
    pub fn stats(&self) -> LearnerStats {
        LearnerStats { splats: self.learnt.splats().len(), ..self.stats }
    }

    /// Takes a frame and does a slice of work. Returns an update, if one is proven. The scene stays as it is until the
    /// update is [adopted](Learner::adopt). `price`: see [`Encoder::learn_more`](crate::Encoder::learn_more).
    ///
    /// # Errors
    /// If the device fails. What was learnt before stays.
    pub fn frame(&mut self, found: &Found, price: f64) -> Result<Option<Proven>, Error> {
        self.price = if price.is_finite() { price.max(1.0) } else { 1.0 };
        self.collect(found)?;
        let work = match self.work.take() {
            Some(Work::Training(draft)) => self.refine(draft)?,
            Some(judging) => Some(judging),
            None => {
                self.redraw()?;
                if self.fresh >= FRESH && self.kept.len() >= self.options.fewest_frames {
                    self.work = self.begin()?.map(Work::Training);
                }
                return Ok(None);
            }
        };
        match work {
            Some(Work::Judging(trial)) => self.judge(trial, found.rate),
            training => {
                self.work = training;
                Ok(None)
            }
        }
    }

    /// Takes a frame to learn from later, and does nothing else.
    ///
    /// # Errors
    /// As [`Learner::frame`].
    pub fn collect(&mut self, found: &Found) -> Result<(), Error> {
        if found.certain { self.keep(found) } else { Ok(()) }
    }

    /// Stands on an update that it has proven, from the next frame on.
    pub fn adopt(&mut self, after: &Learnt) {
        self.learnt.clone_from(after);
        self.kept.iter_mut().for_each(|kept| kept.shown = None);
    }

    /// Keeps a frame if the camera has moved enough, and in any case to judge by.
    fn keep(&mut self, found: &Found) -> Result<(), Error> {
        let Found { number, frame, render, pose, mask, .. } = found;
        let frame = Arc::new(KeyFrame::new(*number, &self.camera, pose, frame, mask.as_deref()));
        if self.work.is_some() {
            let held = HeldOut { frame: frame.clone(), render: render.clone() };
            // One more: what is worth its bytes is chosen by the first of them.
            self.held_out.push(held, self.options.judged + 1);
        }
        let shown = self.shown(pose)?;
        let moved = self
            .kept
            .back()
            .is_none_or(|last| parallax(&last.frame, &frame, &shown) >= self.options.parallax);
        if moved {
            while self.kept.len() >= self.options.frames {
                if let Some(kept) = self.kept.pop_front() {
                    self.age(kept.frame);
                }
            }
            self.kept.push_back(Kept { frame, shown: Some(shown) });
            self.fresh += 1;
        }
        Ok(())
    }

    /// Keeps some of the older key frames, so that what they show is not forgotten.
    fn age(&mut self, frame: Arc<KeyFrame>) {
        self.older.push(frame);
        if self.older.len() > OLDER {
            // Leave out the one whose next follows soonest. So the others spread over the dive.
            let gap = |i: &usize| self.older[i + 1].number.wrapping_sub(self.older[*i].number);
            let closest = (1..self.older.len() - 1).min_by_key(|i| gap(i)).unwrap_or(0);
            self.older.remove(closest);
        }
    }

    fn shown(&mut self, pose: &Pose) -> Result<Shown, Error> {
        let mut render = Picture::new(self.camera.width, self.camera.height);
        let pixels = self.renderer.draw(pose)?.as_chunks::<5>().0;
        let bytes = pixels.iter().flat_map(|[r, g, b, ..]| [*r, *g, *b]);
        render.data.iter_mut().zip(bytes).for_each(|(to, v)| *to = crate::render::to_byte(v));
        Ok(Shown { render, depths: self.renderer.depths().collect() })
    }

    /// Draws some key frames anew, after an update.
    fn redraw(&mut self) -> Result<(), Error> {
        for _ in 0..REDRAWN {
            let Some(index) = self.kept.iter().position(|kept| kept.shown.is_none()) else {
                return Ok(());
            };
            let pose = self.kept[index].frame.pose;
            self.kept[index].shown = Some(self.shown(&pose)?);
        }
        Ok(())
    }

    /// Begins an episode; `None`: the frames show nothing new.
    fn begin(&mut self) -> Result<Option<Draft>, Error> {
        let full = self.learnt.number() == u16::MAX;
        if full || self.kept.iter().any(|kept| kept.shown.is_none()) {
            return Ok(None);
        }
        self.fresh = 0;
        let removed = self.harmful()?;
        let base = self.learnt.without(&removed);
        let most = self.options.splats.min(TRIED).min(MAX_LEARNT - base.splats().len());
        if !removed.is_empty() {
            self.show_all(&base)?;
        }
        let starts = self.starts(most);
        if starts.len() < FEWEST {
            return Ok(None);
        }
        let course = self.course(&starts);
        let again = self.again(&removed, TRIED - starts.len());
        let splats: Vec<LearntSplat> =
            again.iter().map(|place| self.learnt.splats()[usize::from(*place)]).collect();
        let mut gone = [&removed[..], &again].concat();
        gone.sort_unstable();
        let base = self.learnt.without(&gone);
        self.trainer.set_first(self.scene.first_tried(base.splats().len()).unwrap_or(0));
        self.trainer.set(&course.state(&starts, &splats, &mut self.random))?;
        let training = |frame: &Arc<KeyFrame>| (frame.clone(), training_frame(frame));
        let all = self.older.iter().chain(self.kept.iter().map(|kept| &kept.frame));
        let frames = all.map(training).collect();
        self.held_out.clear();
        let count = starts.len();
        let places = starts
            .iter()
            .map(|start| start.position)
            .chain(splats.iter().map(LearntSplat::centre))
            .collect();
        Ok(Some(Draft { base, removed, again, course, frames, places, count, step: 0 }))
    }

    /// The learnt splats that the key frames show, without those that go; `most` of them.
    fn again(&self, removed: &[u16], most: usize) -> Vec<u16> {
        let seen = |splat: &LearntSplat| {
            self.kept.iter().any(|kept| kept.frame.pixel_of(splat.centre()).is_some())
        };
        let all = (0..).zip(self.learnt.splats());
        let shown =
            all.filter(|(place, splat)| removed.binary_search(place).is_err() && seen(splat));
        shown.map(|(place, _)| place).take(most).collect()
    }

    /// Draws all key frames with another state than the scene's.
    fn show_all(&mut self, learnt: &Learnt) -> Result<(), Error> {
        self.scene.show_part(learnt)?;
        for index in 0..self.kept.len() {
            let pose = self.kept[index].frame.pose;
            self.kept[index].shown = Some(self.shown(&pose)?);
        }
        self.scene.show(&self.learnt).map_err(Error::from)
    }

    /// The learnt splats beside which the newest key frames look more like the prior alone.
    fn harmful(&mut self) -> Result<Vec<u16>, Error> {
        if self.learnt.splats().is_empty() {
            return Ok(Vec::new());
        }
        let splats = self.learnt.splats().to_vec();
        let mut harms = Harms::new(&splats);
        let none = Learnt::none(self.scene.id());
        let newest: Vec<usize> = (0..self.kept.len()).rev().take(COMPARED).collect();
        self.scene.show_part(&none)?;
        for index in newest {
            let pose = self.kept[index].frame.pose;
            let without = self.shown(&pose)?.render;
            let kept = &self.kept[index];
            if let Some(shown) = &kept.shown {
                harms.add(&kept.frame, &shown.render, &without);
            }
        }
        self.scene.show(&self.learnt)?;
        Ok(harms.harmful())
    }

    /// The splats that an episode starts from: the middle frame's first, then what others show beside.
    fn starts(&self, most: usize) -> Vec<Start> {
        let mut order: Vec<usize> = (0..self.kept.len()).collect();
        let middle = self.kept.len() / 2;
        order.sort_by_key(|index| index.abs_diff(middle));
        let mut starts = Vec::new();
        for index in order {
            let kept = &self.kept[index];
            let mut others: Vec<usize> = (0..self.kept.len()).filter(|i| *i != index).collect();
            others.sort_by_key(|other| other.abs_diff(index));
            let others: Vec<&KeyFrame> = others.iter().map(|i| &*self.kept[*i].frame).collect();
            if let Some(shown) = &kept.shown {
                add_starts(&kept.frame, shown, &others, most, &mut starts);
            }
        }
        starts
    }

    fn course(&self, starts: &[Start]) -> Course {
        let eye = self.kept[self.kept.len() / 2].frame.pose.centre();
        let mut distances: Vec<f64> = starts.iter().map(|s| s.position.distance(eye)).collect();
        distances.sort_by(f64::total_cmp);
        let distance = distances[distances.len() / 2];
        let half_pixel = 0.5 * distance / f64::from(self.camera.fx);
        let sum: DVec3 = starts.iter().map(|start| start.position).sum();
        let origin = (sum / starts.len() as f64).as_vec3().to_array();
        let exponent = half_pixel.log2().floor().clamp(-40.0, 40.0) as i8;
        Course {
            steps: self.options.steps,
            distance,
            grid: UpdateGrid { origin, exponent },
            sh_degree: self.scene.analysis().sh_degree,
            pixels: self.camera.pixels(),
            room: TRIED,
            centre: self.scene.centre(),
        }
    }

    /// Takes some steps; `None`: nothing is left of the draft.
    fn refine(&mut self, mut draft: Draft) -> Result<Option<Work>, Error> {
        self.scene.show_part(&draft.base)?;
        for _ in 0..self.options.steps_per_frame {
            if draft.step >= draft.course.steps {
                break;
            }
            self.step(&draft)?;
            draft.step += 1;
        }
        self.scene.show(&self.learnt)?;
        if draft.step < draft.course.steps {
            return Ok(Some(Work::Training(draft)));
        }
        let (update, changes) = draft.update(self.scene.id(), &self.learnt, &self.trainer.state()?);
        let new = |splat: &NewSplat| Part { splat: splat.learnt(&update.grid), new: 1.0 };
        let parts = update.splats.iter().map(new).chain(changes).collect();
        let horizon = self.horizon() / self.price;
        let trial = Trial::new(&self.learnt, update, parts, horizon)?;
        Ok(trial.map(Work::Judging))
    }

    /// Trains the splats by a part of a frame.
    fn step(&mut self, draft: &Draft) -> Result<(), Error> {
        let turn = self.turn(draft);
        let (key, frame) = &draft.frames[turn];
        let size = [self.camera.width, self.camera.height];
        let part = part_size(size);
        let at: Vec<[usize; 2]> =
            draft.places.iter().filter_map(|place| key.pixel_of(*place)).collect();
        let Some(around) = at.get(self.random.bits() as usize % at.len().max(1)) else {
            return Ok(());
        };
        let corner = corner_around(*around, size, part);
        let inside = |[x, y]: &&[usize; 2]| {
            let within =
                |k: usize, at: usize| (corner[k]..corner[k] + part[k]).contains(&(at as u32));
            within(0, *x) && within(1, *y)
        };
        let shown = at.iter().filter(inside).count() as f64 / draft.places.len() as f64;
        let [first, part_of] = [corner, part].map(|pair| pair.map(|v| v as usize));
        let frame = frame.part(size[0] as usize, first, part_of);
        let camera = camera_of(&key.camera, corner, part);
        let view = TrainingView { camera: &camera, pose: &key.pose, frame: &frame, factor: 1 };
        Ok(self.trainer.step(&view, &draft.course.at(draft.step, shown))?)
    }

    /// Frames in which the camera comes as far as it must for an update to pay, as it moves now.
    fn horizon(&self) -> f64 {
        let numbers = self.kept.front().zip(self.kept.back());
        let frames =
            numbers.map_or(0, |(first, last)| last.frame.number.wrapping_sub(first.frame.number));
        let between = f64::from(frames) / self.kept.len().saturating_sub(1).max(1) as f64;
        f64::from(self.options.horizon) * between.clamp(1.0, MOST_BETWEEN)
    }

    /// Which frame's turn it is: two of three times one of the newest.
    fn turn(&mut self, draft: &Draft) -> usize {
        let (all, newest) = (draft.frames.len(), self.options.frames.min(draft.frames.len()));
        let bits = self.random.bits();
        let among = if bits.is_multiple_of(3) { all } else { newest };
        all - 1 - ((bits >> 8) % among as u64) as usize
    }

    /// Chooses what of an update is worth its bytes by a frame that it was not learnt from, and judges it by others.
    /// Returns the update if it pays.
    fn judge(&mut self, mut trial: Trial, rate: Option<Rate>) -> Result<Option<Proven>, Error> {
        while let Some(held) = self.held_out.pop() {
            let with = self.drawn(trial.after(), &held)?;
            let HeldOut { frame, render } = &held;
            if trial.parts.is_empty() {
                trial.saved.push(self.judge.saved(&frame.picture, render, &with, rate)?);
                continue;
            }
            let price = self.judge.bytes_per_error(&frame.picture, render, rate)?;
            let worths = worths(frame, &trial.parts, [render, &with], price);
            match trial.chosen(&self.learnt, &worths)? {
                Some(chosen) => trial = chosen,
                None => return Ok(self.refuse()),
            }
        }
        if trial.saved.len() < self.options.judged {
            self.work = Some(Work::Judging(trial));
            return Ok(None);
        }
        if !pays(&trial.saved, trial.len(), trial.horizon) {
            return Ok(self.refuse());
        }
        self.stats.updates += 1;
        self.stats.update_bytes += trial.len();
        Ok(Some(trial.proven()))
    }

    fn refuse(&mut self) -> Option<Proven> {
        self.stats.refused += 1;
        None
    }

    /// What another state than the scene's shows in a frame.
    fn drawn(&mut self, after: &Learnt, held: &HeldOut) -> Result<Picture, Error> {
        let mut with = Picture::new(self.camera.width, self.camera.height);
        self.scene.show(after)?;
        let drawn = self.renderer.picture(&held.frame.pose, &mut with);
        self.scene.show(&self.learnt)?;
        drawn?;
        if let Some(mask) = &held.frame.mask {
            // What does not count shows the same in both, and costs nothing.
            mask.each_masked(&mut with.data, |at, rgb| {
                rgb.copy_from_slice(&held.render.data[at..at + 3]);
            });
        }
        Ok(with)
    }
}

fn training_frame(key: &KeyFrame) -> TrainingFrame {
    let (pixels, _) = key.picture.data.as_chunks::<3>();
    let rgb = |pixel: usize| pixels[pixel].map(|byte| f32::from(byte) / 255.0);
    TrainingFrame::from_fn(pixels.len(), |pixel| key.counts(pixel).then(|| rgb(pixel)))
}

/// How far points at the picture's median depth have moved between two frames because the camera did, pixels.
fn parallax(last: &KeyFrame, frame: &KeyFrame, shown: &Shown) -> f64 {
    let mut depths: Vec<f32> = shown.depths.iter().copied().filter(|z| *z > 0.0).collect();
    if depths.is_empty() {
        return 0.0;
    }
    let middle = depths.len() / 2;
    let (_, median, _) = depths.select_nth_unstable_by(middle, f32::total_cmp);
    let moved = last.pose.centre().distance(frame.pose.centre());
    moved * f64::from(frame.camera.fx) / f64::from(*median)
}

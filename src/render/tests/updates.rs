//! A scene that takes updates draws what the merged prior draws.

use std::sync::Arc;

use super::{CAMERA, assert_silent, engine, pose, splats};
use crate::prior::{Fade, Learnt, NewSplat, Update, UpdateGrid};
use crate::random::Random;
use crate::render::levels::anchor;
use crate::render::{Plan, Renderer, Scene};
use crate::search::{COMPACT, Placement, PoseCode, quantised};
use crate::{Encoder, EncoderOptions, Engine, Picture, Pose, Prior, RenderOptions};

const GRID: UpdateGrid = UpdateGrid { origin: [0.0, 0.0, 4.0], exponent: -5 };
/// Cells of the fades: on the left, and above.
const LEFT: ([i32; 3], [i32; 3]) = ([-9, -9, -9], [-2, 9, 9]);
const ABOVE: ([i32; 3], [i32; 3]) = ([-9, -9, -9], [9, -2, 9]);

fn prior(seed: u64) -> Prior {
    Prior::from_splats(splats(seed, 700, 1), RenderOptions::GSPLAT).unwrap()
}

fn new_splats(seed: u64, count: usize) -> Vec<NewSplat> {
    let mut random = Random::new(seed);
    let mut steps = |reach: f32| random.within(-reach, reach) as i32;
    let mut splat = |_| NewSplat {
        // More than half of each coordinate is the prior's median.
        position: [40.0, 30.0, 40.0].map(|reach| steps(2.6) / 2 * steps(reach)),
        log_scale: [0, 1, 2].map(|_| (steps(4.0) - 8) as i8),
        rotation: [0, 1, 2].map(|_| steps(6.0) as i8),
        opacity: (steps(6.0) + 2) as i8,
        colour: [0, 1, 2].map(|_| steps(12.0) as i8),
    };
    (0..count).map(&mut splat).collect()
}

fn fade((min, max): ([i32; 3], [i32; 3]), factor: u8) -> Fade {
    Fade { min, max, factor }
}

/// What is learnt after an update more.
fn then(learnt: &Learnt, splats: Vec<NewSplat>, removed: &[u16], fades: &[Fade]) -> Learnt {
    let mut learnt = learnt.clone();
    let update = Update {
        prior: learnt.prior(),
        number: learnt.number() + 1,
        before: learnt.state(),
        grid: GRID,
        splats,
        removed: removed.to_vec(),
        changed: Vec::new(),
        fades: fades.to_vec(),
        frames: [0, 0],
    };
    learnt.add(&update).unwrap();
    learnt
}

fn plan() -> Plan {
    Plan { depths: true, ..Plan::picture() }
}

fn code(scene: &Scene, pose: &Pose) -> PoseCode {
    let translation = pose.translation + pose.rotation * scene.centre();
    let at = Placement {
        rotation: pose.wxyz().map(|v| v as f32),
        translation: translation.as_vec3().to_array(),
    };
    quantised(&at, &anchor(scene), COMPACT)
}

/// A picture as floats, in 8 bits, at a coded pose in 8 bits, and the depths there.
#[derive(Debug, PartialEq)]
struct Drawn {
    floats: Vec<u32>,
    bytes: Vec<u8>,
    coded: Vec<u8>,
    depths: Vec<u32>,
}

impl Drawn {
    fn by(renderer: &mut Renderer, seed: u64) -> Drawn {
        let bits = |floats: &[f32]| floats.iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
        let floats = bits(renderer.draw(&pose(seed)).unwrap());
        let mut picture = Picture::new(CAMERA.width, CAMERA.height);
        renderer.picture(&pose(seed), &mut picture).unwrap();
        renderer.draw_coded_deep(&code(renderer.scene(), &pose(seed + 100))).unwrap();
        let depths: Vec<f32> = renderer.depths().collect();
        let coded = renderer.rendered().to_vec();
        Drawn { floats, bytes: picture.data, coded, depths: bits(&depths) }
    }

    fn of(engine: &Engine, scene: &Arc<Scene>, seed: u64) -> Drawn {
        Drawn::by(&mut engine.renderer(scene, &CAMERA, plan()).unwrap(), seed)
    }
}

/// A scene with room for updates, and renderers of it that were made before any.
struct Updated {
    engine: Engine,
    prior: Prior,
    scene: Arc<Scene>,
    renderer: Renderer,
}

impl Updated {
    fn new(seed: u64) -> Updated {
        let (engine, prior) = (engine(), prior(seed));
        let scene = engine.upload_for_updates(&prior).unwrap();
        let renderer = engine.renderer(&scene, &CAMERA, plan()).unwrap();
        Updated { engine, prior, scene, renderer }
    }

    fn none(&self) -> Learnt {
        Learnt::none(self.prior.id())
    }

    /// The prior with what is learnt, on the device. It has the same coordinate frame.
    fn merged(&self, learnt: &Learnt) -> Arc<Scene> {
        let merged = self.prior.with_learnt(learnt).unwrap();
        assert_eq!(merged.coordinate_frame(), self.prior.coordinate_frame());
        self.engine.upload(&merged).unwrap()
    }

    /// What the merged prior draws, and what the scene draws by the old renderer. A new one draws the same.
    fn drawn(&mut self, learnt: &Learnt, seed: u64) -> [Drawn; 2] {
        self.scene.show(learnt).unwrap();
        let own = Drawn::by(&mut self.renderer, seed);
        assert!(Drawn::of(&self.engine, &self.scene, seed) == own, "by a new renderer");
        [Drawn::of(&self.engine, &self.merged(learnt), seed), own]
    }

    fn assert_same(&mut self, what: &str, learnt: &Learnt, seed: u64) -> Drawn {
        let [merged, own] = self.drawn(learnt, seed);
        assert!(own == merged, "{what}");
        own
    }
}

#[test]
fn a_scene_with_updates_draws_what_the_merged_prior_draws() {
    for seed in 0..3 {
        let mut updated = Updated::new(seed);
        let none = updated.none();
        let bare = updated.assert_same("nothing is learnt", &none, seed);
        let first = then(&none, new_splats(seed, 90), &[], &[]);
        let with_new = updated.assert_same("new splats", &first, seed);
        let second = then(&first, new_splats(seed + 10, 60), &[0, 3, 4, 50, 89], &[]);
        let with_more = updated.assert_same("more of them, some taken back", &second, seed);
        let third = then(&second, vec![], &[1, 2], &[fade(LEFT, 0)]);
        let faded = updated.assert_same("own splats gone", &third, seed);
        let all = [&bare, &with_new, &with_more, &faded];
        for (i, drawn) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|before| before.bytes != drawn.bytes), "update {i} shows");
        }
        // Back again, which no chain does, but an encoder that learns anew.
        assert!(updated.assert_same("without fades", &second, seed) == with_more);
        assert!(updated.assert_same("nothing again", &none, seed) == bare);
        assert_silent(&updated.engine);
    }
}

/// The merged prior holds a logit, the scene a product: they differ in the last bits.
#[test]
fn splats_that_fade_in_part_look_alike() {
    let mut updated = Updated::new(5);
    let none = updated.none();
    let bare = updated.assert_same("nothing is learnt", &none, 5);
    let fades = [fade(LEFT, 102), fade(ABOVE, 128)];
    let learnt = then(&none, new_splats(5, 40), &[], &fades);
    let [merged, own] = updated.drawn(&learnt, 5);
    for (merged, own) in [(&merged.bytes, &own.bytes), (&merged.coded, &own.coded)] {
        let others = merged.iter().zip(own).filter(|(a, b)| a != b).count();
        assert!(merged.iter().zip(own).all(|(a, b)| a.abs_diff(*b) <= 1));
        assert!(others * 200 < own.len(), "{others} of {} bytes", own.len());
    }
    let less = |i: &usize| own.bytes[*i].abs_diff(bare.bytes[*i]) > 8;
    assert!((0..own.bytes.len()).filter(less).count() > own.bytes.len() / 10, "the fades show");
    assert!(updated.assert_same("nothing again", &none, 5) == bare);
    assert_silent(&updated.engine);
}

/// A learner draws a part of what is learnt; afterwards all of it is drawn as before.
#[cfg(feature = "training")]
#[test]
fn a_part_of_what_is_learnt_goes_without_a_trace() {
    let mut updated = Updated::new(6);
    let first = then(&updated.none(), new_splats(6, 30), &[], &[]);
    let both = then(&first, new_splats(7, 25), &[], &[]);
    let before = updated.assert_same("what is learnt", &both, 6);
    let second: Vec<u16> = (30..55).collect();
    updated.scene.show_part(&both.without(&second)).unwrap();
    let part = Drawn::by(&mut updated.renderer, 6);
    assert!(updated.assert_same("what is learnt again", &both, 6) == before);
    assert!(part == updated.assert_same("the first update alone", &first, 6));
    assert_silent(&updated.engine);
}

#[test]
fn there_is_room_for_a_full_chain() {
    let mut updated = Updated::new(8);
    let full = then(&updated.none(), new_splats(8, 4096), &[], &[]);
    updated.assert_same("a full chain", &full, 8);
    assert_silent(&updated.engine);
}

/// An encoder that was made before the update finds the same pose by the scene as by the merged prior, and draws the
/// same picture there.
#[test]
fn a_search_goes_by_what_is_learnt() {
    let updated = Updated::new(4);
    let first = then(&updated.none(), new_splats(4, 80), &[], &[]);
    let second = then(&first, new_splats(14, 40), &[2, 7], &[fade(LEFT, 0)]);
    let options = EncoderOptions { rate: None, ..EncoderOptions::default() };
    let of = |scene: &Arc<Scene>| {
        Encoder::new(&updated.engine, scene, &CAMERA, options.clone()).unwrap()
    };
    let mut own = of(&updated.scene);
    for (seed, learnt) in [(4, updated.none()), (5, first), (6, second.clone())] {
        let merged = updated.merged(&learnt);
        let mut frame = Picture::new(CAMERA.width, CAMERA.height);
        let mut renderer = updated.engine.renderer(&merged, &CAMERA, Plan::picture()).unwrap();
        renderer.picture(&pose(seed), &mut frame).unwrap();
        own.set_learnt(&learnt).unwrap();
        own.reset();
        let start = pose(seed).stepped(&[0.02, -0.02, 0.03, 0.005, -0.006, 0.004]);
        let by_own = own.encode(&frame, Some(start)).unwrap();
        let by_merged = of(&merged).encode(&frame, Some(start)).unwrap();
        assert_eq!(by_own.pose, by_merged.pose, "{} learnt", learnt.splats().len());
        assert!(by_own.render == by_merged.render, "{} learnt", learnt.splats().len());
        let psnr = by_own.stats.render_psnr;
        assert!(psnr > 40.0, "{} learnt: {psnr} dB", learnt.splats().len());
    }
    assert_silent(&updated.engine);
}

/// The scene of an encoder that is to learn must have been uploaded for updates.
#[cfg(feature = "training")]
#[test]
fn a_scene_without_room_refuses_to_learn() {
    let (engine, prior) = (engine(), prior(1));
    let options = EncoderOptions::default();
    let scene = engine.upload(&prior).unwrap();
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options.clone()).unwrap();
    let error = encoder.learn(&crate::learning::LearnOptions::default()).unwrap_err();
    assert!(matches!(error, crate::Error::Update(crate::prior::UpdateError::NoRoom)), "{error}");
    assert!(encoder.learner_stats().is_none());
    let scene = engine.upload_for_updates(&prior).unwrap();
    let mut encoder = Encoder::new(&engine, &scene, &CAMERA, options).unwrap();
    encoder.learn(&crate::learning::LearnOptions::default()).unwrap();
    assert!(encoder.learner_stats().is_some());
}

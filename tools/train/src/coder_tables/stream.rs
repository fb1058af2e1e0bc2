//! Training the tables of inter frames.

use nvsprior::Picture;
use nvsprior::coder_tables::Tables;
use nvsprior::random::Random;
use nvsprior::residual::wavelet::training::{Pays, Sampler};
use nvsprior::residual::wavelet::{Earlier, Planes, Step, WaveletEncoder};
use nvsprior::residual::{Viewpoint, difference, warp};
use rayon::prelude::*;

use super::examples::{Collector, Example};
use super::float_networks::{self, quantise};
use super::{STEPS, TableOptions, TableProgress, offsets, optimiser, vary};

/// A frame of a run, with all that a later one needs to be predicted from it.
#[derive(Clone)]
pub struct RunFrame {
    /// What the camera saw.
    pub picture: Picture,
    /// What the prior shows at the pose found.
    pub render: Picture,
    pub viewpoint: Viewpoint,
    pub depths: Vec<f32>,
}

/// How many frames after its reference a frame comes.
const DISTANCES: [usize; 6] = [1, 1, 1, 2, 3, 5];
/// Frames in a row that are coded at once.
const LENGTH: usize = 12;

/// Trains tables of inter frames, from those of intra frames. `runs`: frames in order, at some 15 a second.
pub fn train_stream_tables(
    runs: &[Vec<RunFrame>],
    options: &TableOptions,
    mut progress: impl FnMut(TableProgress),
) -> Tables {
    let mut random = Random::new(options.seed);
    let alone = Tables::generic();
    let mut tables = alone.for_stream();
    let mut weights = float_networks::weights_of(&tables);
    let chains = chains(runs);
    for round in 0..options.rounds {
        let seeds: Vec<_> = chains.iter().map(|_| random.bits()).collect();
        let of_chain = |(chain, seed): (&&[RunFrame], &u64)| {
            (0..options.steps_per_frame as u64)
                .flat_map(|again| collect(chain, &alone, &tables, &mut Random::new(seed ^ again)))
                .collect::<Vec<_>>()
        };
        let examples: Vec<Vec<_>> = chains.par_iter().zip(&seeds).map(of_chain).collect();
        let examples: Vec<_> = examples.into_iter().flatten().collect();
        offsets(&examples, &mut tables);
        let bits = optimiser::fit(&mut weights, &examples, options.epochs, &mut random);
        quantise(&weights, &mut tables);
        let frames = chains.iter().map(|chain| chain.len()).sum::<usize>();
        let coded = (frames * options.steps_per_frame).max(1);
        progress(TableProgress { round, examples: examples.len(), bits: bits / coded as f64 });
    }
    tables
}

/// Parts of the runs, overlapping by half.
fn chains(runs: &[Vec<RunFrame>]) -> Vec<&[RunFrame]> {
    let starts = |run: &[RunFrame]| (0..run.len().saturating_sub(LENGTH / 2)).step_by(LENGTH / 2);
    let chain = |run: &'_ Vec<RunFrame>, start: usize| start..run.len().min(start + LENGTH);
    runs.iter().flat_map(|run| starts(run).map(move |at| &run[chain(run, at)])).collect()
}

/// Codes a chain of frames in a closed loop, and yields the coefficients of the inter frames.
fn collect(
    chain: &[RunFrame],
    alone: &Tables,
    tables: &Tables,
    random: &mut Random,
) -> Vec<Example> {
    let Picture { width, height, .. } = chain[0].picture;
    let mut collector = Collector::new(random.bits());
    let mut sampler = Sampler::new(width, height, alone).with_stream(tables);
    let distance = DISTANCES[(random.bits() % DISTANCES.len() as u64) as usize];
    let span = u64::from(STEPS.end - STEPS.start);
    let step = Step::new(STEPS.start + (random.bits() % span) as u8);
    let mirrored = random.bits().is_multiple_of(2);
    let light = vary::Light::some(random);
    let mut warped: Planes = std::array::from_fn(|_| vec![0; (width * height) as usize]);
    let mut before: Option<Shown> = None;
    for frame in chain.iter().step_by(distance) {
        let mut frame = if mirrored { frame.mirrored() } else { frame.clone() };
        light.apply(&mut frame.picture);
        let encoder = sampler.encoder();
        let is_inter = set_earlier(encoder, &frame, before.as_ref(), &mut warped);
        let pays = encoder.set_inter(&frame.picture, &frame.render, true, is_inter);
        let first = collector.examples.len();
        sampler.visit(step, |sample| {
            if pays != Pays::No {
                collector.take(sample);
            }
        });
        collector.even_out(first);
        let mut shown = frame.render.clone();
        sampler.encoder().add_to(&mut shown);
        before = Some(Shown::new(shown, &frame));
    }
    collector.examples
}

/// A frame as it was shown, for later ones to be predicted from.
struct Shown {
    picture: Picture,
    difference: Picture,
    viewpoint: Viewpoint,
}

impl Shown {
    fn new(picture: Picture, frame: &RunFrame) -> Shown {
        let difference = difference(&picture, &frame.render);
        Shown { picture, difference, viewpoint: frame.viewpoint }
    }
}

/// Sets what a frame is predicted from. Whether there is anything.
fn set_earlier(
    encoder: &mut WaveletEncoder,
    frame: &RunFrame,
    before: Option<&Shown>,
    warped: &mut Planes,
) -> bool {
    let Some(Shown { picture, difference, viewpoint }) = before else { return false };
    warp(difference, viewpoint, &frame.viewpoint, &frame.depths, warped);
    let earlier = Earlier { warped, shown: picture, difference };
    encoder.set_earlier(&frame.picture, &frame.render, &earlier, false);
    true
}

impl RunFrame {
    /// The frame as a mirror shows it.
    fn mirrored(&self) -> RunFrame {
        let mut frame = self.clone();
        vary::mirror(&mut frame.picture);
        vary::mirror(&mut frame.render);
        let width = frame.picture.width;
        frame.depths.chunks_mut(width as usize).for_each(<[f32]>::reverse);
        let Viewpoint { camera, placement } = &mut frame.viewpoint;
        camera.cx = width as f32 - camera.cx;
        let [w, x, y, z] = placement.rotation;
        placement.rotation = [w, x, -y, -z];
        placement.translation[0] = -placement.translation[0];
        frame
    }
}

/// Mean bytes and PSNR of frames predicted from the one `distance` before, closed loop.
pub fn measure_stream(
    run: &[RunFrame],
    tables: &Tables,
    step: Step,
    distance: usize,
) -> (f64, f64) {
    let Picture { width, height, .. } = run[0].picture;
    let mut sampler = Sampler::new(width, height, &Tables::generic()).with_stream(tables);
    let mut bytes = Vec::with_capacity(8 * run[0].picture.data.len() + 64);
    let mut warped: Planes = std::array::from_fn(|_| vec![0; (width * height) as usize]);
    let mut before: Option<Shown> = None;
    let (mut sum, mut psnr, mut count) = (0.0, 0.0, 0.0);
    for frame in run.iter().step_by(distance) {
        let inter = set_earlier(sampler.encoder(), frame, before.as_ref(), &mut warped);
        sampler.encoder().set_inter(&frame.picture, &frame.render, true, inter);
        sampler.encoder().encode(step, &mut bytes);
        let mut shown = frame.render.clone();
        sampler.encoder().add_to(&mut shown);
        if inter {
            sum += bytes.len() as f64;
            psnr += shown.psnr(&frame.picture);
            count += 1.0;
        }
        before = Some(Shown::new(shown, frame));
    }
    (sum / f64::max(count, 1.0), psnr / f64::max(count, 1.0))
}

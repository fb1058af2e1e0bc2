//! The vehicle's side: a difference picture as bytes.

use std::ops::Range;
use std::sync::Arc;

use crate::Picture;

use super::super::interest::Interest;

use super::bits::Writer;
use super::choose::Chooser;
use super::colour;
use super::context::BandContext;
use super::displaced::Earlier;
use super::displaced_choice::{DisplacementChooser, Pictures};
use super::fineness::LAMBDA;
use super::frame::Frame;
use super::gains::{Gains, LevelGains};
use super::geometry::{Finest, Geometry, Planes};
use super::header::{FineBlocks, Header};
use super::inter::{Inter, Pays};
use super::lifting::{self, FRACTION};
use super::model::Model;
use super::pass::{Due, Pass, Source};
use super::predictor::{Predictor, Predictors};
use super::prices::Prices;
use super::quantised::{Quantised, is_any};
use super::small_blocks_choice::{BlockChooser, take_back};
use super::step::Step;
use crate::coder_tables::PLANES;
use crate::coder_tables::Tables;
use crate::range_coder::RangeEncoder;
use crate::residual::Tune;

/// A level with a coefficient above this is looked through, steps.
const WORTH_A_LOOK: f32 = 0.9;

/// Codes the pictures of one size, in memory of its own.
pub struct WaveletEncoder {
    frame: Frame,
    predictors: Predictors,
    /// Lifted planes of the difference.
    difference: [Vec<i32>; PLANES],
    /// The same in quantiser steps.
    wanted: [Vec<f32>; PLANES],
    chosen: [Vec<i16>; PLANES],
    gains: LevelGains,
    prices: Prices,
    pass: Pass,
    chooser: BlockChooser,
    /// For inter frames.
    displacements: Option<Box<DisplacementChooser>>,
    /// That of the difference, if it was asked for.
    model: Option<Model>,
}

impl WaveletEncoder {
    /// For pictures of a size.
    pub fn new(width: u32, height: u32, tables: &Tables) -> WaveletEncoder {
        WaveletEncoder::tuned(width, height, tables, Tune::Psnr)
    }

    /// As [`WaveletEncoder::new`], with another thing that counts.
    pub fn tuned(width: u32, height: u32, tables: &Tables, tune: Tune) -> WaveletEncoder {
        let frame = Frame::new(width, height);
        let len = frame.geometry.len();
        WaveletEncoder {
            difference: std::array::from_fn(|_| vec![0; len]),
            wanted: std::array::from_fn(|_| vec![0.0; len]),
            chosen: std::array::from_fn(|_| vec![0; len]),
            gains: LevelGains::default(),
            prices: Prices::new(&frame.geometry, tune),
            pass: Pass::new(&frame.geometry),
            chooser: BlockChooser::new(&frame.small_blocks.grids),
            displacements: None,
            model: None,
            predictors: Predictors::new(tables, &Tables::stream()),
            frame,
        }
    }

    /// Takes a frame and its render, both of the encoder's size. `sees_render`: the topside draws the same
    /// render, byte for byte.
    pub fn set(&mut self, frame: &Picture, render: &Picture, sees_render: bool) {
        self.set_inter(frame, render, sees_render, false);
    }

    /// Makes room for inter frames.
    pub fn prepare_inter(&mut self) {
        self.frame.prepare_inter();
        let Geometry { width, height, .. } = self.frame.geometry;
        let chooser = || Box::new(DisplacementChooser::new(width, height));
        self.displacements.get_or_insert_with(chooser);
    }

    /// Takes what a frame may be predicted from. `displaced`: chooses displaced blocks, as they suit the step in use;
    /// whether there are any. If there are none, what was taken before holds. Either way, the frame must be set again.
    pub fn set_earlier(
        &mut self,
        frame: &Picture,
        render: &Picture,
        earlier: &Earlier,
        displaced: bool,
    ) -> bool {
        self.prepare_inter();
        let WaveletEncoder { frame: coded, difference, displacements, .. } = self;
        let (Some(inter), Some(displacements)) = (&mut coded.inter, displacements) else {
            return false;
        };
        inter.displaced.clear();
        if displaced {
            set_difference(frame, render, difference);
            let pictures = Pictures { frame, render, difference, earlier };
            displacements.choose(&mut inter.displaced, &pictures, coded.step);
        }
        if displaced && !inter.displaced.in_use {
            return false;
        }
        inter.set(&coded.geometry, earlier, render, &mut coded.scratch);
        inter.displaced.in_use
    }

    /// Whether the payload of the frame has small blocks.
    pub fn has_small_blocks(&self) -> bool {
        self.frame.small_blocks.in_use || self.frame.has_displaced()
    }

    /// Bytes that its small blocks take.
    pub(super) fn block_bytes(&mut self) -> f64 {
        let blocks = &mut self.frame.small_blocks;
        let plain = if blocks.in_use { blocks.bits() } else { 0.0 };
        let inter = self.frame.inter.as_mut().filter(|_| self.frame.is_inter);
        (plain + inter.map_or(0.0, |inter| inter.displaced.bits())) / 8.0
    }

    /// Chooses what is predicted from the render as a step needs it.
    pub fn choose_blocks(&mut self, step: Step) {
        self.frame.step = step;
        self.pass.forget_render();
        let had_blocks = !self.frame.is_all_predicted();
        self.chooser.choose(&mut self.frame, &mut self.difference);
        if had_blocks || !self.frame.is_all_predicted() {
            self.model = None;
        }
    }

    /// Sets which parts of the picture count more, from here on.
    pub fn set_interest(&mut self, interest: Option<&Arc<Interest>>) {
        self.prices.set_interest(&self.frame.geometry, interest);
    }

    /// Sets the tables of inter frames.
    pub(super) fn set_stream_tables(&mut self, tables: &Tables) {
        *self.predictors.inter = Predictor::new(tables);
    }

    /// As [`WaveletEncoder::set`]. `inter`: the frame is predicted from what [`WaveletEncoder::set_earlier`] took,
    /// unless that surely does not pay.
    pub fn set_inter(
        &mut self,
        frame: &Picture,
        render: &Picture,
        sees_render: bool,
        inter: bool,
    ) -> Pays {
        self.model = None;
        self.pass.forget_render();
        let WaveletEncoder { frame: coded, difference, prices, .. } = self;
        coded.sees_render = sees_render;
        coded.set_render(render);
        prices.set_frame(&coded.geometry, frame, render);
        set_difference(frame, render, difference);
        for plane in &mut *difference {
            for level in 0..coded.geometry.levels {
                let geometry = &coded.geometry;
                lifting::forward(plane, geometry.width, geometry.sizes[level], &mut coded.scratch);
            }
        }
        let inter = coded.inter.as_mut().filter(|_| inter);
        let pays = inter.map_or(Pays::No, |inter| {
            inter.choose(&coded.geometry, difference, &mut coded.scratch)
        });
        coded.is_inter = pays != Pays::No;
        coded.predict_all();
        pays
    }

    /// Predicts all blocks of the frame from the render, even if it is of no use there. Returns whether a block
    /// changes.
    pub(super) fn predict_all(&mut self) -> bool {
        self.model = None;
        self.pass.forget_render();
        take_back(&mut self.frame, &mut self.difference)
    }

    /// A rough model of the frame, coded.
    pub(super) fn model(&mut self) -> Model {
        if let Some(model) = &self.model {
            return model.clone();
        }
        let geometry = &self.frame.geometry;
        let mut model = Model::new();
        for band in geometry.bands() {
            let scale = (geometry.norm(&band) / f64::from(1 << FRACTION)) as f32;
            for row in band.rows(geometry) {
                for difference in &self.difference {
                    let row = difference[row.clone()].iter();
                    model.take(row.map(|value| (*value as f32 * scale).abs()));
                }
            }
        }
        self.model.insert(model).clone()
    }

    /// Chooses coefficients. `lambda`: what a bit is worth, squared steps. The bits of those that had to be weighed.
    pub(super) fn choose(&mut self, step: Step, lambda: f32) -> f32 {
        self.frame.step = step;
        self.want(step);
        let WaveletEncoder { frame, predictors, wanted, chosen, gains, prices, pass, .. } = self;
        let predictor = predictors.of(frame);
        *gains = LevelGains::default();
        let finest = finest(&frame.geometry, |plane, row| {
            wanted[plane][row].iter().fold(false, |any, size| any | (size.abs() > WORTH_A_LOOK))
        });
        let mut chooser = Chooser { wanted, lambda, prices, predictor, gains, bits: 0.0 };
        pass.run(frame, predictor, finest, &mut chooser);
        let bits = chooser.bits;
        for (plane, chosen) in chosen.iter_mut().enumerate() {
            pass.quantised.copy_to(&frame.geometry, plane, chosen);
        }
        bits
    }

    /// Scales the coefficients to code to steps.
    fn want(&mut self, step: Step) {
        let geometry = &self.frame.geometry;
        for band in geometry.bands() {
            let scale = geometry.norm(&band) / (step.value() * f64::from(1 << FRACTION));
            for (wanted, difference) in self.wanted.iter_mut().zip(&self.difference) {
                for row in band.rows(geometry) {
                    let from = &difference[row.clone()];
                    for (to, from) in wanted[row].iter_mut().zip(from) {
                        *to = *from as f32 * scale as f32;
                    }
                }
            }
        }
    }

    /// Codes what was chosen, in place of what `bytes` held, within their capacity. `cut`: the end will be left away.
    /// Whether there was room for all.
    pub(super) fn write(&mut self, cut: bool, bytes: &mut Vec<u8>) -> bool {
        bytes.clear();
        let WaveletEncoder { frame, predictors, chosen, gains, pass, .. } = self;
        let predictor = predictors.of(frame);
        let finest = finest_of(&frame.geometry, chosen);
        let Frame { sees_render, step, low_predicted, .. } = *frame;
        let header = Header { cut, sees_render, step, finest, low_predicted };
        let max = bytes.capacity();
        let mut encoder = RangeEncoder::new(bytes, max);
        let Frame { small_blocks, inter, is_inter, .. } = frame;
        let inter = inter.as_mut().filter(|_| *is_inter);
        let fine =
            FineBlocks { plain: small_blocks, displaced: inter.map(|inter| &mut inter.displaced) };
        header.write(fine, &mut encoder);
        if let Some(inter) = frame.inter_in_use() {
            inter.write(&mut encoder);
        }
        let mut writer = Writer { encoder, predictor, chosen, gains };
        pass.run(frame, predictor, finest, &mut writer);
        writer.encoder.finish()
    }

    /// Shows the coefficients chosen last: each one's value, and what was wanted, steps.
    pub(super) fn show(&mut self, visit: impl FnMut(&Due, i16, f32)) {
        let WaveletEncoder { frame, predictors, wanted, chosen, gains, pass, .. } = self;
        let predictor = predictors.of(frame);
        let finest = finest_of(&frame.geometry, chosen);
        pass.run(frame, predictor, finest, &mut Show { wanted, chosen, gains, visit });
    }

    /// Codes at a step, in place of what `bytes` held, within their capacity. Whether there was room for all.
    pub fn encode(&mut self, step: Step, bytes: &mut Vec<u8>) -> bool {
        self.choose(step, LAMBDA);
        self.write(false, bytes)
    }

    /// Adds what was chosen or coded last to the render.
    pub fn add_to(&mut self, render: &mut Picture) {
        let WaveletEncoder { frame, predictors, pass, .. } = self;
        pass.finish(frame, predictors.of(frame));
        pass.add_to(frame.inter_in_use().map(Inter::picture), &mut render.data);
    }

    /// What the frame that was set is predicted from.
    pub(super) fn inter_in_use(&self) -> Option<&Inter> {
        self.frame.inter_in_use()
    }
}

/// Writes the planes of the difference of a frame and its render.
fn set_difference(frame: &Picture, render: &Picture, difference: &mut Planes) {
    let [frame, render] = [frame, render].map(|picture| picture.data.as_chunks::<3>().0);
    let pixels = frame.iter().zip(render);
    let differences = pixels
        .map(|(frame, render)| std::array::from_fn(|c| i32::from(frame[c]) - i32::from(render[c])));
    colour::to_planes(differences, difference);
}

/// The finest level of each plane with a row that counts.
fn finest(geometry: &Geometry, counts: impl Fn(usize, Range<usize>) -> bool) -> Finest {
    std::array::from_fn(|plane| {
        let holds = |level: usize| {
            let mut bands = geometry.bands().filter(|band| band.level == level);
            bands.any(|band| band.rows(geometry).any(|row| counts(plane, row)))
        };
        (0..=geometry.levels).find(|level| holds(*level)).unwrap_or(geometry.levels + 1)
    })
}

/// The finest level of each plane that has a coefficient.
fn finest_of(geometry: &Geometry, chosen: &[Vec<i16>; PLANES]) -> Finest {
    finest(geometry, |plane, row| is_any(&chosen[plane][row]))
}

struct Show<'a, V> {
    wanted: &'a [Vec<f32>; PLANES],
    chosen: &'a [Vec<i16>; PLANES],
    gains: &'a LevelGains,
    visit: V,
}

impl<V: FnMut(&Due, i16, f32)> Source for Show<'_, V> {
    const LOOKS_AT_ALL: bool = true;

    fn next(&mut self, due: &Due) -> Option<i16> {
        let (plane, index) = (due.context.plane, due.index());
        let value = self.chosen[plane][index];
        (self.visit)(due, value, self.wanted[plane][index]);
        Some(value)
    }

    fn gains(&mut self, zeros: &[BandContext; 3], _: &Quantised) -> Option<Gains> {
        Some(self.gains[zeros[0].band.level])
    }
}

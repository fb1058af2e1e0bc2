//! The wavelet coder at a rate: by quality, by a budget, or by the picture wanted.

use std::sync::Arc;

use crate::Picture;
use crate::packet::{Reference, Residual, residual_part_len, without_zeros};

use super::super::interest::Interest;
use super::super::rate::{Content, Rate, RateResult};
use super::budget::{BudgetSearch, Learnt};
use super::decoder::WaveletDecoder;
use super::displaced::Earlier;
use super::encoder::WaveletEncoder;
use super::fineness::{Bracket, Fineness};
use super::inter::Pays;
use super::step::Step;
use crate::coder_tables::Tables;
use crate::residual::Tune;

/// Most codings of a search. A frame with a tight budget may have two searches.
const MAX_PROBES: u32 = 10;
/// A PSNR may lie above its target by this much, dB.
const PSNR_SLACK: f64 = 0.05;
/// Bytes of a reference, beyond those of an intra frame of a stream.
const REFERENCE_BYTES: f64 = Reference::LEN as f64;
/// Share of its bytes that an inter frame must save, if it is in doubt: an intra frame outlasts losses.
const WORTH_INTER: f64 = 0.02;
/// Share that displaced blocks must save beside the warped difference: what holds for one frame may not for the next.
const WORTH_DISPLACED: f64 = 0.05;
/// Payloads up to this length are also coded with the whole frame predicted from the render (docs/decisions.md, 26).
const TIGHT: usize = 160;
/// Small blocks of such payloads are chosen at this step: no byte more or less makes them others.
const TIGHT_STEP: u8 = 48;
/// Blocks are chosen again if the step has moved by more than this since they were chosen, eighths of an octave.
const NEAR: u8 = 2;

/// Codes frames of one size at a rate, in memory of its own.
pub struct RateEncoder {
    encoder: WaveletEncoder,
    decoder: WaveletDecoder,
    portable: bool,
    best: Coding,
    trial: Coding,
    probes: u32,
    kind: FrameKind<Reference>,
    trials: Trials,
    /// What earlier searches have shown: of frames that are predicted from none, and from an earlier one.
    learnt: [Learnt; 2],
    /// As that, how far the model of the PSNR is below it, dB.
    psnr_off: [f64; 2],
}

/// What a frame is, or may be, predicted from beside its render.
#[derive(Clone, Copy)]
pub enum FrameKind<R> {
    /// It is of no stream.
    AllIntra,
    /// It is of a stream, and predicted from none of its frames.
    Intra,
    /// It is of a stream, and predicted from a reference.
    Inter(R),
}

/// What a frame may be predicted from: a reference, and the frame that it names.
pub type InterSource<'a> = FrameKind<(Reference, Earlier<'a>)>;

/// How a frame of a stream may be coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// By itself.
    Alone,
    /// Predicted from the warped difference of an earlier frame.
    Warped,
    /// As that, with displaced blocks.
    Displaced,
}

/// When frames are coded in all ways to see which is best: less and less often as long as the answer stays.
#[derive(Default)]
struct Trials {
    /// What was best, and what the coefficients had told of the warped difference.
    last: Option<(Way, Pays)>,
    /// How often the answer stayed.
    streak: u32,
    /// Frames that are still to go by it.
    waiting: u32,
}

impl Trials {
    /// How a frame is to be coded; `None`: try it.
    fn answer(&mut self, pays: Pays) -> Option<Way> {
        let (way, told) = self.last?;
        let holds = told == pays && self.waiting > 0;
        self.waiting = self.waiting.saturating_sub(1);
        holds.then_some(way)
    }

    /// Takes what a trial came to.
    fn learn(&mut self, pays: Pays, way: Way) {
        let same = self.last.replace((way, pays)).is_some_and(|(before, _)| before == way);
        self.streak = if same { self.streak + 1 } else { 0 };
        self.waiting = (1 << self.streak.min(3)) - 1;
    }
}

/// A payload, and what it shows.
struct Coding {
    payload: Vec<u8>,
    small_blocks: bool,
    reconstruction: Picture,
    psnr: f64,
}

impl Coding {
    fn new(width: u32, height: u32) -> Coding {
        Coding {
            payload: Vec::with_capacity(super::super::max_payload_len(width, height)),
            small_blocks: false,
            reconstruction: Picture::new(width, height),
            psnr: f64::NEG_INFINITY,
        }
    }
}

impl RateEncoder {
    /// For pictures of a size. `portable`: the topside draws this device's renders, byte for byte.
    pub fn new(
        width: u32,
        height: u32,
        tables: &Tables,
        portable: bool,
        tune: Tune,
    ) -> RateEncoder {
        RateEncoder {
            encoder: WaveletEncoder::tuned(width, height, tables, tune),
            decoder: WaveletDecoder::new(width, height, tables),
            portable,
            best: Coding::new(width, height),
            trial: Coding::new(width, height),
            probes: 0,
            kind: FrameKind::AllIntra,
            trials: Trials::default(),
            learnt: Default::default(),
            psnr_off: [0.0; 2],
        }
    }

    /// Codes a frame of the encoder's size; the outcome is in [`RateEncoder::coded`]. `source`: what it may be
    /// predicted from.
    pub fn encode(
        &mut self,
        frame: &Picture,
        render: &Picture,
        rate: Rate,
        overhead: usize,
        source: InterSource,
    ) -> RateResult {
        self.kind = FrameKind::AllIntra;
        if !matches!(source, FrameKind::AllIntra) {
            self.encoder.prepare_inter();
            self.decoder.prepare_inter();
        }
        self.probes = 0;
        let plain = frame.psnr(render);
        if matches!(rate, Rate::Psnr(target) if plain >= target) {
            return RateResult { content: Content::NotNeeded, reached: true, probes: 0 };
        }
        let of_payload = match rate {
            Rate::Bytes(budget) => Rate::Bytes(max_payload(budget.saturating_sub(overhead))),
            other => other,
        };
        let overhead = overhead + self.set(frame, render, of_payload, source);
        let (coded, reached) = match rate {
            Rate::Quality(quality) => {
                self.choose(Fineness::of_quality(quality));
                self.show(frame, render);
                self.write_or_coarser(frame, render);
                let content = Content::Payload;
                return RateResult { content, reached: true, probes: self.probes };
            }
            Rate::Bytes(budget) => {
                let room = budget.saturating_sub(overhead);
                if room <= residual_part_len(0) {
                    return RateResult { content: Content::NoRoom, reached: false, probes: 0 };
                }
                self.within(frame, render, room);
                (self.best.psnr > plain, true)
            }
            Rate::Psnr(target) => {
                let reached = self.reaching(frame, render, target);
                (self.best.psnr > plain, reached)
            }
        };
        RateResult { content: Content::payload_if(coded), reached, probes: self.probes }
    }

    /// Sets which parts of the picture count more, from here on.
    pub fn set_interest(&mut self, interest: Option<&Arc<Interest>>) {
        self.encoder.set_interest(interest);
    }

    /// What was coded, the picture that it makes, and its PSNR, dB.
    pub fn coded(&self) -> (Residual<'_>, &Picture, f64) {
        let Coding { ref payload, small_blocks, ref reconstruction, psnr } = self.best;
        let stream = |reference| Residual::Stream { reference, small_blocks, payload };
        let residual = match self.kind {
            FrameKind::AllIntra => Residual::Coded { small_blocks, payload },
            FrameKind::Intra => stream(None),
            FrameKind::Inter(reference) => stream(Some(reference)),
        };
        (residual, reconstruction, psnr)
    }

    /// Takes a frame, and chooses whether it is inter. `rate`: of its payload. Returns the bytes that a frame of a
    /// stream takes more.
    fn set(&mut self, frame: &Picture, render: &Picture, rate: Rate, source: InterSource) -> usize {
        let (reference, earlier) = match source {
            FrameKind::Inter((reference, earlier)) => (reference, earlier),
            alone => {
                self.take(frame, render, false, rate);
                let is_stream = matches!(alone, FrameKind::Intra);
                self.kind = if is_stream { FrameKind::Intra } else { FrameKind::AllIntra };
                return 0;
            }
        };
        let way = self.set_inter(frame, render, rate, &earlier);
        let reference = (way != Way::Alone).then_some(reference);
        self.kind = reference.map_or(FrameKind::Intra, FrameKind::Inter);
        reference.map_or(0, |_| Reference::LEN)
    }

    /// Takes a frame that may be predicted from an earlier one, in the best way.
    fn set_inter(
        &mut self,
        frame: &Picture,
        render: &Picture,
        rate: Rate,
        earlier: &Earlier,
    ) -> Way {
        self.encoder.set_earlier(frame, render, earlier, false);
        let pays = self.take(frame, render, true, rate);
        let way = self.trials.answer(pays).unwrap_or_else(|| {
            let way = self.best_way(frame, render, rate, earlier, pays);
            self.trials.learn(pays, way);
            // The trial ended with the frame alone.
            self.encoder.set_earlier(frame, render, earlier, false);
            self.take(frame, render, true, rate);
            way
        });
        let is_set = match way {
            Way::Alone => pays == Pays::No,
            Way::Warped => true,
            Way::Displaced => false,
        };
        if is_set {
            return if pays == Pays::No { Way::Alone } else { way };
        }
        let displaced =
            way == Way::Displaced && self.encoder.set_earlier(frame, render, earlier, true);
        if displaced && self.take(frame, render, true, rate) != Pays::No {
            return way;
        }
        // Warped differences may pay if displaced blocks do not.
        let is_inter = way == Way::Displaced && pays != Pays::No;
        if displaced && is_inter {
            self.encoder.set_earlier(frame, render, earlier, false);
        }
        let pays = self.take(frame, render, is_inter, rate);
        if pays == Pays::No { Way::Alone } else { Way::Warped }
    }

    /// Codes a frame that was set to the warped difference in all ways.
    fn best_way(
        &mut self,
        frame: &Picture,
        render: &Picture,
        rate: Rate,
        earlier: &Earlier,
        pays: Pays,
    ) -> Way {
        let fineness = self.guess(rate);
        let mut best = (f64::INFINITY, Way::Alone);
        if pays != Pays::No {
            best = (self.price(frame, render, fineness), Way::Warped);
        }
        if self.encoder.set_earlier(frame, render, earlier, true)
            && self.take(frame, render, true, rate) != Pays::No
        {
            let price = self.price(frame, render, fineness);
            let worth_it = WORTH_DISPLACED * 8.0 * self.trial.payload.len() as f64;
            if price + worth_it < best.0 {
                best = (price, Way::Displaced);
            }
        }
        if best.1 == Way::Alone {
            return Way::Alone;
        }
        self.take(frame, render, false, rate);
        let alone = self.price(frame, render, fineness);
        let worth_it = WORTH_INTER * 8.0 * self.trial.payload.len() as f64;
        if best.0 + 8.0 * REFERENCE_BYTES + worth_it < alone { best.1 } else { Way::Alone }
    }

    /// Sets the encoder to a frame, and chooses its blocks for about the step that the rate asks for.
    fn take(&mut self, frame: &Picture, render: &Picture, inter: bool, rate: Rate) -> Pays {
        let pays = self.encoder.set_inter(frame, render, self.portable, inter);
        if matches!(rate, Rate::Bytes(room) if room <= TIGHT) {
            self.encoder.choose_blocks(Step::new(TIGHT_STEP));
            return pays;
        }
        let mut before = None;
        // Blocks that are plain leave less to code, and so bring the step down.
        for _ in 0..2 {
            let step = self.guess(rate).step();
            if before.is_none_or(|before: Step| before.index().abs_diff(step.index()) > NEAR) {
                self.encoder.choose_blocks(step);
            }
            before = Some(step);
        }
        pays
    }

    /// About how finely a payload's rate asks for.
    fn guess(&mut self, rate: Rate) -> Fineness {
        if let Rate::Quality(quality) = rate {
            return Fineness::of_quality(quality);
        }
        let model = self.encoder.model();
        let first = match rate {
            Rate::Quality(_) => None,
            Rate::Bytes(bytes) => {
                let room = bytes as f64 - self.encoder.block_bytes();
                Bracket::new(room.max(1.0), 0.0, |at| model.bytes(at)).next()
            }
            Rate::Psnr(target) => Bracket::new(target, 0.0, |at| model.psnr(at)).next(),
        };
        first.unwrap_or(Fineness::of_quality(0.0))
    }

    /// What a coding comes to: its bits, and its error in the bits that it is worth.
    fn price(&mut self, frame: &Picture, render: &Picture, fineness: Fineness) -> f64 {
        self.choose(fineness);
        self.write(false);
        self.show(frame, render);
        let Coding { payload, reconstruction, .. } = &self.trial;
        let step = fineness.step().value();
        let values = frame.data.len() as f64;
        let error = frame.mse(reconstruction) * 65_025.0 * values / (step * step);
        8.0 * payload.len() as f64 + error / f64::from(fineness.lambda())
    }

    /// Chooses coefficients. How many bytes those take that had to be weighed.
    fn choose(&mut self, fineness: Fineness) -> f64 {
        self.probes += 1;
        f64::from(self.encoder.choose(fineness.step(), fineness.lambda())) / 8.0
    }

    /// The picture of what was chosen last, and its PSNR, in `trial`.
    fn show(&mut self, frame: &Picture, render: &Picture) {
        let trial = &mut self.trial;
        trial.reconstruction.clone_from(render);
        self.encoder.add_to(&mut trial.reconstruction);
        trial.psnr = frame.psnr(&trial.reconstruction);
    }

    /// Writes what was chosen last. Whether a payload may be that long.
    fn write(&mut self, cut: bool) -> bool {
        self.trial.small_blocks = self.encoder.has_small_blocks();
        self.encoder.write(cut, &mut self.trial.payload)
    }

    /// Keeps the coding just tried.
    fn keep(&mut self) {
        std::mem::swap(&mut self.best, &mut self.trial);
    }

    /// The coarsest picture that reaches a PSNR, or the finest there is. Whether it is reached.
    fn reaching(&mut self, frame: &Picture, render: &Picture, target: f64) -> bool {
        let model = self.encoder.model();
        let inter = usize::from(self.encoder.inter_in_use().is_some());
        let off = self.psnr_off[inter];
        let mut bracket = Bracket::new(target + 0.4 * PSNR_SLACK, off, |at| model.psnr(at));
        let mut best: Option<(Fineness, f64)> = None;
        let mut last = None;
        while let Some(fineness) = bracket.next().filter(|_| self.probes < MAX_PROBES) {
            self.choose(fineness);
            self.show(frame, render);
            last = Some(fineness);
            let psnr = self.trial.psnr;
            bracket.tell(fineness, psnr);
            let better = |(_, before): (Fineness, f64)| {
                if before < target { psnr > before } else { (target..before).contains(&psnr) }
            };
            if best.is_none_or(better) {
                best = Some((fineness, psnr));
            }
            if (target..=target + PSNR_SLACK).contains(&psnr) {
                break;
            }
        }
        self.psnr_off[inter] = bracket.last_off().map_or(off, |last| 0.5 * (off + last));
        if let Some((fineness, _)) = best.filter(|(fineness, _)| last != Some(*fineness)) {
            self.choose(fineness);
            self.show(frame, render);
        }
        self.write_or_coarser(frame, render);
        self.best.psnr >= target
    }

    /// Keeps what was chosen last; if it is longer than a payload may be, the finest that is not.
    fn write_or_coarser(&mut self, frame: &Picture, render: &Picture) {
        if self.write(false) {
            self.keep();
        } else {
            let longest = self.trial.payload.capacity();
            self.within(frame, render, residual_part_len(longest));
        }
    }

    /// The best picture whose residual part has at most `room` bytes.
    fn within(&mut self, frame: &Picture, render: &Picture, room: usize) {
        let max = max_payload(room);
        self.best.psnr = f64::NEG_INFINITY;
        self.best.payload.clear();
        self.search_within(frame, render, max);
        // Blocks were chosen as a fine picture needs them. A coarse one lacks the render's details in the others.
        if max <= TIGHT && self.encoder.predict_all() {
            self.search_within(frame, render, max);
        }
    }

    /// Codes until a payload has about `max` bytes; keeps what is better than the best so far.
    fn search_within(&mut self, frame: &Picture, render: &Picture, max: usize) {
        let blocks = self.encoder.block_bytes();
        let model = self.encoder.model();
        let inter = usize::from(self.encoder.inter_in_use().is_some());
        let learnt = self.learnt[inter];
        let mut search = BudgetSearch::new(max, blocks, learnt, |at| libm::log(model.bytes(at)));
        self.search(frame, render, max, &mut search);
        self.learnt[inter] = search.learnt(learnt);
    }

    fn search(
        &mut self,
        frame: &Picture,
        render: &Picture,
        max: usize,
        search: &mut BudgetSearch<impl Fn(Fineness) -> f64>,
    ) {
        let last = self.probes + MAX_PROBES;
        while let Some(fineness) = search.next().filter(|_| self.probes < last) {
            let weighed = self.choose(fineness);
            if search.chosen(fineness, weighed)
                && search.written(self.write_within(frame, render, max))
            {
                return;
            }
        }
        if let Some(fineness) = search.unwritten() {
            let weighed = self.choose(fineness);
            search.chosen(fineness, weighed);
            search.written(self.write_within(frame, render, max));
        }
        if let Some(fineness) = search.too_long() {
            self.cut(frame, render, fineness, max);
        }
    }

    /// Writes what was chosen last; keeps it if it has room and is the best so far. Its length, or more than `max`.
    fn write_within(&mut self, frame: &Picture, render: &Picture, max: usize) -> usize {
        let whole = self.write(false);
        let len = self.trial.payload.len();
        if !whole || len > max {
            return len.max(max + 1);
        }
        self.show(frame, render);
        if self.trial.psnr > self.best.psnr {
            self.keep();
        }
        len
    }

    /// Codes more than there is room for, and leaves the end away; keeps it if it is the best so far.
    fn cut(&mut self, frame: &Picture, render: &Picture, fineness: Fineness, max: usize) {
        self.choose(fineness);
        self.write(true);
        let trial = &mut self.trial;
        trial.payload.truncate(max);
        // No payload ends with a zero: a reader takes those for padding.
        trial.payload.truncate(without_zeros(&trial.payload).len());
        trial.reconstruction.clone_from(render);
        // It fails only if the render is not the encoder's own.
        let _ = self.decoder.add_own(&self.encoder, &trial.payload, &mut trial.reconstruction);
        trial.psnr = frame.psnr(&trial.reconstruction);
        if trial.psnr > self.best.psnr {
            self.keep();
        }
    }
}

/// The longest payload whose residual part has at most `room` bytes.
fn max_payload(room: usize) -> usize {
    room.saturating_sub(residual_part_len(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_that_stays_is_asked_for_less_and_less_often() {
        let mut trials = Trials::default();
        let mut tried = |frames: std::ops::Range<u32>, pays, way| -> Vec<u32> {
            let due =
                |_: &u32| trials.answer(pays).is_none().then(|| trials.learn(pays, way)).is_some();
            frames.filter(due).collect()
        };
        assert_eq!(tried(0..32, Pays::Yes, Way::Warped), [0, 1, 3, 7, 15, 23, 31]);
        // The coefficients tell something else.
        assert_eq!(tried(32..40, Pays::Perhaps, Way::Alone), [32, 33, 35, 39]);
    }
}

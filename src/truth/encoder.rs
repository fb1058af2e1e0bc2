//! Truth maps as bytes.

use crate::Picture;
use crate::image::Mask;
use crate::packet::truth as layout;
use crate::range_coder::RangeEncoder;

use super::THRESHOLDS;
use super::choice::{Choice, MENDED_HARM};
use super::marks::{Comparison, Mark, Marks};

/// After so many predicted maps comes a key map, which is predicted from none: what its loss has spoiled ends there.
const PREDICTED: u32 = 7;
/// What a block that is said to differ, but is as seen, may cost to say right, bits.
const PRICE: f32 = 8.0;
/// If a map is too long, that is halved so often at most.
const HALVINGS: u32 = 6;
/// Most bytes of a map by which no block differs.
const RIGHT: usize = 3;
/// Most frames between a map and the key map that it is predicted from.
const FARTHEST: u32 = 15;
/// Number of the thresholds.
const LEVELS: u8 = 0;

/// What is compared.
pub struct Compared<'a> {
    /// What the camera saw, as it was treated.
    pub frame: &'a Picture,
    /// What the topside will show.
    pub picture: &'a Picture,
    pub base: Base<'a>,
    pub mask: Option<&'a Mask>,
}

/// What is shown if nothing of the difference picture has come.
#[derive(Clone, Copy)]
pub enum Base<'a> {
    /// The same: there is no difference picture.
    Picture,
    /// The render.
    Render(&'a Picture),
    /// It is not known: the difference picture is predicted from another frame.
    Unknown,
}

/// How a map is written.
#[derive(Clone, Copy)]
struct Form {
    /// Blocks along a side of a cell: 1, 2 or 4.
    side: usize,
    /// It tells no block that the render shows from one that the difference picture mends.
    whole: bool,
    /// Frames since the key map that it is predicted from; 0: it is one itself.
    distance: u32,
}

/// Writes the truth maps of pictures of one size, in memory of its own.
pub struct TruthEncoder {
    comparison: Comparison,
    /// What is true.
    marks: Marks,
    /// What the map says.
    said: Marks,
    /// What the last key map said, and of which frame.
    key: Marks,
    key_frame: Option<u32>,
    choice: Choice,
    /// Maps since then.
    predicted: u32,
    /// Bytes that the best map of the last frame took.
    needed: usize,
    /// The best map, and the one that is tried.
    bytes: Vec<u8>,
    tried: Vec<u8>,
    coded: Vec<u8>,
}

impl TruthEncoder {
    pub fn new(width: u32, height: u32) -> TruthEncoder {
        let marks = Marks::new(width, height);
        // A mark takes two bits, of 16 bits' worth each at most.
        let room = 4 * marks.marks.len() + 16;
        TruthEncoder {
            comparison: Comparison::new(width, height),
            choice: Choice::new(&marks),
            said: marks.clone(),
            key: marks.clone(),
            marks,
            key_frame: None,
            predicted: 0,
            needed: 1,
            bytes: Vec::with_capacity(room),
            tried: Vec::with_capacity(room),
            coded: Vec::with_capacity(room),
        }
    }

    /// Bytes that the best map of the last frame took.
    pub fn needed(&self) -> usize {
        self.needed
    }

    /// The next map is a key map: the topside may lack those before.
    pub fn forget(&mut self) {
        self.key_frame = None;
    }

    /// Compares the pictures of a frame. Returns how many bytes the best map takes.
    pub fn compare(&mut self, number: u32, compared: &Compared) -> usize {
        self.mark(compared);
        let differs = self.marks.marks.iter().any(|mark| mark.is_off());
        let limit = if differs { layout::MAX_LEN } else { RIGHT };
        self.find(self.distance(number), limit);
        self.needed = self.bytes.len();
        self.needed
    }

    /// Writes the map of the frame that was compared last, in `limit` bytes at most; `None`: there is no room for any.
    pub fn encode(&mut self, number: u32, limit: usize) -> Option<&[u8]> {
        if self.bytes.len() > limit && !self.find(self.distance(number), limit) {
            return None;
        }
        if self.bytes[0] & layout::PREDICTED != 0 {
            self.predicted += 1;
        } else {
            self.predicted = 0;
            self.key_frame = Some(number);
            std::mem::swap(&mut self.key, &mut self.said);
        }
        Some(&self.bytes)
    }

    /// Finds the best map of at most `limit` bytes. Whether there is one.
    fn find(&mut self, distance: u32, limit: usize) -> bool {
        let mut best = self.plain().map(|(whole, harm)| {
            self.write_plain(whole);
            8.0 + PRICE * harm
        });
        best = best.filter(|_| self.bytes.len() <= limit);
        // If the scene has changed much, a new key map is shorter.
        let distances = if distance > 0 { &[distance, 0][..] } else { &[0] };
        for side in [1, 2, 4] {
            self.choice.prepare(&self.marks, &self.key, side);
            for distance in distances {
                for whole in [false, true] {
                    let form = Form { side, whole, distance: *distance };
                    best = self.find_in(form, limit, best);
                }
            }
        }
        best.is_some()
    }

    /// Keeps the best map of a form, if it is short enough and costs less than `best`. Returns what the best one costs.
    fn find_in(&mut self, form: Form, limit: usize, best: Option<f32>) -> Option<f32> {
        let mut price = PRICE;
        for _ in 0..=HALVINGS {
            let harm = self.choice.choose(form.whole, form.distance > 0, price);
            if best.is_some_and(|best| PRICE * harm >= best) {
                break;
            }
            self.write(form);
            if self.tried.len() <= limit {
                let cost = 8.0 * self.tried.len() as f32 + PRICE * harm;
                if best.is_some_and(|best| cost >= best) {
                    break;
                }
                std::mem::swap(&mut self.bytes, &mut self.tried);
                self.said.set_blocks_of(&self.choice.cells, form.side);
                return Some(cost);
            }
            price /= 2.0;
        }
        best
    }

    /// How many frames before the key map came that the next one is predicted from; 0: it is a key map.
    fn distance(&self, number: u32) -> u32 {
        let distance = self.key_frame.map_or(0, |key| number.wrapping_sub(key));
        let near = (1..=FARTHEST).contains(&distance) && self.predicted < PREDICTED;
        if near { distance } else { 0 }
    }

    /// If all blocks are as seen: whether only the whole packet shows that, and the harm of saying so.
    fn plain(&self) -> Option<(bool, f32)> {
        let of = |mark: Mark| self.marks.marks.iter().filter(|found| **found == mark).count();
        let (rendered, all) = (of(Mark::Rendered), self.marks.marks.len());
        match rendered + of(Mark::Mended) == all {
            true if rendered == all => Some((false, 0.0)),
            true => Some((true, MENDED_HARM * rendered as f32)),
            false => None,
        }
    }

    /// Marks what is true.
    fn mark(&mut self, compared: &Compared) {
        let Compared { frame, picture, base, mask } = *compared;
        let thresholds = THRESHOLDS[usize::from(LEVELS)];
        let (render, as_seen) = match base {
            Base::Render(render) => (render, None),
            Base::Picture => (picture, Some(Mark::Rendered)),
            Base::Unknown => (picture, Some(Mark::Mended)),
        };
        self.comparison.mark(frame, [picture, render], mask, thresholds, &mut self.marks);
        for mark in self.marks.marks.iter_mut().filter(|mark| !mark.is_off()) {
            *mark = as_seen.unwrap_or(*mark);
        }
    }

    /// Writes that all blocks are as seen.
    fn write_plain(&mut self, whole: bool) {
        self.said.marks.fill(if whole { Mark::Mended } else { Mark::Rendered });
        self.bytes.clear();
        self.bytes.push(LEVELS << 6 | u8::from(whole) << 3);
    }

    /// Writes the marks that were chosen to `tried`.
    fn write(&mut self, form: Form) {
        let Form { side, whole, distance } = form;
        self.coded.clear();
        let mut coder = RangeEncoder::new(&mut self.coded, layout::MAX_LEN);
        let predicted = distance > 0;
        self.choice.code(&mut coder, whole, predicted);
        // There is always room.
        coder.finish();
        let fineness = side.trailing_zeros() as u8 + 1;
        let flags = if predicted { layout::PREDICTED } else { 0 } | u8::from(whole) << 3;
        self.tried.clear();
        self.tried.push(LEVELS << 6 | flags | fineness);
        layout::write_len((distance as u8) << 4, self.coded.len(), &mut self.tried);
        self.tried.extend_from_slice(&self.coded);
    }
}

//! Truth maps as bytes.

use crate::Picture;
use crate::image::Mask;
use crate::packet::truth as layout;
use crate::range_coder::RangeEncoder;

use super::THRESHOLDS;
use super::coding::{Form, code};
use super::marks::{Comparison, Mark, Marks};

/// After so many predicted maps comes one that is predicted from none: what a loss has spoiled ends there.
const PREDICTED: u32 = 7;
/// The forms that are tried, in this order, until one is short enough.
const FORMS: [Form; 6] = [
    Form { side: 1, whole: false },
    Form { side: 1, whole: true },
    Form { side: 2, whole: false },
    Form { side: 2, whole: true },
    Form { side: 4, whole: false },
    Form { side: 4, whole: true },
];
/// Most frames between a map and the one that it is predicted from.
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

/// Writes the truth maps of pictures of one size, in memory of its own.
pub struct TruthEncoder {
    comparison: Comparison,
    /// What is true.
    marks: Marks,
    /// What the map says.
    said: Marks,
    /// What the last map said, and of which frame.
    before: Marks,
    last: Option<u32>,
    /// Maps since the last one that was predicted from none.
    predicted: u32,
    /// Bytes that the finest map of the last frame took.
    needed: usize,
    bytes: Vec<u8>,
    coded: Vec<u8>,
}

impl TruthEncoder {
    pub fn new(width: u32, height: u32) -> TruthEncoder {
        let marks = Marks::new(width, height);
        // A mark takes two bits, of 16 bits' worth each at most.
        let room = 4 * marks.marks.len() + 16;
        TruthEncoder {
            comparison: Comparison::new(width, height),
            said: marks.clone(),
            before: marks.clone(),
            marks,
            last: None,
            predicted: 0,
            needed: 1,
            bytes: Vec::with_capacity(room),
            coded: Vec::with_capacity(room),
        }
    }

    /// Bytes that the finest map of the last frame took.
    pub fn needed(&self) -> usize {
        self.needed
    }

    /// The next map is predicted from none: the topside may lack those before.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Compares the pictures of a frame, and writes the finest map. Returns how many bytes it takes.
    pub fn compare(&mut self, number: u32, compared: &Compared) -> usize {
        self.mark(compared);
        match self.plain() {
            Some(whole) => self.write_plain(whole),
            None => self.write(FORMS[0], self.distance(number)),
        }
        self.needed = self.bytes.len();
        self.needed
    }

    /// Writes the map of the frame that was compared last, in `limit` bytes at most; `None`: there is no room for any.
    pub fn encode(&mut self, number: u32, limit: usize) -> Option<&[u8]> {
        let distance = self.distance(number);
        // The finest one is there already.
        let mut coarser = FORMS[1..].iter();
        while self.bytes.len() > limit
            && let Some(form) = coarser.next()
        {
            self.write(*form, distance);
        }
        if self.bytes.len() > limit {
            self.last = None;
            return None;
        }
        self.predicted = if distance > 0 { self.predicted + 1 } else { 0 };
        self.last = Some(number);
        std::mem::swap(&mut self.before, &mut self.said);
        Some(&self.bytes)
    }

    /// How many frames before the map came that the next one is predicted from; 0: it is predicted from none.
    fn distance(&self, number: u32) -> u32 {
        let distance = self.last.map_or(0, |last| number.wrapping_sub(last));
        let near = (1..=FARTHEST).contains(&distance) && self.predicted < PREDICTED;
        if near { distance } else { 0 }
    }

    /// Whether all blocks are as seen, and then whether only the whole packet shows that.
    fn plain(&self) -> Option<bool> {
        let same = |mark: Mark| self.marks.marks.iter().all(|found| *found == mark);
        match () {
            () if same(Mark::Rendered) => Some(false),
            () if same(Mark::Mended) => Some(true),
            () => None,
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
        self.said.marks.copy_from_slice(&self.marks.marks);
        self.bytes.clear();
        self.bytes.push(LEVELS << 6 | u8::from(whole) << 5);
    }

    /// Writes the map in a form, predicted from the one of so many frames before; 0: from none.
    fn write(&mut self, form: Form, distance: u32) {
        self.said.marks.copy_from_slice(&self.marks.marks);
        self.coded.clear();
        let mut coder = RangeEncoder::new(&mut self.coded, layout::MAX_LEN);
        let before = (distance > 0).then_some(&self.before);
        code(&mut coder, form, before, &mut self.said, |_, _| ());
        // There is always room.
        coder.finish();
        let side = form.side.trailing_zeros() as u8 + 1;
        let flags = u8::from(distance > 0) << 4 | u8::from(form.whole) << 5;
        self.bytes.clear();
        self.bytes.push(LEVELS << 6 | flags | side << 2);
        layout::write_len((distance as u8) << 4, self.coded.len(), &mut self.bytes);
        self.bytes.extend_from_slice(&self.coded);
    }
}

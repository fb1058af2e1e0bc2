//! Interlaced video. Each frame is woven of two fields, its even rows and its odd ones, which were taken one after the
//! other: what moves is combed. Of each frame one picture is made, for the time of its even rows.

use super::frame::{Layout, VideoFrame};
use super::matroska::Block;

/// Whether frames that follow each other are woven of fields of two times. Those of one time fit each other better than
/// those of two frames do, both ways. Of two times, a field fits one of the other frame's as well as its own frame's,
/// and worse the other way, where three times as much time lies between. Texture alone does neither.
pub fn is_interlaced(frames: &[VideoFrame]) -> bool {
    /// How much better and worse, at least.
    const CLEAR: f64 = 1.1;
    /// Pairs of frames that must say so; and of those that say anything, one of so many.
    const ENOUGH: (usize, usize) = (2, 4);
    let (mut woven, mut whole) = (0, 0);
    for pair in frames.windows(2) {
        let [one, next] = [&pair[0], &pair[1]];
        let own = 0.5 * (misfit(one, one) + misfit(next, next));
        let [ahead, behind] = [misfit(one, next), misfit(next, one)];
        let (near, far) = (ahead.min(behind), ahead.max(behind));
        woven += usize::from(near < CLEAR * own && far > CLEAR * near);
        whole += usize::from(near > CLEAR * own);
    }
    woven >= ENOUGH.0 && ENOUGH.1 * woven >= woven + whole
}

/// How badly the even rows of a frame fit the odd ones of another.
fn misfit(even: &VideoFrame, odd: &VideoFrame) -> f64 {
    /// More columns say nothing more.
    const COLUMNS: usize = 640;
    let (width, height) = even.size();
    let every = (width as usize / COLUMNS).max(1);
    let of_row = |y: usize| {
        let at = |y: usize| y * even.layout.strides[0];
        let [above, below] = [at(y - 1), at(y + 1)].map(|from| &even.data[from..]);
        let here = &odd.data[at(y)..];
        let columns = (0..width as usize).step_by(every);
        let off = |x: usize| i64::from(above[x]) + i64::from(below[x]) - 2 * i64::from(here[x]);
        columns.map(|x| off(x).unsigned_abs()).sum::<u64>()
    };
    (1..(height as usize).saturating_sub(1)).step_by(2).map(of_row).sum::<u64>() as f64
}

/// Makes pictures of frames, one after the other.
#[derive(Default)]
pub struct Fields {
    before: Option<Vec<u8>>,
    here: Option<Block>,
}

impl Fields {
    /// Takes the next frame, `None` after the last. Gives the picture of the one before it.
    pub fn add(&mut self, next: Option<Block>, layout: &Layout) -> Option<Block> {
        let here = std::mem::replace(&mut self.here, next)?;
        let after = self.here.as_ref().map_or(&here.data, |after| &after.data);
        let before = self.before.as_ref().unwrap_or(&here.data);
        let data = picture(layout, [before, &here.data, after]);
        self.before = Some(here.data);
        Some(Block { ticks: here.ticks, data })
    }
}

/// The picture of a frame, from it and the frames before and after it. As FFmpeg's filter `yadif` does it: the odd rows
/// follow from the even ones beside them, along edges, as far as something changes there; what stands stays as it is.
fn picture(layout: &Layout, frames: [&Vec<u8>; 3]) -> Vec<u8> {
    let mut picture = frames[1].clone();
    for plane in 0..3 {
        let (stride, from) = (layout.strides[plane], layout.planes[plane]);
        let half = |side: u32| if plane == 0 { side } else { side.div_ceil(2) } as usize;
        let (width, height) = (half(layout.header.width), half(layout.header.height));
        for y in (1..height).step_by(2) {
            let below = if y + 1 < height { y + 1 } else { y - 1 };
            let rows =
                frames.map(|frame| [y - 1, y, below].map(|y| &frame[from + y * stride..][..width]));
            let made = &mut picture[from + y * stride..][..width];
            made.iter_mut().enumerate().for_each(|(x, value)| *value = pixel(&rows, x));
        }
    }
    picture
}

/// A pixel of an odd row. `rows`: of the frame before, this one and the one after, each the row above, its own, and the
/// one below.
fn pixel(rows: &[[&[u8]; 3]; 3], x: usize) -> u8 {
    let [before, here, after] = rows;
    let change = |other: &[&[u8]; 3]| {
        let [above, own, below] = [0, 1, 2].map(|i| other[i][x].abs_diff(here[i][x]));
        own.max(above.midpoint(below))
    };
    let change = change(before).max(change(after));
    let own = here[1][x];
    let last = here[0].len() - 1;
    let [above, below] = [here[0], here[2]]
        .map(|row| move |x: usize, by: isize| row[x.saturating_add_signed(by).min(last)]);
    // Along which of three lines above and below agree best.
    let unlike = |slope: isize| {
        let at = |by| u32::from(above(x, by + slope).abs_diff(below(x, by - slope)));
        2 * (at(-1) + at(0) + at(1)) + u32::from(slope != 0)
    };
    let slope = [0, -1, 1].into_iter().min_by_key(|slope| unlike(*slope)).unwrap_or(0);
    let between = above(x, slope).midpoint(below(x, -slope));
    between.clamp(own.saturating_sub(change), own.saturating_add(change))
}

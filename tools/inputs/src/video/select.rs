//! Which frames of a video a mapping takes: sharp ones, of which neighbours overlap.

use super::analysis::Facts;

/// Neighbours have this share of the picture in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    pub least: f64,
    pub most: f64,
}

impl Overlap {
    /// Enough for matching from both sides, and not so much that pictures repeat each other.
    pub const USUAL: Overlap = Overlap { least: 0.6, most: 0.8 };

    fn middle(&self) -> f64 {
        0.5 * (self.least + self.most)
    }

    /// With so much more of the picture new from one frame to the next.
    fn wider(&self, factor: f64) -> Overlap {
        let share = |of: f64| (1.0 - factor * (1.0 - of)).max(0.05);
        Overlap { least: share(self.least), most: share(self.most) }
    }
}

/// A frame that was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Its place among the facts.
    pub at: usize,
    /// What it has in common with the one chosen before; `None` for the first.
    pub overlap: Option<f64>,
}

/// Why two neighbours have less in common than is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The picture jumps: a cut, or a motion faster than the frame rate shows.
    Jump,
    /// All frames between are blurred.
    Blur,
}

/// A place where neighbours have too little in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Break {
    /// Times of the frames chosen on either side, seconds.
    pub from: f64,
    pub to: f64,
    pub overlap: f64,
    pub cause: Cause,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    pub choices: Vec<Choice>,
    pub breaks: Vec<Break>,
    /// Share of the frames that are blurred.
    pub blurred: f64,
}

/// A frame's detail below which it is blurred, whatever it shows.
const BLURRED: f64 = 0.08;
/// A frame's sharpness beside that of the sharper ones around it, below which it is blurred.
const BESIDE: f64 = 0.35;
/// How far around, seconds.
const AROUND: f64 = 2.0;
/// Frames that have more in common are as good as one.
const SAME: f64 = 0.95;

/// Chooses frames of one video. Fewer than `most`, if that is given: then neighbours have less in common.
pub fn select(facts: &[Facts], aspect: f64, most: Option<usize>) -> Selection {
    let sharp = sharp(facts);
    let blurred = sharp.iter().filter(|sharp| !**sharp).count() as f64 / facts.len().max(1) as f64;
    let by = |overlap: &Overlap| choose(facts, &sharp, aspect, overlap);
    let mut selection = by(&Overlap::USUAL);
    if let Some(most) = most.filter(|most| selection.choices.len() > *most) {
        // More and more new from one frame to the next.
        const FACTOR: f64 = 1.05;
        let mut factor = 1.0;
        while selection.choices.len() > most && factor < 20.0 {
            factor *= FACTOR;
            selection = by(&Overlap::USUAL.wider(factor));
        }
        thin(&mut selection.choices, most, facts, aspect);
    }
    selection.blurred = blurred;
    selection
}

/// Leaves so many, evenly.
fn thin(choices: &mut Vec<Choice>, most: usize, facts: &[Facts], aspect: f64) {
    let count = choices.len();
    if count <= most {
        return;
    }
    let kept: Vec<usize> = (0..most).map(|i| choices[i * count / most.max(1)].at).collect();
    *choices = with_overlaps(&kept, facts, aspect);
}

fn with_overlaps(chosen: &[usize], facts: &[Facts], aspect: f64) -> Vec<Choice> {
    let before = std::iter::once(None).chain(chosen.iter().copied().map(Some));
    let overlap = |(before, at): (Option<usize>, &usize)| Choice {
        at: *at,
        overlap: before.map(|before| facts[before].overlap(&facts[*at], aspect)),
    };
    before.zip(chosen).map(overlap).collect()
}

/// Which frames are sharp, beside those around them and by themselves.
fn sharp(facts: &[Facts]) -> Vec<bool> {
    let (mut from, mut to) = (0, 0);
    let mut around: Vec<f64> = Vec::new();
    let sharp = |fact: &Facts| {
        while facts[from].time < fact.time - AROUND {
            from += 1;
        }
        while to < facts.len() && facts[to].time <= fact.time + AROUND {
            to += 1;
        }
        around.clear();
        around.extend(facts[from..to.max(from + 1)].iter().map(|other| other.sharpness));
        // The upper quartile.
        let at = around.len() * 3 / 4;
        let (_, usual, _) = around.select_nth_unstable_by(at, f64::total_cmp);
        fact.sharpness >= BESIDE * *usual && fact.detail >= BLURRED
    };
    facts.iter().map(sharp).collect()
}

fn choose(facts: &[Facts], sharp: &[bool], aspect: f64, wanted: &Overlap) -> Selection {
    let mut chosen: Vec<usize> = Vec::new();
    let mut breaks = Vec::new();
    let Some(mut last) = first(facts, sharp, aspect, 0) else { return Selection::default() };
    chosen.push(last);
    while let Some((next, cause)) = next(facts, sharp, aspect, wanted, last) {
        let overlap = facts[last].overlap(&facts[next], aspect);
        if overlap < wanted.least {
            let (from, to) = (facts[last].time, facts[next].time);
            breaks.push(Break { from, to, overlap, cause });
        }
        chosen.push(next);
        last = next;
    }
    Selection { choices: with_overlaps(&chosen, facts, aspect), breaks, blurred: 0.0 }
}

/// The sharpest of the frames that show nearly what the first sharp one from `from` on shows.
fn first(facts: &[Facts], sharp: &[bool], aspect: f64, from: usize) -> Option<usize> {
    let start = (from..facts.len()).find(|at| sharp[*at])?;
    let same = |at: &usize| facts[start].overlap(&facts[*at], aspect) >= SAME;
    sharpest(facts, sharp, (start..facts.len()).take_while(same))
}

/// The sharpest frame; of equally sharp ones the first.
fn sharpest(facts: &[Facts], sharp: &[bool], among: impl Iterator<Item = usize>) -> Option<usize> {
    let better = |best: Option<usize>, at: usize| match best {
        Some(best) if facts[best].sharpness >= facts[at].sharpness => Some(best),
        _ => Some(at),
    };
    among.filter(|at| sharp[*at]).fold(None, better)
}

/// The next frame to take after `last`, and why it may have little in common with that.
fn next(
    facts: &[Facts],
    sharp: &[bool],
    aspect: f64,
    wanted: &Overlap,
    last: usize,
) -> Option<(usize, Cause)> {
    let overlap = |at: usize| facts[last].overlap(&facts[at], aspect);
    let after = last + 1..facts.len();
    let enough = after.clone().take_while(|at| overlap(*at) >= wanted.least);
    let end = last + 1 + enough.count();
    let within = last + 1..end;
    let window = within.clone().filter(|at| overlap(*at) <= wanted.most);
    if let Some(best) = sharpest(facts, sharp, window) {
        return Some((best, Cause::Jump));
    }
    // None is sharp, or the picture leaves the window in one step: the farthest sharp one before.
    let before = within.filter(|at| sharp[*at] && overlap(*at) < SAME);
    let nearest = |best: Option<usize>, at: usize| match best {
        Some(best) if overlap(best) <= overlap(at) => Some(best),
        _ => Some(at),
    };
    if let Some(best) = before.fold(None, nearest) {
        // At the end of the video the picture need not move on.
        let ends = end == facts.len() && overlap(best) > 0.5 * (1.0 + wanted.middle());
        return (!ends).then_some((best, Cause::Jump));
    }
    if end == facts.len() {
        return None;
    }
    let cause = if sharp[end] { Cause::Jump } else { Cause::Blur };
    let start = (end..facts.len()).find(|at| sharp[*at])?;
    // A step beyond the window that still has something in common is taken as it is.
    if overlap(start) > 0.3 {
        Some((start, cause))
    } else {
        Some((first(facts, sharp, aspect, start)?, cause))
    }
}

//! Which frames of a video a mapping takes: sharp ones, of which neighbours overlap.

use super::analysis::Facts;
use super::decoder::DecoderChoice;

/// What is wanted of the frames.
#[derive(Clone, Copy, Debug)]
pub struct ChoiceOptions {
    pub decoder: DecoderChoice,
    /// Share that neighbours have in common, about: 0.2 to 0.9.
    pub overlap: f64,
    /// At most so many frames of all videos together.
    pub most: Option<usize>,
    /// Longest side to which pictures will be reduced for matching, pixels: only the estimate of time depends on it.
    pub matched: u32,
}

impl Default for ChoiceOptions {
    /// Enough for matching from both sides, and not so much that pictures repeat each other.
    fn default() -> ChoiceOptions {
        ChoiceOptions { decoder: DecoderChoice::Auto, overlap: 0.7, most: None, matched: 1280 }
    }
}

/// Neighbours have this share of the picture in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    pub least: f64,
    pub best: f64,
    pub most: f64,
    /// Frames that have more in common are as good as one.
    pub same: f64,
}

impl Overlap {
    /// About a share: ten hundredths more or less.
    pub fn about(share: f64) -> Overlap {
        const EITHER_WAY: f64 = 0.1;
        let most = (share + EITHER_WAY).min(SAME);
        Overlap { least: share - EITHER_WAY, best: share, most, same: SAME }
    }

    /// With so much more of the picture new from one frame to the next, or less.
    fn wider(&self, factor: f64) -> Overlap {
        let share = |of: f64| (1.0 - factor * (1.0 - of)).max(0.05);
        let same = share(self.same).max(self.same);
        Overlap { least: share(self.least), best: share(self.best), most: share(self.most), same }
    }
}

/// A frame that was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Its place among the facts.
    pub at: usize,
    /// What it has in common with the one chosen before; `None` for the first.
    pub overlap: Option<f64>,
    /// Poses are found on these; those of the others follow from them.
    pub first: bool,
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
    /// Times of the last frame before it and of the one chosen after it, seconds.
    pub from: f64,
    pub to: f64,
    pub overlap: f64,
    pub cause: Cause,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    pub choices: Vec<Choice>,
    pub breaks: Vec<Break>,
    /// The chosen frames look blurred by themselves. A scene without any fine texture looks so, too.
    pub blurred: bool,
}

/// Detail below which frames look blurred. Of the drawn quay a Gaussian of 3 pixels in a width of 1280 leaves 0.17, one
/// of 5 pixels 0.09, a camera that moves by 48 pixels 0.14; sharp it has 0.47.
const BLURRED: f64 = 0.15;
/// A frame's sharpness beside that of the sharper ones around it, below which it is blurred; and how far around,
/// seconds.
const SHARPNESS: (f64, f64) = (0.35, 2.0);
/// The same for its detail, which longer blur takes away.
const DETAIL: (f64, f64) = (0.3, 10.0);
/// With less in common, a new part of the dive begins.
const LITTLE: f64 = 0.3;
/// Frames that are nearly as sharp as the sharpest are as good.
const AS_SHARP: f64 = 0.9;
/// Frames that have more in common are as good as one, for poses.
const SAME: f64 = 0.95;
/// Frames for the training have so much in common, if they are at least so many; else more, up to what still moves.
pub const MANY: f64 = 0.92;
pub const LEAST: usize = 60;
const MOVES: f64 = 0.99;

/// Chooses frames of one video. At most `most`, if that is given: then neighbours have less in common than wanted.
pub fn select(facts: &[Facts], aspect: f64, wanted: &Overlap, most: Option<usize>) -> Selection {
    let sharp = sharp(facts);
    let by = |overlap: &Overlap| choose(facts, &sharp, aspect, overlap);
    let mut selection = by(wanted);
    if let Some(most) = most.filter(|most| selection.choices.len() > *most) {
        // More and more new from one frame to the next.
        const FACTOR: f64 = 1.05;
        let mut factor = 1.0;
        while selection.choices.len() > most && factor < 20.0 {
            factor *= FACTOR;
            selection = by(&wanted.wider(factor));
        }
        thin(&mut selection.choices, most, facts, aspect);
    }
    let mut details: Vec<f64> = selection.choices.iter().map(|of| facts[of.at].detail).collect();
    details.sort_by(f64::total_cmp);
    selection.blurred = details.get(details.len() / 2).is_some_and(|detail| *detail < BLURRED);
    selection
}

/// Adds frames for the training: their neighbours overlap more than those that poses are found on. At most `most` in
/// all, if that is given.
pub fn add_frames(
    selection: &mut Selection,
    facts: &[Facts],
    aspect: f64,
    (wanted, most): (&Overlap, Option<usize>),
) {
    // Where nothing moves one frame is enough.
    let first: Vec<usize> = selection.choices.iter().map(|choice| choice.at).collect();
    if first.len() < 2 {
        return;
    }
    const DENSER: f64 = 0.8;
    let sharp = sharp(facts);
    let mut share = wanted.best.max(MANY);
    let mut all: Vec<usize> = Vec::new();
    while all.len() < LEAST && share < MOVES {
        let overlap = wanted.wider((1.0 - share) / (1.0 - wanted.best));
        let more = choose(facts, &sharp, aspect, &overlap).choices;
        all = first.iter().copied().chain(more.iter().map(|choice| choice.at)).collect();
        all.sort_unstable();
        all.dedup();
        share = 1.0 - DENSER * (1.0 - share);
    }
    if let Some(room) = most.map(|most| most.saturating_sub(first.len())) {
        let others: Vec<usize> = all.into_iter().filter(|at| !first.contains(at)).collect();
        let count = others.len();
        let some = (0..room.min(count)).map(|i| others[i * count / room.min(count)]);
        all = first.iter().copied().chain(some).collect();
        all.sort_unstable();
    }
    selection.choices = with_overlaps(&all, facts, aspect);
    let of_first = |choice: &mut Choice| choice.first = first.binary_search(&choice.at).is_ok();
    selection.choices.iter_mut().for_each(of_first);
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
        first: true,
    };
    before.zip(chosen).map(overlap).collect()
}

/// Which frames are sharp, beside those around them.
fn sharp(facts: &[Facts]) -> Vec<bool> {
    let by_sharpness = beside(facts, SHARPNESS, |fact| fact.sharpness);
    let by_detail = beside(facts, DETAIL, |fact| fact.detail);
    by_sharpness.into_iter().zip(by_detail).map(|(a, b)| a && b).collect()
}

/// Whether each frame has at least a share of what the upper quartile of those around it has.
fn beside(facts: &[Facts], (share, around): (f64, f64), of: impl Fn(&Facts) -> f64) -> Vec<bool> {
    /// Frames around that are looked at; of more, some.
    const MOST: usize = 200;
    let (mut from, mut to) = (0, 0);
    let enough = |fact: &Facts| {
        while facts[from].time < fact.time - around {
            from += 1;
        }
        while to < facts.len() && facts[to].time <= fact.time + around {
            to += 1;
        }
        let some = facts[from..to].iter().step_by((to - from).div_ceil(MOST).max(1));
        let mut values: Vec<f64> = some.map(&of).collect();
        let at = values.len() * 3 / 4;
        let (_, usual, _) = values.select_nth_unstable_by(at, f64::total_cmp);
        of(fact) >= share * *usual
    };
    facts.iter().map(enough).collect()
}

fn choose(facts: &[Facts], sharp: &[bool], aspect: f64, wanted: &Overlap) -> Selection {
    let mut chosen: Vec<usize> = Vec::new();
    let mut breaks = Vec::new();
    let Some(mut last) = first(facts, sharp, (aspect, wanted.same), 0) else {
        return Selection::default();
    };
    chosen.push(last);
    while let Some(Next { at, broken }) = next(facts, sharp, aspect, wanted, last) {
        let overlap = facts[last].overlap(&facts[at], aspect);
        if let Some((cause, from)) = broken.filter(|_| overlap < wanted.least) {
            breaks.push(Break { from: facts[from].time, to: facts[at].time, overlap, cause });
        }
        chosen.push(at);
        last = at;
    }
    Selection { choices: with_overlaps(&chosen, facts, aspect), breaks, blurred: false }
}

/// The sharpest of the frames that show nearly what the first sharp one from `from` on shows.
fn first(
    facts: &[Facts],
    sharp: &[bool],
    (aspect, same): (f64, f64),
    from: usize,
) -> Option<usize> {
    let start = (from..facts.len()).find(|at| sharp[*at])?;
    let same = |at: &usize| facts[start].overlap(&facts[*at], aspect) >= same;
    sharpest(facts, sharp, (start..facts.len()).take_while(same), |_| 0.0)
}

/// Of the frames that are nearly as sharp as the sharpest, the one that is least `far`; of those the first.
fn sharpest(
    facts: &[Facts],
    sharp: &[bool],
    among: impl Iterator<Item = usize>,
    far: impl Fn(usize) -> f64,
) -> Option<usize> {
    let among: Vec<usize> = among.filter(|at| sharp[*at]).collect();
    let most = among.iter().map(|at| facts[*at].sharpness).fold(0.0, f64::max);
    let good = among.into_iter().filter(|at| facts[*at].sharpness >= AS_SHARP * most);
    good.min_by(|a, b| far(*a).total_cmp(&far(*b)))
}

/// The frame to take next.
struct Next {
    at: usize,
    /// Why it may have too little in common with the last one, and the last frame before that.
    broken: Option<(Cause, usize)>,
}

fn next(
    facts: &[Facts],
    sharp: &[bool],
    aspect: f64,
    wanted: &Overlap,
    last: usize,
) -> Option<Next> {
    let overlap = |at: usize| facts[last].overlap(&facts[at], aspect);
    let near = |at: usize| Next { at, broken: None };
    let enough = (last + 1..facts.len()).take_while(|at| overlap(*at) >= wanted.least);
    let end = last + 1 + enough.count();
    let within = last + 1..end;
    let window = within.clone().filter(|at| overlap(*at) <= wanted.most);
    let far = |at: usize| (overlap(at) - wanted.best).abs();
    if let Some(best) = sharpest(facts, sharp, window, far) {
        return Some(near(best));
    }
    if end == facts.len() {
        // The video ends before the picture has moved on. What is new at its end is worth a frame.
        let new = within.filter(|at| overlap(*at) <= 0.5 * (1.0 + wanted.best));
        return sharpest(facts, sharp, new, overlap).map(near);
    }
    // None is sharp, or the picture leaves the window in one step: the farthest sharp one before.
    let before = within.filter(|at| sharp[*at] && overlap(*at) < wanted.same);
    if let Some(best) = before.min_by(|a, b| overlap(*a).total_cmp(&overlap(*b))) {
        return Some(near(best));
    }
    let broken = Some(if sharp[end] { (Cause::Jump, end - 1) } else { (Cause::Blur, last) });
    let start = (end..facts.len()).find(|at| sharp[*at])?;
    // What still has something in common is taken as it is.
    let whole = (aspect, wanted.same);
    let at = if overlap(start) > LITTLE { start } else { first(facts, sharp, whole, start)? };
    Some(Next { at, broken })
}

#[cfg(test)]
mod tests {
    use super::super::motion::Similarity;
    use super::*;

    const ASPECT: f64 = 0.5625;
    /// Frames per second.
    const RATE: f64 = 25.0;

    /// Frames whose camera has gone so many widths of the picture.
    fn facts(way: impl IntoIterator<Item = f64>) -> Vec<Facts> {
        let fact = |(index, x): (usize, f64)| Facts {
            index,
            time: index as f64 / RATE,
            sharpness: 100.0 * (1.0 + 0.02 * ((index * 37 % 11) as f64 / 11.0)),
            detail: 0.4,
            stretch: 0,
            place: Similarity { t: [x, 0.0], ..Similarity::IDENTITY },
        };
        way.into_iter().enumerate().map(fact).collect()
    }

    fn steady(frames: usize, step: f64) -> Vec<Facts> {
        facts((0..frames).map(|i| step * i as f64))
    }

    fn usual(facts: &[Facts]) -> Selection {
        select(facts, ASPECT, &Overlap::about(0.7), None)
    }

    #[test]
    fn more_overlap_takes_more_frames() {
        let facts = steady(1000, 0.005);
        let [some, more] =
            [0.5, 0.9].map(|share| select(&facts, ASPECT, &Overlap::about(share), None));
        assert!(more.choices.len() > 4 * some.choices.len() && more.breaks.is_empty());
        assert!(overlaps(&more).iter().all(|overlap| (0.8..=0.95).contains(overlap)));
    }

    fn overlaps(selection: &Selection) -> Vec<f64> {
        selection.choices.iter().filter_map(|choice| choice.overlap).collect()
    }

    #[test]
    fn neighbours_overlap_as_wanted_at_any_speed() {
        for step in [0.002, 0.01, 0.04, 0.15] {
            let facts = steady(1000, step);
            let selection = usual(&facts);
            let expected = 1000.0 * step / 0.3;
            let count = selection.choices.len() as f64;
            assert!((0.9 * expected..1.2 * expected + 3.0).contains(&count), "{step}: {count}");
            assert!(selection.breaks.is_empty() && !selection.blurred);
            let within = overlaps(&selection);
            assert!(within.iter().all(|overlap| (0.6..=0.9).contains(overlap)), "{within:?}");
        }
    }

    #[test]
    fn a_camera_that_stands_gives_few_frames() {
        let stands = facts((0..3000).map(|i| 0.03 * (f64::from(i) * 0.01).sin()));
        assert_eq!(usual(&stands).choices.len(), 1);
        let goes = (0..100).map(|i| 0.01 * f64::from(i));
        let way = goes.clone().chain([0.99; 2000]).chain(goes.map(|x| 0.99 + x));
        let count = usual(&facts(way)).choices.len();
        assert!((6..=10).contains(&count), "{count}");
    }

    #[test]
    fn sharp_frames_are_taken() {
        let mut facts = steady(500, 0.01);
        // Every fifth frame is sharp.
        facts.iter_mut().filter(|fact| fact.index % 5 != 3).for_each(|fact| fact.sharpness *= 0.5);
        let selection = usual(&facts);
        assert!(selection.choices.len() > 12);
        assert!(selection.choices.iter().all(|choice| choice.at % 5 == 3), "{selection:?}");
    }

    #[test]
    fn where_all_is_plain_frames_are_taken_all_the_same() {
        let mut facts = steady(1000, 0.01);
        facts[500..].iter_mut().for_each(|fact| fact.sharpness *= 0.02);
        let selection = usual(&facts);
        let plain = selection.choices.iter().filter(|choice| choice.at >= 500).count();
        assert!(plain > 12 && selection.breaks.len() <= 1, "{plain} {selection:?}");
    }

    #[test]
    fn cuts_jumps_and_blur_break_the_dive() {
        let mut cut = steady(600, 0.01);
        cut[300..].iter_mut().for_each(|fact| fact.stretch = 1);
        let [only] = usual(&cut).breaks[..] else { panic!() };
        assert!(only.cause == Cause::Jump && only.overlap == 0.0 && only.from < only.to);
        assert!((only.to - 12.0).abs() < 0.5 && (only.from - 11.96).abs() < 1e-9, "{only:?}");
        let mut blurred = steady(600, 0.01);
        for fact in &mut blurred[300..400] {
            fact.sharpness *= 0.1;
            fact.detail *= 0.1;
        }
        let selection = usual(&blurred);
        let [only] = selection.breaks[..] else { panic!("{:?}", selection.breaks) };
        assert!(only.cause == Cause::Blur && only.overlap < 0.1, "{only:?}");
        assert!(selection.choices.iter().all(|choice| !(300..400).contains(&choice.at)));
    }

    /// How many frames there are for the training, and for poses.
    fn counts(facts: &[Facts], most: Option<usize>) -> [usize; 2] {
        let wanted = Overlap::about(0.7);
        let mut selection = select(facts, ASPECT, &wanted, most);
        let first = selection.choices.clone();
        add_frames(&mut selection, facts, ASPECT, (&wanted, most));
        let all = &selection.choices;
        let again: Vec<usize> = all.iter().filter(|of| of.first).map(|of| of.at).collect();
        assert_eq!(again, first.iter().map(|of| of.at).collect::<Vec<_>>());
        assert!(all.is_sorted_by(|a, b| a.at < b.at));
        [all.len(), first.len()]
    }

    #[test]
    fn a_training_takes_many_frames() {
        // A short clip: five frames for poses, at least sixty to train on.
        let [many, few] = counts(&steady(333, 0.0035), None);
        assert!((60..=110).contains(&many) && (4..=6).contains(&few), "{many} {few}");
        // All that there are, and all that are sharp.
        let [many, few] = counts(&steady(30, 0.05), None);
        assert!(many == 30 && few < 10, "{many} {few}");
        let mut blurred = steady(60, 0.05);
        blurred
            .iter_mut()
            .filter(|fact| fact.index % 2 == 1)
            .for_each(|fact| fact.sharpness *= 0.1);
        assert_eq!(counts(&blurred, None)[0], 30);
        // A long one, of 40 pictures' width: neighbours have up to 92 % in common, and those for poses come to these.
        let [many, few] = counts(&steady(4000, 0.01), None);
        assert!((450..=640).contains(&many) && (120..=150).contains(&few), "{many} {few}");
        // What stands stays one frame.
        let goes = (0..100).map(|i| 0.01 * f64::from(i));
        let way = goes.clone().chain([0.99; 2000]).chain(goes.map(|x| 0.99 + x));
        assert!(counts(&facts(way), None)[0] < 200);
        assert_eq!(counts(&facts([0.3; 3000]), None), [1, 1]);
        for most in [3, 20, 80] {
            let [many, few] = counts(&steady(4000, 0.01), Some(most));
            assert!(many <= most && few <= many, "{many} {few} of {most}");
        }
    }

    #[test]
    fn no_more_frames_than_wanted_and_evenly() {
        let facts = steady(2000, 0.02);
        for most in [2, 7, 50, 90] {
            let selection = select(&facts, ASPECT, &Overlap::about(0.7), Some(most));
            let count = selection.choices.len();
            assert!(count <= most && count + count / 4 + 1 >= most, "{count} of {most}");
            let gaps = selection.choices.windows(2).map(|pair| pair[1].at - pair[0].at);
            let (least, longest) =
                gaps.fold((usize::MAX, 0), |(a, b), gap| (a.min(gap), b.max(gap)));
            assert!(longest < 3 * least || most == 2, "{least} {longest}");
        }
    }

    #[test]
    fn a_video_without_detail_is_told() {
        let mut facts = steady(300, 0.01);
        facts.iter_mut().for_each(|fact| fact.detail = 0.02);
        assert!(usual(&facts).blurred);
        assert_eq!(usual(&[]), Selection::default());
    }
}

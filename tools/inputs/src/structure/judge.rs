//! What gives reason to doubt poses that were found, before hours of training.

use glam::DVec3;
use nvsprior::geometry::Distortion;

use super::DEPTH;
use crate::colmap::ColmapModel;
use crate::navigation::Alignment;
use crate::posed::PosedPictures;

/// Reprojection error, pixels of the pictures as they were matched. Good poses have 0.3 to 0.8.
const ERROR: f64 = 1.2;
/// How much a lens's focal lengths may differ: pixels are square.
const SQUARE: f64 = 0.03;
/// Widths of view of lenses, degrees.
const VIEW: [f64; 2] = [15.0, 140.0];
/// Distortions of lenses, k1 and k2.
const BENT: f64 = 1.5;
/// A step from one picture to the next that is so many times the median is a jump, if it is as long as [`FAR`].
const JUMP: f64 = 12.0;
/// In median depths of the scene.
const FAR: f64 = 0.5;
/// How far the cameras must lie apart, in median depths of the scene.
const SPAN: f64 = 0.1;

/// How far poses may be off the stated places, of the course's width.
const ELSEWHERE: f64 = 0.1;

/// How far a stated focal length moves if it may, if it is wrong. A right one of the reef's pictures of 320×180 moves
/// by 1 %.
const STATED_LENS: f64 = 0.04;

/// A reason to doubt the poses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Doubtful {
    #[error(
        "the points miss their places by {pixels:.2} pixels of the matched pictures (good poses: 0.3 to 0.8): check \
         that one lens took all pictures, or give a calibrated one with --camera"
    )]
    Error { pixels: f64 },
    #[error(
        "the lens that came out is no real one ({what}), so the scene is warped: give pictures at full size, or the \
         calibrated lens with --camera"
    )]
    Lens { what: String },
    #[error(
        "the pictures fit better with a focal length of {found:.0} pixels, or one farther off, than with the \
         {stated:.0} that were stated: was the lens calibrated in air, or at another size? Leave the numbers of \
         --camera out, or calibrate it in the water"
    )]
    StatedLens { stated: f64, found: f64 },
    #[error(
        "from {from} to {to} the camera jumps {times:.0} times as far as it usually goes: something is missing there, \
         or the scale changes; look at the held-out PSNR, or map the two parts by themselves"
    )]
    Jump { from: String, to: String, times: f64 },
    #[error(
        "the cameras span {span:.3} depths of the scene: what lies near and what lies far cannot be told apart; move \
         the camera sideways, by a third of the distance to the scene or more"
    )]
    Span { span: f64 },
    #[error(
        "the poses do not fit the places that the vehicle states: they are {off:.1} m off, over a course {span:.1} m \
         wide; one of the two is wrong"
    )]
    Elsewhere { off: f64, span: f64 },
    #[error(
        "{left_out}: they fall into pieces of {pieces} pictures that nothing joins, of which the largest is taken; \
         film a way from one to the other, or map each by itself"
    )]
    Pieces { left_out: String, pieces: String },
    #[error(
        "{left_out}: they have {percent:.0} % of the others' contrast, as in darkness or silt; film that part again \
         with more light, or in clearer water"
    )]
    Dim { left_out: String, percent: f64 },
    #[error(
        "{left_out}: nothing joins them to the others; take pictures that overlap more (of a video with --overlap \
         85){}",
        if *all_compared { "" } else { ", or compare all of them with --matching exhaustive" }
    )]
    Alone { left_out: String, all_compared: bool },
}

/// Mean of the points' errors, pixels.
pub fn reprojection_error(posed: &PosedPictures) -> Option<f64> {
    let points = posed.points.as_deref().unwrap_or_default();
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for error in points.iter().filter_map(|point| point.error) {
        sum += error;
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}

/// All reasons to doubt poses, in the unit of [`DEPTH`]. `size`: longest side of the pictures as they were matched.
pub fn doubtful(posed: &PosedPictures, size: u32, error: Option<f64>) -> Vec<Doubtful> {
    let mut reasons = Vec::new();
    reasons.extend(error.and_then(|error| large_error(posed, size, error)));
    reasons.extend(no_lens(posed));
    reasons.extend(jump(posed));
    reasons.extend(small_span(posed));
    reasons
}

/// Whether a stated lens does not fit. `freed`: the poses as they become if the focal length may change.
pub fn stated_lens(posed: &PosedPictures, freed: &ColmapModel) -> Option<Doubtful> {
    let input = posed.inputs.first()?;
    let view = freed.views.iter().find(|view| view.name == input.name)?;
    let [stated, found] = [&input.lens, &view.lens].map(|lens| lens.intrinsics().fx);
    let off = (found / stated - 1.0).abs();
    (off > STATED_LENS).then_some(Doubtful::StatedLens { stated, found })
}

/// Whether poses do not fit a stated course.
pub fn elsewhere(alignment: &Alignment) -> Option<Doubtful> {
    let (off, span) = (alignment.off?, alignment.span?);
    (off > ELSEWHERE * span).then_some(Doubtful::Elsewhere { off, span })
}

fn large_error(posed: &PosedPictures, size: u32, error: f64) -> Option<Doubtful> {
    let (width, height) = posed.inputs.first()?.lens.size();
    let reduced = (f64::from(size) / f64::from(width.max(height).max(1))).min(1.0);
    let pixels = error * reduced;
    (pixels > ERROR).then_some(Doubtful::Error { pixels })
}

fn no_lens(posed: &PosedPictures) -> Option<Doubtful> {
    posed.inputs.iter().find_map(|input| {
        let lens = input.lens.intrinsics();
        let ratio = lens.fx / lens.fy;
        let view = 2.0 * (0.5 * f64::from(lens.width) / lens.fx).atan().to_degrees();
        let bent = match *input.lens.distortion() {
            Distortion::Brown([k1, k2, ..]) => k1.abs().max(k2.abs()),
            Distortion::None | Distortion::Fisheye(_) => 0.0,
        };
        let what = if (ratio - 1.0).abs() > SQUARE {
            format!("focal lengths {:.0} and {:.0}", lens.fx, lens.fy)
        } else if !(VIEW[0]..=VIEW[1]).contains(&view) {
            format!("it would see {view:.0}°")
        } else if bent > BENT {
            format!("distortion {bent:.1}")
        } else {
            return None;
        };
        Some(Doubtful::Lens { what })
    })
}

/// The largest step from a picture to the next one by name, if it is a jump.
fn jump(posed: &PosedPictures) -> Option<Doubtful> {
    let step =
        |pair: &[crate::posed::PosedInput]| pair[0].pose.centre().distance(pair[1].pose.centre());
    let steps: Vec<f64> = posed.inputs.windows(2).map(step).collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let median = *sorted.get(sorted.len() / 2)?;
    let (at, longest) = steps.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    let times = longest / median;
    let [from, to] = [at, at + 1].map(|i| posed.inputs[i].name.clone());
    (times > JUMP && *longest > FAR * DEPTH).then_some(Doubtful::Jump { from, to, times })
}

fn small_span(posed: &PosedPictures) -> Option<Doubtful> {
    let mut centres = posed.inputs.iter().map(|input| input.pose.centre());
    let first = centres.next()?;
    let (low, high) = centres
        .fold((first, first), |(low, high), centre: DVec3| (low.min(centre), high.max(centre)));
    let span = low.distance(high) / DEPTH;
    (span < SPAN).then_some(Doubtful::Span { span })
}

#[cfg(test)]
mod tests {
    use nvsprior::Pose;
    use nvsprior::geometry::{Intrinsics, Lens};

    use super::*;
    use crate::colmap::ColmapView;
    use crate::points::Point;
    use crate::posed::PosedInput;

    fn input(i: usize, x: f64, f: [f64; 2], k1: f64) -> PosedInput {
        let intrinsics =
            Intrinsics { width: 640, height: 360, fx: f[0], fy: f[1], cx: 320.0, cy: 180.0 };
        let distortion = match k1 == 0.0 {
            true => Distortion::None,
            false => Distortion::brown(&[k1, 0.0, 0.0, 0.0]).unwrap(),
        };
        PosedInput {
            name: format!("{i}.png"),
            file: format!("{i}.png").into(),
            lens: Lens::new(intrinsics, distortion).unwrap(),
            pose: Pose { translation: DVec3::new(x, 0.0, 0.0), ..Pose::IDENTITY },
            split: None,
            mask: None,
        }
    }

    fn run(places: &[f64], f: [f64; 2], k1: f64) -> PosedPictures {
        let inputs = places.iter().enumerate().map(|(i, x)| input(i, *x, f, k1)).collect();
        let point = Point { position: DVec3::Z, rgb: None, error: Some(0.9), track: None };
        PosedPictures { inputs, points: Some(vec![point, Point { error: Some(1.1), ..point }]) }
    }

    const F: [f64; 2] = [550.0, 548.0];
    const STEADY: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];

    #[test]
    fn good_poses_give_no_reason() {
        let posed = run(&STEADY, F, 0.2);
        assert_eq!(reprojection_error(&posed), Some(1.0));
        assert_eq!(doubtful(&posed, 640, Some(1.0)), []);
        // The same error in pictures that were matched at half their size is half of it.
        assert_eq!(doubtful(&posed, 320, Some(2.0)), []);
    }

    #[test]
    fn each_reason_is_said() {
        let said = |posed: &PosedPictures, error: f64| {
            let reasons = doubtful(posed, 640, Some(error));
            assert_eq!(reasons.len(), 1, "{reasons:?}");
            reasons[0].to_string()
        };
        assert!(said(&run(&STEADY, F, 0.0), 1.3).contains("by 1.30 pixels"));
        assert!(said(&run(&STEADY, [279.0, 255.0], 0.0), 0.4).contains("lengths 279 and 255"));
        assert!(said(&run(&STEADY, [9_000.0; 2], 0.0), 0.4).contains("see 4°"));
        assert!(said(&run(&STEADY, F, 1.8), 0.4).contains("distortion 1.8"));
        let jump = said(&run(&[0.0, 0.2, 0.4, 5.4, 5.6, 5.8], F, 0.0), 0.4);
        assert!(jump.contains("2.png to 3.png") && jump.contains("25 times"), "{jump}");
        assert!(said(&run(&[0.0, 0.01, 0.02], F, 0.0), 0.4).contains("span 0.005"));
    }

    #[test]
    fn a_lens_that_was_calibrated_in_air_is_told() {
        let posed = run(&STEADY, F, 0.0);
        let freed = |f: f64| {
            let PosedInput { name, pose, lens, .. } = input(0, 0.0, [f, f], 0.0);
            ColmapModel { views: vec![ColmapView { name, pose, lens }], points: Vec::new() }
        };
        assert_eq!(stated_lens(&posed, &freed(560.0)), None);
        let said = stated_lens(&posed, &freed(610.0)).unwrap().to_string();
        assert!(said.contains("610") && said.contains("550"), "{said}");
    }
}

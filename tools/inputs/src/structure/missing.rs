//! Why pictures have no pose.

use std::path::Path;

use super::Matching;
use super::judge::Doubtful;
use super::pairs::{ALL, luma};
use crate::frame_file::open_image;

/// Share of the pictures without a pose that deserves a word.
const MANY: f64 = 0.2;
/// Pictures that are looked at, of those with a pose and of those without.
const SOME: usize = 16;
/// The size at which they are looked at: noise is gone.
const SIZE: (u32, u32) = (160, 90);
/// With so little of the others' contrast pictures are dark, or show silt.
const DIM: f64 = 0.4;

/// What to say of pictures without a pose, if there are many. `pieces`: how many pictures each piece has, the largest
/// first.
pub fn reason(
    folder: &Path,
    (found, missing): (&[&String], &[String]),
    pieces: &[usize],
    matching: Matching,
) -> Option<Doubtful> {
    let pictures = found.len() + missing.len();
    if missing.len() as f64 <= MANY * pictures as f64 {
        return None;
    }
    let left_out = format!(
        "{} of {pictures} pictures have no pose, and the prior will not show what only they show",
        missing.len()
    );
    if pieces.len() > 1 {
        let pieces: Vec<_> = pieces.iter().map(usize::to_string).collect();
        return Some(Doubtful::Pieces { left_out, pieces: pieces.join(", ") });
    }
    let own = contrast(folder, missing.iter());
    let share = own.zip(contrast(folder, found.iter().copied())).map(|(own, of)| own / of);
    if let Some(share) = share.filter(|share| *share < DIM) {
        return Some(Doubtful::Dim { left_out, percent: 100.0 * share });
    }
    let all_compared = matching == Matching::Exhaustive || pictures <= ALL;
    Some(Doubtful::Alone { left_out, all_compared })
}

/// The median contrast of some pictures: the standard deviation of their luma. None if one cannot be read.
fn contrast<'a>(folder: &Path, names: impl ExactSizeIterator<Item = &'a String>) -> Option<f64> {
    let every = names.len().div_ceil(SOME).max(1);
    let of = |name: &String| Some(deviation(&luma(&open_image(&folder.join(name)).ok()?, SIZE)));
    let mut all = names.step_by(every).map(of).collect::<Option<Vec<f64>>>()?;
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

fn deviation(values: &[f32]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().copied().map(f64::from).sum::<f64>() / count;
    let square = values.iter().map(|value| (f64::from(*value) - mean).powi(2));
    (square.sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};

    use super::*;

    /// Six pictures; those from the fourth on have a share of the first ones' contrast, and noise.
    fn pictures(share: f64) -> (tempfile::TempDir, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<String> = (0..6).map(|i| format!("{i}.png")).collect();
        for (i, name) in names.iter().enumerate() {
            let share = if i < 3 { 1.0 } else { share };
            let noise = |x: u32, y: u32| f64::from((x * 7919 + y * 104_729) % 31) - 15.0;
            let value = |x, y| 40.0 + share * (60.0 + 50.0 * f64::from(x / 80 % 2)) + noise(x, y);
            let picture = GrayImage::from_fn(640, 360, |x, y| Luma([value(x, y) as u8]));
            picture.save(folder.path().join(name)).unwrap();
        }
        (folder, names)
    }

    fn said(share: f64, count: usize, pieces: &[usize]) -> Option<String> {
        let (folder, names) = pictures(share);
        let (found, missing) = names.split_at(count);
        let found: Vec<&String> = found.iter().collect();
        let reason = reason(folder.path(), (&found, missing), pieces, Matching::Auto);
        reason.map(|reason| reason.to_string())
    }

    #[test]
    fn what_pictures_without_a_pose_lack_is_said() {
        let dim = said(0.2, 3, &[3]).unwrap();
        assert!(dim.contains("3 of 6 pictures") && dim.contains("darkness or silt"), "{dim}");
        let alone = said(1.0, 3, &[3]).unwrap();
        assert!(alone.contains("--overlap") && !alone.contains("exhaustive"), "{alone}");
        let pieces = said(0.2, 3, &[3, 2]).unwrap();
        assert!(pieces.contains("pieces of 3, 2 pictures"), "{pieces}");
        assert_eq!(said(0.2, 5, &[5]), None);
    }
}

//! Going on with a prior: what its new pictures do not show must stay as it is.
//!
//! Views of the prior as it was are trained on beside the new pictures. What has changed does not count in them: splats
//! where the pictures' detail is not the prior's, as it was and as it is now. So what is gone does not come back, and
//! what is new is not taken for a fault. Where the pictures show the same detail in another light, the views take that
//! light: their detail stays, and their blurred colours follow the splats.

use crate::trainer::SH_0;
use glam::DVec3;
use nvsprior::prior::{RenderOptions, Splats};
use nvsprior::{Camera, Engine, Picture, Pose, Prior};
use rayon::prelude::*;

use super::{Exposure, MapError};
use crate::PosedPicture;
use crate::drawn::Drawn;

/// Pictures that must show a splat, so that they say something of it.
const SEEN_BY: u32 = 2;
/// A splat shows in a picture if its centre lies nearer than so many mean depths of the pixel there.
const NEAR: f64 = 1.1;
/// Mean difference in detail from which on a splat has changed, values in [0, 1].
const CHANGED: f32 = 0.03;
/// A pixel of a memory view counts if splats that have changed have less than this share in it.
const SHARE: f32 = 0.25;
/// Share of a memory view's pixels that must count, so that it is worth a step.
const WORTH: f64 = 0.1;
/// Light changes over so many pixels; what changes over fewer is detail. Half the side of a square.
const LIGHT: usize = 8;
/// Half the side of the square that an error is a mean over, pixels.
const AROUND: usize = 2;

/// What the new pictures say of a splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Evidence {
    /// How many show it.
    pictures: u32,
    /// Mean difference of the pictures from the splats as they are, values in [0, 1].
    error: f32,
    /// Mean difference of their detail from that of the prior as it was.
    change: f32,
}

/// The pictures that say what is there now.
pub struct Now<'a> {
    pub engine: &'a Engine,
    pub splats: &'a Splats,
    pub options: &'a RenderOptions,
    pub poses: &'a [Pose],
    pub exposures: &'a [Exposure],
}

/// The views that stand for what was known before.
pub struct Memory {
    /// Place of the first one among all views.
    pub first: usize,
    /// By view: the prior as it was, and which of its pixels may count.
    before: Vec<(Picture, Vec<bool>)>,
    /// By new picture: the difference of its detail from the prior's, around each pixel.
    changes: Vec<Vec<f32>>,
}

impl Memory {
    /// Chooses, of the views of a prior, those of which enough has not changed: at most as many as there are new
    /// pictures, spread evenly over the list. They are added to the pictures.
    pub fn new(
        engine: &Engine,
        prior: &Prior,
        pictures: &mut Vec<PosedPicture>,
        views: Vec<PosedPicture>,
    ) -> Result<Memory, MapError> {
        let (splats, options) = (prior.splats(), prior.options());
        let mut drawn = Drawn::new(engine, prior)?;
        let mut changes = Vec::new();
        for view in pictures.iter() {
            let render = drawn.draw(&view.camera, &view.pose)?;
            changes.push(detail_errors(view, &view.picture, render));
        }
        let poses: Vec<Pose> = pictures.iter().map(|view| view.pose).collect();
        let exposures = vec![Exposure::NONE; pictures.len()];
        let now = Now { engine, splats, options, poses: &poses, exposures: &exposures };
        let evidence = now.evidence(&mut drawn, pictures, &changes)?;
        let mut marks = Marks::new(&now, &evidence)?;
        let mut worth = Vec::new();
        for view in views {
            let shares = marks.shares(&view)?;
            let free = |(i, share): (usize, &[f32; 2])| share[0] < SHARE && view.counts(i);
            let free: Vec<bool> = shares.iter().enumerate().map(free).collect();
            let counted = free.iter().filter(|free| **free).count();
            if counted as f64 >= WORTH * free.len() as f64 {
                worth.push((view, free));
            }
        }
        let (first, mut before) = (pictures.len(), Vec::new());
        for (view, free) in evenly(worth, first) {
            before.push((view.picture.clone(), free.clone()));
            pictures.push(PosedPicture { mask: Some(free), ..view });
        }
        Ok(Memory { first, before, changes })
    }

    /// Says anew, by the splats as they are, which pixels of the memory views count, and in which light. Returns how
    /// wrong each splat is in the new pictures.
    pub fn renew(&self, now: &Now, views: &mut [PosedPicture]) -> Result<Vec<f32>, MapError> {
        let prior = Prior::from_splats(now.splats.clone(), *now.options)?;
        let mut drawn = Drawn::new(now.engine, &prior)?;
        let (pictures, memory) = views.split_at_mut(self.first);
        let evidence = now.evidence(&mut drawn, pictures, &self.changes)?;
        let mut marks = Marks::new(now, &evidence)?;
        for (view, (before, free)) in memory.iter_mut().zip(&self.before) {
            let shares = marks.shares(view)?;
            let render = drawn.draw(&view.camera, &view.pose)?;
            let counts = free.iter().zip(&shares).map(|(free, share)| *free && share[0] < SHARE);
            let counts: Vec<bool> = counts.collect();
            relight(&mut view.picture, before, render, &counts, &shares);
            view.mask = Some(counts);
        }
        Ok(evidence.iter().map(|splat| splat.error).collect())
    }
}

/// At most so many of a list, spread evenly over it.
fn evenly<T>(all: Vec<T>, most: usize) -> impl Iterator<Item = T> {
    let (count, most) = (all.len().max(1), most.min(all.len()));
    let chosen = move |place: usize| (place + 1) * most / count > place * most / count;
    all.into_iter().enumerate().filter(move |(place, _)| chosen(*place)).map(|(_, item)| item)
}

impl Now<'_> {
    /// What the pictures say of each splat. `drawn`: the splats. `changes`: see [`Memory`].
    fn evidence(
        &self,
        drawn: &mut Drawn,
        pictures: &[PosedPicture],
        changes: &[Vec<f32>],
    ) -> Result<Vec<Evidence>, MapError> {
        let mut sums = vec![Evidence::default(); self.splats.len()];
        let fitted = self.poses.iter().zip(self.exposures);
        for ((view, (pose, exposure)), changes) in pictures.iter().zip(fitted).zip(changes) {
            let render = drawn.draw(&view.camera, pose)?;
            let errors = errors(view, &exposure.undone_picture(view), render);
            let width = view.camera.width as usize;
            let shapes = self.splats.positions.par_iter().zip(&self.splats.log_scales);
            sums.par_iter_mut().zip(shapes).for_each(|(sum, (position, log_scale))| {
                let place = DVec3::from(position.map(f64::from));
                let Some(([x, y], depth)) = shown(&view.camera, pose, place) else { return };
                let pixel = y * width + x;
                let mean = f64::from(render[pixel][3] / (1.0 - render[pixel][4]).max(1e-3));
                let size = f64::from(log_scale.iter().fold(f32::MIN, |a, b| a.max(*b)).exp());
                if view.counts(pixel) && depth <= NEAR * mean + size {
                    sum.pictures += 1;
                    sum.error += errors[pixel];
                    sum.change += changes[pixel];
                }
            });
        }
        for sum in &mut sums {
            let count = sum.pictures.max(1) as f32;
            (sum.error, sum.change) = (sum.error / count, sum.change / count);
        }
        Ok(sums)
    }
}

/// The pixel that a point shows in, column and row, and its depth; `None` if it lies beyond the picture.
fn shown(camera: &Camera, pose: &Pose, point: DVec3) -> Option<([usize; 2], f64)> {
    let p = pose.rotation * point + pose.translation;
    if p.z <= 0.0 {
        return None;
    }
    let x = p.x / p.z * f64::from(camera.fx) + f64::from(camera.cx);
    let y = p.y / p.z * f64::from(camera.fy) + f64::from(camera.cy);
    let within = x >= 0.0 && y >= 0.0 && x < camera.width.into() && y < camera.height.into();
    within.then_some(([x as usize, y as usize], p.z))
}

/// Mean difference of a picture from a render around each pixel.
fn errors(view: &PosedPicture, frame: &Picture, render: &[[f32; 5]]) -> Vec<f32> {
    let difference = differences(frame, render);
    around(view, &magnitudes(&difference))
}

/// As [`errors`], of what is left if the light is taken to be the same.
fn detail_errors(view: &PosedPicture, frame: &Picture, render: &[[f32; 5]]) -> Vec<f32> {
    let mut difference = differences(frame, render);
    let counts: Vec<bool> = (0..difference.len()).map(|i| view.counts(i)).collect();
    let light = blurred(&difference, view.camera.width as usize, LIGHT, &counts);
    for (difference, light) in difference.iter_mut().zip(light) {
        *difference = [0, 1, 2].map(|c| difference[c] - light[c]);
    }
    around(view, &magnitudes(&difference))
}

/// Picture less render, values in [0, 1].
fn differences(frame: &Picture, render: &[[f32; 5]]) -> Vec<[f32; 3]> {
    let (pixels, _) = frame.data.as_chunks::<3>();
    let difference = |(own, drawn): (&[u8; 3], &[f32; 5])| {
        [0, 1, 2].map(|c| f32::from(own[c]) / 255.0 - drawn[c].clamp(0.0, 1.0))
    };
    pixels.iter().zip(render).map(difference).collect()
}

/// Mean over the channels.
fn magnitudes(difference: &[[f32; 3]]) -> Vec<[f32; 3]> {
    difference.iter().map(|d| [(d[0].abs() + d[1].abs() + d[2].abs()) / 3.0; 3]).collect()
}

fn around(view: &PosedPicture, values: &[[f32; 3]]) -> Vec<f32> {
    let counts: Vec<bool> = (0..values.len()).map(|i| view.counts(i)).collect();
    let means = blurred(values, view.camera.width as usize, AROUND, &counts);
    means.iter().map(|mean| mean[0]).collect()
}

/// Means over squares around each pixel, of those pixels that count; 0 if none does.
fn blurred(values: &[[f32; 3]], width: usize, half: usize, counts: &[bool]) -> Vec<[f32; 3]> {
    let height = values.len() / width.max(1);
    let window = |at: usize, end: usize| at.saturating_sub(half)..(at + half + 1).min(end);
    let weighed = |i: usize| match counts[i] {
        true => [values[i][0], values[i][1], values[i][2], 1.0],
        false => [0.0; 4],
    };
    let add = |a: [f32; 4], b: [f32; 4]| [0, 1, 2, 3].map(|k| a[k] + b[k]);
    let row = |i: usize| {
        let first = i - i % width;
        window(i % width, width).map(|x| weighed(first + x)).fold([0.0; 4], add)
    };
    let rows: Vec<[f32; 4]> = (0..values.len()).into_par_iter().map(row).collect();
    let column = |i: usize| {
        let sum = window(i / width, height).map(|y| rows[y * width + i % width]);
        let [r, g, b, count] = sum.fold([0.0; 4], add);
        [r, g, b].map(|sum| sum / count.max(1.0))
    };
    (0..values.len()).into_par_iter().map(column).collect()
}

/// A view of the prior as it was, in the light of the render as far as the new pictures show what it shows.
fn relight(
    picture: &mut Picture,
    before: &Picture,
    render: &[[f32; 5]],
    counts: &[bool],
    shares: &[[f32; 2]],
) {
    let mut lighter = differences(before, render);
    lighter.iter_mut().for_each(|rgb| *rgb = rgb.map(|v| -v));
    let light = blurred(&lighter, before.width as usize, LIGHT, counts);
    let (pixels, _) = picture.data.as_chunks_mut::<3>();
    let (known, _) = before.data.as_chunks::<3>();
    for (((pixel, known), light), share) in pixels.iter_mut().zip(known).zip(light).zip(shares) {
        let seen = share[1].clamp(0.0, 1.0);
        *pixel = [0, 1, 2].map(|c| {
            (f32::from(known[c]) + 255.0 * seen * light[c]).round().clamp(0.0, 255.0) as u8
        });
    }
}

/// Draws how large a share of each pixel those splats have that have changed, and those that pictures show.
struct Marks(Drawn);

impl Marks {
    fn new(now: &Now, evidence: &[Evidence]) -> Result<Marks, MapError> {
        let mut marked = now.splats.with_sh_degree(0);
        for (sh, splat) in marked.sh.as_chunks_mut::<3>().0.iter_mut().zip(evidence) {
            let seen = splat.pictures >= SEEN_BY;
            let mark = |is: bool| (f32::from(u8::from(is)) - 0.5) / SH_0;
            *sh = [mark(seen && splat.change >= CHANGED), mark(seen), mark(false)];
        }
        let options = RenderOptions { background: [0.0; 3], ..*now.options };
        Ok(Marks(Drawn::new(now.engine, &Prior::from_splats(marked, options)?)?))
    }

    /// By pixel of a view: the share of what has changed, and of what pictures show.
    fn shares(&mut self, view: &PosedPicture) -> Result<Vec<[f32; 2]>, MapError> {
        let drawn = self.0.draw(&view.camera, &view.pose)?;
        Ok(drawn.iter().map(|pixel| [pixel[0], pixel[1]]).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_thinned_evenly() {
        let thinned = |most| evenly((0..10).collect(), most).collect::<Vec<_>>();
        assert_eq!(thinned(10), (0..10).collect::<Vec<_>>());
        assert_eq!(thinned(99).len(), 10);
        assert_eq!(thinned(5), [1, 3, 5, 7, 9]);
        assert_eq!(thinned(0), [0; 0]);
        assert_eq!(evenly(Vec::<u8>::new(), 3).count(), 0);
    }

    #[test]
    fn means_leave_out_what_does_not_count() {
        let values: Vec<[f32; 3]> = (0..12).map(|i| [i as f32, 1.0, 0.0]).collect();
        let mut counts = vec![true; 12];
        counts[5] = false;
        let means = blurred(&values, 4, 1, &counts);
        // Around pixel 5: 0, 1, 2, 4, 6, 8, 9, 10.
        assert_eq!(means[5], [5.0, 1.0, 0.0]);
        // Around pixel 0: 0, 1, 4.
        assert_eq!(means[0], [5.0 / 3.0, 1.0, 0.0]);
        assert_eq!(blurred(&values, 4, 1, &[false; 12])[5], [0.0; 3]);
    }

    /// A picture of stripes, and a render of it in another light.
    fn stripes(lighter: f32) -> (Picture, Vec<[f32; 5]>) {
        let mut picture = Picture::new(40, 40);
        for (i, rgb) in picture.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            *rgb = [if i % 2 == 0 { 80 } else { 120 }; 3];
        }
        let drawn = |rgb: &[u8; 3]| {
            let [r, g, b] = rgb.map(|v| f32::from(v) / 255.0 + lighter);
            [r, g, b, 1.0, 0.0]
        };
        let render = picture.data.as_chunks::<3>().0.iter().map(drawn).collect();
        (picture, render)
    }

    #[test]
    fn light_is_no_change_of_detail() {
        let (picture, render) = stripes(0.2);
        let camera = Camera { width: 40, height: 40, fx: 40.0, fy: 40.0, cx: 20.0, cy: 20.0 };
        let view = PosedPicture::new(camera, Pose::IDENTITY, picture.clone());
        let detail = detail_errors(&view, &picture, &render);
        assert!(detail.iter().all(|error| *error < 1e-5));
        assert!(errors(&view, &picture, &render).iter().all(|error| (error - 0.2).abs() < 1e-5));
        let flat = vec![[0.4, 0.4, 0.4, 1.0, 0.0]; 1600];
        assert!(detail_errors(&view, &picture, &flat).iter().all(|error| *error > CHANGED));
    }

    #[test]
    fn a_view_takes_the_light_of_what_pictures_show_and_keeps_its_detail() {
        let (before, render) = stripes(0.2);
        let mut picture = before.clone();
        let seen = |i: usize| f32::from(u8::from(i < 800));
        let shares: Vec<[f32; 2]> = (0..1600).map(|i| [0.0, seen(i)]).collect();
        relight(&mut picture, &before, &render, &[true; 1600], &shares);
        assert_eq!(picture.data[..3], [131; 3]);
        assert_eq!(picture.data[3..6], [171; 3]);
        assert_eq!(picture.data[2400..], before.data[2400..]);
    }
}

//! From how different sides a mapping run saw the site, and which picture to take next.

use std::path::Path;

use nvsprior::prior::Splats;
use nvsprior::{Camera, Engine, Picture, Pose, Prior};
use nvsprior_inputs::args::progress;
use nvsprior_runs::Sheet;
use nvsprior_train::mapper::Mapper;
use nvsprior_train::parallax::{Parallax, TWO_SIDES, Wanted};
use serde_json::{Value, json};

use crate::picture_renderer::PictureRenderer;

/// If less than this share of what was seen was seen from two sides, a picture is asked for.
const ENOUGH: f64 = 0.7;
/// Views that are drawn.
const DRAWN: usize = 6;
/// Most views that are looked at.
const VIEWS: usize = 200;
/// Colours by parallax: seen from one side, from two that are near each other, from two sides, and never.
const COLOURS: [[f32; 3]; 4] = [[0.85, 0.1, 0.1], [0.95, 0.75, 0.1], [0.1, 0.65, 0.25], [0.3; 3]];
/// Least parallax of the second colour, degrees.
const NEAR: f64 = 5.0;
/// Y₀₀: the colour of a splat is its first coefficient times this, plus a half.
const SH0: f32 = 0.282_094_8;

pub struct Sides {
    parallax: Parallax,
    views: Vec<(Camera, Pose)>,
    wanted: Option<Wanted>,
}

impl Sides {
    /// Of a prior, by the pictures that it was trained on.
    pub fn of(engine: &Engine, prior: &Prior, mapper: &Mapper) -> anyhow::Result<Sides> {
        let cameras = mapper.views()[..mapper.pictures()].iter().map(|view| view.camera);
        let all = cameras.zip(mapper.poses().iter().copied());
        let every = mapper.pictures().div_ceil(VIEWS);
        let views: Vec<(Camera, Pose)> = all.step_by(every).collect();
        let bar = progress(views.len(), "parallax");
        let parallax = Parallax::of(engine, prior, &views, &mut || bar.inc(1))?;
        bar.finish_and_clear();
        let enough = parallax.from_two_sides() >= ENOUGH;
        let wanted = parallax.wanted(prior.splats(), &views).filter(|_| !enough);
        Ok(Sides { parallax, views, wanted })
    }

    pub fn print(&self) {
        let Some(median) = self.parallax.median() else { return };
        say!(
            "parallax: {:.0} % of the site was seen from sides {TWO_SIDES:.0}° apart or more; half of it from {:.0}°",
            100.0 * self.parallax.from_two_sides(),
            median.to_degrees()
        );
        let Some(Wanted { pose, about, side }) = &self.wanted else { return };
        let [x, y, z] = pose.centre().to_array();
        let where_to = match *side {
            "left" | "right" => format!("to the {side} of"),
            other => other.to_owned(),
        };
        say!(
            "the picture to take next: fly an arc {where_to} what was seen from one side only, around \
             ({:.2}, {:.2}, {:.2}), to ({x:.2}, {y:.2}, {z:.2})",
            about.x,
            about.y,
            about.z
        );
    }

    pub fn json(&self) -> Value {
        let next = self.wanted.as_ref().map(|wanted| {
            let (q, t) = (wanted.pose.rotation, wanted.pose.translation);
            json!({
                "side": wanted.side,
                "around": wanted.about.to_array(),
                "qvec": [q.w, q.x, q.y, q.z],
                "tvec": t.to_array(),
            })
        });
        json!({
            "median_degrees": self.parallax.median().map(f64::to_degrees),
            "from_two_sides": self.parallax.from_two_sides(),
            "next": next,
        })
    }

    /// Draws views of the run, beside each the same with splats in the colours of their parallax.
    pub fn draw(&self, engine: &Engine, prior: &Prior, path: &Path) -> anyhow::Result<()> {
        let coloured = Prior::from_splats(self.coloured(prior.splats()), *prior.options())?;
        let every = self.views.len().div_ceil(DRAWN);
        let views: Vec<_> = self.views.iter().copied().step_by(every).collect();
        let pictures = PictureRenderer::new(engine, prior)?.render_all(&views)?;
        let colours = PictureRenderer::new(engine, &coloured)?.render_all(&views)?;
        let most = |side: fn(&Picture) -> u32| pictures.iter().map(side).max().unwrap_or(0);
        let cell = (most(|picture| picture.width), most(|picture| picture.height));
        let mut sheet = Sheet::new(2, pictures.len() as u32, cell, 0);
        for (line, (picture, colours)) in (0..).zip(pictures.iter().zip(&colours)) {
            sheet.paste(0, line, picture);
            sheet.paste(1, line, colours);
        }
        Ok(sheet.save(path)?)
    }

    fn coloured(&self, splats: &Splats) -> Splats {
        let colour = |angle: &Option<f64>| match angle.map(f64::to_degrees) {
            None => COLOURS[3],
            Some(angle) if angle < NEAR => COLOURS[0],
            Some(angle) if angle < TWO_SIDES => COLOURS[1],
            Some(_) => COLOURS[2],
        };
        let coefficient = |value: f32| (value - 0.5) / SH0;
        let sh = self.parallax.angles.iter().flat_map(|angle| colour(angle).map(coefficient));
        Splats { sh: sh.collect(), sh_degree: 0, ..splats.clone() }
    }
}

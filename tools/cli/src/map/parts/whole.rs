//! A run in parts, whole: trains them all, writes one prior, and tells what it came to.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;
use glam::DVec3;
use nvsprior::prior::Splats;
use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::render::{BlockReader, Scene};
use nvsprior::{Engine, Prior};
use nvsprior_inputs::report::write_json;
use nvsprior_train::parts::{Cells, Parts, View, places};
use serde_json::{Value, json};

use super::super::report::{Poses, mean};
use super::PartsRun;
use crate::picture_renderer::PictureRenderer;

/// All parts, put together.
struct Whole<'a> {
    run: &'a PartsRun<'a>,
    parts: &'a Parts,
    points: &'a [DVec3],
    /// Splats that each part keeps.
    counts: Vec<usize>,
    poses: Option<Poses>,
}

/// A picture that was held out, drawn by the whole prior.
struct Measured {
    name: String,
    split: String,
    /// Parts that it shows.
    shows: Vec<usize>,
    psnr: f64,
}

impl PartsRun<'_> {
    /// Trains the parts one after the other, and writes them as one prior. `parts`: how many.
    pub fn run(mut self, parts: usize, poses: Option<Poses>) -> anyhow::Result<()> {
        let views: Vec<View> = self.listed.train.iter().map(|input| self.view(input)).collect();
        let cameras: Vec<DVec3> = views.iter().map(|view| view.pose.centre()).collect();
        let cells = Cells::of(&cameras, parts)?;
        let folder = self.folder();
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        self.args.inputs.write_undistorted(&self.listed)?;
        let near = f64::from(self.options.render.near);
        if self.listed.points.is_empty() {
            let own = Parts::new(cells.clone(), parts, views.clone(), &[], near);
            self.listed.points = self.coarse_points(&own)?;
        }
        let points = places(&self.listed.points);
        let parts = Parts::new(cells, parts, views.clone(), &points, near);
        self.check_memory(&parts)?;
        let mut splats = Splats { sh_degree: self.options.sh_degree, ..Splats::default() };
        let mut counts = Vec::new();
        for part in 0..parts.count() {
            let mut own = self.part(&parts, part)?;
            counts.push(own.len());
            splats.append(&mut own);
        }
        let scene = self.write(&splats, &views)?;
        let whole = Whole { run: &self, parts: &parts, points: &points, counts, poses };
        whole.report(scene)?;
        self.remove_folder();
        self.args.device.check(self.engine)
    }
}

impl Whole<'_> {
    /// Measures the prior that was written, and writes the figures.
    fn report(&self, prior: PathBuf) -> anyhow::Result<()> {
        let measured = match self.measure(&prior) {
            Ok(measured) => measured,
            Err(error) => {
                // The prior is there.
                tell!("warning: {}: {error:#}; the whole is not measured", prior.display());
                Vec::new()
            }
        };
        let at_border = |border: bool| {
            let own = measured.iter().filter(move |one| (one.shows.len() > 1) == border);
            mean(own.map(|one| one.psnr))
        };
        let all = mean(measured.iter().map(|one| one.psnr));
        if let Some(psnr) = all {
            let border =
                at_border(true).map_or(String::new(), |psnr| format!(", {psnr:.2} dB at borders"));
            tell!("the whole: {psnr:.2} dB held out{border}");
        }
        let Some(folder) = &self.run.args.report else { return Ok(()) };
        let mut report = Poses::json(self.poses.as_ref());
        let whole = json!({
            "held_out_psnr": all,
            "held_out_psnr_at_borders": at_border(true),
            "held_out_psnr_elsewhere": at_border(false),
            "splats": self.counts.iter().sum::<usize>(),
            "parts": self.parts(),
            "pictures": measured.iter().map(Measured::json).collect::<Vec<_>>(),
        });
        report.extend(whole.as_object().cloned().unwrap_or_default());
        write_json(&folder.join("report.json"), &report)
    }

    fn parts(&self) -> Vec<Value> {
        let part = |(part, splats): (usize, &usize)| {
            let pictures = self.parts.pictures(part).len();
            json!({ "pictures": pictures, "splats": splats })
        };
        self.counts.iter().enumerate().map(part).collect()
    }

    /// Draws the pictures that were held out.
    fn measure(&self, prior: &Path) -> anyhow::Result<Vec<Measured>> {
        let PartsRun { engine, listed, args, preprocessing, options, .. } = self.run;
        let plan = options.plan([listed.size.width, listed.size.height], DVec3::ZERO);
        // What a training took there is room for.
        let room = plan.memory(engine.device())?.peak;
        let mut renderer = PictureRenderer::of(engine, scene(engine, prior, room)?);
        let mut measured = Vec::new();
        for (split, input) in &listed.held_out {
            let picture = args.inputs.read_picture(input, &listed.size, preprocessing)?;
            let psnr = picture.psnr(renderer.render(&picture.camera, &picture.pose)?);
            let shows = self.parts.shown_by(&self.run.view(input), self.points);
            measured.push(Measured { name: input.name.clone(), split: split.clone(), shows, psnr });
        }
        Ok(measured)
    }
}

impl Measured {
    fn json(&self) -> Value {
        let parts: Vec<usize> = self.shows.iter().map(|part| part + 1).collect();
        json!({ "name": self.name, "split": self.split, "parts": parts, "psnr": self.psnr })
    }
}

/// The prior, in blocks if it is written so.
fn scene(engine: &Engine, path: &Path, room: u64) -> anyhow::Result<Arc<Scene>> {
    if BlockedPrior::is_at(path) {
        let blocked = Arc::new(BlockedPrior::open(path)?);
        return Ok(engine.open_blocked(&blocked, room, BlockReader::when_needed())?);
    }
    Ok(engine.upload(&Prior::open(path, &Default::default())?)?)
}

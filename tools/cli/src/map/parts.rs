//! `nvsprior map --parts`: a long run in parts, each trained by itself.

mod whole;

use std::path::{Path, PathBuf};

use anyhow::Context;
use nvsprior::image::Preprocessing;
use nvsprior::prior::{Besides, Extras, KeyFrames, Splats, ply, replace_file};
use nvsprior::{Engine, Prior};
use nvsprior_inputs::posed::PosedInput;
use nvsprior_train::key_frames;
use nvsprior_train::mapper::{ColouredPoint, MapOptions};
use nvsprior_train::parts::{Parts, View, points_of_splats};

use super::budget::Budget;
use super::inputs::{self, Listed};
use super::report::RunWorth;
use super::{Args, Training, forward_seconds, memory, saved};
use crate::container::Container;

/// Steps of a coarse prior, as a share of those of a part.
const COARSE: f64 = 1.0 / 3.0;
/// How much smaller pictures are for it, and how many rows they have at least.
const COARSE_REDUCED: u32 = 3;
const COARSE_ROWS: u32 = 45;

/// A run that is mapped in parts.
pub struct PartsRun<'a> {
    pub args: &'a Args,
    pub engine: &'a Engine,
    /// All of the run.
    pub listed: Listed,
    pub options: MapOptions,
    pub preprocessing: Preprocessing,
    pub container: Container,
}

/// What is trained by itself.
struct Trained<'a> {
    /// Names its files.
    name: String,
    listed: Listed,
    options: MapOptions,
    budget: Budget,
    /// Who keeps which of its splats, and which part it is.
    parts: &'a Parts,
    part: usize,
}

impl PartsRun<'_> {
    /// Where parts lie until all are there.
    fn folder(&self) -> PathBuf {
        saved::beside(&self.args.out, ".parts")
    }

    /// What a picture has in view, at the size that it is trained at.
    fn view(&self, input: &PosedInput) -> View {
        View { camera: self.args.inputs.camera_at(input, &self.listed.size), pose: input.pose }
    }

    /// The points of coarse priors: one for each cell, of the pictures that were taken there, which are reduced. A
    /// coarse prior of the whole run would have its splats as far away as the run is long.
    fn coarse_points(&self, own: &Parts) -> anyhow::Result<Vec<ColouredPoint>> {
        tell!("no points: they are taken from coarse priors, which come first");
        let by = (self.listed.size.height / COARSE_ROWS).clamp(1, COARSE_REDUCED);
        let options = MapOptions { reductions: vec![1], ..self.options.clone() };
        let mut points = Vec::new();
        for part in 0..own.count() {
            let listed = self.listed_of(own, part);
            let (size, reductions) = (listed.size.reduced(by), vec![1]);
            let listed = Listed { held_out: Vec::new(), size, reductions, ..listed };
            let budget = self.args.budget(None).times(COARSE);
            let name = format!("coarse-{}", part + 1);
            let trained =
                Trained { name, listed, options: options.clone(), budget, parts: own, part };
            points.extend(points_of_splats(&self.trained(trained)?));
        }
        Ok(points)
    }

    /// Says how much memory each part takes, and refuses what is more than there is.
    fn check_memory(&self, parts: &Parts) -> anyhow::Result<()> {
        for part in 0..parts.count() {
            let pictures = parts.pictures(part);
            let taken_in = |i: &&usize| parts.taken_in(&self.listed.train[**i].pose) == part;
            let own = pictures.iter().filter(taken_in).count();
            eprint!("{}: {own} pictures and {} beside it; ", name(part), pictures.len() - own);
            memory::check(self.engine, &self.listed_of(parts, part), &self.options, false)?;
        }
        Ok(())
    }

    /// What a part is trained on, and measured by.
    fn listed_of(&self, parts: &Parts, part: usize) -> Listed {
        let own = &self.listed;
        let taken_in = |input: &PosedInput| parts.taken_in(&input.pose) == part;
        let held_out = own.held_out.iter().filter(|(_, input)| taken_in(input));
        Listed {
            train: parts.pictures(part).iter().map(|i| own.train[*i].clone()).collect(),
            held_out: held_out.cloned().collect(),
            // The whole is measured by them at the end.
            every: None,
            points: parts.points_of(part, &own.points),
            origin: own.origin,
            size: own.size,
            reductions: own.reductions.clone(),
        }
    }

    /// The splats that a part keeps.
    fn part(&self, parts: &Parts, part: usize) -> anyhow::Result<Splats> {
        tell!("{} of {}", name(part), parts.count());
        self.trained(Trained {
            name: name(part),
            listed: self.listed_of(parts, part),
            options: self.options.clone(),
            budget: self.args.budget(None),
            parts,
            part,
        })
    }

    /// Trains, unless an interrupted run has done that. Returns the splats that are kept.
    fn trained(&self, trained: Trained) -> anyhow::Result<Splats> {
        let Trained { name, listed, options, budget, parts, part } = trained;
        let inputs = self.args.inputs.read_part(listed, &self.preprocessing)?;
        let own = inputs::fingerprint(&inputs, &options, &budget);
        // The same pictures may be divided in another way.
        let division = crc32fast::hash(format!("{parts:?}").as_bytes());
        let done = self.folder().join(format!("{name}-{own:08x}{division:08x}.ply"));
        if self.args.resume && done.exists() {
            tell!("{}: trained before", done.display());
            return read_splats(&done, options.sh_degree);
        }
        let out = self.folder().join(format!("{name}.ply"));
        let report = self.args.report.as_ref().map(|folder| folder.join(&name));
        if let Some(folder) = &report {
            saved::check_report(folder)?;
        }
        let training = Training { args: self.args, engine: self.engine, options: &options, budget };
        let (mut mapper, mut report) = training.train(&out, report.as_deref(), inputs)?;
        let splats = mapper.splats()?;
        let prior = Prior::from_splats(splats.clone(), options.render)?;
        let forward = forward_seconds(self.engine, &prior, &mapper)?;
        let splats = splats.filtered(&parts.kept(part, &splats));
        let mut bytes = Vec::new();
        let (none, raw) = (KeyFrames::NONE, Preprocessing::NONE);
        ply::write_ply(&splats, &options.render, &none, &raw, &mut bytes)?;
        replace_file(&done, &bytes)?;
        saved::remove(&out)?;
        report.finish(&mut mapper, splats.len(), forward, &RunWorth::default())?;
        Ok(splats)
    }

    /// Writes all parts as one prior.
    fn write(&self, splats: &Splats, views: &[View]) -> anyhow::Result<PathBuf> {
        let PartsRun { args, options, container, preprocessing, .. } = self;
        let views: Vec<_> = views.iter().map(|view| (view.camera, view.pose)).collect();
        let key_frames = key_frames::of_run(splats, options.render.near, &views)?;
        let lens = self.listed.train.first().map(|input| input.lens);
        let preprocessing = *preprocessing;
        let extras = Extras { key_frames, preprocessing, lens, ..Extras::default() };
        let render = &options.render;
        let besides = Besides { options: render, frame: None, coder_tables: None, extras: &extras };
        let splats = Splats { origin: self.listed.origin.into(), ..splats.clone() };
        let bytes = container.write(&splats, &besides)?;
        container.save(&args.out, &bytes)?;
        say!("{}: {} splats, {} bytes", args.out.display(), splats.len(), bytes.len());
        Ok(args.out.clone())
    }

    /// Removes what lay there until all parts were: the prior is written.
    fn remove_folder(&self) {
        let folder = self.folder();
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            if is_own(&entry.file_name().to_string_lossy()) {
                // It is in nobody's way if it stays.
                let _ = std::fs::remove_file(entry.path());
            }
        }
        let _ = std::fs::remove_dir(&folder);
    }
}

/// Whether a file of the folder is one that this command writes there, or the half of one that a killed run left:
/// `.NAME.PROCESS-ATTEMPT`.
fn is_own(name: &str) -> bool {
    let half = name.strip_prefix('.').and_then(|name| name.rsplit_once('.'));
    let name = half.filter(|(_, end)| end.contains('-')).map_or(name, |(name, _)| name);
    let known = name.starts_with("part-") || name.starts_with("coarse-");
    known && (name.ends_with(".ply") || name.ends_with(".training"))
}

/// What a part is called, from 1.
fn name(part: usize) -> String {
    format!("part-{}", part + 1)
}

fn read_splats(path: &Path, sh_degree: u32) -> anyhow::Result<Splats> {
    let named = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(named)?;
    let splats = ply::read_ply(&bytes).with_context(named)?.splats;
    anyhow::ensure!(splats.sh_degree == sh_degree, "{}: not of this training", named());
    Ok(splats)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_own_files_are_removed() {
        for (name, own) in [
            ("part-1-0123.ply", true),
            ("part-12.ply.training", true),
            (".part-2.ply.training.4711-0", true),
            (".harbour.ply.4711-0", false),
            ("coarse-1-0123.ply", true),
            ("harbour.ply", false),
            ("part-1.png", false),
        ] {
            assert_eq!(is_own(name), own, "{name}");
        }
    }
}

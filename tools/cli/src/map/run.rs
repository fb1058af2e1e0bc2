//! A mapping run, from the arguments to the prior and its report.

use glam::DVec3;
use nvsprior::geometry::Lens;
use nvsprior::image::Preprocessing;
use nvsprior::prior::compact::Quantisation;
use nvsprior::prior::{Besides, Extras, Splats};
use nvsprior::{Engine, Prior, RenderOptions};
use nvsprior_inputs::args::progress;
use nvsprior_train::doubt::doubt_of;
use nvsprior_train::key_frames;
use nvsprior_train::mapper::{MapOptions, Mapper};

use super::course::Course;
use super::inputs::MapInputs;
use super::parts::PartsRun;
use super::rehearsal::Rehearsal;
use super::report::{Report, RunWorth};
use super::sides::Sides;
use super::structure::Search;
use super::worth::Worth;
use super::{Args, Training, check, forward_seconds, memory, saved};
use crate::container::{Container, FINENESS};
use crate::prior_file::PriorFile;

pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.check {
        return check::run(args);
    }
    let container = Container::of(&args.out, Quantisation::default().scaled(FINENESS))?;
    let from = args.from.prior(&args.overrides)?;
    let options = args.options(from.as_ref());
    options.render.check()?;
    saved::check_out(&args.out)?;
    if let Some(prior) = &from {
        container.check_tables(prior.coder_tables().is_some())?;
    }
    if let Some(folder) = &args.report {
        saved::check_report(folder)?;
    }
    args.inputs.check()?;
    let navigation = args.structure.navigation()?;
    let given = args.video.check(args.structure.unposed())?;
    let engine = args.device.open()?;
    let own = || args.inputs.preprocessing();
    let preprocessing = from.as_ref().map_or_else(own, |prior| *prior.preprocessing());
    let search = Search {
        out: &args.out,
        masks: args.inputs.masks(),
        width: args.inputs.width(),
        seed: args.seed,
    };
    let unposed = args.video.pictures(given, &search)?;
    let found = args.structure.find(unposed.as_ref(), &search, navigation)?;
    let (found, poses) = found.unzip();
    let listed = args.inputs.list(found, from.as_ref().map(Prior::origin))?;
    listed.tell_origin();
    let options = MapOptions { reductions: listed.reductions.clone(), ..options };
    let options = match from {
        Some(_) => options,
        None => options.stating_focal(&listed.size),
    };
    if let Some(parts) = args.parts {
        let engine = &engine;
        let run = PartsRun { args, engine, listed, options, preprocessing, container };
        return run.run(parts.into(), poses);
    }
    memory::check(&engine, &listed, &options, from.is_some())?;
    let lens = listed.train.first().map(|input| input.lens);
    let origin = listed.origin;
    let inputs = args.inputs.read(listed, &preprocessing)?;
    let points = inputs.points.clone();
    let (mut mapper, mut report) = train(args, &engine, from.as_ref(), &options, inputs)?;
    report.poses = poses;
    let made = Made { args, container, render: &options.render, preprocessing, lens, origin };
    let prior = made.write(from.as_ref(), &mapper)?;
    let forward = forward_seconds(&engine, &prior, &mapper)?;
    let rehearsal = Rehearsal { engine: &engine, options: &options, budget: args.rehearsal(&from) };
    let worth = rehearsal.run(&prior, &mapper, &points)?;
    made.write_worth(&engine, &prior, &mapper, worth.as_ref())?;
    let sides = Sides::of(&engine, &prior, &mapper)?;
    sides.print();
    if let Some(folder) = &args.report {
        sides.draw(&engine, &prior, &folder.join("parallax.png"))?;
    }
    report.finish(&mut mapper, prior.len(), forward, &RunWorth { worth, sides: Some(sides) })?;
    args.device.check(&engine)
}

/// Trains until the budget is used up.
fn train(
    args: &Args,
    engine: &Engine,
    from: Option<&Prior>,
    options: &MapOptions,
    inputs: MapInputs,
) -> anyhow::Result<(Mapper, Report)> {
    let budget = args.budget(from);
    let Some(prior) = from else {
        let training = Training { args, engine, options, budget };
        return training.train(&args.out, args.report.as_deref(), inputs);
    };
    let MapInputs { train, held_out, .. } = inputs;
    let mut report = Report::new(args.report.as_deref(), held_out);
    let memory = args.from.memory(engine, prior, &args.inputs, &train)?;
    let mut mapper = Mapper::going_on(engine, prior, train, memory, options)?;
    // It is short: no state is saved.
    let save_every = args.save_every();
    Course { budget, save: &|_| Ok(()), save_every }.run(&mut mapper, &mut report)?;
    Ok((mapper, report))
}

/// What is written once a training is done.
struct Made<'a> {
    args: &'a Args,
    container: Container,
    render: &'a RenderOptions,
    preprocessing: Preprocessing,
    lens: Option<Lens>,
    origin: DVec3,
}

impl Made<'_> {
    /// Writes the prior with all that belongs to it but its doubt. `from`: the prior that the training went on with.
    fn write(&self, from: Option<&Prior>, mapper: &Mapper) -> anyhow::Result<Prior> {
        let Made { args, container, render, preprocessing, lens, origin } = *self;
        let splats = Splats { origin: origin.into(), ..mapper.splats()? };
        let cameras = mapper.views()[..mapper.pictures()].iter().map(|view| view.camera);
        let mut views: Vec<_> = cameras.zip(mapper.poses().iter().copied()).collect();
        if let Some(prior) = from {
            let camera = views[0].0;
            views.extend(prior.key_frames().poses().iter().map(|pose| (camera, *pose)));
        }
        let key_frames = key_frames::of_run(&splats, render.near, &views)?;
        let record = |prior| args.from.record(prior, mapper.pictures(), splats.len());
        let extras = Extras {
            key_frames,
            preprocessing,
            lens: from.and_then(|prior| prior.extras().lens).or(lens),
            filter_weights: from.and_then(|prior| prior.filter_weights().cloned()),
            doubt: None,
            pose_trials: from
                .map_or_else(Default::default, |from| from.extras().pose_trials.clone()),
            record: from.map(record).transpose()?.flatten(),
        };
        let coder_tables = from.and_then(|prior| prior.coder_tables()).map(AsRef::as_ref);
        let besides = Besides { options: render, frame: None, coder_tables, extras: &extras };
        let bytes = container.write(&splats, &besides)?;
        container.save(&args.out, &bytes)?;
        if from.is_none() {
            // A prior is there: what was saved on the way to it is not needed any more.
            saved::remove(&args.out)?;
        }
        let prior = Prior::open(&args.out, &Default::default())?;
        say!("{}: {} splats, {} bytes", args.out.display(), prior.len(), bytes.len());
        Ok(prior)
    }

    /// Adds how far the prior's picture may be off, and poses. A `.ply` has no place for it.
    fn write_worth(
        &self,
        engine: &Engine,
        prior: &Prior,
        mapper: &Mapper,
        worth: Option<&Worth>,
    ) -> anyhow::Result<()> {
        if !prior.report().format.is_own() {
            return Ok(());
        }
        let pictures = mapper.views().iter().zip(mapper.poses().iter().copied());
        let bar = progress(pictures.len(), "doubt");
        let doubt = Some(doubt_of(engine, prior, pictures, &mut || bar.inc(1))?);
        let pose_trials = worth.map(Worth::trials);
        let pose_trials = pose_trials.unwrap_or_else(|| prior.extras().pose_trials.clone());
        let extras = Extras { doubt, pose_trials, ..prior.extras().clone() };
        let file = PriorFile::open(&self.args.out, None);
        // The prior is there, and is worth more.
        if let Err(error) = file.and_then(|file| file.save_extras(&extras)) {
            tell!(
                "warning: {error:#}; the prior does not say how far pictures and poses are off; \
                 `nvsprior prior doubt` adds the former"
            );
        }
        Ok(())
    }
}

//! Which parts of a prior pictures do not need: in all views, and in a mission's views.

use nvsprior::prior::analysis::{PriorAnalysis, key_bits, splat_bytes};
use nvsprior::{Camera, EncoderOptions, Engine, Pose, Prior};
use nvsprior_train::removal::{Removal, max_needed, removals};

use crate::mission::{Mission, places, spaced};
use crate::picture_renderer::{PictureRenderer, compare_times};
use crate::view_set::{ViewSet, expected_loss};
use nvsprior_inputs::args::DeviceArgs;
use nvsprior_inputs::report::row;

/// Views of a mission that are looked at.
const VIEWS: usize = 12;
/// Halvings of the share that may go.
const HALVINGS: usize = 6;
/// If a mission has no frames: PSNR of the prior's pictures against them, dB.
const FIDELITY: f64 = 27.0;

/// Prints it all. Without a device, only what is known without pictures.
pub fn print(
    prior: &Prior,
    mission: Option<&Mission>,
    tolerance: Option<f64>,
    device: &DeviceArgs,
) -> anyhow::Result<()> {
    let analysis = PriorAnalysis::of(prior);
    print_findings(&analysis);
    print_guards(prior, &analysis);
    let places =
        mission.map_or_else(|| vec![default_view(prior)], |m| places(spaced(&m.views, VIEWS)));
    print_pyramid(&places[0].0);
    let engine = match device.open() {
        Ok(engine) => engine,
        Err(error) => {
            row("render", format!("not measured: {error:#}"));
            return Ok(());
        }
    };
    print_times(&engine, prior, &analysis, &places)?;
    if let Some(mission) = mission {
        Sampled::new(&engine, prior, mission, places)?.print(tolerance)?;
    }
    device.check(&engine)
}

fn print_findings(analysis: &PriorAnalysis) {
    for finding in analysis.findings() {
        let left_out = finding.kind == nvsprior::prior::analysis::Kind::Exact;
        let name = if left_out { "left out" } else { "could go" };
        let (count, what, kind) = (finding.count, finding.name, finding.kind);
        let (bytes, reason) = (finding.bytes, &finding.reason);
        row(name, format!("{count} {what} ({kind}), {bytes} bytes on the device: {reason}"));
    }
    if analysis.findings().is_empty() {
        row("left out", "nothing: there is a camera for all of it".into());
    }
}

fn print_guards(prior: &Prior, analysis: &PriorAnalysis) {
    let alpha = match analysis.clamps_alpha {
        true => "needed: some opacity is above it",
        false => "idle: no opacity is above it",
    };
    row("alpha guard", alpha.into());
    let colour = match analysis.clamps_colour {
        true => "needed: some colour may fall below 0",
        false => "idle: no colour falls below 0 from any side",
    };
    row("colour guard", colour.into());
    let background = if analysis.background { "needed: not black" } else { "idle: black" };
    row("background", background.into());
    let near = prior.options().near;
    row("key bits", format!("{} for cameras anywhere, near plane {near}", analysis.key_bits));
}

fn print_pyramid(camera: &Camera) {
    let level = |factor: &u32| {
        let level = camera.reduced(*factor);
        let name = if *factor == 1 { "1".into() } else { format!("1/{factor}") };
        (level.width > 0 && level.height > 0).then_some(name)
    };
    let levels: Vec<_> = EncoderOptions::default().factors.iter().filter_map(level).collect();
    row("pyramid", format!("{} of {}×{}", levels.join(", "), camera.width, camera.height));
}

/// Milliseconds of a render with the uploaded parts, and with the whole prior.
fn print_times(
    engine: &Engine,
    prior: &Prior,
    analysis: &PriorAnalysis,
    places: &[(Camera, Pose)],
) -> anyhow::Result<()> {
    let mut whole = PictureRenderer::of(engine, engine.upload_whole(prior)?);
    let mut needed = PictureRenderer::new(engine, prior)?;
    let times = compare_times(&mut whole, &mut needed, places)?;
    let all =
        analysis.splats.len() == prior.len() && analysis.sh_degree == prior.splats().sh_degree;
    row(
        "render",
        match all {
            true => format!("{:.2} ms, with nothing left out", times.second),
            false => format!("{:.2} ms, {:.2} ms with all of it", times.second, times.first),
        },
    );
    Ok(())
}

/// A camera of the usual size, three spreads in front of the middle of the prior.
fn default_view(prior: &Prior) -> (Camera, Pose) {
    let (width, height) = (320, 180);
    let camera = Camera { width, height, fx: 274.0, fy: 274.0, cx: 160.0, cy: 90.0 };
    let frame = prior.coordinate_frame();
    let centre = glam::DVec3::from(frame.centre.map(f64::from));
    let back = glam::DVec3::Z * 3.0 * f64::from(frame.spread);
    (camera, Pose::from_centre(glam::DQuat::IDENTITY, centre - back))
}

/// A mission's views and what leaving splats out does there.
struct Sampled<'a> {
    engine: &'a Engine,
    prior: &'a Prior,
    removals: Vec<Removal>,
    views: ViewSet,
    others: ViewSet,
}

impl<'a> Sampled<'a> {
    fn new(
        engine: &'a Engine,
        prior: &'a Prior,
        mission: &Mission,
        mut places: Vec<(Camera, Pose)>,
    ) -> anyhow::Result<Sampled<'a>> {
        let mut whole = PictureRenderer::new(engine, prior)?;
        let views = ViewSet::of(&mission.views, VIEWS, &mut whole)?;
        let others = ViewSet::of(&mission.others, VIEWS, &mut whole)?;
        places.extend(mission.near(0));
        let removals = removals(engine, prior, &places)?;
        Ok(Sampled { engine, prior, removals, views, others })
    }

    fn print(&self, tolerance: Option<f64>) -> anyhow::Result<()> {
        let deepest = self.deepest();
        let near = self.prior.options().near;
        row(
            "key bits",
            format!("{} at these views: depths to {deepest:.2}", key_bits(near, deepest)),
        );
        let seen: Vec<bool> = self.removals.iter().map(|r| r.pixels > 0).collect();
        self.print_without("unseen", &seen)?;
        if let Some(tolerance) = tolerance {
            let kept = self.min_shown(tolerance)?;
            self.print_without("hardly seen", &kept)?;
        }
        Ok(())
    }

    /// The greatest distance of a splat from a camera.
    fn deepest(&self) -> f32 {
        let centres = self.views.places.iter().map(|(_, pose)| pose.centre().as_vec3());
        let farthest = |centre: glam::Vec3| {
            let positions = self.prior.splats().positions.iter();
            positions.map(|p| centre.distance(glam::Vec3::from(*p))).fold(0.0, f32::max)
        };
        centres.map(farthest).fold(0.0, f32::max)
    }

    /// What pictures are like without some splats.
    fn print_without(&self, name: &str, kept: &[bool]) -> anyhow::Result<()> {
        let gone = kept.iter().filter(|kept| !**kept).count();
        if gone == 0 {
            row(name, "no splat at these views".into());
            return Ok(());
        }
        let bytes = gone as u64 * splat_bytes(self.prior.splats().sh_degree);
        let (mut whole, mut small) =
            (PictureRenderer::new(self.engine, self.prior)?, self.without(kept)?);
        let times = compare_times(&mut whole, &mut small, &self.views.places)?;
        let (psnr, loss) = self.views.compare(&mut small)?;
        let share = 100.0 * gone as f64 / kept.len() as f64;
        row(
            name,
            format!(
                "{gone} splats ({share:.1} %, bounded at {} views), {bytes} bytes on the \
             device: {psnr:.2} dB between renders, {} lost; {:.2} ms per render, {:.2} ms with them",
                self.views.places.len(),
                decibels(loss),
                times.second,
                times.first
            ),
        );
        if !self.others.places.is_empty() {
            let (psnr, loss) = self.others.compare(&mut small)?;
            let count = self.others.places.len();
            row(
                "",
                format!("at {count} views of other splits: {psnr:.2} dB, {} lost", decibels(loss)),
            );
        }
        Ok(())
    }

    fn without(&self, kept: &[bool]) -> anyhow::Result<PictureRenderer> {
        let left = Prior::from_splats(self.prior.splats().filtered(kept), *self.prior.options())?;
        PictureRenderer::new(self.engine, &left)
    }

    /// Which splats stay if as many are left out as the tolerance allows, starting with those that show least.
    fn min_shown(&self, tolerance: f64) -> anyhow::Result<Vec<bool>> {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let share = 0.5 * (low + high);
            let mut small = self.without(&max_needed(&self.removals, share))?;
            let (psnr, loss) = self.views.compare(&mut small)?;
            let framed = self.views.frames.is_some();
            let loss = if framed { loss } else { expected_loss(FIDELITY, psnr) };
            if loss <= tolerance { low = share } else { high = share }
        }
        Ok(max_needed(&self.removals, low))
    }
}

/// A loss against frames, if there are any.
fn decibels(loss: f64) -> String {
    if loss.is_nan() { "no frames, so not known".into() } else { format!("{loss:.3} dB") }
}

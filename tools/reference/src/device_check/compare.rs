//! A device's picture beside the host's, and which stage they part at.

use std::fmt;
use std::sync::Arc;

use crate::probe::{Probe, SortPrecision, Stages};
use nvsprior::render::definition::{Definition, Drawn, Record};
use nvsprior::render::{Plan, Scene};
use nvsprior::{Camera, Engine, Error, Picture, Pose, Prior};
use nvsprior_kernels::shared::{CULLED, PIXEL};

use super::scenes::code;

/// The first thing that differs.
#[derive(Debug)]
pub struct Difference {
    stage: &'static str,
    count: usize,
    input: String,
    host: String,
    device: String,
}

impl Difference {
    pub fn new(
        stage: &'static str,
        count: usize,
        input: impl Into<String>,
        host: impl Into<String>,
        device: impl Into<String>,
    ) -> Difference {
        let (input, host, device) = (input.into(), host.into(), device.into());
        Difference { stage, count, input, host, device }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { stage, count, input, host, device } = self;
        writeln!(f, "stage {stage}, {count} values differ, first:")?;
        writeln!(f, "  in:     {input}")?;
        writeln!(f, "  host:   {host}")?;
        write!(f, "  device: {device}")
    }
}

/// A prior on the device and on the host.
pub struct Compared<'a> {
    engine: &'a Engine,
    prior: &'a Prior,
    uploaded: Arc<Scene>,
    definition: Definition,
}

impl Compared<'_> {
    pub fn new<'a>(engine: &'a Engine, prior: &'a Prior) -> Result<Compared<'a>, Error> {
        let (uploaded, definition) = (engine.upload(prior)?, Definition::new(prior));
        Ok(Compared { engine, prior, uploaded, definition })
    }

    /// Draws at a pose, and at that pose as a packet would hold it. How many pictures are the same, or what differs.
    pub fn compare(&self, camera: &Camera, pose: &Pose) -> Result<Result<u64, Difference>, Error> {
        let host = self.definition.draw(camera, pose);
        let mut renderer = self.engine.renderer(&self.uploaded, camera, Plan::picture())?;
        let image = renderer.draw(pose)?.to_vec();
        if let Some(at) = first_difference(&host.image, &image) {
            let (probe, room) = (Probe::of(self.engine), 1 << 22);
            let stages = probe.stages(&self.uploaded, camera, pose, room, SortPrecision::Exact)?;
            return Ok(Err(stage_of(&host, &stages, &image, at)));
        }
        let mut picture = Picture::new(camera.width, camera.height);
        renderer.picture(pose, &mut picture)?;
        if let Some(difference) = bytes_differ("quantize_rgb8", &host.rgb8, &picture) {
            return Ok(Err(difference));
        }
        let Some(code) = code(self.prior, pose) else {
            return Ok(Ok(1));
        };
        let host = self.definition.draw_coded(camera, &code);
        renderer.coded_picture(&code, &mut picture)?;
        let coded = bytes_differ("project at a coded pose", &host.rgb8, &picture);
        Ok(coded.map_or(Ok(2), Err))
    }
}

fn first_difference(host: &[f32], device: &[f32]) -> Option<usize> {
    std::iter::zip(host, device).position(|(a, b)| a.to_bits() != b.to_bits())
}

fn bytes_differ(stage: &'static str, host: &[u8], device: &Picture) -> Option<Difference> {
    let unequal = || std::iter::zip(host, &device.data).enumerate().filter(|(_, (a, b))| a != b);
    let (at, (a, b)) = unequal().next()?;
    let input = format!("pixel {}, channel {}", at / 3, at % 3);
    Some(Difference::new(stage, unequal().count(), input, a.to_string(), b.to_string()))
}

/// Which stage made a difference in the picture.
fn stage_of(host: &Drawn, device: &Stages, image: &[f32], at: usize) -> Difference {
    if let Some(difference) = records_differ(host, device) {
        return difference;
    }
    if host.order != device.order {
        let pairs = || std::iter::zip(&host.order, &device.order).enumerate();
        let unequal = || pairs().filter(|(_, (a, b))| a != b);
        let (place, (a, b)) = unequal().next().unwrap_or((host.order.len(), (&0, &0)));
        let (a, b) = (format!("splat {a}"), format!("splat {b}"));
        return Difference::new("sort", unequal().count(), format!("place {place}"), a, b);
    }
    let bits = |v: f32| format!("{v:?} (0x{:08x})", v.to_bits());
    let unequal = std::iter::zip(&host.image, image).filter(|(a, b)| a.to_bits() != b.to_bits());
    let (pixel, channel) = (at / PIXEL as usize, at % PIXEL as usize);
    let input = format!("pixel {pixel}, channel {channel}");
    // Or stage `bin_emit` has left a splat out: then the list of the pixel's tile is too short.
    Difference::new("splat (or bin)", unequal.count(), input, bits(host.image[at]), bits(image[at]))
}

fn records_differ(host: &Drawn, device: &Stages) -> Option<Difference> {
    let of_device = |i: usize| (device.keys[i] != CULLED).then(|| record(&device.records[i]));
    let unequal = || {
        let records = host.records.iter().enumerate().map(|(i, r)| (i, *r, of_device(i)));
        records.filter(|(_, a, b)| a != b)
    };
    let (i, a, b) = unequal().next()?;
    let text = |r: Option<Record>| r.map_or("culled".into(), |r| format!("{r:?}"));
    Some(Difference::new("project", unequal().count(), format!("splat {i}"), text(a), text(b)))
}

fn record(r: &[f32; 12]) -> Record {
    Record {
        mean: [r[0], r[1]],
        conic: [r[2], r[3], r[4]],
        log_opacity: r[5],
        rgb: [r[8], r[9], r[10]],
        depth: r[11],
    }
}

//! `nvsprior-lab device-report`: all that is measured of a device in some minutes, in one report: `docs/latency.md`.

mod coding;
pub mod command;
pub mod devices;
mod host;
mod measuring;
mod model;
mod pace;
mod page;
mod plots;
mod print;
pub mod schema;
mod sizes;
mod stages;

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nvsprior::Engine;
use nvsprior_inputs::args::DeviceArgs;
use nvsprior_kernels::modules;

use crate::ceilings::{self, Ceilings, Clock};
use host::Host;
use measuring::{Measuring, Subject};
use nvsprior_reference::device_check::verify;
use schema::{Best, Bounds, DeviceFacts, Model, Report, VERSION};

/// What a part may take of all seconds; the rest is for the ceilings, and for making pipelines.
const VERIFYING: f64 = 0.06;
const SIZES: f64 = 0.85;
/// A device that takes longer for one submission is given up.
const HUNG: Duration = Duration::from_secs(60);
/// Measurements of the ceilings; the best counts.
const CEILINGS: usize = 5;

/// Measures a device. What fails is named in the report.
pub fn measure(args: &DeviceArgs, subject: &Subject, bounds: Bounds) -> Report {
    let mut all = Measuring::new(bounds);
    if let Some(engine) = all.part("device", || args.open_watched(Some(HUNG))) {
        all.device(&engine, subject);
        all.part("validation layer", || args.check(&engine));
    }
    all.report.seconds = all.since.elapsed().as_secs_f64();
    all.report
}

impl Measuring {
    fn new(bounds: Bounds) -> Measuring {
        let report = Report {
            version: VERSION,
            nvsprior: env!("CARGO_PKG_VERSION").into(),
            shaders: shaders(),
            device: None,
            host: Host::here(),
            bounds,
            verify: None,
            ceilings: None,
            model: Model::default(),
            sizes: Vec::new(),
            not_measured: Vec::new(),
            failures: Vec::new(),
            seconds: 0.0,
        };
        Measuring { report, since: Instant::now() }
    }

    fn device(&mut self, engine: &Engine, subject: &Subject) {
        self.report.device = Some(DeviceFacts::of(engine));
        let bounds = self.report.bounds;
        let pace = self.pace(bounds.seconds * VERIFYING);
        self.report.verify = self.part("the same bytes as every other device", || {
            verify(engine, bounds.scenes, || pace.goes_on())
        });
        let clock = Clock::of(engine.vulkan());
        if clock == Clock::Host {
            let why = "the device has no timestamps; ceilings are timed by the host's clock";
            self.missing("times of stages", why);
        }
        self.report.ceilings = self.part("ceilings", || Best::measure(engine, clock));
        let best = self.report.ceilings;
        let machine = model::machine(engine.device().kind, best.as_ref());
        let machine = machine.map_err(|why| self.missing("prediction of stages", why)).ok();
        self.report.model = model::about(machine.as_ref());
        // Larger pictures take longer, but not everything does.
        let widths = || subject.cameras.iter().map(|camera| f64::from(camera.width));
        for (camera, width) in subject.cameras.iter().zip(widths()) {
            let seconds = bounds.seconds * SIZES * width / widths().sum::<f64>();
            self.size(engine, subject, camera, machine, seconds);
        }
    }
}

impl Best {
    fn measure(engine: &Engine, clock: Clock) -> anyhow::Result<Best> {
        let device = engine.vulkan();
        let mut rates = Ceilings { flops: 0.0, bytes: 0.0 };
        for _ in 0..CEILINGS {
            let Ceilings { flops, bytes } = ceilings::measure_by(device, clock)?;
            rates = Ceilings { flops: rates.flops.max(flops), bytes: rates.bytes.max(bytes) };
        }
        Ok(Best { clock, rates, dispatch_seconds: ceilings::dispatch_seconds(device, clock)? })
    }
}

impl DeviceFacts {
    fn of(engine: &Engine) -> DeviceFacts {
        let info = engine.device();
        DeviceFacts {
            name: info.name.clone(),
            kind: info.kind.name().into(),
            driver: info.driver.clone(),
            vulkan: format!("{}.{}", info.api.0, info.api.1),
            subgroup: info.subgroup,
            form: match info.wave {
                Some(wave) => format!("waves of {wave}"),
                None if info.in_lockstep() => "lockstep".into(),
                None => "plain".into(),
            },
            timestamps: engine.vulkan().timestamps(),
            portable: info.portable,
            memory_bytes: info.heap,
        }
    }
}

/// Check sum of all shaders.
fn shaders() -> String {
    let mut check = crc32fast::Hasher::new();
    modules::ALL.iter().for_each(|module| check.update(module.spirv));
    format!("{:08x}", check.finalize())
}

/// Writes `report.json` and `index.html` to a folder, and prints what they say.
pub fn write(report: &Report, folder: &Path) -> anyhow::Result<()> {
    let (json, page) = (folder.join("report.json"), folder.join("index.html"));
    report.write(&json)?;
    let text = page::text(report)?;
    std::fs::write(&page, text).with_context(|| format!("writing {}", page.display()))?;
    print::print(report);
    println!("\n{} and {} have all of it", json.display(), page.display());
    Ok(())
}

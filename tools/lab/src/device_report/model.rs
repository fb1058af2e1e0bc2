//! What a stage should take on a device: by the model that fits it, if there is one.

use nvsprior::vulkan::DeviceKind;
use nvsprior::{Engine, Prior};

use super::host::Host;
use super::schema::{Best, Model};
use crate::cost::{Cost, KnownGpu, Machine, Sharing, Work, compiled_rows};
use crate::gpu_check::Row;

/// The model that a device is predicted by.
pub enum Predictor {
    /// Bytes and operations at the ceilings measured here: a CPU device.
    Ceilings(Machine),
    /// What a compiler makes of the stages: a GPU whose figures are known.
    Compiled(KnownGpu, Vec<Row>),
    /// There is none.
    None,
}

impl Predictor {
    /// The one that fits a device, or why there is none.
    pub fn of(
        engine: &Engine,
        prior: &Prior,
        host: &Host,
        ceilings: Option<&Best>,
    ) -> Result<Predictor, String> {
        let device = engine.device();
        match (device.kind, ceilings) {
            (DeviceKind::Cpu, None) => Err("the ceilings are not known".into()),
            (DeviceKind::Cpu, Some(Best { rates, dispatch_seconds, .. })) => {
                Ok(Predictor::Ceilings(Machine {
                    name: "here",
                    flops: rates.flops,
                    bytes: rates.bytes,
                    latency: 0.0,
                    dispatch: *dispatch_seconds,
                    sharing: Sharing::of(engine, prior),
                }))
            }
            _ => {
                let names = [device.name.as_str(), host.board.as_deref().unwrap_or_default()];
                let known = KnownGpu::of(&names);
                let known = known.ok_or("the figures of this GPU are not known to the model")?;
                let rows = compiled_rows().map_err(|error| format!("{error:#}"))?;
                Ok(Predictor::Compiled(known, rows))
            }
        }
    }

    /// What the report says of it.
    pub fn about(&self) -> Model {
        let (name, machine) = match self {
            Predictor::Ceilings(machine) => {
                ("operations at the ceilings measured here".to_owned(), machine)
            }
            Predictor::Compiled(known, _) => {
                (format!("compiled stages on {}", known.machine.name), &known.machine)
            }
            Predictor::None => return Model::default(),
        };
        Model {
            name: Some(name),
            flops: Some(machine.flops),
            copy_bytes: Some(machine.bytes),
            dispatch_seconds: Some(machine.dispatch),
        }
    }

    /// Seconds of a stage in a picture; `None` if the model does not have it.
    pub fn seconds(&self, stage: &str, cost: &Cost) -> anyhow::Result<Option<f64>> {
        match self {
            Predictor::Ceilings(machine) => {
                let work = cost.of(stage);
                Ok((work != Work::default()).then(|| machine.seconds(&work)))
            }
            Predictor::Compiled(known, rows) => {
                // Pictures in 8 bits have no depths.
                let stage = if stage == "splat" { "splat_colour" } else { stage };
                Ok(known.times(rows, stage, cost)?.map(|times| times.seconds()))
            }
            Predictor::None => Ok(None),
        }
    }
}

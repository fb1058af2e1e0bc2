//! What a stage should take on a device: by its bytes and operations, at the ceilings measured here. That tells nothing
//! of a GPU, whose time goes into other things; so GPUs have no prediction.

use nvsprior::vulkan::DeviceKind;

use super::schema::{Best, Model};
use crate::cost::Machine;

/// The device as the model sees it, or why it has no prediction.
pub fn machine(kind: DeviceKind, ceilings: Option<&Best>) -> Result<Machine, &'static str> {
    match (kind, ceilings) {
        (DeviceKind::Cpu, None) => Err("the ceilings are not known"),
        (DeviceKind::Cpu, Some(Best { rates, dispatch_seconds, .. })) => {
            Ok(Machine { flops: rates.flops, bytes: rates.bytes, dispatch: *dispatch_seconds })
        }
        _ => Err("no model of a GPU's time is near enough: docs/latency.md"),
    }
}

/// What the report says of it.
pub fn about(machine: Option<&Machine>) -> Model {
    let Some(machine) = machine else { return Model::default() };
    Model {
        name: Some("operations at the ceilings measured here".into()),
        flops: Some(machine.flops),
        copy_bytes: Some(machine.bytes),
        dispatch_seconds: Some(machine.dispatch),
    }
}

//! The devices there are.

use std::ffi::c_char;

use nvsprior::vulkan::{DeviceKind, devices};

use super::engine::write_text;
use super::handle::fence;
use super::limits::engine_bytes;
use super::memory::Grant;
use super::status::*;
use super::structs::{Out, Place, versioned, zeroed};

/// A graphics card with memory of its own.
pub const NVSP_DEVICE_DISCRETE_GPU: u32 = 1;
/// A GPU that shares the host's memory.
pub const NVSP_DEVICE_INTEGRATED_GPU: u32 = 2;
/// A GPU of a virtual machine.
pub const NVSP_DEVICE_VIRTUAL_GPU: u32 = 3;
/// A driver that computes on the CPU.
pub const NVSP_DEVICE_CPU: u32 = 4;
/// Any other device.
pub const NVSP_DEVICE_OTHER: u32 = 5;

/// A device that a driver offers.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_device_info {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Its name, ending in NUL; nvsp_engine_options.device takes it, a part of it, or its number as text.
    pub name: [c_char; 256],
    /// Name and version of its driver, ending in NUL.
    pub driver: [c_char; 256],
    /// Why it cannot run an engine, ending in NUL; empty if it can.
    pub unfit: [c_char; 128],
    /// NVSP_DEVICE_*.
    pub kind: u32,
    /// Vulkan version, first number.
    pub vulkan_major: u32,
    /// Vulkan version, second number.
    pub vulkan_minor: u32,
    /// Zero.
    pub reserved: u32,
    /// Its largest heap of memory, bytes.
    pub memory: u64,
    /// Its largest buffer, bytes.
    pub largest_buffer: u64,
}
versioned!(nvsp_device_info, 680);

/// Describes a device of the installed drivers, by its number, and tells how many there are. Each call asks the drivers
/// anew, which takes milliseconds, and allocates. Any thread may call it.
///
/// Fails with NVSP_ERR_MEMORY, NVSP_ERR_VULKAN, NVSP_ERR_NO_DEVICE if no driver is installed, or NVSP_ERR_ARGUMENT if
/// no device has this number; `count` is written then, too.
///
/// # Parameters
/// - `number`: the device's number, from 0.
/// - `info`: receives the description. NULL: not wanted.
/// - `count`: receives how many devices there are. NULL: not wanted.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_device_get_info(
    number: u32,
    info: Out<nvsp_device_info>,
    count: Place<u32>,
) -> nvsp_status {
    fence(|| {
        let out = info.optional()?;
        let _memory = Grant::take("a list of devices", engine_bytes(), u64::MAX)?;
        let all = devices()?;
        count.write(all.len() as u32);
        let Some(device) = all.get(number as usize) else {
            return Err(Failure::argument("number"));
        };
        let mut found = nvsp_device_info {
            kind: match device.info.kind {
                DeviceKind::DiscreteGpu => NVSP_DEVICE_DISCRETE_GPU,
                DeviceKind::IntegratedGpu => NVSP_DEVICE_INTEGRATED_GPU,
                DeviceKind::VirtualGpu => NVSP_DEVICE_VIRTUAL_GPU,
                DeviceKind::Cpu => NVSP_DEVICE_CPU,
                DeviceKind::Other => NVSP_DEVICE_OTHER,
            },
            vulkan_major: device.info.api.0,
            vulkan_minor: device.info.api.1,
            memory: device.memory,
            largest_buffer: device.info.storage_range,
            ..zeroed()
        };
        write_text(&device.info.name, &mut found.name);
        write_text(&device.info.driver, &mut found.driver);
        write_text(device.unfit.unwrap_or_default(), &mut found.unfit);
        out.write(&found);
        Ok(NVSP_OK)
    })
}

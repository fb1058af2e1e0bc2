//! What a device says of itself.

use ash::vk;

/// What kind of device it is, the preferred one first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card with memory of its own.
    DiscreteGpu,
    /// A GPU that shares the host's memory.
    IntegratedGpu,
    /// A GPU of a virtual machine.
    VirtualGpu,
    /// A driver that computes on the CPU, such as llvmpipe.
    Cpu,
    /// Any other.
    Other,
}

impl DeviceKind {
    pub(super) fn of(device_type: vk::PhysicalDeviceType) -> DeviceKind {
        match device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::DiscreteGpu,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::IntegratedGpu,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::VirtualGpu,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        }
    }

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            DeviceKind::DiscreteGpu => "discrete GPU",
            DeviceKind::IntegratedGpu => "integrated GPU",
            DeviceKind::VirtualGpu => "virtual GPU",
            DeviceKind::Cpu => "CPU",
            DeviceKind::Other => "other",
        }
    }
}

/// What a device says of itself.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Its name.
    pub name: String,
    /// What kind of device it is.
    pub kind: DeviceKind,
    /// Driver's name and version text.
    pub driver: String,
    /// Vulkan version.
    pub api: (u32, u32),
    /// Invocations of a subgroup.
    pub subgroup: u32,
    /// Whether compute shaders can shuffle within a subgroup.
    pub shuffles: bool,
    /// Invocations of a subgroup that stages with a form for waves are built for: 16, 32 or 64. `None`: the device
    /// lacks operations that these forms need, cannot promise full subgroups, or has other sizes.
    pub wave: Option<u32>,
    /// Whether shaders may use 64-bit integers.
    pub int64: bool,
    /// Shared memory of a workgroup, bytes.
    pub shared_memory: u32,
    /// Largest storage buffer, bytes.
    pub storage_range: u64,
    /// Largest piece of memory that the device gives at once, bytes.
    pub allocation: u64,
    /// Its largest heap of device memory, bytes.
    pub heap: u64,
    /// `maxComputeWorkGroupCount`, first component.
    pub workgroups: u32,
    /// Whether host and device share one memory, so that nothing needs staging.
    pub unified: bool,
    /// Whether stages can ask for rounding to nearest even. Else the device rounds as it does by default.
    pub(crate) rounding_control: bool,
    /// Whether the device computes the operations of the final picture to the same bits as every other. Measured when
    /// an engine is made with it.
    pub portable: bool,
}

/// Why a device without hardware is not used.
pub(super) const NO_HARDWARE: &str = "has no hardware: its driver compiles, and computes nothing";

impl DeviceInfo {
    /// For tests.
    #[cfg(test)]
    pub(super) const NONE: DeviceInfo = DeviceInfo {
        name: String::new(),
        kind: DeviceKind::Other,
        driver: String::new(),
        api: (1, 2),
        subgroup: 32,
        shuffles: true,
        wave: None,
        int64: true,
        shared_memory: 0,
        storage_range: 0,
        allocation: 0,
        heap: 0,
        workgroups: 0,
        unified: false,
        rounding_control: false,
        portable: false,
    };

    /// Whether there is no hardware, as on the device that Mesa's RADV makes for `RADV_FORCE_FAMILY`: its compiler
    /// works, what is submitted is dropped. It calls itself a discrete GPU. No engine is made with it.
    pub fn is_null(&self) -> bool {
        self.name.starts_with("Null hardware")
    }

    /// Whether the device runs a subgroup of eight invocations as one vector, as llvmpipe does. Some stages have a form
    /// for such devices, `…_lockstep`. It has no barriers and no shared copies, loads two words per access, and lanes
    /// hand each other what they loaded.
    pub fn in_lockstep(&self) -> bool {
        self.kind == DeviceKind::Cpu && self.subgroup == 8 && self.int64 && self.shuffles
    }
}

impl std::fmt::Display for DeviceInfo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} ({}, {}, Vulkan {}.{}, subgroup {}{})",
            self.name,
            self.kind.name(),
            self.driver,
            self.api.0,
            self.api.1,
            self.subgroup,
            if self.portable { "" } else { ", not portable" }
        )
    }
}

/// A device that the driver knows, whether or not it can run the engine.
#[derive(Clone, Debug)]
pub struct ListedDevice {
    /// What it says of itself. Whether it is portable is not measured.
    pub info: DeviceInfo,
    /// Its own memory, bytes: the largest heap.
    pub memory: u64,
    /// Why it cannot run the engine; `None` if it can.
    pub unfit: Option<&'static str>,
}

//! The only place that names Vulkan: device choice, memory, pipelines, commands. Its interface is
//! safe: buffers know their sizes, recorded commands keep alive what they use, and a submission
//! returns when the device has finished. And what else needs the processor itself: the floating-point environment.

mod buffer;
mod cache;
mod commands;
mod device;
mod device_info;
mod error;
mod float_environment;
mod given;
#[cfg(feature = "inspection")]
mod inspection;
mod instance;
mod kernel;
mod spirv;
mod transfer;

// The types of a given device's handles.
pub use ash;
pub use buffer::{Buffer, Memory};
pub use commands::{CommandCounts, Commands, Part, Recorder, StageTime, Timing};
pub use device::{Device, DeviceOptions, MemoryUse, devices};
pub use device_info::{DeviceInfo, DeviceKind, ListedDevice};
pub use error::Error;
pub use float_environment::FloatEnvironment;
pub use given::{DeviceHandles, EnabledFeatures, GivenDevice, QueueLock};
#[cfg(feature = "inspection")]
pub use inspection::Compiled;
pub use kernel::{Code, Kernel};

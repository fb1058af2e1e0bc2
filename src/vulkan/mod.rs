//! The only place that names Vulkan: device choice, memory, pipelines, commands. Its interface is
//! safe: buffers know their sizes, recorded commands keep alive what they use, and a submission
//! returns when the device has finished.

mod buffer;
mod cache;
mod commands;
mod device;
mod error;
mod given;
mod kernel;
mod spirv;

// The types of a given device's handles.
pub use ash;
pub use buffer::{Buffer, Memory};
pub use commands::{Commands, Recorder, StageTime, Timing};
pub use device::{Device, DeviceInfo, DeviceKind, DeviceOptions, ListedDevice, MemoryUse, devices};
pub use error::Error;
pub use given::{DeviceHandles, EnabledFeatures, GivenDevice, QueueLock};
pub use kernel::{Code, Kernel};

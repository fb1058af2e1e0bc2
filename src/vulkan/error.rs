//! What can go wrong below the renderer.

use ash::vk;

/// A failure of the Vulkan layer, naming the call or thing that failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The Vulkan loader library is missing.
    #[error(
        "no Vulkan loader ({0}); install a Vulkan driver: on Debian or Ubuntu `apt-get install \
         libvulkan1 mesa-vulkan-drivers` (a CPU driver that works everywhere), else your GPU's"
    )]
    NoLoader(String),
    /// No device that can run the engine.
    #[error(
        "no Vulkan device fits: {found}. nvsprior needs Vulkan 1.2 with the \
         vulkanMemoryModel feature; on Debian or Ubuntu `apt-get install mesa-vulkan-drivers` \
         brings a CPU driver that works everywhere"
    )]
    NoDevice {
        /// Devices seen, and why each does not fit.
        found: String,
    },
    /// None of the devices is the one asked for.
    #[error(
        "no Vulkan device \"{wanted}\"; there are: {found}. Give a number, or a part of a name"
    )]
    UnknownDevice {
        /// What was asked for.
        wanted: String,
        /// Numbers and names of the devices.
        found: String,
    },
    /// The device that the program gave cannot run the engine.
    #[error("the given device does not fit: {reason}")]
    GivenDevice {
        /// Why.
        reason: String,
    },
    /// Validation was asked for and its layer is not installed.
    #[error("validation layer VK_LAYER_KHRONOS_validation is not installed")]
    NoValidationLayer,
    /// A Vulkan call failed.
    #[error("{call} failed: {result:?}")]
    Call {
        /// Name of the Vulkan function.
        call: &'static str,
        /// What it returned.
        result: vk::Result,
    },
    /// The device was lost; the engine must be opened again.
    #[error("device lost in {call}")]
    DeviceLost {
        /// Name of the Vulkan function that noticed.
        call: &'static str,
    },
    /// The device did not end its work in time. It counts as lost, and what it may still use is never freed.
    #[error("the device did not end its work within {milliseconds} ms, the time of the watchdog")]
    Hung {
        /// The watchdog's time.
        milliseconds: u64,
    },
    /// Memory could not be had.
    #[error("no memory for buffer {buffer} of {bytes} bytes: {reason}")]
    Memory {
        /// Which buffer.
        buffer: &'static str,
        /// Its size.
        bytes: u64,
        /// The allocator's reason.
        reason: String,
    },
    /// A buffer is larger than the device lets a shader see.
    #[error(
        "buffer {buffer} needs {bytes} bytes; this device's storage buffers hold {limit}{advice}"
    )]
    BufferTooLarge {
        /// Which buffer.
        buffer: &'static str,
        /// Size needed.
        bytes: u64,
        /// `maxStorageBufferRange` of the device.
        limit: u64,
        /// What would fit, as the end of the message; empty if that is not known.
        advice: String,
    },
    /// More workgroups than the device runs at once.
    #[error("{count} workgroups of {kernel}; this device dispatches {limit}{advice}")]
    TooManyWorkgroups {
        /// Which kernel.
        kernel: &'static str,
        /// Number needed.
        count: u64,
        /// `maxComputeWorkGroupCount` of the device, first component.
        limit: u64,
        /// As in [`Error::BufferTooLarge`].
        advice: String,
    },
    /// A picture needs more (tile, splat) pairs than 32 bits count. Or one tile or workgroup has so many splats that
    /// the driver ended a shader's loop early: llvmpipe ends loops after 65,535 rounds.
    #[error(
        "too many (tile, splat) pairs: more than 32 bits count, or more in one tile than this \
         device's driver lets a shader go through"
    )]
    TooManyPairs,
}

impl Error {
    /// Whether host or device memory ran out.
    pub fn is_out_of_memory(&self) -> bool {
        use vk::Result as R;
        match self {
            Error::Memory { .. }
            | Error::BufferTooLarge { .. }
            | Error::TooManyWorkgroups { .. }
            | Error::TooManyPairs => true,
            Error::Call { result, .. } => {
                matches!(*result, R::ERROR_OUT_OF_HOST_MEMORY | R::ERROR_OUT_OF_DEVICE_MEMORY)
            }
            _ => false,
        }
    }

    /// For `map_err`: adds to the error of a passed limit how many of something the device has room for.
    pub(crate) fn with_room_for(most: u64, of: &str) -> impl Fn(Error) -> Error {
        let text = format!("; {most} {of} would fit");
        move |mut error| {
            if let Error::BufferTooLarge { advice, .. } | Error::TooManyWorkgroups { advice, .. } =
                &mut error
            {
                advice.clone_from(&text);
            }
            error
        }
    }

    /// For `map_err`: wraps a result code with the name of its call.
    pub(super) fn of(call: &'static str) -> impl Fn(vk::Result) -> Error {
        move |result| match result {
            vk::Result::ERROR_DEVICE_LOST => Error::DeviceLost { call },
            result => Error::Call { call, result },
        }
    }
}

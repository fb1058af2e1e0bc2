//! What can go wrong below the renderer.

use ash::vk;

/// A failure of the Vulkan layer, naming the call or thing that failed.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum Error {
    #[error(
        "no Vulkan loader ({0}); install a Vulkan driver: on Debian or Ubuntu `apt-get install \
         libvulkan1 mesa-vulkan-drivers` (a CPU driver that works everywhere), else your GPU's"
    )]
    NoLoader(String),
    #[error(
        "no Vulkan device fits: {found}. nvsprior needs Vulkan 1.2 with the \
         vulkanMemoryModel feature; on Debian or Ubuntu `apt-get install mesa-vulkan-drivers` \
         brings a CPU driver that works everywhere"
    )]
    NoDevice { found: String },
    #[error(
        "no Vulkan device \"{wanted}\"; there are: {found}. Give a number, or a part of a name"
    )]
    UnknownDevice { wanted: String, found: String },
    #[error("the given device does not fit: {reason}")]
    GivenDevice { reason: String },
    #[error("validation layer VK_LAYER_KHRONOS_validation is not installed")]
    NoValidationLayer,
    #[error("{call} failed: {result:?}")]
    Call { call: &'static str, result: vk::Result },
    #[error("device lost in {call}")]
    DeviceLost { call: &'static str },
    #[error("the device did not end its work within {milliseconds} ms, the time of the watchdog")]
    Hung { milliseconds: u64 },
    #[error("no memory for buffer {buffer} of {bytes} bytes: {reason}")]
    Memory { buffer: &'static str, bytes: u64, reason: String },
    #[error(
        "buffer {buffer} needs {bytes} bytes; this device's storage buffers hold {limit}{advice}"
    )]
    BufferTooLarge { buffer: &'static str, bytes: u64, limit: u64, advice: String },
    #[error("{count} workgroups of {kernel}; this device dispatches {limit}{advice}")]
    TooManyWorkgroups { kernel: &'static str, count: u64, limit: u64, advice: String },
    /// A picture needs more (tile, splat) pairs than 32 bits count. Or one tile or workgroup has so many splats that
    /// the driver ended a shader's loop early: llvmpipe ends loops after 65,535 rounds.
    #[error(
        "too many (tile, splat) pairs: more than 32 bits count, or more in one tile than this \
         device's driver lets a shader go through"
    )]
    TooManyPairs,
    #[error("the work was cancelled")]
    Interrupted,
    /// A part of what is drawn could not be read.
    #[error("{0}")]
    Unread(Box<dyn std::error::Error + Send + Sync>),
    #[error(
        "the camera sees blocks of {needed} splats; the memory of the prior has room for {room}: \
         raise its limit"
    )]
    TooManySplats { needed: u64, room: u64 },
}

impl Error {
    /// Whether host or device memory ran out.
    pub fn is_out_of_memory(&self) -> bool {
        use vk::Result as R;
        match self {
            Error::Memory { .. }
            | Error::BufferTooLarge { .. }
            | Error::TooManyWorkgroups { .. }
            | Error::TooManySplats { .. }
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

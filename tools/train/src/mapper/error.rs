//! Why a prior cannot be trained.

use nvsprior::prior::PriorError;
use nvsprior::vulkan::Error as DeviceError;

use crate::trainer::NoRoom;

#[derive(Debug, thiserror::Error)]
pub enum MapError {
    #[error("no picture to train on")]
    NoPictures,
    #[error("picture {index}: {width}×{height}, the first one has another size")]
    Size { index: usize, width: u32, height: u32 },
    #[error("picture {index}: its pose is not finite")]
    Pose { index: usize },
    #[error("option {name} = {value} is out of range: {range}")]
    Option { name: &'static str, value: f64, range: &'static str },
    #[error("the saved state is of another training: {what}")]
    State { what: &'static str },
    #[error(transparent)]
    Splats(#[from] PriorError),
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    #[error(transparent)]
    Device(#[from] DeviceError),
}

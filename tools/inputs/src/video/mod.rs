//! Video files as frames: decoded by a program beside this one, with their time stamps, and chosen for a mapping.

mod analysis;
mod clock;
mod decoder;
mod encoder;
mod error;
mod estimate;
mod folder;
mod frame;
mod interlaced;
mod mapping;
mod matroska;
mod motion;
mod plane;
mod probe;
mod reader;
mod select;
mod source;

pub use decoder::{Decoder, DecoderChoice, FrameSize, on_path};
pub use encoder::{EncoderError, encode_video, frame_name};
pub use error::VideoError;
pub use folder::{FrameRecord, Record, VideoRecord, frame_times};
pub use frame::{VideoFrame, rgb};
pub use mapping::frames_for_mapping;
pub use matroska::Header;
pub use reader::{Ended, VideoReader};
pub use select::ChoiceOptions;
pub use source::Video;

//! The two ends of a link: frames in and modem frames out, modem frames in and pictures out.
//!
//! A [`Vehicle`] is an encoder with all that sends its packets: rate or pull, protection, what the topside holds, keys,
//! frame numbers. A [`Topside`] is a decoder with all that brings them: packets from modem frames, poses, the order of
//! pictures and their age, reports. Neither has a thread, a socket, a file or a clock.
//!
//! # Give, then drain
//!
//! Every call has the time `now`: seconds on a clock of the caller's. Each side may have its own. If it is set back,
//! work goes on. *Give* an end what there is: a camera frame ([`Vehicle::frame`]), what the modem received
//! ([`VehicleLink::receive`], [`Topside::receive`]). Then *drain* it, each until there is no more:
//!
//! | | vehicle | topside |
//! |---|---|---|
//! | for the modem | [`VehicleLink::transmit`] | [`Topside::report`] |
//! | to show | | [`Topside::picture`] |
//! | to know | [`VehicleLink::event`] | [`TopsideLink::event`] |
//! | when to come again, at the latest | [`VehicleLink::due`] | [`TopsideLink::due`] |
//!
//! Whatever comes, in whatever order, an end goes on; what cannot be read is refused, and that is no failure. What an
//! end refuses loses nothing. [`VehicleEvent::Store`] and [`TopsideEvent::Store`] tell when to store a few bytes, with
//! which the end goes on after a restart: numbers of keys and frames that must not come twice.
//!
//! Who encodes or decodes elsewhere has [`VehicleLink`] and [`TopsideLink`]: packets in place of frames and pictures.
//!
//! ```no_run
//! # fn main() -> Result<(), nvsprior_link::LinkError> {
//! # let (engine, scene, camera) = todo!();
//! # let seconds: fn() -> f64 = todo!();
//! # let (camera_frame, modem_received): (fn() -> Option<nvsprior::Picture>, fn() -> Option<Vec<u8>>) = todo!();
//! # let modem_send: fn(&[u8]) = todo!();
//! use nvsprior_link::{CameraFrame, Vehicle, VehicleOptions};
//! let options = VehicleOptions::new(64, 5_000.0, 15.0);
//! let mut vehicle = Vehicle::new(&engine, &scene, &camera, Default::default(), &options)?;
//! loop {
//!     let now = seconds();
//!     if let Some(picture) = camera_frame() {
//!         let frame = CameraFrame { exposed: now, picture: &picture, info: Default::default(), user: &[] };
//!         vehicle.frame(now, &frame, seconds)?;
//!     }
//!     while let Some(bytes) = modem_received() {
//!         let _ = vehicle.link().receive(now, &bytes); // what is no report is refused
//!     }
//!     while let Some(frame) = vehicle.link().transmit(seconds(), 64)? {
//!         modem_send(frame);
//!     }
//! }
//! # }
//! ```

#![deny(unsafe_code)]

mod age_limit;
mod codec;
mod error;
mod event;
mod exposure;
mod frame_numbers;
mod frame_set;
mod hearing;
pub mod keys;
pub mod modem;
mod options;
mod pilot;
mod playout;
mod pull;
#[allow(missing_docs)] // The C library takes parts of it.
mod screen;
mod stored;
mod timeline;
mod topside;
mod topside_link;
mod vehicle;
mod vehicle_link;

pub use age_limit::{AgeLimit, VERY_OLD};
pub use codec::{LinkDecoder, LinkEncoder};
pub use error::LinkError;
pub use event::{TopsideEvent, VehicleEvent};
pub use exposure::{ClockSource, PERIOD as STAMP_PERIOD};
pub use options::{Pacing, Playout, TopsideOptions, VehicleOptions};
pub use pilot::Region;
pub use screen::{Shown, Shows};
pub use stored::MAX_STATE;
pub use topside::{Recalled, Topside};
pub use topside_link::{DuePacket, TopsideLink, Worth};
pub use vehicle::{CameraFrame, Vehicle};
pub use vehicle_link::{PlannedFrame, VehicleLink};

/// What the C library takes apart: it decodes on a thread of its own. No promise.
#[doc(hidden)]
pub mod parts {
    pub use crate::playout::Due;
    pub use crate::playout::number_of;
    pub use crate::screen::{Done, Screen, Work};
}

// What tests of all kinds share.
#[cfg(test)]
#[path = "../../../tests/common/mod.rs"]
mod common;
#[cfg(test)]
#[path = "../../../tests/scene/mod.rs"]
mod scene;
#[cfg(test)]
mod tests;

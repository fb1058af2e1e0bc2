//! GStreamer elements of nvsprior: pictures through an acoustic modem.
//!
//! | element | from | to |
//! |---|---|---|
//! | `nvspvehicle` | `video/x-raw`, and reports | modem frames |
//! | `nvsptopside` | modem frames | `video/x-raw`, and reports |
//! | `nvspenc` | `video/x-raw` | packets |
//! | `nvspdec` | packets | `video/x-raw` |
//!
//! `docs/gstreamer.md` says how they are used.

#![deny(unsafe_code)]
// `plugin_define` makes public items without any.
#![allow(missing_docs)]

mod caps;
mod coding;
mod decoder;
mod element;
mod encoder;
mod end_files;
mod held_prior;
mod lock;
mod property;
mod showing;
mod stats;
mod topside;
mod vehicle;

use gst::glib;

fn plugin_init(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    vehicle::register(plugin)?;
    topside::register(plugin)?;
    encoder::register(plugin)?;
    decoder::register(plugin)
}

gst::plugin_define!(
    nvsprior,
    env!("CARGO_PKG_DESCRIPTION"),
    plugin_init,
    env!("CARGO_PKG_VERSION"),
    // One of the two licences, as GStreamer writes it.
    "MIT/X11",
    "nvsprior",
    "nvsprior",
    "https://crates.io/crates/nvsprior"
);

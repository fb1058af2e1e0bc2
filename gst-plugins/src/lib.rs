//! GStreamer elements of nvsprior: pictures through an acoustic modem.
//!
//! | element | from | to |
//! |---|---|---|
//! | `nvspenc` | `video/x-raw` | packets |
//! | `nvsppay` | packets | shares, each one datagram or modem frame |
//! | `nvspdepay` | shares | packets |
//! | `nvspdec` | packets | `video/x-raw` |
//!
//! `docs/gstreamer.md` says how they are used.

#![deny(unsafe_code)]
// `plugin_define` makes public items without any.
#![allow(missing_docs)]

mod budget;
mod caps;
mod decoder;
mod depayloader;
mod element;
mod encoder;
mod held_prior;
mod keys;
mod lock;
mod payloader;
mod property;
mod stats;

use gst::glib;

fn plugin_init(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    budget::register();
    encoder::register(plugin)?;
    decoder::register(plugin)?;
    payloader::register(plugin)?;
    depayloader::register(plugin)
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

//! How fine the difference pictures of `nvspenc` are.

use gst::glib;
use nvsprior::Rate;

/// What decides how fine difference pictures are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, glib::Enum)]
#[enum_type(name = "NvspriorRate")]
pub enum RateKind {
    #[enum_value(name = "Quality of the difference picture: property quality", nick = "quality")]
    #[default]
    Quality,
    #[enum_value(name = "Bytes of the whole packet: property bytes", nick = "bytes")]
    Bytes,
    #[enum_value(name = "PSNR with as few bytes as possible: property psnr", nick = "psnr")]
    Psnr,
    #[enum_value(name = "No difference pictures: poses alone", nick = "none")]
    None,
}

/// The values of the properties about it.
#[derive(Clone, Copy, Debug)]
pub struct Fineness {
    pub rate: RateKind,
    pub quality: f32,
    pub bytes: u32,
    pub psnr: f32,
}

impl Default for Fineness {
    fn default() -> Fineness {
        Fineness { rate: RateKind::default(), quality: 10.0, bytes: 500, psnr: 30.0 }
    }
}

impl Fineness {
    pub fn rate(&self) -> Option<Rate> {
        match self.rate {
            RateKind::Quality => Some(Rate::Quality(self.quality)),
            RateKind::Bytes => Some(Rate::Bytes(self.bytes as usize)),
            RateKind::Psnr => Some(Rate::Psnr(f64::from(self.psnr))),
            RateKind::None => None,
        }
    }
}

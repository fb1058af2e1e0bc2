//! Layouts of pixels in DMA-BUFs.

use std::fmt;

/// A layout of pixels that only its maker's hardware reads: a DRM format modifier.
#[derive(Debug)]
pub(super) struct Modifier(pub u64);

impl fmt::Display for Modifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let owner = match self.0 >> 56 {
            _ if self.0 == 0x00ff_ffff_ffff_ffff => "DRM_FORMAT_MOD_INVALID, an unknown layout",
            0x01 => "a layout of Intel's",
            0x02 => "a layout of AMD's",
            0x03 => "a layout of NVIDIA's, such as block-linear",
            0x04 => "a layout of Samsung's",
            0x05 => "a layout of Qualcomm's",
            0x06 => "a layout of Vivante's",
            0x07 => "a layout of Broadcom's",
            0x08 => "a layout of Arm's, such as AFBC",
            0x09 => "a layout of Allwinner's",
            0x0a => "a layout of Amlogic's",
            _ => "an unknown layout",
        };
        write!(f, "modifier {:#018x}: {owner}", self.0)
    }
}

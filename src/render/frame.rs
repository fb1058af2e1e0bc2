//! The buffers of a camera's frame on the device, and of the search for its pose.

use bytemuck::Zeroable;

use crate::Picture;
use crate::image::Mask;
use crate::search::{self, Anchor, PoseCode, Program, Search};
use crate::shared::SUMS;
use crate::vulkan::{Buffer, Device, Error, Memory};

use super::levels::{Level, LevelBuffers};
use super::light::{Correction, FlatField};

/// A pose's code, and the frame that it is relative to. Stage `solve` writes it, stage `project` reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Coded {
    pub anchor: Anchor,
    pub code: PoseCode,
}

/// 8-bit pictures of the size of level 0.
pub struct Bytes {
    pub render: Buffer,
    pub coded_asked: Buffer,
    pub coded: Buffer,
}

/// What a search needs beyond a [`LevelBuffers`].
pub struct FrameBuffers {
    pub bytes: Buffer,
    /// How the frame's light becomes the prior's: see [`FlatField`].
    pub light: Buffer,
    light_floats: Vec<f32>,
    /// Which pixels do not count: see stage `pyramid`.
    pub mask: Buffer,
    pub difference: Buffer,
    pub search_asked: Buffer,
    pub search: Buffer,
    pub search_read: Buffer,
    pub coded_read: Buffer,
    /// Sums by tile of a search's last evaluation.
    pub tile_sums_read: Buffer,
}

/// Words of a picture's bytes, up to whole groups of four pixels.
fn words(level: &Level) -> usize {
    level.camera.pixels().div_ceil(4) * 3
}

impl Bytes {
    pub fn new(device: &Device, levels: &LevelBuffers) -> Result<Bytes, Error> {
        let words = levels.sizes.first().map_or(0, words);
        Ok(Bytes {
            render: Buffer::new::<u32>(device, "8-bit picture", words, Memory::Readback)?,
            coded_asked: Buffer::new::<Coded>(device, "pose code", 1, Memory::Upload)?,
            coded: Buffer::new::<Coded>(device, "pose code", 1, Memory::Device)?,
        })
    }
}

impl FrameBuffers {
    pub fn new(device: &Device, levels: &LevelBuffers) -> Result<FrameBuffers, Error> {
        let words = levels.sizes.first().map_or(0, words);
        let camera = levels.sizes.first().map(|level| level.camera);
        let [width, height] = camera.map_or([0, 0], |c| [c.width, c.height].map(|v| v as usize));
        let field = FlatField::new(width, height);
        let light = Buffer::new::<f32>(device, "light", field.room(), Memory::Upload)?;
        let mask_words = 1 + (width * height).div_ceil(32);
        let mut frame = FrameBuffers {
            mask: Buffer::new::<u32>(device, "mask", mask_words, Memory::Upload)?,
            light_floats: Vec::with_capacity(field.room()),
            light,
            bytes: Buffer::new::<u32>(device, "8-bit frame", words, Memory::Upload)?,
            difference: Buffer::new::<u32>(device, "difference", words, Memory::Readback)?,
            search_asked: Buffer::new::<Search>(device, "search", 1, Memory::Upload)?,
            search: Buffer::new::<Search>(device, "search", 1, Memory::Device)?,
            search_read: Buffer::new::<Search>(device, "search read back", 1, Memory::Readback)?,
            coded_read: Buffer::new::<Coded>(device, "pose code read back", 1, Memory::Readback)?,
            tile_sums_read: Buffer::new::<[f32; SUMS as usize]>(
                device,
                "sums by tile read back",
                levels.most_tiles() as usize,
                Memory::Readback,
            )?,
        };
        frame.set_light(&Correction::NONE, &field);
        frame.set_mask(None);
        Ok(frame)
    }

    /// How the light of frames is corrected, and what of them counts.
    pub fn set_light(&mut self, correction: &Correction, field: &FlatField) {
        field.floats(correction, &mut self.light_floats);
        self.light.write(&self.light_floats);
    }

    /// Which pixels of frames count; `None`: all do.
    pub fn set_mask(&mut self, mask: Option<&Mask>) {
        let Some(mask) = mask else {
            self.mask.write(&[0u32]);
            return;
        };
        let word = |pixels: &[bool]| {
            pixels.iter().rev().fold(0u32, |word, counts| word << 1 | u32::from(!counts))
        };
        let words: Vec<u32> = std::iter::once(1).chain(mask.data.chunks(32).map(word)).collect();
        self.mask.write(&words);
    }

    /// Asks for a search. Returns it as it begins.
    pub fn ask(&mut self, program: &Program) -> Search {
        let mut search = Search { program: *program, ..Search::zeroed() };
        search::begin(&mut search);
        self.search_asked.write(&[search]);
        search
    }

    /// Takes the camera's picture, of the size of level 0.
    pub fn set(&mut self, frame: &Picture) {
        self.bytes.write(&frame.data);
    }
}

/// A linear value as a byte: clamped, rounded to nearest; a NaN gives 0. Stage `quantize_rgb8` does the same.
pub fn to_byte(value: f32) -> u8 {
    crate::shared::to_byte(value) as u8
}

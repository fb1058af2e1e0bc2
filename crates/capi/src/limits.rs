//! How much memory calls may take: what a caller allows, and what each call needs at most.

use nvsprior::Camera;
use nvsprior::image::ImageView;
use nvsprior::prior::PriorClaims;
use nvsprior::tracking::Relocaliser;

use super::memory::Grant;
use super::status::Failure;

/// What an engine's options allow everything that is made with it.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// Most pixels of a picture.
    pub frame_pixels: u32,
    /// Most bytes of host memory that a prior, an encoder or a decoder may take.
    pub host_bytes: u64,
    /// What is made is for a stream.
    pub stream: bool,
    /// Key frames that what is made searches by.
    pub key_frames: usize,
}

impl Limits {
    /// Refuses a picture that is too large.
    pub(super) fn check(&self, width: u32, height: u32) -> Result<(), Failure> {
        if u64::from(width) * u64::from(height) > u64::from(self.frame_pixels) {
            let limit = self.frame_pixels;
            return Err(nvsprior::Error::FrameTooLarge { width, height, limit }.into());
        }
        Ok(())
    }

    /// Sets memory aside for an encoder of this camera, after its size was checked.
    pub(super) fn encoder(&self, camera: &Camera) -> Result<Grant, Failure> {
        self.check(camera.width, camera.height)?;
        Grant::take("an encoder", self.encoder_bytes(camera.width, camera.height), self.host_bytes)
    }

    /// Sets memory aside for an encoder that has two frames under way.
    pub(super) fn pipelined(&self, camera: &Camera) -> Result<Grant, Failure> {
        self.check(camera.width, camera.height)?;
        let bytes = 2 * self.encoder_bytes(camera.width, camera.height);
        Grant::take("an encoder", bytes, self.host_bytes)
    }

    /// Sets memory aside for coding difference pictures of this size.
    pub(super) fn coder(&self, (width, height): (u32, u32)) -> Result<Grant, Failure> {
        let bytes = self.encoder_bytes(width, height);
        Grant::take("a coder of difference pictures", bytes, self.host_bytes)
    }

    /// Sets memory aside for reading a mask of this size, as far as it can be one.
    pub(super) fn mask(&self, width: u32, height: u32) -> Result<Grant, Failure> {
        let most = u64::from(ImageView::MAX_SIDE);
        let bytes = u64::from(width).min(most) * u64::from(height).min(most);
        Grant::take("a mask", bytes + SMALL, self.host_bytes)
    }

    /// Sets memory aside for what an encoder's images are seen through, and for another camera unless it stays the
    /// same.
    pub(super) fn seen(&self, camera: &Camera, seen: u64, same: bool) -> Result<Grant, Failure> {
        self.check(camera.width, camera.height)?;
        let own = if same { SMALL } else { self.encoder_bytes(camera.width, camera.height) };
        Grant::take("an encoder's camera, lens and mask", own + seen, self.host_bytes)
    }

    /// Sets memory aside for decoding pictures of this size.
    pub(super) fn decoder(&self, (width, height): (u32, u32)) -> Result<Grant, Failure> {
        self.check(width, height)?;
        Grant::take("a decoder", decoder(width, height), self.host_bytes)
    }

    /// Sets memory aside for the first packet of a stream of this size.
    pub(super) fn stream(&self, (width, height): (u32, u32)) -> Result<Grant, Failure> {
        Grant::take("the frames of a stream", stream_decoder(width, height), self.host_bytes)
    }

    fn encoder_bytes(&self, width: u32, height: u32) -> u64 {
        encoder(width, height)
            + if self.stream { stream_encoder(width, height) } else { 0 }
            + Relocaliser::landmark_bytes(self.key_frames) as u64
    }

    /// Sets memory aside for reading a file of `size` bytes. Reading itself grows its memory by steps.
    pub(super) fn file(&self, size: u64) -> Result<Grant, Failure> {
        Grant::take("a prior's file", 2 * size + SMALL, self.host_bytes.saturating_add(SMALL))
    }

    /// Sets memory aside for the head of a prior in blocks, in a file of `size` bytes.
    pub(super) fn blocks_head(&self, size: u64) -> Result<Grant, Failure> {
        // A block takes 40 bytes of the head, and more of the file.
        Grant::take(
            "the head of a prior",
            4 * (size / 8).min(LONGEST_HEAD) + PRIOR,
            self.host_bytes,
        )
    }

    /// Sets memory aside for a prior of this content, with a file of `beside` bytes beside it.
    pub(super) fn prior(&self, bytes: &[u8], beside: u64) -> Result<Grant, Failure> {
        let needed = PriorClaims::of(bytes).map_or(PRIOR, |claims| prior(&claims));
        // Its bytes, and what they hold: a key frame takes the most.
        let beside = beside.saturating_mul(8);
        Grant::take("a prior", needed.saturating_add(beside), self.host_bytes)
    }
}

/// Bytes that every call may take besides: lists of the driver's objects, texts, threads.
pub(super) const SMALL: u64 = 1 << 20;

/// Opening a device: shader modules, lists of the driver's extensions and memory types.
pub(super) fn engine_bytes() -> u64 {
    8 * SMALL
}

/// Bytes of a head of a million blocks, with the doubt of some million splats.
const LONGEST_HEAD: u64 = 64 << 20;

/// A prior besides its splats: coder tables beside it, pipelines.
const PRIOR: u64 = 8 * SMALL;

/// Opening a prior, besides the content of its file.
pub(super) fn prior(claims: &PriorClaims) -> u64 {
    claims.host_bytes() + PRIOR
}

/// Device memory of an encoder or a decoder for each splat, bytes; measured: 102.
pub(super) const WORKSPACE: u64 = 112;

/// Device memory of an encoder besides [`WORKSPACE`]; measured: 0.5 MB and 70 bytes per pixel.
pub(super) fn encoder_device(width: u32, height: u32) -> u64 {
    SMALL + 80 * pixels(width, height)
}

/// Device memory of a decoder besides [`WORKSPACE`]; measured: 0.5 MB and 61 bytes per pixel.
pub(super) fn decoder_device(width: u32, height: u32) -> u64 {
    SMALL + 72 * pixels(width, height)
}

/// An encoder of pictures of this size, and its first frame; measured: 5.6 MB, 210 bytes per pixel, and the search by
/// key frames. That takes 44 bytes for each pixel of its picture, which is enlarged, but to no more than 640 columns.
pub(super) fn encoder(width: u32, height: u32) -> u64 {
    let (across, down) = (u64::from(width), u64::from(height));
    let pixels = pixels(width, height);
    let searched = (640 * 640 * down / across.max(1)).clamp(pixels, 4 * pixels);
    8 * SMALL + 224 * pixels + 48 * searched
}

/// Decoding pictures of this size; measured: 0.4 MB and 131 bytes per pixel.
pub(super) fn decoder(width: u32, height: u32) -> u64 {
    4 * SMALL + 136 * pixels(width, height)
}

/// What an encoder of a stream takes besides: 32 frames of 6 bytes per pixel, 27 planes of 4, depths, four
/// pyramids.
pub(super) fn stream_encoder(width: u32, height: u32) -> u64 {
    SMALL + 327 * pixels(width, height)
}

/// What a decoder takes besides, from the first packet of a stream on: the frames, 15 planes, a picture, depths.
pub(super) fn stream_decoder(width: u32, height: u32) -> u64 {
    SMALL + 272 * pixels(width, height)
}

/// Pixels, with sides rounded up as the coders do.
fn pixels(width: u32, height: u32) -> u64 {
    u64::from(width.next_multiple_of(16)) * u64::from(height.next_multiple_of(16))
}

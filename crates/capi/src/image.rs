//! Images, pictures, cameras and poses as C hands them over.

use nvsprior::image::{Colour, ImageView, PixelFormat, write_picture};
use nvsprior::{Camera, Picture, Pose};

use super::dmabuf::{self, Readings, nvsp_dmabuf};
use super::handle::fence;
use super::slices::{slice, slice_mut};
use super::status::*;
use super::structs::{Checked, In, NVSP_ABI_VERSION, Out, versioned};

/// Three bytes per pixel: red, green, blue.
pub const NVSP_FORMAT_RGB8: u32 = 1;
/// Three bytes per pixel: blue, green, red.
pub const NVSP_FORMAT_BGR8: u32 = 2;
/// Four bytes per pixel: red, green, blue, alpha. Alpha is ignored in images and 255 in pictures.
pub const NVSP_FORMAT_RGBA8: u32 = 3;
/// Plane 0: Y; plane 1: U and V in turn, one pair per two by two pixels. Images only.
pub const NVSP_FORMAT_NV12: u32 = 4;
/// Planes Y, U, V; one U and one V per two by two pixels. Images only.
pub const NVSP_FORMAT_I420: u32 = 5;

/// BT.601, limited range: what most cameras and V4L2 deliver.
pub const NVSP_COLOUR_BT601_LIMITED: u32 = 0;
/// BT.601, full range: JPEG.
pub const NVSP_COLOUR_BT601_FULL: u32 = 1;
/// BT.709, limited range: HDTV, most H.264 decoders.
pub const NVSP_COLOUR_BT709_LIMITED: u32 = 2;
/// BT.709, full range.
pub const NVSP_COLOUR_BT709_FULL: u32 = 3;

/// A camera's image; read during the call only. If its size is not the camera's, it is scaled to
/// it. Its shape must be the camera's (1 % is tolerated). With a lens its size must be the lens's.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_image {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_FORMAT_*.
    pub format: u32,
    /// NVSP_COLOUR_*; used for NV12 and I420 only.
    pub colour: u32,
    /// Pixels, 1 to 16384.
    pub width: u32,
    /// Pixels, 1 to 16384.
    pub height: u32,
    /// First byte of each plane that the format has. All NULL if the planes lie in `dmabufs`.
    pub planes: [*const u8; 3],
    /// Bytes from one row to the next, of each plane.
    pub strides: [usize; 3],
    /// Bytes of each plane. Nothing beyond them is read. For a plane in a DMA-BUF 0 means up to its end.
    pub sizes: [usize; 3],
    /// The DMA-BUF that each plane lies in, which nobody may write during the call. NULL, except for the first: the
    /// first's. All NULL: the image lies at `planes`.
    pub dmabufs: [*const nvsp_dmabuf; 3],
    /// Where each plane begins in its DMA-BUF, bytes. 0 if there is none.
    pub offsets: [usize; 3],
}
versioned!(nvsp_image, 144);

/// A place for a picture. The call that fills it also writes its `width`, `height` and `needed`, if it succeeds and if
/// it fails with NVSP_ERR_BUFFER_TOO_SMALL. So a place without pixels asks for the size.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_picture {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_FORMAT_RGB8, NVSP_FORMAT_BGR8 or NVSP_FORMAT_RGBA8.
    pub format: u32,
    /// Receives the picture's width, pixels.
    pub width: u32,
    /// Receives the picture's height, pixels.
    pub height: u32,
    /// Zero.
    pub reserved: u32,
    /// First byte. NULL only if `size` is 0.
    pub pixels: *mut u8,
    /// Bytes from one row to the next; 0: rows without padding. Bytes after a row's pixels are left as they are.
    pub stride: usize,
    /// Bytes of the place. Nothing beyond them is written.
    pub size: usize,
    /// Receives how many bytes the picture needs with this format and stride.
    pub needed: usize,
}
versioned!(nvsp_picture, 56);

/// A pinhole camera without distortion; x right, y down, z forward. Pixel (0, 0) covers [0, 1) x [0, 1). A device
/// refuses sizes for which its buffers are too small or its dispatches too few, with NVSP_ERR_MEMORY; the text tells
/// the limit. Every device that Vulkan 1.2 allows takes 2048 by 2048.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_camera {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Pixels, 1 to 4096.
    pub width: u32,
    /// Pixels, 1 to 4096.
    pub height: u32,
    /// Focal length along x, pixels, 0.01 to 1,000,000.
    pub fx: f32,
    /// Focal length along y, pixels, 0.01 to 1,000,000.
    pub fy: f32,
    /// Principal point, x, pixels from the left edge, -1,000,000 to 1,000,000.
    pub cx: f32,
    /// Principal point, y, pixels from the upper edge, -1,000,000 to 1,000,000.
    pub cy: f32,
}
versioned!(nvsp_camera, 32);

/// Where a camera stands: x_camera = R x_world + t. Within another structure it always has the fields below, set up as
/// by NVSP_INIT; what a pose gains in a later version is appended to the outer structure.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_pose {
    pub struct_size: u32,
    pub abi_version: u32,
    /// Quaternion of R: w, x, y, z. Any length but zero.
    pub rotation: [f64; 4],
    /// t, in the prior's unit.
    pub translation: [f64; 3],
}
versioned!(nvsp_pose, 64);

fn format(code: u32, field: &'static str) -> Result<PixelFormat, Failure> {
    match code {
        NVSP_FORMAT_RGB8 => Ok(PixelFormat::Rgb8),
        NVSP_FORMAT_BGR8 => Ok(PixelFormat::Bgr8),
        NVSP_FORMAT_RGBA8 => Ok(PixelFormat::Rgba8),
        NVSP_FORMAT_NV12 => Ok(PixelFormat::Nv12),
        NVSP_FORMAT_I420 => Ok(PixelFormat::I420),
        _ => Err(Failure::argument(field)),
    }
}

fn colour(code: u32) -> Result<Colour, Failure> {
    match code {
        NVSP_COLOUR_BT601_LIMITED => Ok(Colour::Bt601Limited),
        NVSP_COLOUR_BT601_FULL => Ok(Colour::Bt601Full),
        NVSP_COLOUR_BT709_LIMITED => Ok(Colour::Bt709Limited),
        NVSP_COLOUR_BT709_FULL => Ok(Colour::Bt709Full),
        _ => Err(Failure::argument("nvsp_image.colour")),
    }
}

/// Reads an image, as the converter takes it, and what keeps the planes readable that lie in DMA-BUFs.
///
/// # Safety
/// The planes have as many bytes as the image says, which nobody changes for as long as the result is in use.
pub(super) unsafe fn view<'a>(image: In<nvsp_image>) -> Result<(ImageView<'a>, Readings), Failure> {
    let image = image.required()?;
    let format = format(image.format, "nvsp_image.format")?;
    let count = format.planes().len();
    let colour = if count > 1 { colour(image.colour)? } else { Colour::default() };
    // SAFETY: the planes are as the image says, see `# Safety`.
    let (planes, readings) = unsafe { planes(&image, count)? };
    let nvsp_image { width, height, strides, .. } = image;
    Ok((ImageView { width, height, format, colour, planes, strides }, readings))
}

/// The bytes of an image's planes.
///
/// # Safety
/// As for [`view`].
unsafe fn planes<'a>(image: &nvsp_image, count: usize) -> Result<dmabuf::Planes<'a>, Failure> {
    let nvsp_image { dmabufs, offsets, sizes, .. } = *image;
    if dmabufs.iter().any(|buffer| !buffer.is_null()) {
        if image.planes.iter().any(|plane| !plane.is_null()) {
            return Err(Failure::argument("nvsp_image: planes and dmabufs"));
        }
        // SAFETY: NULL or live handles, as the header asks of this field. Nobody writes the buffers, see `# Safety`,
        // and each reading comes along.
        return unsafe { dmabuf::planes(dmabufs, offsets, sizes, count) };
    }
    if offsets != [0; 3] {
        return Err(Failure::argument("nvsp_image.offsets: without dmabufs"));
    }
    let mut planes: [&[u8]; 3] = [&[]; 3];
    for (i, plane) in planes.iter_mut().enumerate().take(count) {
        // SAFETY: so many bytes stand there, see `# Safety`.
        *plane = unsafe { slice(image.planes[i], sizes[i], "nvsp_image.planes")? };
    }
    Ok((planes, [None, None, None]))
}

/// Writes a picture to the caller's place, and how large it is.
pub(super) fn write(picture: &Picture, place: Out<nvsp_picture>) -> Result<(), Failure> {
    let Fitting { out, place, format, stride } = check_place(picture, place)?;
    // SAFETY: so many bytes stand there, as the header asks of these fields.
    let into = unsafe { slice_mut(place.pixels, place.size, "nvsp_picture.pixels")? };
    write_picture(picture, format, stride, into)?;
    out.write(&place);
    Ok(())
}

/// A place that a picture fits.
pub(super) struct Fitting {
    out: Checked<nvsp_picture>,
    place: nvsp_picture,
    format: PixelFormat,
    stride: usize,
}

/// Checks the caller's place for a picture of this size. If it is too small, writes how large it must be.
pub(super) fn check_place(picture: &Picture, place: Out<nvsp_picture>) -> Result<Fitting, Failure> {
    let (out, mut place) = (place.required()?, place.given().read()?);
    let format = format(place.format, "nvsp_picture.format")?;
    if place.reserved != 0 {
        return Err(Failure::argument("nvsp_picture.reserved: not zero"));
    }
    let [plane] = format.planes() else {
        return Err(Failure::argument("nvsp_picture.format"));
    };
    let row = picture.width as usize * plane.step;
    let stride = if place.stride == 0 { row } else { place.stride };
    if stride < row {
        return Err(Failure::argument("nvsp_picture.stride: below a row of pixels"));
    }
    let needed = stride.saturating_mul(picture.height as usize - 1).saturating_add(row);
    (place.width, place.height, place.needed) = (picture.width, picture.height, needed);
    if place.size < needed {
        out.write(&place);
        return Err(Failure::Room { needed, found: place.size });
    }
    Ok(Fitting { out, place, format, stride })
}

pub(super) fn camera(camera: In<nvsp_camera>) -> Result<Camera, Failure> {
    let nvsp_camera { width, height, fx, fy, cx, cy, .. } = camera.required()?;
    let camera = Camera { width, height, fx, fy, cx, cy };
    camera.check().map_err(nvsprior::Error::from)?;
    let (focal, centre) = (0.01..=FAR, -FAR..=FAR);
    for (fits, field) in [
        (focal.contains(&fx), "nvsp_camera.fx"),
        (focal.contains(&fy), "nvsp_camera.fy"),
        (centre.contains(&cx), "nvsp_camera.cx"),
        (centre.contains(&cy), "nvsp_camera.cy"),
    ] {
        if !fits {
            return Err(Failure::argument(field));
        }
    }
    Ok(camera)
}

/// What no camera's intrinsics reach, pixels.
const FAR: f32 = 1e6;

/// A pose from outside, if there is one.
pub(super) fn pose(pose: In<nvsp_pose>) -> Result<Option<Pose>, Failure> {
    let Some(pose) = pose.optional()? else { return Ok(None) };
    let pose = Pose::from_wxyz(pose.rotation, pose.translation);
    pose.map(Some).ok_or(Failure::argument("a pose that is no rigid motion"))
}

/// Writes the pose on the way from one pose to another: 0 is the first, 1 the second, and each step of the way is the
/// same motion. Beyond 0 to 1 it goes on. Any thread may call it.
///
/// Fails with NVSP_ERR_ARGUMENT if a pose is no rigid motion or the part is not finite, or so large that the pose is
/// not.
///
/// # Parameters
/// - `from`, `to`: the poses, from world to camera.
/// - `part`: the part of the way: of a frame number between two others, (number - first) / (second - first).
/// - `between`: receives the pose.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_pose_between(
    from: In<nvsp_pose>,
    to: In<nvsp_pose>,
    part: f64,
    between: Out<nvsp_pose>,
) -> nvsp_status {
    fence(|| {
        let (out, from, to) = (between.required()?, pose(from)?, pose(to)?);
        let (Some(from), Some(to)) = (from, to) else { return Err(Failure::null("from or to")) };
        let found = pose_out(&from.between(&to, part));
        let numbers = found.rotation.iter().chain(&found.translation);
        if !part.is_finite() || !numbers.copied().all(f64::is_finite) {
            return Err(Failure::argument("part: not finite, or too large"));
        }
        out.write(&found);
        Ok(NVSP_OK)
    })
}

pub(super) fn pose_out(pose: &Pose) -> nvsp_pose {
    nvsp_pose { rotation: pose.wxyz(), translation: pose.translation.into(), ..NO_POSE }
}

/// A pose of zeros, set up.
pub(super) const NO_POSE: nvsp_pose = nvsp_pose {
    struct_size: size_of::<nvsp_pose>() as u32,
    abi_version: NVSP_ABI_VERSION,
    rotation: [0.0; 4],
    translation: [0.0; 3],
};

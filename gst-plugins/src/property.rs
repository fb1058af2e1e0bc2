//! Properties that are written as text: cameras, lenses, poses, masks.

use std::path::PathBuf;

use nvsprior::geometry::{CameraError, Distortion, Intrinsics, Lens, LensError};
use nvsprior::image::{Mask, PixelError};
use nvsprior::residual::Interest;
use nvsprior::{Camera, Pose};
use nvsprior_link::Region;

/// Why a property cannot be used. The texts name the property, and say what it should be.
#[derive(Debug, thiserror::Error)]
pub enum PropertyError {
    #[error("property {0} is not set: {1}")]
    Missing(&'static str, &'static str),
    #[error("property {name}: {word:?} is no number")]
    Number { name: &'static str, word: String },
    #[error("property {name} = {value:?}: {found} numbers, but it must be {form}")]
    Count { name: &'static str, value: String, found: usize, form: &'static str },
    #[error("property camera: {0}")]
    Camera(#[from] CameraError),
    #[error("property lens: {0}")]
    Lens(#[from] LensError),
    #[error("property lens = {0:?}: it must begin with brown or fisheye")]
    LensModel(String),
    #[error("property start: {0:?} is no pose, as its rotation is no quaternion")]
    Pose(String),
    #[error("property region: {0:?} is no part of the picture; it must be {REGION_FORM}")]
    Region(String),
    #[error("property mask: {}: {error}", file.display())]
    MaskFile { file: PathBuf, error: image::ImageError },
    #[error("property mask: {0}")]
    Mask(#[from] PixelError),
}

const CAMERA_FORM: &str =
    "width,height,fx,fy,cx,cy in pixels, or fx,fy,cx,cy for frames as they come";
const POSE_FORM: &str = "qw,qx,qy,qz,tx,ty,tz, world to camera";
const REGION_FORM: &str = "x,y,width,height as parts of the picture's width and height";
const LENS_FORM: &str = "MODEL,width,height,fx,fy,cx,cy,k1,..., with 4, 5 or 8 coefficients for \
                         brown, and 4 for fisheye";

fn numbers(name: &'static str, text: &str) -> Result<Vec<f64>, PropertyError> {
    let number = |word: &str| {
        let word = word.trim();
        word.parse().map_err(|_| PropertyError::Number { name, word: word.to_owned() })
    };
    text.split(',').map(number).collect()
}

fn count(name: &'static str, value: &str, found: usize, form: &'static str) -> PropertyError {
    PropertyError::Count { name, value: value.to_owned(), found, form }
}

/// A camera. `frames`: width and height of the frames, for a camera that states none.
pub fn camera(text: &str, frames: (u32, u32)) -> Result<Camera, PropertyError> {
    let numbers = numbers("camera", text)?;
    let (width, height, rest) = match numbers[..] {
        [width, height, fx, fy, cx, cy] => (width as u32, height as u32, [fx, fy, cx, cy]),
        [fx, fy, cx, cy] => (frames.0, frames.1, [fx, fy, cx, cy]),
        _ => return Err(count("camera", text, numbers.len(), CAMERA_FORM)),
    };
    let [fx, fy, cx, cy] = rest.map(|value| value as f32);
    let camera = Camera { width, height, fx, fy, cx, cy };
    camera.check()?;
    Ok(camera)
}

pub fn sized_camera(text: &str) -> Result<Camera, PropertyError> {
    match numbers("camera", text)?.len() {
        6 => camera(text, (0, 0)),
        found => Err(count("camera", text, found, "width,height,fx,fy,cx,cy in pixels")),
    }
}

/// A lens with distortion, as OpenCV's calibration gives it.
pub fn lens(text: &str) -> Result<Lens, PropertyError> {
    let (model, rest) = text.split_once(',').unwrap_or((text, ""));
    let fisheye = match model.trim() {
        "brown" => false,
        "fisheye" => true,
        _ => return Err(PropertyError::LensModel(text.to_owned())),
    };
    let numbers = numbers("lens", rest)?;
    let Some((&[width, height, fx, fy, cx, cy], coefficients)) = numbers.split_first_chunk() else {
        return Err(count("lens", text, numbers.len(), LENS_FORM));
    };
    let distortion = match fisheye {
        false => Distortion::brown(coefficients)?,
        true => {
            let four = coefficients.try_into();
            Distortion::Fisheye(four.map_err(|_| count("lens", text, numbers.len(), LENS_FORM))?)
        }
    };
    let (width, height) = (width as u32, height as u32);
    let lens = Lens::new(Intrinsics { width, height, fx, fy, cx, cy }, distortion)?;
    lens.check_corners()?;
    Ok(lens)
}

pub fn pose(text: &str) -> Result<Pose, PropertyError> {
    let numbers = numbers("start", text)?;
    let [qw, qx, qy, qz, tx, ty, tz] = numbers[..] else {
        return Err(count("start", text, numbers.len(), POSE_FORM));
    };
    let pose = Pose::from_wxyz([qw, qx, qy, qz], [tx, ty, tz]).filter(Pose::is_finite);
    pose.ok_or_else(|| PropertyError::Pose(text.to_owned()))
}

/// A part of pictures of a size, with a weight. `text`: its left and upper edge, width and height, all from 0 to 1.
pub fn region(text: &str, size: (u32, u32), weight: u8) -> Result<Interest, PropertyError> {
    let [x, y, width, height] = region_parts(text)?;
    let part = |from: f64, length: f64, of: u32| {
        let pixel = |at: f64| (at * f64::from(of)) as u32;
        // At least one pixel.
        pixel(from).min(of - 1)..pixel(from + length).max(pixel(from) + 1)
    };
    let (across, down) = (part(x, width, size.0), part(y, height, size.1));
    Interest::rectangle(size, across, down, weight)
        .map_err(|_| PropertyError::Region(text.to_owned()))
}

/// The same for a topside, which does not know the pictures' size yet.
pub fn pilots_region(text: &str, weight: u32) -> Result<Region, PropertyError> {
    let [x, y, width, height] = region_parts(text)?;
    let edges = [x, y, (x + width).min(1.0), (y + height).min(1.0)];
    let weight = u8::try_from(weight).unwrap_or(u8::MAX);
    Region::new(edges, weight).ok_or_else(|| PropertyError::Region(text.to_owned()))
}

fn region_parts(text: &str) -> Result<[f64; 4], PropertyError> {
    let numbers = numbers("region", text)?;
    let [x, y, width, height] = numbers[..] else {
        return Err(count("region", text, numbers.len(), REGION_FORM));
    };
    let inside =
        |from: f64, length: f64| from >= 0.0 && length > 0.0 && from + length <= 1.0 + 1e-9;
    match inside(x, width) && inside(y, height) {
        true => Ok([x, y, width, height]),
        false => Err(PropertyError::Region(text.to_owned())),
    }
}

/// The mask in a PNG file: white counts.
pub fn mask(file: &str) -> Result<Mask, PropertyError> {
    let file = PathBuf::from(file);
    let picture = match image::open(&file) {
        Ok(picture) => picture.into_luma8(),
        Err(error) => return Err(PropertyError::MaskFile { file, error }),
    };
    let (width, height) = picture.dimensions();
    Ok(Mask::from_gray(width, height, picture.as_raw(), width as usize)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_read() {
        let six = camera("320,180,274.4,274.4,160,90", (640, 360)).unwrap();
        assert_eq!((six.width, six.height, six.fx, six.cy), (320, 180, 274.4, 90.0));
        let four = camera("548.8, 548.8, 320, 180", (640, 360)).unwrap();
        assert_eq!((four.width, four.height, four.cx), (640, 360, 320.0));
        assert_eq!(four.at_most_wide(320).fx, 274.4);
        assert_eq!(four.at_most_wide(0), four);
        for wrong in ["", "1,2,3", "320,180,x,1,1,1", "0,180,1,1,1,1", "320,180,-1,1,1,1"] {
            let text = camera(wrong, (640, 360)).unwrap_err().to_string();
            assert!(text.contains("property camera"), "{text}");
        }
        assert!(sized_camera("1,1,1,1").is_err());
    }

    #[test]
    fn lenses_are_read() {
        let brown = lens("brown,640,360,500,500,320,180,-0.1,0.01,0,0").unwrap();
        assert_eq!(brown.size(), (640, 360));
        assert!(lens("fisheye,640,360,300,300,320,180,0.01,0,0,0").is_ok());
        let wrong = [
            "pinhole,1",
            "brown,640,360,500,500,320",
            "brown,640,360,500,500,320,180,1,2,3",
            "fisheye,640,360,300,300,320,180,0.01",
        ];
        for wrong in wrong {
            let text = lens(wrong).unwrap_err().to_string();
            assert!(text.contains("property lens"), "{text}");
        }
    }

    #[test]
    fn poses_are_read() {
        assert_eq!(pose("1,0,0,0,0.5,0,0").unwrap().translation.x, 0.5);
        for wrong in ["1,0,0,0,1,2", "0,0,0,0,1,2,3", "1,0,0,0,1,2,nan", "a,0,0,0,1,2,3"] {
            let text = pose(wrong).unwrap_err().to_string();
            assert!(text.contains("property start"), "{text}");
        }
    }

    #[test]
    fn regions_are_read() {
        let size = (320, 180);
        let rectangle = Interest::rectangle(size, 80..240, 45..90, 8).unwrap();
        assert_eq!(region("0.25,0.25,0.5,0.25", size, 8).unwrap(), rectangle);
        assert!(region("0,0,1,1", size, 8).is_ok());
        assert!(region("0.999,0.999,0.0001,0.0001", size, 8).is_ok());
        for wrong in ["", "0,0,1", "0,0,0,1", "0.5,0,0.6,1", "-0.1,0,0.5,1", "nan,0,1,1", "0,0,1,x"]
        {
            let text = region(wrong, size, 8).unwrap_err().to_string();
            assert!(text.contains("property region"), "{text}");
        }
    }

    #[test]
    fn a_missing_mask_is_named() {
        let text = mask("/no/such/mask.png").unwrap_err().to_string();
        assert!(text.contains("/no/such/mask.png"), "{text}");
    }
}

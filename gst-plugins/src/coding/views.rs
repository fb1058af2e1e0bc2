//! From frames as they come to pictures as the encoder takes them.

use nvsprior::image::{Converter, ImageView, Mask};
use nvsprior::{Camera, Encoder, Error, Picture};
use nvsprior_link::LinkError;

use crate::property::{self, PropertyError};

use super::settings::Coding;

/// Why frames cannot be encoded as the properties say.
#[derive(Debug, thiserror::Error)]
pub enum SetUpError {
    #[error(transparent)]
    Property(#[from] PropertyError),
    #[error(transparent)]
    Library(#[from] Error),
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// What makes the camera's pictures of frames of a size.
pub struct Views {
    converter: Converter,
    picture: Picture,
    /// The region of interest as the properties had it last, and its weight.
    region: Option<(String, u32)>,
}

impl Views {
    /// For frames of a size, as the properties say: the camera, its pictures, and which of their pixels count.
    pub fn new(
        coding: &Coding,
        size: (u32, u32),
    ) -> Result<(Camera, Views, Option<Mask>), SetUpError> {
        let (camera, converter, mask) = views(coding, size)?;
        let picture = Picture::new(camera.width, camera.height);
        Ok((camera, Views { converter, picture, region: None }, mask))
    }

    /// As [`Views::new`], for an encoder that goes on with its numbers and poses.
    pub fn changed(
        coding: &Coding,
        size: (u32, u32),
        encoder: &mut Encoder,
    ) -> Result<Views, SetUpError> {
        let (camera, mut views, mask) = Views::new(coding, size)?;
        encoder.set_mask(None)?;
        encoder.set_camera(&camera)?;
        encoder.set_mask(mask.as_ref())?;
        views.look(coding, encoder)?;
        Ok(views)
    }

    /// Follows the region of interest.
    pub fn look(&mut self, coding: &Coding, encoder: &mut Encoder) -> Result<(), PropertyError> {
        let region = coding.region.clone().map(|text| (text, coding.region_weight));
        if self.region == region {
            return Ok(());
        }
        self.region = region;
        let Camera { width, height, .. } = *encoder.camera();
        let weight = |weight: u32| u8::try_from(weight).unwrap_or(u8::MAX);
        let interest = self.region.as_ref();
        let interest = interest
            .map(|(text, of)| property::region(text, (width, height), weight(*of)))
            .transpose()?;
        encoder.set_interest(interest);
        Ok(())
    }

    /// The camera's picture of a frame.
    pub fn picture(&mut self, image: &ImageView) -> Result<&Picture, Error> {
        self.converter.convert(image, &mut self.picture)?;
        Ok(&self.picture)
    }
}

/// The camera, what makes its pictures of frames of a size, and which of their pixels count.
fn views(
    settings: &Coding,
    size: (u32, u32),
) -> Result<(Camera, Converter, Option<Mask>), SetUpError> {
    let lens = settings.lens.as_deref().map(property::lens).transpose()?;
    let mask = settings.mask.as_deref().map(property::mask).transpose()?;
    let camera = match (&settings.camera, &lens) {
        (Some(camera), _) => property::camera(camera, size)?,
        (None, Some(lens)) => lens.pinhole(),
        (None, None) => {
            let what = "give fx,fy,cx,cy or width,height,fx,fy,cx,cy in pixels, or a lens";
            return Err(PropertyError::Missing("camera", what).into());
        }
    };
    let camera = camera.at_most_wide(settings.width);
    camera.check().map_err(PropertyError::from)?;
    let Some(lens) = lens else {
        let converter = Converter::new(camera.width, camera.height).map_err(Error::from)?;
        let mask = mask.map(|mask| mask.resized(camera.width, camera.height));
        return Ok((camera, converter, mask));
    };
    let converter = Converter::undistorting(&lens, &camera).map_err(PropertyError::from)?;
    let mask = match mask {
        Some(mask) => Some(mask.undistorted(&lens, &camera).map_err(PropertyError::from)?),
        None => converter.covered().cloned(),
    };
    Ok((camera, converter, mask))
}

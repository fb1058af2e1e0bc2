//! The topside: packets in, pictures out.

use std::sync::Arc;

use crate::packet::{Latent, PacketError, Residual};
use crate::render::{Plan, Renderer, Scene};
use crate::residual::decode_residual;
use crate::{Camera, Engine, Error, Packet, Picture, Pose};

/// A decoded frame.
#[derive(Debug)]
pub struct Decoded {
    /// The picture.
    pub picture: Picture,
    /// Frame number, modulo 2²⁴.
    pub frame: u32,
    /// The pose it was rendered at.
    pub pose: Pose,
    /// The vehicle was not sure of the pose.
    pub uncertain: bool,
    /// What of the packet could not be used: then the picture is the render alone.
    pub damage: Option<Error>,
}

/// Decodes packets, in any order.
pub struct Decoder {
    engine: Engine,
    scene: Arc<Scene>,
    cameras: Vec<Camera>,
    renderer: Option<(Camera, Renderer)>,
}

/// Cameras that a decoder remembers: one per tag.
const CAMERAS: usize = 256;

impl Decoder {
    /// Makes a decoder of packets about an uploaded prior.
    pub fn new(engine: &Engine, scene: &Arc<Scene>) -> Decoder {
        Decoder {
            engine: engine.clone(),
            scene: scene.clone(),
            cameras: Vec::new(),
            renderer: None,
        }
    }

    /// Tells the decoder of a camera, for packets that only name it.
    pub fn add_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        camera.check()?;
        if !self.cameras.contains(camera) {
            if self.cameras.len() == CAMERAS {
                self.cameras.remove(0);
            }
            self.cameras.push(*camera);
        }
        Ok(())
    }

    /// Decodes a packet. Where only its latent part is sound, the picture is the render alone.
    ///
    /// # Errors
    /// Where the latent part is damaged, is about another prior, or names a camera that never came.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<Decoded, Error> {
        let salvage = Packet::salvage(bytes)?;
        let latent = salvage.latent;
        latent.check_prior(self.scene.id())?;
        let mut damage: Option<Error> = None;
        match salvage.camera {
            Ok(Some(camera)) => self.add_camera(&camera)?,
            Ok(None) => {}
            Err(error) => damage = Some(error.into()),
        }
        let pose = latent.pose.dequantise(&self.scene.frame());
        let render = self.render(&latent, &pose)?;
        let picture = match residual(&render, salvage.residual) {
            Ok(picture) => picture,
            Err(error) => {
                damage = Some(error);
                render
            }
        };
        let Latent { frame, uncertain_start: uncertain, .. } = latent;
        Ok(Decoded { picture, frame, pose, uncertain, damage })
    }

    fn render(&mut self, latent: &Latent, pose: &Pose) -> Result<Picture, Error> {
        // The newest camera whose tag fits.
        let named = self.cameras.iter().rev().find(|c| latent.check_camera(c).is_ok());
        let (frame, tag) = (latent.frame, latent.camera_tag);
        let camera = *named.ok_or(Error::CameraUnknown { frame, tag })?;
        if self.renderer.as_ref().is_none_or(|(held, _)| *held != camera) {
            let renderer = self.engine.renderer(&self.scene, &camera, Plan::picture())?;
            self.renderer = Some((camera, renderer));
        }
        let mut picture = Picture::new(camera.width, camera.height);
        if let Some((_, renderer)) = &mut self.renderer {
            renderer.picture(pose, &mut picture)?;
        }
        Ok(picture)
    }
}

fn residual(render: &Picture, part: Result<Residual, PacketError>) -> Result<Picture, Error> {
    Ok(decode_residual(render, &part?)?)
}

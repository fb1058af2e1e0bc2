//! The topside of the paper's system.

use std::sync::Arc;

use nvsprior::render::{Plan, Renderer, Scene};
use nvsprior::residual::add;
use nvsprior::{Camera, Engine, Picture};

use crate::error::Error;
use crate::packet::{Packet, Session};
use crate::webp::Webp;

/// Decodes the packets of one [`Encoder`](crate::Encoder), in any order behind the first one.
pub struct Decoder {
    engine: Engine,
    scene: Arc<Scene>,
    view: Option<View>,
}

/// What a camera's pictures take.
struct View {
    camera: Camera,
    renderer: Renderer,
    webp: Webp,
    difference: Picture,
}

impl Decoder {
    /// Makes one, which knows no camera yet.
    pub fn new(engine: &Engine, scene: &Arc<Scene>) -> Decoder {
        Decoder { engine: engine.clone(), scene: scene.clone(), view: None }
    }

    /// Decodes a packet to the picture that the encoder foretold. `picture` is replaced; on an error it stays.
    ///
    /// # Errors
    /// If the packet is damaged, about another prior, or about a camera that no packet has stated.
    pub fn decode(&mut self, packet: &[u8], picture: &mut Picture) -> Result<(), Error> {
        let packet = Packet::read(packet)?;
        if let Some(session) = &packet.session {
            self.learn(session)?;
        }
        let View { camera, renderer, webp, difference } =
            self.view.as_mut().ok_or(Error::SessionUnknown)?;
        let mut shown = Picture::new(camera.width, camera.height);
        if let Some(payload) = packet.payload {
            webp.decode(payload, difference)?;
        }
        renderer.coded_picture(&packet.pose.words(), &mut shown)?;
        if packet.payload.is_some() {
            add(&difference.data, &mut shown.data);
        }
        *picture = shown;
        Ok(())
    }

    fn learn(&mut self, session: &Session) -> Result<(), Error> {
        let (expected, found) = (self.scene.id(), session.prior);
        if expected != found {
            return Err(Error::OtherPrior { expected, found });
        }
        let camera = session.camera;
        if self.view.as_ref().is_some_and(|view| view.camera == camera) {
            return Ok(());
        }
        camera.check().map_err(nvsprior::Error::from)?;
        let renderer = self.engine.renderer(&self.scene, &camera, Plan::picture())?;
        let (webp, difference) =
            (Webp::new(camera.width, camera.height), Picture::new(camera.width, camera.height));
        self.view = Some(View { camera, renderer, webp, difference });
        Ok(())
    }
}

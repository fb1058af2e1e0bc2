//! The engine: a device with its pipelines.

use std::sync::Arc;

use crate::render::{Kernels, Plan, Renderer, Scene};
use crate::vulkan::{Device, DeviceInfo, DeviceOptions, Error, MemoryUse};
use crate::{Camera, Prior};

/// A device with all pipelines built; make it once, share it between encoders and decoders.
#[derive(Clone)]
pub struct Engine {
    pub(crate) device: Device,
    pub(crate) kernels: Arc<Kernels>,
}

impl Engine {
    /// Opens a device and builds the pipelines.
    pub fn new(options: &DeviceOptions) -> Result<Engine, Error> {
        let device = Device::open(options)?;
        let kernels = Arc::new(Kernels::new(&device)?);
        Ok(Engine { device, kernels })
    }

    /// The device, in words: `{}` of it is the one-line banner.
    pub fn device(&self) -> &DeviceInfo {
        self.device.info()
    }

    /// Device memory in use.
    pub fn memory(&self) -> MemoryUse {
        self.device.memory()
    }

    /// Messages of the validation layer so far; empty where validation is off.
    pub fn validation_messages(&self) -> Vec<String> {
        self.device.validation_messages()
    }

    /// Uploads a prior, for any number of renderers; what no picture shows is left out.
    pub fn upload(&self, prior: &Prior) -> Result<Arc<Scene>, Error> {
        Ok(Arc::new(Scene::new(&self.device, prior)?))
    }

    /// Uploads a prior with what no picture shows, to compare with.
    pub fn upload_whole(&self, prior: &Prior) -> Result<Arc<Scene>, Error> {
        Ok(Arc::new(Scene::whole(&self.device, prior)?))
    }

    /// Makes a renderer of an uploaded prior.
    pub fn renderer(
        &self,
        scene: &Arc<Scene>,
        camera: &Camera,
        plan: Plan,
    ) -> Result<Renderer, Error> {
        Renderer::new(&self.device, &self.kernels, scene, camera, plan)
    }
}

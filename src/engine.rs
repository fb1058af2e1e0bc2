//! The engine: a device with its pipelines.

use std::sync::{Arc, Mutex, PoisonError};

use crate::prior::analysis::PriorAnalysis;
use crate::prior::blocked::BlockedPrior;
use crate::render::arithmetic;
use crate::render::{
    BlockReader, Kernels, PipelineKey, Plan, Renderer, Scene, SceneKernels, WindowRoom,
};
use crate::vulkan::{Device, DeviceInfo, DeviceOptions, Error, MemoryUse};
use crate::{Camera, Prior};

/// Pipelines, and the kind of prior that they are for.
type SceneSet = (PipelineKey, Arc<SceneKernels>);

/// A device with its pipelines; make it once, share it between encoders and decoders.
#[derive(Clone)]
pub struct Engine {
    device: Device,
    kernels: Arc<Kernels>,
    scene_kernels: Arc<Mutex<Vec<SceneSet>>>,
}

impl Engine {
    /// Opens a device and builds the pipelines that do not depend on a prior.
    pub fn new(options: &DeviceOptions) -> Result<Engine, Error> {
        let mut device = Device::open(options)?;
        let portable = arithmetic::agrees(&device)?;
        device.set_portable(portable);
        let kernels = Arc::new(Kernels::new(&device)?);
        Ok(Engine { device, kernels, scene_kernels: Arc::default() })
    }

    /// Describes the device. `{}` prints it in one line.
    pub fn device(&self) -> &DeviceInfo {
        self.device.info()
    }

    /// The device itself, for your own kernels.
    pub fn vulkan(&self) -> &Device {
        &self.device
    }

    /// Device memory in use.
    pub fn memory(&self) -> MemoryUse {
        self.device.memory()
    }

    /// Messages of the validation layer so far; empty if validation is off.
    pub fn validation_messages(&self) -> Vec<String> {
        self.device.validation_messages()
    }

    /// Uploads a prior, for any number of renderers. Leaves out what no picture shows. Builds the
    /// pipelines for priors of its kind, if it is the first.
    pub fn upload(&self, prior: &Prior) -> Result<Arc<Scene>, Error> {
        self.upload_analysed(prior, PriorAnalysis::of(prior))
    }

    /// Makes a scene of a blocked prior, whose splats come and go by what cameras see. They take at most `limit` bytes
    /// of host and device memory together, with what one renderer of them takes by splats. `reader` starts the thread
    /// that reads blocks ahead. Pictures have the same bytes as those of the whole prior.
    ///
    /// A picture that shows more splats than there is room for fails with [`Error::TooManySplats`]. Renderers of one
    /// prior work in turn.
    pub fn open_blocked(
        &self,
        blocked: &Arc<BlockedPrior>,
        limit: u64,
        reader: BlockReader,
    ) -> Result<Arc<Scene>, Error> {
        let key = PipelineKey { sh_degree: blocked.sh_degree(), clamped: blocked.clamps_alpha() };
        let room = WindowRoom::within(blocked, limit, self.device.info().storage_range);
        let kernels = self.scene_kernels(&key)?;
        Ok(Arc::new(Scene::of_blocked(&self.device, blocked, kernels, &room, reader)?))
    }

    fn upload_analysed(&self, prior: &Prior, analysis: PriorAnalysis) -> Result<Arc<Scene>, Error> {
        let kernels = self.scene_kernels(&PipelineKey::of(&analysis))?;
        Ok(Arc::new(Scene::new(&self.device, prior, analysis, kernels)?))
    }

    #[doc(hidden)]
    pub fn scene_kernels(&self, traits: &PipelineKey) -> Result<Arc<SceneKernels>, Error> {
        // Only whole sets are put in, so what a thread that panicked left is valid.
        let mut sets = self.scene_kernels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, set)) = sets.iter().find(|(of, _)| of == traits) {
            return Ok(set.clone());
        }
        let set = Arc::new(SceneKernels::new(&self.device, traits)?);
        sets.push((*traits, set.clone()));
        Ok(set)
    }

    /// Uploads a prior together with what no picture shows, for comparisons.
    pub fn upload_whole(&self, prior: &Prior) -> Result<Arc<Scene>, Error> {
        self.upload_analysed(prior, PriorAnalysis::everything(prior))
    }

    /// The pipelines that do not depend on a prior.
    #[doc(hidden)]
    pub fn kernels(&self) -> &Arc<Kernels> {
        &self.kernels
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

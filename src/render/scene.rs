//! The prior as the device holds it; shared by every renderer of it.

use std::sync::Arc;

use glam::DVec3;

use crate::coder_tables::Tables;
use crate::filter_weights::FilterWeights;
use crate::image::Preprocessing;
use crate::prior::analysis::PriorAnalysis;
use crate::prior::blocked::BlockedPrior;
use crate::prior::{CoordinateFrame, KeyFrames};
use crate::shared::{self, GEOMETRY_PLANES, GROUP};
use crate::vulkan::{Buffer, Device, Error, Memory};
use crate::{Prior, PriorId};

use super::block_cache::BlockReader;
use super::splat_buffers::{DrawnSplats, Planes, SplatBuffers};
use super::window::{Residency, Window, WindowRoom};
use super::{PipelineKey, SceneKernels};

/// A prior on the device.
pub struct Scene {
    pub(crate) splats: Arc<SplatBuffers>,
    analysis: PriorAnalysis,
    id: PriorId,
    frame: CoordinateFrame,
    origin: DVec3,
    key_frames: KeyFrames,
    coder_tables: Arc<Tables>,
    filter_weights: Option<Arc<FilterWeights>>,
    preprocessing: Preprocessing,
    pose_doubt: f64,
    /// Only if it is a blocked prior.
    window: Option<Window>,
}

impl Scene {
    /// What the device holds of the splats.
    #[doc(hidden)]
    pub fn splat_buffers(&self) -> &SplatBuffers {
        &self.splats
    }

    /// Uploads what pictures of a prior need. They are drawn by pipelines made for its [`PipelineKey`].
    pub(crate) fn new(
        device: &Device,
        prior: &Prior,
        analysis: PriorAnalysis,
        kernels: Arc<SceneKernels>,
    ) -> Result<Scene, Error> {
        let count = analysis.splats.len();
        let named = format!("splats of degree {}", analysis.sh_degree);
        let room = Error::with_room_for(most_splats(device, analysis.sh_degree), &named);
        check_workgroups(device, count).map_err(&room)?;
        let upload = |name, planes: &[f32]| Buffer::from_slice(device, name, planes).map_err(&room);
        let Planes { geometry, sh, radius } = Planes::of(prior, &analysis, count);
        let buffers = [upload("geometry", &geometry)?, upload("spherical harmonics", &sh)?];
        let held = DrawnSplats::all(count as u32, radius);
        let splats = SplatBuffers::new(kernels, buffers, &held, *prior.options());
        Ok(Scene {
            splats: Arc::new(splats),
            analysis,
            id: prior.id(),
            frame: prior.coordinate_frame(),
            origin: prior.origin(),
            key_frames: prior.key_frames().clone(),
            coder_tables: prior.coder_tables().cloned().unwrap_or_else(generic_tables),
            filter_weights: prior.filter_weights().cloned(),
            preprocessing: *prior.preprocessing(),
            pose_doubt: prior.extras().pose_trials.doubt(),
            window: None,
        })
    }

    /// Makes a scene of a blocked prior, with room for so many of its splats. None are there yet: renderers bring those
    /// that they need.
    pub(crate) fn of_blocked(
        device: &Device,
        blocked: &Arc<BlockedPrior>,
        kernels: Arc<SceneKernels>,
        room: &WindowRoom,
        reader: BlockReader,
    ) -> Result<Scene, Error> {
        let planes = |name, planes: u32| {
            Buffer::new::<[f32; 2]>(device, name, planes as usize * room.device, Memory::Device)
        };
        let buffers = [
            planes("geometry", GEOMETRY_PLANES)?,
            planes("spherical harmonics", shared::sh_planes(blocked.sh_degree()))?,
        ];
        let held = DrawnSplats { splats: 0, stride: room.device as u32, radius: blocked.radius() };
        let tables = blocked.coder_tables().map(|tables| Arc::new(tables.clone()));
        Ok(Scene {
            splats: Arc::new(SplatBuffers::new(kernels, buffers, &held, *blocked.options())),
            analysis: PriorAnalysis::of_head(
                blocked.options(),
                blocked.sh_degree(),
                blocked.clamps_alpha(),
            ),
            id: blocked.id(),
            frame: blocked.coordinate_frame(),
            origin: blocked.origin(),
            key_frames: blocked.extras().key_frames.clone(),
            coder_tables: tables.unwrap_or_else(generic_tables),
            filter_weights: blocked.extras().filter_weights.clone(),
            preprocessing: blocked.extras().preprocessing,
            pose_doubt: blocked.extras().pose_trials.doubt(),
            window: Some(Window::new(device, blocked, room, reader)?),
        })
    }

    /// The window, if it is a blocked prior's.
    pub(crate) fn window(&self) -> Option<&Window> {
        self.window.as_ref()
    }

    /// Which part of the prior is on the device; `None`: it is no blocked prior, and all of it is there.
    pub fn residency(&self) -> Option<Residency> {
        self.window.as_ref().map(Window::residency)
    }

    /// Whether it is on this very device, as it was opened.
    pub fn is_on(&self, device: &Device) -> bool {
        self.splats.geometry.is_on(device)
    }

    /// What was uploaded, and what was not.
    pub fn analysis(&self) -> &PriorAnalysis {
        &self.analysis
    }

    /// Identity of the prior.
    pub fn id(&self) -> PriorId {
        self.id
    }

    /// As [`Prior::origin`].
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// The point that the device's positions are relative to. So f32 tells points apart even if the
    /// prior lies far from its origin.
    pub(crate) fn centre(&self) -> DVec3 {
        DVec3::from(self.frame.centre.map(f64::from))
    }

    /// The frame in which packets state camera positions.
    pub fn coordinate_frame(&self) -> CoordinateFrame {
        self.frame
    }

    /// The wavelet coder's tables for pictures of this prior: its own, or the library's.
    pub fn coder_tables(&self) -> &Arc<Tables> {
        &self.coder_tables
    }

    /// The display filter's weights for this prior's scene; `None`: it has none of its own.
    pub fn filter_weights(&self) -> Option<&Arc<FilterWeights>> {
        self.filter_weights.as_ref()
    }

    /// How the pictures that the prior was trained on were treated.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// How many times further off poses are in this prior than pictures tell: see
    /// [`PoseTrials::doubt`](crate::prior::PoseTrials::doubt).
    pub(crate) fn pose_doubt(&self) -> f64 {
        self.pose_doubt
    }

    /// Where to look for a lost camera; possibly none.
    pub fn key_frames(&self) -> &KeyFrames {
        &self.key_frames
    }
}

/// Those for a prior without tables of its own.
fn generic_tables() -> Arc<Tables> {
    Arc::new(Tables::generic())
}

impl PipelineKey {
    /// The key of a prior with this analysis.
    pub fn of(analysis: &PriorAnalysis) -> PipelineKey {
        PipelineKey { sh_degree: analysis.sh_degree, clamped: analysis.clamps_alpha }
    }
}

/// How many splats of a degree the device has room for.
fn most_splats(device: &Device, sh_degree: u32) -> u64 {
    let info = device.info();
    let planes = GEOMETRY_PLANES.max(shared::sh_planes(sh_degree));
    let by_bytes = info.storage_range / (u64::from(planes) * 8);
    // One more shows nothing.
    by_bytes.min(u64::from(info.workgroups) * u64::from(GROUP) - 1)
}

/// Refuses more splats than a stage with an invocation per splat can have.
fn check_workgroups(device: &Device, splats: usize) -> Result<(), Error> {
    let (count, limit) = (splats as u64 / u64::from(GROUP) + 1, device.info().workgroups.into());
    if count > limit {
        let advice = String::new();
        return Err(Error::TooManyWorkgroups { kernel: "pose_jacobian", count, limit, advice });
    }
    Ok(())
}

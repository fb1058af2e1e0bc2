//! The prior as the device holds it; shared by every renderer of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DMat3, DQuat, DVec3};

use crate::coder_tables::Tables;
use crate::image::Preprocessing;
use crate::prior::analysis::PriorAnalysis;
use crate::prior::{CoordinateFrame, KeyFrames, Learnt, Splats, UpdateError};
use crate::shared::{self, GEOMETRY_PLANES, GROUP};
use crate::vulkan::{Buffer, Device, Error};
use crate::{Prior, PriorId, RenderOptions};

use super::learnt_room::{self, LearntRoom};
use super::{PipelineKey, SceneKernels};

/// Splats on the device, activated and laid out in planes, and the pipelines that draw them: what the stages read.
pub(crate) struct SplatBuffers {
    pub kernels: Arc<SceneKernels>,
    pub geometry: Buffer,
    pub sh: Buffer,
    /// How many splats the planes have room for.
    pub room: u32,
    /// How many there are, and the bits of [`Held::radius`]. They change between frames only.
    held: [AtomicU32; 2],
    pub options: RenderOptions,
}

/// The splats that are drawn: the first ones of the planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Held {
    /// How many.
    pub splats: u32,
    /// See [`Params::stride`](crate::shared::Params::stride).
    pub stride: u32,
    /// See [`Params::radius`](crate::shared::Params::radius).
    pub radius: f32,
}

impl Held {
    /// All that there is room for.
    pub fn all(splats: u32, radius: f32) -> Held {
        Held { splats, stride: splats, radius }
    }
}

impl SplatBuffers {
    pub fn new(
        kernels: Arc<SceneKernels>,
        [geometry, sh]: [Buffer; 2],
        held: &Held,
        options: RenderOptions,
    ) -> SplatBuffers {
        let words = [held.splats, held.radius.to_bits()].map(AtomicU32::new);
        SplatBuffers { kernels, geometry, sh, room: held.stride, held: words, options }
    }

    /// Sets how many splats are drawn from the next frame on, and the distance that none exceeds.
    pub fn hold(&self, splats: u32, radius: f32) {
        let words = [splats, radius.to_bits()];
        self.held.iter().zip(words).for_each(|(to, word)| to.store(word, Ordering::Release));
    }

    pub fn held(&self) -> Held {
        let [splats, radius] = [0, 1].map(|i: usize| self.held[i].load(Ordering::Acquire));
        Held { splats, stride: self.room, radius: f32::from_bits(radius) }
    }
}

/// A prior on the device.
pub struct Scene {
    pub(crate) splats: Arc<SplatBuffers>,
    analysis: PriorAnalysis,
    id: PriorId,
    frame: CoordinateFrame,
    key_frames: KeyFrames,
    coder_tables: Arc<Tables>,
    preprocessing: Preprocessing,
    /// Only if it was uploaded for updates.
    learnt_room: Option<LearntRoom>,
}

impl Scene {
    /// Uploads what pictures of a prior need. They are drawn by pipelines made for its [`PipelineKey`]. `for_updates`:
    /// makes room for learnt splats.
    pub(crate) fn new(
        device: &Device,
        prior: &Prior,
        analysis: PriorAnalysis,
        kernels: Arc<SceneKernels>,
        for_updates: bool,
    ) -> Result<Scene, Error> {
        let own = analysis.splats.len();
        let count = own + if for_updates { learnt_room::ROOM } else { 0 };
        let named = format!("splats of degree {}", analysis.sh_degree);
        let room = Error::with_room_for(most_splats(device, analysis.sh_degree), &named);
        check_workgroups(device, count).map_err(&room)?;
        let upload = |name, planes: &[f32]| Buffer::from_slice(device, name, planes).map_err(&room);
        let Planes { geometry, sh, radius } = Planes::of(prior, &analysis, count);
        let learnt_room = for_updates
            .then(|| LearntRoom::new(device, prior, &analysis, &geometry, radius))
            .transpose()?;
        let buffers = [upload("geometry", &geometry)?, upload("spherical harmonics", &sh)?];
        let held = Held { splats: own as u32, stride: count as u32, radius };
        let splats = SplatBuffers::new(kernels, buffers, &held, *prior.options());
        Ok(Scene {
            splats: Arc::new(splats),
            analysis,
            id: prior.id(),
            frame: prior.coordinate_frame(),
            key_frames: prior.key_frames().clone(),
            coder_tables: prior.coder_tables().cloned().unwrap_or_else(generic_tables),
            preprocessing: *prior.preprocessing(),
            learnt_room,
        })
    }

    /// Checks that it can draw what is learnt.
    pub(crate) fn check_learnt(&self, learnt: &Learnt) -> Result<(), UpdateError> {
        if !self.takes_updates() {
            return Err(UpdateError::NoRoom);
        }
        let (stated, prior) = (learnt.prior(), self.id);
        if stated != prior { Err(UpdateError::Foreign { stated, prior }) } else { Ok(()) }
    }

    /// Draws what is learnt too, from the next frame on. Call it between frames. Nothing is done if the scene was not
    /// uploaded for updates.
    pub(crate) fn show(&self, learnt: &Learnt) -> Result<(), Error> {
        self.learnt_room.as_ref().map_or(Ok(()), |room| room.show(&self.splats, learnt))
    }

    /// As [`Scene::show`], with a part of what is learnt.
    #[cfg(feature = "training")]
    pub(crate) fn show_part(&self, part: &Learnt) -> Result<(), Error> {
        self.learnt_room.as_ref().map_or(Ok(()), |room| room.show_part(&self.splats, part))
    }

    /// Where the splats that a learner trains begin in the planes, behind so many learnt ones; `None`: there is no
    /// room.
    #[cfg(feature = "training")]
    pub(crate) fn first_tried(&self, learnt: usize) -> Option<u32> {
        self.learnt_room.as_ref().map(|room| room.first_tried(learnt))
    }

    /// Whether it was uploaded for updates.
    pub fn takes_updates(&self) -> bool {
        self.learnt_room.is_some()
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

    /// How the pictures that the prior was trained on were treated.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
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

/// A splat's scaled axes in the world, the columns of `A = R S`. The covariance is `A Aᵀ`, which
/// stays positive however thin the splat.
pub(crate) fn scaled_axes(splats: &Splats, i: usize) -> DMat3 {
    let [w, x, y, z] = splats.unit_rotation(i).map(f64::from);
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let scale = splats.log_scales[i].map(|s| libm::exp(f64::from(s)));
    DMat3::from_cols(
        rotation.x_axis * scale[0],
        rotation.y_axis * scale[1],
        rotation.z_axis * scale[2],
    )
}

/// What the device holds of a prior's splats, in planes of a pair of floats per splat.
pub(super) struct Planes {
    /// See [`GEOMETRY_PLANES`].
    pub geometry: Vec<f32>,
    /// See [`shared::sh_planes`].
    pub sh: Vec<f32>,
    /// See [`Params::radius`](crate::shared::Params::radius).
    pub radius: f32,
}

impl Planes {
    /// With room for `stride` splats.
    pub fn of(prior: &Prior, analysis: &PriorAnalysis, stride: usize) -> Planes {
        let splats = prior.splats();
        Planes {
            geometry: geometry(splats, &analysis.splats, stride, centre(prior)),
            sh: sh_planes(splats, &analysis.splats, stride, analysis.sh_degree),
            radius: radius(splats, &analysis.splats, centre(prior)),
        }
    }
}

/// What the device's positions are relative to.
pub(super) fn centre(prior: &Prior) -> DVec3 {
    DVec3::from(prior.coordinate_frame().centre.map(f64::from))
}

/// The distance from `centre` that no middle of the splats that `which` names exceeds, as the device holds it.
fn radius(splats: &Splats, which: &[u32], centre: DVec3) -> f32 {
    let middle = |i: &u32| DVec3::from(splats.positions[*i as usize].map(f64::from));
    let farthest = which.iter().map(|i| middle(i).distance(centre)).fold(0.0, f64::max);
    // Both roundings to f32 are far below this.
    (farthest * (1.0 + 1e-6)) as f32
}

/// Planes of position (relative to `centre`), opacity and axes of the splats that `which` names,
/// computed in f64 and rounded once.
pub(super) fn geometry(splats: &Splats, which: &[u32], stride: usize, centre: DVec3) -> Vec<f32> {
    pair_planes(which, stride, GEOMETRY_PLANES, |i| {
        let axes = scaled_axes(splats, i).to_cols_array();
        let position = DVec3::from(splats.positions[i].map(f64::from)) - centre;
        position
            .to_array()
            .map(|v| v as f32)
            .into_iter()
            .chain([splats.opacity(i) as f32])
            .chain(axes.map(|v| v as f32))
    })
}

/// Planes of the coefficients that are needed, RGB after RGB. Two coefficients take three planes.
pub(super) fn sh_planes(splats: &Splats, which: &[u32], stride: usize, degree: u32) -> Vec<f32> {
    let own = splats.sh_stride();
    let needed = 3 * shared::sh_coefficients(degree) as usize;
    let of = |i: usize| splats.sh[i * own..][..needed].iter().copied();
    pair_planes(which, stride, shared::sh_planes(degree), of)
}

/// Packs the values of every splat that `which` names, two per plane; 0 if a splat has no more values. The planes have
/// room for `stride` splats.
fn pair_planes<I: Iterator<Item = f32>>(
    which: &[u32],
    stride: usize,
    planes: u32,
    values: impl Fn(usize) -> I,
) -> Vec<f32> {
    let mut words = vec![0.0; stride * planes as usize * 2];
    for (place, i) in which.iter().enumerate() {
        for (k, value) in values(*i as usize).enumerate() {
            words[(k / 2 * stride + place) * 2 + k % 2] = value;
        }
    }
    words
}

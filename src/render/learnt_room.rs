//! Room in the planes of splats for what is learnt while diving.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use crate::Prior;
use crate::prior::Splats;
use crate::prior::analysis::PriorAnalysis;
use crate::prior::update::{Learnt, LearntSplat, MAX_LEARNT, StateId, append};
use crate::shared::{GEOMETRY_PLANES, sh_planes};
use crate::vulkan::{Buffer, Device, Error, Memory, Part, Recorder, Timing};

use super::splat_buffers::{self, SplatBuffers};

/// Splats that there is room for beside the learnt ones: those that a learner tries.
pub(crate) const TRIED: usize = 512;

/// Splats that a scene for updates has room for behind the prior's.
pub(crate) const ROOM: usize = MAX_LEARNT + TRIED;

/// The plane of geometry that holds z and opacity.
const OPACITY_PLANE: u32 = 1;

/// What it takes to write learnt splats behind a prior's, and to fade the prior's.
pub(crate) struct LearntRoom {
    device: Device,
    /// Splats of the prior on the device.
    own: u32,
    /// Distance that none of them exceeds.
    radius: f32,
    sh_degree: u32,
    centre: DVec3,
    /// Their positions, for fades.
    positions: Vec<[f32; 3]>,
    /// Their z and opacity.
    opacities: Vec<f32>,
    written: Mutex<Written>,
}

/// What was written last, and the buffers that it goes through.
struct Written {
    geometry: Buffer,
    sh: Buffer,
    opacities: Buffer,
    faded: bool,
    /// What the planes hold; `None`: something that has no name.
    state: Option<StateId>,
}

impl LearntRoom {
    /// Makes room behind the splats of a prior. `geometry`: their planes, as they were uploaded.
    pub fn new(
        device: &Device,
        prior: &Prior,
        analysis: &PriorAnalysis,
        geometry: &[f32],
        radius: f32,
    ) -> Result<LearntRoom, Error> {
        let own = analysis.splats.len();
        let stride = own + ROOM;
        let first = OPACITY_PLANE as usize * 2 * stride;
        let upload = |name, floats| Buffer::new::<f32>(device, name, floats, Memory::Upload);
        let tail = |planes: u32| planes as usize * 2 * ROOM;
        let positions = &prior.splats().positions;
        Ok(LearntRoom {
            device: device.clone(),
            own: own as u32,
            radius,
            sh_degree: analysis.sh_degree,
            centre: splat_buffers::centre(prior),
            positions: analysis.splats.iter().map(|i| positions[*i as usize]).collect(),
            opacities: geometry[first..][..2 * own].to_vec(),
            written: Mutex::new(Written {
                geometry: upload("learnt geometry", tail(GEOMETRY_PLANES))?,
                sh: upload("learnt spherical harmonics", tail(sh_planes(analysis.sh_degree)))?,
                opacities: upload("opacities", 2 * own)?,
                faded: false,
                state: Some(prior.id().into()),
            }),
        })
    }

    #[cfg(feature = "training")]
    /// Where the splats that a learner trains begin, behind `learnt` ones.
    pub fn first_tried(&self, learnt: usize) -> u32 {
        self.own + learnt as u32
    }

    /// Replaces what is learnt, unless the planes hold it already. Call it between two frames. Returns after the device
    /// has it.
    pub fn show(&self, splats: &SplatBuffers, learnt: &Learnt) -> Result<(), Error> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if written.state != Some(learnt.state()) {
            self.write(&mut written, splats, learnt)?;
            written.state = Some(learnt.state());
        }
        Ok(())
    }

    /// Replaces what is learnt by a part of it, which no state names. Call it between two frames. Returns after the
    /// device has it.
    #[cfg(feature = "training")]
    pub fn show_part(&self, splats: &SplatBuffers, part: &Learnt) -> Result<(), Error> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        self.write(&mut written, splats, part)
    }

    fn write(
        &self,
        written: &mut Written,
        splats: &SplatBuffers,
        learnt: &Learnt,
    ) -> Result<(), Error> {
        written.state = None;
        let all = learnt.splats();
        let mut recorder = Recorder::new(&self.device, Timing::None)?;
        self.write_tail(&mut recorder, written, splats, all);
        if learnt.fades() > 0 || written.faded {
            self.write_opacities(&mut recorder, written, splats, learnt);
        }
        recorder.barrier("learnt");
        recorder.finish()?.run()?;
        written.faded = learnt.fades() > 0;
        let distance =
            |splat: &LearntSplat| DVec3::from(splat.position.map(f64::from)).distance(self.centre);
        let farthest = all.iter().map(distance).fold(0.0, f64::max);
        let radius = self.radius.max((farthest * (1.0 + 1e-6)) as f32);
        splats.hold(self.own + all.len() as u32, radius);
        Ok(())
    }

    fn write_tail(
        &self,
        recorder: &mut Recorder,
        written: &mut Written,
        splats: &SplatBuffers,
        all: &[LearntSplat],
    ) {
        if all.is_empty() {
            return;
        }
        let Written { geometry, sh, .. } = written;
        let mut own = Splats { sh_degree: self.sh_degree, ..Splats::default() };
        append(&mut own, all);
        let which: Vec<u32> = (0..all.len() as u32).collect();
        geometry.write(&splat_buffers::geometry(&own, &which, which.len(), self.centre));
        sh.write(&splat_buffers::sh_planes(&own, &which, which.len(), self.sh_degree));
        let parts = |planes: u32| -> Vec<Part> {
            let words = 2 * all.len() as u64;
            let to = |plane| 2 * (plane * u64::from(splats.room) + u64::from(self.own));
            (0..u64::from(planes)).map(|p| Part { from: p * words, to: to(p), words }).collect()
        };
        recorder.copy_parts(geometry, &splats.geometry, &parts(GEOMETRY_PLANES));
        recorder.copy_parts(sh, &splats.sh, &parts(sh_planes(self.sh_degree)));
    }

    fn write_opacities(
        &self,
        recorder: &mut Recorder,
        written: &mut Written,
        splats: &SplatBuffers,
        learnt: &Learnt,
    ) {
        let pairs = self.opacities.chunks_exact(2).zip(&self.positions);
        let faded =
            |(pair, position): (&[f32], &[f32; 3])| [pair[0], pair[1] * learnt.fade_of(*position)];
        let words: Vec<[f32; 2]> = pairs.map(faded).collect();
        written.opacities.write(&words);
        let to = 2 * u64::from(OPACITY_PLANE) * u64::from(splats.room);
        let part = Part { from: 0, to, words: 2 * u64::from(self.own) };
        recorder.copy_parts(&written.opacities, &splats.geometry, &[part]);
    }
}

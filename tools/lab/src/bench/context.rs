//! What every measurement shares: the frames, the prior on the device, and the best known poses.

use std::sync::Arc;

use anyhow::Context as _;
use nvsprior::image::Preprocessor;
use nvsprior::render::Scene;
use nvsprior::tracking::Evaluation;
use nvsprior::vulkan::MemoryUse;
use nvsprior::{
    Camera, Encoder, EncoderOptions, Engine, FrameInfo, FrameStats, Hint, Picture, Pose, Prior,
};

use super::forward::Forward;
use super::searcher::Searcher;
use nvsprior_inputs::frame_file;
use nvsprior_inputs::input::Input;
use nvsprior_paper::{DescentOptions, Optimizer};

/// A frame of the run.
pub struct Shot {
    pub file: String,
    /// Name of what is written about it, without ending.
    pub name: String,
    pub camera: Camera,
    /// As the prior's preprocessing left it.
    pub picture: Picture,
    /// Its pose from outside, as `encode` would have it.
    pub external: Option<Pose>,
    /// Its pose in the camera file.
    pub known: Option<Pose>,
    /// When it was taken, seconds.
    pub time: Option<f64>,
}

impl Shot {
    /// What an encoder is told of it, if it is told this pose.
    pub fn told(&self, pose: Option<Pose>) -> FrameInfo {
        FrameInfo { hint: pose.map(Hint::of), time: self.time }
    }

    pub fn read(input: &Input, preprocessor: &mut Preprocessor) -> anyhow::Result<Shot> {
        let Camera { width, height, .. } = input.camera;
        let mut picture = frame_file::read_frame(&input.path, width, height)?;
        preprocessor.apply(&mut picture);
        Ok(Shot {
            file: input.file.clone(),
            name: input.name.clone(),
            camera: input.camera,
            picture,
            external: input.external.hint.map(|hint| hint.pose),
            known: input.known,
            time: input.external.time,
        })
    }
}

/// The best pose that is known of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    pub pose: Pose,
    /// PSNR of the render there, dB.
    pub psnr: f64,
}

/// A frame encoded, beside a forward render.
pub struct Sample {
    pub shot: usize,
    /// Milliseconds of a forward render just before.
    pub forward_ms: f64,
    pub stats: FrameStats,
    pub pose: Pose,
    pub trace: Vec<Evaluation>,
}

impl Sample {
    /// From the frame to pose, render and difference, milliseconds, without coding.
    pub fn frame_ms(&self) -> f64 {
        self.stats.refine_milliseconds
    }

    pub fn in_forward_renders(&self) -> f64 {
        self.frame_ms() / self.forward_ms
    }
}

/// All frames with one optimiser.
pub struct OptimizerRun {
    pub optimizer: Optimizer,
    pub samples: Vec<Sample>,
}

pub struct Context {
    pub engine: Engine,
    pub prior: Prior,
    pub scene: Arc<Scene>,
    pub shots: Vec<Shot>,
    /// Of each frame.
    pub best: Vec<Best>,
    pub forward: Forward,
    /// See [`EncoderOptions::threshold`].
    pub threshold: f64,
    /// Most device memory in use together with an encoder: the encoder's, the forward renderer's and the prior's.
    pub device_memory: MemoryUse,
}

impl Context {
    /// Encoder options of this run, the rest at their defaults. The shots were treated when they were read.
    pub fn options(&self) -> EncoderOptions {
        let threshold = self.threshold;
        // Bytes are compared with those of coders that tell nothing of how far their picture is from the frame.
        EncoderOptions { threshold, frames_treated: true, truth: false, ..Default::default() }
    }

    /// Fails unless all frames have one size. `option`: what needs that.
    pub fn one_size(&self, option: &str) -> anyhow::Result<()> {
        let camera = self.shots[0].camera;
        for Shot { file, camera: other, .. } in &self.shots {
            anyhow::ensure!(
                (other.width, other.height) == (camera.width, camera.height),
                "{file}: of another size than the first frame; {option} needs frames of one size"
            );
        }
        Ok(())
    }

    /// An encoder of the first frame's camera.
    pub fn encoder(&self, options: EncoderOptions) -> anyhow::Result<Encoder> {
        Ok(Encoder::new(&self.engine, &self.scene, &self.shots[0].camera, options)?)
    }

    /// An encoder of the first frame's camera by the paper's system, which sends no difference pictures.
    pub fn papers(&self, optimizer: Optimizer) -> anyhow::Result<nvsprior_paper::Encoder> {
        let options = nvsprior_paper::EncoderOptions {
            descent: DescentOptions { optimizer, ..DescentOptions::default() },
            threshold: self.threshold,
            rate: None,
            frames_treated: true,
        };
        let camera = &self.shots[0].camera;
        Ok(nvsprior_paper::Encoder::new(&self.engine, &self.scene, camera, options)?)
    }

    /// Encodes a frame, a forward render of its best known pose just before.
    pub fn sample(
        &mut self,
        encoder: &mut dyn Searcher,
        shot: usize,
        start: Option<Pose>,
    ) -> anyhow::Result<Sample> {
        let Shot { file, camera, picture, .. } = &self.shots[shot];
        let encoding = || format!("encoding {file}");
        encoder.set_camera(camera).with_context(encoding)?;
        let forward_ms = self.forward.measure(camera, &self.best[shot].pose)?;
        let encoded = encoder.encode(picture, start.into()).with_context(encoding)?;
        let MemoryUse { used, reserved, buffers } = self.engine.memory();
        let peak = &mut self.device_memory;
        peak.used = peak.used.max(used);
        peak.reserved = peak.reserved.max(reserved);
        peak.buffers = peak.buffers.max(buffers);
        let trace = encoder.trace().to_vec();
        Ok(Sample { shot, forward_ms, stats: encoded.stats, pose: encoded.pose, trace })
    }

    /// Keeps a pose as the best known one if it is better. Only for the whole prior.
    pub fn learn(&mut self, sample: &Sample) {
        let best = &mut self.best[sample.shot];
        if sample.stats.render_psnr > best.psnr {
            *best = Best { pose: sample.pose, psnr: sample.stats.render_psnr };
        }
    }

    /// How far a render is below that of the best known pose, dB.
    pub fn short(&self, sample: &Sample) -> f64 {
        self.best[sample.shot].psnr - sample.stats.render_psnr
    }

    /// Distance from the best known pose: between the centres, in the prior's unit, and the angle, degrees.
    pub fn pose_error(&self, sample: &Sample) -> [f64; 2] {
        let best = &self.best[sample.shot].pose;
        let distance = (sample.pose.centre() - best.centre()).length();
        [distance, sample.pose.angle_to(best).to_degrees()]
    }
}

/// Most memory that this process has had, bytes; `None` if the system does not say so.
pub fn host_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

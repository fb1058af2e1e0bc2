//! A run, encoded here and decoded by the topside.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use nvsprior::render::Scene;
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, Engine, Picture, Pose, Rate};
use nvsprior_basin::DemoFrame;
use nvsprior_runs::{FrameKind, SheetRow, remove_own};

use crate::table::Figures;
use crate::topside::{PAPER, Topside};

/// A frame starts from the one before if the mean squared error there is below this.
const THRESHOLD: f64 = 1e-2;
/// The error of a simulated estimator at the first frame: a step (metres, radians).
const FIRST_OFFSET: [f64; 6] = [0.08, -0.06, 0.10, 0.035, -0.044, 0.026];

/// What all codings share.
pub struct Coder<'a> {
    pub engine: &'a Engine,
    pub scene: &'a Arc<Scene>,
    pub camera: Camera,
    pub topside: Topside,
}

/// By which system a run is coded.
#[derive(Clone, Copy)]
pub enum System {
    Ours,
    /// The paper's, with its BFGS and its WebP.
    Papers,
}

enum AnyEncoder {
    Ours(Box<Encoder>),
    Papers(Box<nvsprior_paper::Encoder>),
}

impl AnyEncoder {
    fn encode(&mut self, frame: &Picture, start: Option<Pose>) -> anyhow::Result<Encoded> {
        Ok(match self {
            AnyEncoder::Ours(encoder) => encoder.encode(frame, start)?,
            AnyEncoder::Papers(encoder) => encoder.encode(frame, start)?,
        })
    }
}

/// What came of a run, frame by frame.
#[derive(Default)]
pub struct Coded {
    pub figures: Vec<Figures>,
    pub pictures: Vec<SheetRow>,
}

impl Coder<'_> {
    /// Encodes frames, has each packet decoded, and compares what the topside shows with what the encoder predicted.
    pub fn code(
        &mut self,
        run: &Path,
        frames: &[DemoFrame],
        system: System,
        rate: Rate,
    ) -> anyhow::Result<Coded> {
        let mut encoder = self.encoder(system, rate)?;
        let (search, ending) = match system {
            System::Ours => ("gauss-newton", "nvsp"),
            System::Papers => ("bfgs", PAPER),
        };
        let packets = run.join(format!("packets-{search}"));
        let decoded = run.join(format!("decoded-{search}"));
        // The folders are the demo's own: what an earlier run wrote goes.
        let kinds = [(&packets, FrameKind::Ending(ending)), (&decoded, FrameKind::RECONSTRUCTION)];
        for (folder, kind) in kinds {
            remove_own(folder, kind)
                .and_then(|()| std::fs::create_dir_all(folder))
                .with_context(|| format!("making {}", folder.display()))?;
        }
        let mut coded = Coded::default();
        for (index, frame) in frames.iter().enumerate() {
            let start = (index == 0).then(|| frame.pose.stepped(&FIRST_OFFSET));
            let encoded = encoder.encode(&frame.picture, start)?;
            let packet = packets.join(&frame.name).with_extension(ending);
            std::fs::write(&packet, &encoded.packet)
                .with_context(|| format!("writing {}", packet.display()))?;
            let shown = decoded.join(&frame.name);
            let topside = self.topside.show(&packet, &shown)?;
            anyhow::ensure!(
                topside == encoded.picture,
                "{}: the topside shows another picture than the encoder predicted",
                shown.display()
            );
            let stats = &encoded.stats;
            let (bytes, psnr) = (stats.bytes, stats.psnr);
            let (milliseconds, renders) = (stats.milliseconds, stats.full_renders);
            say!("  frame {}: {bytes} bytes, {psnr:.1} dB", index + 1);
            if index == 0 {
                let camera = run.join(run.file_name().unwrap_or_default()).join(&frame.name);
                say!("    {}: what the camera saw", camera.display());
                say!("    {}: what the topside shows", shown.display());
            }
            coded.figures.push(Figures { bytes, psnr, milliseconds, renders });
            coded.pictures.push(SheetRow {
                frame: frame.picture.clone(),
                render: encoded.render,
                reconstruction: Some(topside),
            });
        }
        Ok(coded)
    }

    fn encoder(&self, system: System, rate: Rate) -> anyhow::Result<AnyEncoder> {
        let (engine, scene, camera) = (self.engine, self.scene, &self.camera);
        let (threshold, rate) = (THRESHOLD, Some(rate));
        Ok(match system {
            System::Ours => {
                let options = EncoderOptions { threshold, rate, ..Default::default() };
                AnyEncoder::Ours(Box::new(Encoder::new(engine, scene, camera, options)?))
            }
            System::Papers => {
                let options =
                    nvsprior_paper::EncoderOptions { threshold, rate, ..Default::default() };
                let encoder = nvsprior_paper::Encoder::new(engine, scene, camera, options)?;
                AnyEncoder::Papers(Box::new(encoder))
            }
        })
    }
}

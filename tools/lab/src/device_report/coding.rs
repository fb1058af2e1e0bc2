//! Times of coding a run of frames for a number of bytes, and of decoding it.

use std::time::Instant;

use nvsprior::packet::{Latent, PoseProfile, QuantisedPose, Residual, Session};
use nvsprior::render::{Plan, Renderer};
use nvsprior::residual::{ResidualDecoder, ResidualEncoder, ResidualSetup, Tune};
use nvsprior::{Camera, Decoder, Packet, Picture, Pose, Rate};

use super::pace::Pace;
use super::schema::Coding;
use crate::bench::context::{Context, Shot};
use nvsprior_inputs::statistics::Spread;

/// A frame's pose, and how long the search for it took, if there was one.
pub struct ShotPose {
    /// Which frame.
    pub shot: usize,
    pub pose: Pose,
    pub search_ms: Option<f64>,
}

/// What a frame took and gave.
struct Coded {
    bytes: f64,
    psnr: f64,
    residual_encode_ms: f64,
    residual_decode_ms: f64,
    encode_ms: Option<f64>,
    decode_ms: f64,
}

/// Both sides, without the search.
struct Coders<'a> {
    context: &'a Context,
    camera: Camera,
    renderer: Renderer,
    encoder: ResidualEncoder,
    residual: ResidualDecoder,
    decoder: Decoder,
    /// Whether the decoder knows the camera.
    told: bool,
}

/// Codes the frames at the poses found for packets of at most `budget` bytes, and decodes these, as long as the pace
/// allows. The first one does not count. Fails if a decoded picture is not the encoder's.
pub fn measure(
    context: &Context,
    found: &[ShotPose],
    budget: usize,
    pace: &Pace,
    done: impl Fn(),
) -> anyhow::Result<Coding> {
    let mut coders = Coders::new(context)?;
    let mut frames = Vec::new();
    for found in found {
        frames.push(coders.code(found, budget)?);
        done();
        if frames.len() > 1 && !pace.goes_on() {
            break;
        }
    }
    Ok(Coding::of(budget, frames.get(1..).unwrap_or_default()))
}

impl Coders<'_> {
    fn new(context: &Context) -> anyhow::Result<Coders<'_>> {
        let (engine, scene, camera) = (&context.engine, &context.scene, context.shots[0].camera);
        let Camera { width, height, .. } = camera;
        let (tables, portable) = (scene.coder_tables().clone(), engine.device().portable);
        let residual = ResidualDecoder::new(width, height, &tables);
        let setup = ResidualSetup { width, height, tune: Tune::Psnr, tables, portable };
        let encoder = ResidualEncoder::new(&setup);
        Ok(Coders {
            context,
            camera,
            renderer: engine.renderer(scene, &camera, Plan::picture())?,
            encoder,
            residual,
            decoder: Decoder::new(engine, scene),
            told: false,
        })
    }

    fn code(&mut self, found: &ShotPose, budget: usize) -> anyhow::Result<Coded> {
        let Coders { context, camera, .. } = self;
        let Shot { file, picture, .. } = &context.shots[found.shot];
        let portable = context.engine.device().portable;
        let frame = context.prior.coordinate_frame();
        let pose = QuantisedPose::quantise(&found.pose, &frame, PoseProfile::Compact)?;
        let mut render = Picture::new(camera.width, camera.height);
        self.renderer.coded_picture(&pose.words(), &mut render)?;
        let session = Session { prior: context.scene.id(), camera: *camera };
        let latent = Latent::new(found.shot as u32, &session, pose, false)?;
        let latent = Latent { portable, ..latent };
        // The first packet tells the topside prior and camera.
        let session = (!std::mem::replace(&mut self.told, true)).then_some(session);
        let bare = Packet { latent, session, render: None, residual: Residual::None, truth: None };
        let since = Instant::now();
        let coded =
            self.encoder.encode(picture, &render, Rate::Bytes(budget), bare.encoded_len())?;
        let packet = Packet { residual: coded.residual, ..bare };
        let bytes = packet.encode()?;
        let residual_encode_ms = milliseconds(since);
        let since = Instant::now();
        let decoded = self.decoder.decode(&bytes)?;
        let decode_ms = milliseconds(since);
        anyhow::ensure!(
            decoded.picture == *coded.reconstruction,
            "{file}: decoded to another picture"
        );
        let mut shown = render.clone();
        let since = Instant::now();
        self.residual.add(&coded.residual, portable, &mut shown)?;
        Ok(Coded {
            bytes: bytes.len() as f64,
            psnr: coded.psnr,
            residual_encode_ms,
            residual_decode_ms: milliseconds(since),
            encode_ms: found.search_ms.map(|ms| ms + residual_encode_ms),
            decode_ms,
        })
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

impl Coding {
    fn of(budget_bytes: usize, frames: &[Coded]) -> Coding {
        let spread = |figure: &dyn Fn(&Coded) -> f64| Spread::of(frames.iter().map(figure));
        let encode_ms: Option<Vec<f64>> = frames.iter().map(|f| f.encode_ms).collect();
        Coding {
            budget_bytes,
            frames: frames.len(),
            bytes: spread(&|f| f.bytes),
            psnr: spread(&|f| f.psnr),
            residual_encode_ms: spread(&|f| f.residual_encode_ms),
            residual_decode_ms: spread(&|f| f.residual_decode_ms),
            encode_ms: encode_ms.map(Spread::of),
            decode_ms: spread(&|f| f.decode_ms),
        }
    }
}

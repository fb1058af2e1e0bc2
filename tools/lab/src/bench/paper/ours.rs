//! The program's own coder and search, with packets as they are sent.

use anyhow::Context as _;
use nvsprior::packet::Parsed;
use nvsprior::{Decoder, EncoderOptions, FrameInfo, Mode, Pose};

use super::coders::Method;
use super::row::{Coded, Setting};
use crate::bench::context::{Context, Shot};
use crate::bench::forward::timed;

pub struct Ours<'a> {
    pub context: &'a Context,
    pub mode: Mode,
}

impl Method for Ours<'_> {
    fn setting(&self, fine: f64) -> Setting {
        Setting::Quality(100.0 * fine)
    }

    fn code(&self, setting: Setting) -> anyhow::Result<Coded> {
        let Ours { context, mode, .. } = *self;
        let options = EncoderOptions { mode, ..context.options() };
        let starts = Starts::Track;
        Ok(packets(context, options, setting, &starts)?.coded)
    }

    fn each(&self, psnr: f64) -> Option<Setting> {
        Some(Setting::Psnr(psnr))
    }
}

pub enum Starts<'a> {
    /// At the frames before.
    Track,
    /// Nowhere: each frame is looked for by the key frames.
    Nothing,
    /// At these poses, and nothing is looked for elsewhere.
    Given(&'a [Pose]),
}

impl Starts<'_> {
    fn known(&self, index: usize, shot: &Shot) -> FrameInfo {
        match self {
            Starts::Track => shot.told(shot.external),
            Starts::Nothing => shot.told(None),
            Starts::Given(poses) => shot.told(Some(poses[index])),
        }
    }
}

/// Frames coded to packets and decoded again.
pub struct Packets {
    pub coded: Coded,
    /// PSNR of the renders, dB.
    pub render_psnr: Vec<f64>,
}

/// Encodes all frames, and decodes their packets.
pub fn packets(
    context: &Context,
    options: EncoderOptions,
    setting: Setting,
    starts: &Starts,
) -> anyhow::Result<Packets> {
    let rate = setting.rate();
    let mut options = EncoderOptions { rate, ..options };
    if matches!(starts, Starts::Given(_)) {
        options.refine.lost_renders = 0;
    }
    let mut encoder = context.encoder(options)?;
    if matches!(starts, Starts::Nothing) {
        encoder.prepare(usize::MAX)?;
    }
    let mut decoder = Decoder::new(&context.engine, &context.scene);
    let share = 1.0 / context.shots.len() as f64;
    let shown = Vec::new();
    let mut coded = Coded { setting, bytes: 0.0, encode_ms: 0.0, decode_ms: 0.0, shown };
    let mut render_psnr = Vec::new();
    for (index, shot) in context.shots.iter().enumerate() {
        let encoding = || format!("encoding {}", shot.file);
        if !matches!(starts, Starts::Track) {
            encoder.reset();
        }
        encoder.set_camera(&shot.camera).with_context(encoding)?;
        let encoded = encoder.encode(&shot.picture, starts.known(index, shot));
        let encoded = encoded.with_context(encoding)?;
        if decoder.size_to_prepare(&Parsed::of(&encoded.packet)?).is_some() {
            // Not counted: the first picture of a camera waits for its pipelines.
            decoder.decode(&encoded.packet)?;
        }
        let (decoded, ms) = timed(|| Ok(decoder.decode(&encoded.packet)?))?;
        anyhow::ensure!(
            decoded.picture == encoded.picture,
            "{}: the topside shows another picture than the encoder predicted",
            shot.file
        );
        coded.bytes += share * encoded.packet.len() as f64;
        coded.encode_ms += share * encoded.stats.milliseconds;
        coded.decode_ms += share * ms;
        coded.shown.push(decoded.picture);
        render_psnr.push(encoded.stats.render_psnr);
    }
    Ok(Packets { coded, render_psnr })
}

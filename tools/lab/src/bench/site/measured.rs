//! The time of a frame, and the memory of the process that encodes it.

use std::path::Path;
use std::sync::Arc;

use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::render::{BlockReader, Plan, Renderer, Scene};
use nvsprior::{Encoder, EncoderOptions, Engine, Picture, Rate};
use serde_json::{Value, json};

use super::super::context::host_bytes;
use super::super::forward::timed;
use super::super::perturbed::even;
use super::tiled::{CAMERA, STEP, pose};
use nvsprior_inputs::statistics::median;

/// Frames that are measured, after those that do not count.
const FRAMES: usize = 40;
const WARM_UP: usize = 4;
/// Units between frames.
const APART: f64 = 0.1;
/// Bytes of a packet.
const BYTES: usize = 300;

/// What encoders of frames along the row take.
pub fn options() -> EncoderOptions {
    EncoderOptions { rate: Some(Rate::Bytes(BYTES)), ..EncoderOptions::default() }
}

/// The frame at a place along the row: the prior's render, darker, with noise and a grey thing in front.
pub fn frame(renderer: &mut Renderer, along: f64) -> anyhow::Result<Picture> {
    let mut picture = Picture::new(CAMERA.width, CAMERA.height);
    renderer.picture(&pose(along), &mut picture)?;
    let mut noise = even(along.to_bits());
    for (at, byte) in picture.data.iter_mut().enumerate() {
        let (x, y) = (at / 3 % CAMERA.width as usize, at / 3 / CAMERA.width as usize);
        let thing = (130..170).contains(&x) && (90..125).contains(&y);
        let shown = if thing { 70.0 } else { 0.9 * f64::from(*byte) };
        let noise = 4.0 * noise.next().unwrap_or_default();
        *byte = (shown + noise).round().clamp(0.0, 255.0) as u8;
    }
    Ok(picture)
}

/// Encodes frames in the middle of the row.
pub fn measure(engine: &Engine, path: &Path, limit: u64) -> anyhow::Result<Value> {
    let blocked = Arc::new(BlockedPrior::open(path)?);
    let scene = engine.open_blocked(&blocked, limit, BlockReader::threaded())?;
    let mut renderer = engine.renderer(&scene, &CAMERA, Plan::picture())?;
    let mut encoder = Encoder::new(engine, &scene, &CAMERA, options())?;
    let copies = (blocked.coordinate_frame().centre[1] / STEP).floor();
    let begin = f64::from(STEP) * (f64::from(copies) + 0.2);
    let (mut times, mut psnr, mut certain, mut renders) = (Vec::new(), 0.0, 0, 0);
    for i in 0..WARM_UP + FRAMES {
        let along = begin + APART * i as f64;
        let frame = frame(&mut renderer, along)?;
        let hint = (i == 0).then(|| pose(along));
        let (encoded, ms) = timed(|| Ok(encoder.encode(&frame, hint)?))?;
        if i >= WARM_UP {
            times.push(ms);
            psnr += encoded.stats.psnr / FRAMES as f64;
            certain += usize::from(encoded.stats.certain);
            renders += encoded.stats.full_renders;
        }
    }
    let blocks = residency(&scene);
    Ok(json!({
        "splats": blocked.len(),
        "blocks": blocked.blocks().len(),
        "file_bytes": std::fs::metadata(path)?.len(),
        "frame_ms": median(times.iter().copied()),
        "longest_ms": times.iter().copied().fold(0.0, f64::max),
        "host_bytes": host_bytes(),
        "device_bytes": engine.memory().reserved,
        "limit_bytes": limit,
        "splats_on_device": blocks["splats"],
        "window": blocks,
        "frames": FRAMES,
        "certain": certain,
        "full_renders": renders,
        "psnr": psnr,
    }))
}

/// What a process tells of a scene's blocks.
pub fn residency(scene: &Scene) -> Value {
    let Some(residency) = scene.residency() else { return Value::Null };
    json!({
        "blocks": residency.blocks,
        "splats": residency.splats,
        "room": residency.room,
        "host_bytes": residency.host_bytes,
        "changes": residency.changes,
        "blocks_waited_for": residency.waits,
        "repeated_searches": residency.repeated,
        "incomplete_searches": residency.incomplete,
    })
}

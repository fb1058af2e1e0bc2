//! A flight along the whole row: frames that wait for blocks, and packets beside those of the prior loaded whole.

use std::path::Path;
use std::sync::Arc;

use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::render::{BlockReader, Plan, Scene};
use nvsprior::vulkan::Error as VulkanError;
use nvsprior::{Encoder, Engine, Prior, RenderOverrides};
use nvsprior_inputs::args::progress;
use serde_json::{Value, json};

use super::super::forward::timed;
use super::measured::{frame, options, residency};
use super::tiled::{CAMERA, STEP, pose};
use nvsprior_inputs::statistics::median;

/// Frames of a copy.
const FRAMES: usize = 20;
/// Units between frames.
const APART: f64 = STEP as f64 / FRAMES as f64;

/// Flies from the first copy to the last.
pub fn fly(engine: &Engine, path: &Path, limit: u64) -> anyhow::Result<Value> {
    let blocked = Arc::new(BlockedPrior::open(path)?);
    let open = || engine.open_blocked(&blocked, limit, BlockReader::threaded());
    // The frames are drawn with blocks of their own, so that they bring none to the encoder.
    let (drawn, scene) = (open()?, open()?);
    let mut renderer = engine.renderer(&drawn, &CAMERA, Plan::picture())?;
    let mut encoder = Encoder::new(engine, &scene, &CAMERA, options())?;
    let whole = whole(engine, path)?;
    let whole_encoder = |scene| Encoder::new(engine, scene, &CAMERA, options());
    let mut whole = whole.as_ref().map(whole_encoder).transpose()?;
    let copies = (2.0 * blocked.coordinate_frame().centre[1] / STEP).round() + 1.0;
    let frames = FRAMES * copies as usize - 8;
    let (mut times, mut late, mut certain, mut other) = (Vec::new(), Vec::new(), 0, Vec::new());
    let bar = progress(frames, "frames of the flight");
    for i in 0..frames {
        let along = APART * (4 + i) as f64;
        let frame = frame(&mut renderer, along)?;
        let hint = (i == 0).then(|| pose(along));
        let before = waits(&scene);
        let (encoded, ms) = timed(|| Ok(encoder.encode(&frame, hint)?))?;
        times.push(ms);
        late.extend((waits(&scene) > before).then_some(i));
        certain += usize::from(encoded.stats.certain);
        if let Some(whole) = &mut whole {
            let same = whole.encode(&frame, hint)?.packet == encoded.packet;
            other.extend((!same).then_some(i));
        }
        bar.inc(1);
    }
    let of = |late: &dyn Fn(usize) -> bool| {
        let times = times.iter().enumerate().filter(|(i, _)| late(*i)).map(|(_, ms)| *ms);
        times.collect::<Vec<f64>>()
    };
    Ok(json!({
        "splats": blocked.len(),
        "blocks": blocked.blocks().len(),
        "copies": copies,
        "frames": frames,
        "certain": certain,
        "frame_ms": median(times.iter().copied()),
        "longest_ms": times.iter().copied().fold(0.0, f64::max),
        "frames_that_waited": late.len(),
        "first_that_waited": late.first(),
        "longest_ms_without_waiting": of(&|i| !late.contains(&i)).into_iter().fold(0.0, f64::max),
        "limit_bytes": limit,
        "window": residency(&scene),
        "compared_with_whole": whole.is_some(),
        "packets_that_differ": other.len(),
        "first_that_differs": other.first(),
    }))
}

fn waits(scene: &Scene) -> u64 {
    scene.residency().map_or(0, |residency| residency.waits)
}

/// The prior loaded whole; `None`: the device has no room for it.
fn whole(engine: &Engine, path: &Path) -> anyhow::Result<Option<Arc<Scene>>> {
    let prior = Prior::open(path, &RenderOverrides::default())?;
    match engine.upload(&prior) {
        Err(VulkanError::BufferTooLarge { .. }) => Ok(None),
        scene => Ok(Some(scene?)),
    }
}

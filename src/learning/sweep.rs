//! Depths from a plane sweep: a pixel lies at the depth at which the other frames show the same around it.

use glam::DVec3;

use super::key_frame::KeyFrame;

/// Planes of a sweep, even in inverse depth.
const PLANES: u32 = 48;
/// The nearest plane and the farthest, in depths of the render.
const NEAREST: f64 = 0.25;
/// See [`NEAREST`].
const FARTHEST: f64 = 1.05;
/// Frames that a pixel is compared with, at most.
const OTHERS: usize = 6;
/// Mean difference of a colour value over the points compared, of 255, above which a depth is refused.
const MOST_DIFFERENT: f32 = 12.0;
/// Points that are compared: the pixel's offsets.
const POINTS: [[i32; 2]; 5] = [[0, 0], [3, 0], [-3, 0], [0, 3], [0, -3]];

/// The point of the world that pixel `(x, y)` of a frame shows; `None` if no depth explains enough of the others.
/// `depth`: that of the render there. `others`: the frames to compare with, the most alike first.
pub fn sweep(
    frame: &KeyFrame,
    [x, y]: [usize; 2],
    depth: f64,
    others: &[&KeyFrame],
) -> Option<(DVec3, f64)> {
    let others = &others[..others.len().min(OTHERS)];
    let pixel = [x as f64 + 0.5, y as f64 + 0.5];
    let (near, far) = (1.0 / (NEAREST * depth), 1.0 / (FARTHEST * depth));
    let mut best: Option<(f32, DVec3, f64)> = None;
    for plane in 0..PLANES {
        let share = f64::from(plane) / f64::from(PLANES - 1);
        let z = 1.0 / (near + (far - near) * share);
        let point = frame.point(pixel, z);
        if let Some(cost) = cost(frame, [x, y], point, others)
            && best.is_none_or(|(least, ..)| cost < least)
        {
            best = Some((cost, point, z));
        }
    }
    best.filter(|(cost, ..)| *cost <= MOST_DIFFERENT).map(|(_, point, z)| (point, z))
}

/// Mean difference from the better half of the other frames; `None` if fewer than two show the point.
fn cost(frame: &KeyFrame, at: [usize; 2], point: DVec3, others: &[&KeyFrame]) -> Option<f32> {
    let mut costs = [f32::MAX; OTHERS];
    let mut count = 0;
    for other in others {
        let shown = other.seen(point).and_then(|(place, _)| difference(frame, at, other, place));
        if let Some(cost) = shown {
            costs[count] = cost;
            count += 1;
        }
    }
    if count < 2 {
        return None;
    }
    let half = count / 2 + 1;
    costs[..count].sort_by(f32::total_cmp);
    Some(costs[..half].iter().sum::<f32>() / half as f32)
}

/// Mean difference of the points around a pixel and around a place in another frame.
fn difference(
    frame: &KeyFrame,
    [x, y]: [usize; 2],
    other: &KeyFrame,
    place: [f64; 2],
) -> Option<f32> {
    let (width, height) = (frame.camera.width as i32, frame.camera.height as i32);
    let mut sum = 0.0;
    for [dx, dy] in POINTS {
        let column = (x as i32 + dx).clamp(0, width - 1);
        let row = (y as i32 + dy).clamp(0, height - 1);
        let own = 3 * (row * width + column) as usize;
        let there = other.colour_at([place[0] + f64::from(dx), place[1] + f64::from(dy)])?;
        for (value, other) in frame.picture.data[own..own + 3].iter().zip(there) {
            sum += (f32::from(*value) - other).abs();
        }
    }
    Some(sum / (3 * POINTS.len()) as f32)
}

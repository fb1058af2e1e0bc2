//! Sites that are rows of copies of one scene.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use anyhow::{Context, ensure};
use glam::{DMat3, DQuat, DVec3};
use nvsprior::prior::blocked::BlockedWriter;
use nvsprior::prior::{Besides, Extras, Splats};
use nvsprior::{Camera, Pose, Prior, RenderOptions};

/// What is taken of the scene: the demo's basin without the walls across the row, and without what lies far off.
const LEAST: [f32; 3] = [-6.5, -6.4, -0.3];
const GREATEST: [f32; 3] = [6.5, 6.4, 5.9];
/// Distance from copy to copy, along y.
pub const STEP: f32 = GREATEST[1] - LEAST[1];
/// Most splats of a copy. So sixty copies fit whole into storage buffers of 128 MiB, to compare with.
const MOST: usize = 39_000;
/// The demo's camera.
pub const CAMERA: Camera =
    Camera { width: 320, height: 180, fx: 271.0, fy: 271.0, cx: 160.0, cy: 90.0 };

/// A part of a scene, to be copied.
pub struct Tiled {
    part: Splats,
    options: RenderOptions,
}

/// The camera on its way along the row, `along` units from its beginning: it looks to the side, a little up and down
/// the row in turns.
pub fn pose(along: f64) -> Pose {
    let centre = DVec3::new(4.6, f64::from(LEAST[1]) + along, 1.2 + 0.2 * (0.21 * along).sin());
    let turn = 0.2 * (0.13 * along).sin();
    let forward = DVec3::new(-turn.cos(), turn.sin(), -0.1).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let down = forward.cross(right);
    let to_world = DMat3::from_cols(right, down, forward);
    Pose::from_centre(DQuat::from_mat3(&to_world).inverse(), centre)
}

impl Tiled {
    /// Takes the part of a scene that is copied.
    pub fn of(scene: &Prior) -> anyhow::Result<Tiled> {
        let splats = scene.splats();
        let inside = |i: &usize| {
            let p = splats.positions[*i];
            let shown = splats.opacity(*i) > 1.5 / 255.0;
            shown && (0..3).all(|axis| p[axis] > LEAST[axis] && p[axis] < GREATEST[axis])
        };
        let mut which: Vec<usize> = (0..splats.len()).filter(inside).collect();
        // Those that show most stay.
        let shows = |i: usize| {
            let mut scales = splats.log_scales[i];
            scales.sort_by(f32::total_cmp);
            splats.opacity(i).ln() + f64::from(scales[1] + scales[2])
        };
        which.sort_by(|a, b| shows(*b).total_cmp(&shows(*a)));
        which.truncate(MOST);
        ensure!(!which.is_empty(), "the scene has no splats where the demo's basin has them");
        let mut kept = vec![false; splats.len()];
        which.iter().for_each(|i| kept[*i] = true);
        Ok(Tiled { part: splats.filtered(&kept), options: *scene.options() })
    }

    /// Splats of a copy.
    pub fn part(&self) -> usize {
        self.part.len()
    }

    /// Writes a row of so many splats. The last copy may be cut off.
    pub fn write(
        &self,
        path: &Path,
        count: usize,
        done: &mut dyn FnMut(usize),
    ) -> anyhow::Result<()> {
        let mut splats = Splats { sh_degree: self.part.sh_degree, ..Splats::default() };
        for copy in 0..count.div_ceil(self.part()) {
            let mut own = self.part.clone();
            own.positions.iter_mut().for_each(|p| p[1] += STEP * copy as f32);
            splats.append(&mut own);
        }
        let kept: Vec<bool> = (0..splats.len()).map(|i| i < count).collect();
        if count < splats.len() {
            splats = splats.filtered(&kept);
        }
        let besides = Besides {
            options: &self.options,
            frame: None,
            coder_tables: None,
            extras: &Extras::default(),
        };
        let file = File::create(path).with_context(|| path.display().to_string())?;
        let writer = BlockedWriter::default();
        writer.write(&splats, &besides, BufWriter::new(file), done)?;
        Ok(())
    }
}

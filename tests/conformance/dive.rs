//! The small scene of the vectors, and frames of it.

use std::sync::Arc;

use nvsprior::coder_tables::Tables;
use nvsprior::packet::{
    Latent, Packet, PoseProfile, QuantisedPose, RenderCheck, Residual, Session,
};
use nvsprior::prior::Splats;
use nvsprior::render::Scene;
use nvsprior::render::definition::Definition;
use nvsprior::residual::{Rate, ResidualEncoder, ResidualSetup};
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, Picture, Pose, Prior, RenderOptions};

use crate::common::{Random, engine};

pub const CAMERA: Camera =
    Camera { width: 96, height: 54, fx: 78.0, fy: 78.5, cx: 48.25, cy: 26.75 };

/// A number in [0, 1) from an index.
fn noise(index: u64) -> f32 {
    Random::at(index).within(0.0, 1.0)
}

/// A wall of 28 × 17 splats with relief, at z ≈ 4.
fn wall() -> Splats {
    let (columns, rows) = (28, 17);
    let mut splats = Splats { sh_degree: 1, ..Splats::default() };
    for i in 0..columns * rows {
        let (x, y) = ((i % columns) as f32 * 0.26 - 3.6, (i / columns) as f32 * 0.26 - 2.2);
        let at = |k: u64| noise(i as u64 * 20 + k) - 0.5;
        splats.positions.push([x, y, 4.0 + 0.8 * at(0)]);
        splats.log_scales.push([-1.9 + 0.6 * at(1), -2.0 + 0.6 * at(2), -3.5]);
        splats.rotations.push([1.0, 0.4 * at(3), 0.4 * at(4), 2.0 * at(5)]);
        splats.opacity_logits.push(2.5 + 3.0 * at(6));
        for channel in 0..3 {
            let patch = (i / columns / 4 * 20 + i % columns / 4) as u64;
            let coarse = noise(9000 + patch * 3 + channel);
            splats.sh.push((0.7 * coarse + 0.3 * noise(i as u64 * 3 + channel) - 0.5) * 3.0);
        }
        splats.sh.extend((7..16).map(|k| 0.2 * at(k)));
    }
    splats
}

/// The prior of most vectors.
pub fn prior() -> Prior {
    Prior::from_splats(wall(), RenderOptions::INRIA).unwrap()
}

/// A prior that needs what the first one does not: all degrees, opacity that is compensated, a background, splats of
/// all sizes, some behind the camera.
pub fn odd_prior() -> Prior {
    let splats = crate::common::random_splats(5, 160, 3);
    let options = RenderOptions {
        antialiased: true,
        background: [0.25, 0.5, 0.125],
        ..RenderOptions::GSPLAT
    };
    Prior::from_splats(splats, options).unwrap()
}

/// Coder tables that are not the library's.
pub fn own_tables() -> Tables {
    let mut tables = Tables::generic();
    let mut index = 0_u64;
    tables.for_each_weight(|weight| {
        index += 1;
        *weight = weight.wrapping_add((noise(index) * 9.0) as i16 - 4);
    });
    tables
}

/// The pose of frame `t` of a slow dive along the wall. Of sums and products alone: hosts' sines differ.
pub fn pose(t: u32) -> Pose {
    let t = f64::from(t);
    let turn = [1.0, 0.002 * t, 0.003 * t, -0.0015 * t];
    Pose::from_wxyz(turn, [0.05 * t, -0.02 * t, 0.01 * t]).unwrap()
}

/// A prior, drawn on the host.
pub struct Dive {
    pub prior: Prior,
    definition: Definition,
}

impl Dive {
    pub fn of(prior: Prior) -> Dive {
        Dive { definition: Definition::new(&prior), prior }
    }

    pub fn scene(&self) -> Arc<Scene> {
        engine().upload(&self.prior).unwrap()
    }

    pub fn quantised(&self, pose: &Pose, profile: PoseProfile) -> QuantisedPose {
        QuantisedPose::quantise(pose, &self.prior.coordinate_frame(), profile).unwrap()
    }

    /// The render at a packet's pose.
    pub fn render(&self, camera: &Camera, pose: &QuantisedPose) -> Picture {
        let data = self.definition.draw_coded(camera, &pose.words()).rgb8;
        Picture { width: camera.width, height: camera.height, data }
    }

    /// What the camera sees of frame `t`: the wall in darker light, and something new in front of it.
    pub fn seen(&self, camera: &Camera, t: u32) -> Picture {
        let data = self.definition.draw(camera, &pose(t)).rgb8;
        let mut picture = Picture { width: camera.width, height: camera.height, data };
        let width = camera.width as usize;
        for (i, value) in picture.data.iter_mut().enumerate() {
            let (x, y) = (i / 3 % width, i / 3 / width);
            let light = 235 - x as u32 / 8;
            *value = (u32::from(*value) * light / 256 + (noise(i as u64) * 4.0) as u32) as u8;
            if (20..33).contains(&x) && (12..25).contains(&y) {
                *value = [200, 120, 40][i % 3];
            }
        }
        picture
    }

    pub fn session(&self, camera: &Camera) -> Session {
        Session { prior: self.prior.id(), camera: *camera }
    }

    /// A latent part.
    pub fn latent(&self, camera: &Camera, t: u32, profile: PoseProfile) -> Latent {
        let tag = self.session(camera).tag().unwrap();
        let pose = self.quantised(&pose(t), profile);
        Latent {
            frame: t,
            tag,
            pose,
            uncertain: false,
            known: None,
            portable: true,
            predicted: None,
        }
    }

    /// One with a short pose.
    pub fn short(&self, camera: &Camera, t: u32) -> Latent {
        self.latent(camera, t, PoseProfile::Short)
    }

    /// A packet without a residual, with the session part.
    pub fn key(&self, camera: &Camera, t: u32) -> Vec<u8> {
        let latent = self.latent(camera, t, PoseProfile::Compact);
        packet(latent, Some(self.session(camera)), None, Residual::None)
    }

    /// A packet with a residual of frame `t`.
    pub fn coded(&self, latent: Latent, camera: Option<&Camera>, t: u32, how: &How) -> Vec<u8> {
        let own = camera.copied().unwrap_or(how.camera);
        let (width, height) = (own.width, own.height);
        let setup = ResidualSetup::new(width, height);
        let tables = self.prior.coder_tables().cloned();
        let tables = tables.unwrap_or_else(|| setup.tables.clone());
        let setup = ResidualSetup { portable: how.portable, tables, ..setup };
        let mut encoder = ResidualEncoder::new(&setup);
        let (seen, render) = (self.seen(&own, t), self.render(&own, &latent.pose));
        let seen = (how.change)(seen);
        let coded = encoder.encode(&seen, &render, how.rate, 0).unwrap();
        packet(latent, camera.map(|camera| self.session(camera)), None, coded.residual)
    }

    /// An encoder's packets of frames 0 to `count`, and its own pictures.
    pub fn encoded(&self, options: EncoderOptions, count: u32) -> Vec<Encoded> {
        self.encoded_as(&CAMERA, options, count, |picture| picture)
    }

    /// An encoder's packets by another camera. `change`: what is done to each picture before.
    pub fn encoded_as(
        &self,
        camera: &Camera,
        options: EncoderOptions,
        count: u32,
        change: fn(Picture) -> Picture,
    ) -> Vec<Encoded> {
        self.encoded_of(camera, options, count, |t| change(self.seen(camera, t)))
    }

    /// An encoder's packets of the pictures that `seen` gives.
    pub fn encoded_of(
        &self,
        camera: &Camera,
        options: EncoderOptions,
        count: u32,
        seen: impl Fn(u32) -> Picture,
    ) -> Vec<Encoded> {
        let mut encoder = Encoder::new(&engine(), &self.scene(), camera, options).unwrap();
        (0..count).map(|t| encoder.encode(&seen(t), pose(t)).unwrap()).collect()
    }
}

/// How a residual is coded.
pub struct How {
    pub camera: Camera,
    pub rate: Rate,
    pub portable: bool,
    pub change: fn(Picture) -> Picture,
}

impl How {
    pub fn at(rate: Rate) -> How {
        How { camera: CAMERA, rate, portable: true, change: |picture| picture }
    }
}

pub fn packet(
    latent: Latent,
    session: Option<Session>,
    render: Option<RenderCheck>,
    residual: Residual,
) -> Vec<u8> {
    Packet { latent, session, render, residual, truth: None }.encode().unwrap()
}

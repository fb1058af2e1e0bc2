//! The vehicle's side: frames to shares, reports to protection.

use std::sync::Arc;

use nvsprior::keys::{Keys, Seen};
use nvsprior::modem::{Division, ModemError, PacketState, Report, Sender, SenderOptions};
use nvsprior::packet::{Extent, residual_part_len};
use nvsprior::render::Scene;
use nvsprior::residual::Tune;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Camera, Encoded, Encoder, EncoderOptions, Engine, Mode, Picture};

/// How a vehicle encodes and sends.
#[derive(Clone, Copy, Debug)]
pub struct VehicleOptions {
    pub sender: SenderOptions,
    pub mode: Mode,
    pub tune: Tune,
    /// See [`EncoderOptions::threshold`].
    pub threshold: f64,
    /// See [`EncoderOptions::frames_treated`].
    pub frames_treated: bool,
    /// See [`EncoderOptions::truth`].
    pub truth: bool,
    /// See [`EncoderOptions::predict_poses`]: if the sender expects reports.
    pub predict_poses: bool,
}

pub struct SentPacket {
    pub frame: usize,
    pub number: u32,
    /// When the frame was exposed, seconds.
    pub exposed: f64,
    pub bytes: PacketBytes,
    pub render_psnr: f64,
    /// Of the whole packet.
    pub psnr: f64,
    pub certain: bool,
    pub inter: bool,
}

/// What the bytes of packets are, without the frame numbers that shares tell by themselves.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct PacketBytes {
    /// Latent part, and the camera where it is sent.
    pub latent: usize,
    pub residual: usize,
    /// Length and check of the residual, which it has among its bytes: not one of the parts of a sum.
    #[serde(skip)]
    pub framing: usize,
    /// The truth map, which the residual has among its bytes, too.
    #[serde(skip)]
    pub truth: usize,
    /// What the shares say of themselves.
    pub headers: usize,
    pub parity: usize,
    /// Numbers and tags, with keys.
    pub tags: usize,
}

impl PacketBytes {
    fn of(
        division: &Division,
        packet: &[u8],
        truth: usize,
        (overhead, tag): (usize, usize),
    ) -> Result<PacketBytes, ModemError> {
        let Division { shares, header_bytes, packet_bytes, left_out, link_bytes, .. } = *division;
        let Extent { head, has_content, .. } = Extent::read(packet)?;
        let residual = packet_bytes.saturating_sub(head);
        let sent = link_bytes.saturating_sub(shares * overhead + header_bytes);
        let parity = sent.saturating_sub(packet_bytes - left_out);
        let latent = sent - parity - residual;
        let framing = if has_content { residual_part_len(0) } else { 0 };
        Ok(PacketBytes {
            latent,
            residual,
            framing: framing.min(residual),
            truth,
            headers: header_bytes,
            parity,
            tags: shares * tag,
        })
    }

    pub fn total(&self) -> usize {
        self.latent + self.residual + self.headers + self.parity + self.tags
    }
}

pub struct Vehicle {
    encoder: Encoder,
    sender: Sender,
    encoded: Encoded,
    /// Bytes of a modem frame's number and tag.
    tag: usize,
    /// The camera's frame after the last one that was sent.
    next: usize,
    /// Bytes of shares that were sent again.
    pub resent: usize,
}

/// A camera frame that a vehicle takes.
pub struct CameraFrame<'a> {
    /// Its number: all camera frames count.
    pub number: usize,
    /// When it was exposed, seconds.
    pub exposed: f64,
    pub picture: &'a Picture,
    pub info: FrameInfo,
    /// User bytes that travel with it.
    pub user: Option<&'a [u8]>,
}

impl Vehicle {
    /// `keys`: those of its modem frames, and of the reports that it takes.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        camera: &Camera,
        options: &VehicleOptions,
        keys: Option<&Keys>,
    ) -> anyhow::Result<Vehicle> {
        let VehicleOptions { sender, mode, tune, threshold, frames_treated, truth, .. } = *options;
        let options = EncoderOptions {
            threshold,
            frames_treated,
            mode,
            tune,
            truth,
            predict_poses: options.predict_poses && sender.expect_reports,
            ..Default::default()
        };
        let encoder = Encoder::new(engine, scene, camera, options)?;
        let sender = match keys {
            Some(keys) => Sender::with_keys(sender, keys)?,
            None => Sender::new(sender)?,
        };
        Ok(Vehicle {
            encoder,
            sender,
            encoded: Encoded::default(),
            tag: keys.map_or(0, Keys::overhead),
            next: 0,
            resent: 0,
        })
    }

    /// Takes a frame, and divides its packet into shares. `ready` tells when that is, seconds; it is asked when the
    /// frame is coded. `None`: the link has no bytes for the frame, so it is left out.
    pub fn take(
        &mut self,
        frame: &CameraFrame,
        ready: impl FnOnce() -> f64,
    ) -> anyhow::Result<Option<SentPacket>> {
        let CameraFrame { number, exposed, picture, info, user } = *frame;
        let Some(bytes) = self.sender.plan(exposed)? else { return Ok(None) };
        self.encoder.skip((number - self.next) as u32);
        self.next = number + 1;
        self.encoder.set_steady_bytes(bytes);
        self.encoder.encode_into(picture, info, &mut self.encoded)?;
        let packet = &self.encoded.packet;
        let division = self.sender.push(ready(), packet, user)?;
        let stats = &self.encoded.stats;
        let costs = (self.sender.options().overhead, self.tag);
        Ok(Some(SentPacket {
            frame: number,
            number: stats.frame,
            exposed,
            bytes: PacketBytes::of(&division, packet, stats.truth_bytes, costs)?,
            render_psnr: stats.render_psnr,
            psnr: stats.psnr,
            certain: stats.certain,
            inter: stats.reference.is_some(),
        }))
    }

    /// What the topside is to show of the last packet, if all of it comes.
    pub fn picture(&self) -> &Picture {
        &self.encoded.picture
    }

    /// The encoder: its mask, its region of interest.
    pub fn encoder(&mut self) -> &mut Encoder {
        &mut self.encoder
    }

    /// The next share that is due at `now`, and when it was.
    pub fn next_share(&mut self, now: f64) -> Option<(f64, &[u8])> {
        self.sender.next(now)
    }

    /// Longest time from a frame's exposure to the end of its packet's last share, seconds.
    pub fn latency(&self) -> f64 {
        self.sender.options().latency
    }

    /// So many frames per second come from here on: see [`Sender::set_frame_rate`].
    ///
    /// # Errors
    /// If the frame rate is not positive and finite.
    pub fn set_frame_rate(&mut self, frame_rate: f64) -> Result<(), ModemError> {
        self.sender.set_frame_rate(frame_rate)
    }

    /// When the next share is due, seconds.
    pub fn due(&self) -> Option<f64> {
        self.sender.due()
    }

    /// See [`Sender::read_report`].
    pub fn read_report<'a>(
        &mut self,
        bytes: &'a [u8],
    ) -> Result<(Report, Option<&'a [u8]>), ModemError> {
        self.sender.read_report(bytes)
    }

    /// With keys: the number of the next modem frame.
    pub fn next_number(&self) -> Option<u64> {
        self.sender.next_number()
    }

    /// With keys: the reports that were taken.
    pub fn seen(&self) -> impl Iterator<Item = Seen> + '_ {
        self.sender.seen()
    }

    pub fn process_report(&mut self, now: f64, report: &Report) -> Result<(), ModemError> {
        for (frame, _) in report.packets().filter(|(_, packet)| packet.state == PacketState::Kept) {
            self.encoder.acknowledge(frame);
        }
        for (frame, held) in report.poses() {
            self.encoder.acknowledge_pose(frame, held);
        }
        self.resent += self.sender.process_report(now, report)?.bytes;
        Ok(())
    }
}

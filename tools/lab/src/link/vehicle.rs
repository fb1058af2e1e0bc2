//! The vehicle's side: frames to shares, reports to protection.

use std::sync::Arc;

use nvsprior::learning::LearnOptions;
use nvsprior::modem::{
    Division, ModemError, PacketState, Protection, RateControlOptions, Report, Sender,
    SenderOptions,
};
use nvsprior::packet::Extent;
use nvsprior::render::Scene;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Encoded, Encoder, EncoderOptions, Engine, Error, Picture, Rate};

use super::{Footage, Setting};

pub struct SentPacket {
    pub frame: usize,
    pub number: u32,
    /// When the frame was exposed, seconds.
    pub exposed: f64,
    pub bytes: PacketBytes,
    pub render_psnr: f64,
    /// Of the whole packet.
    pub psnr: f64,
    pub inter: bool,
    /// Number of the update that it is drawn with; 0: the prior alone.
    pub update: u16,
}

/// An update that was learnt and sent.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct SentUpdate {
    pub number: u16,
    pub bytes: usize,
    /// When it was proven, seconds.
    pub proven: f64,
    /// From when on frames were drawn with it, seconds; `None`: not within the run.
    pub adopted: Option<f64>,
}

#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct PacketBytes {
    /// Latent part, and the camera where it is sent.
    pub latent: usize,
    pub residual: usize,
    /// What the shares say of themselves.
    pub headers: usize,
    pub parity: usize,
}

impl PacketBytes {
    /// Of a packet whose first `picture` bytes make a picture.
    fn of(division: &Division, picture: usize) -> PacketBytes {
        let Division { shares, share_bytes, header_bytes, packet_bytes, .. } = *division;
        PacketBytes {
            latent: picture,
            residual: packet_bytes - picture,
            headers: header_bytes,
            parity: shares * share_bytes - header_bytes - packet_bytes,
        }
    }

    pub fn total(&self) -> usize {
        self.latent + self.residual + self.headers + self.parity
    }
}

pub struct Vehicle {
    encoder: Encoder,
    sender: Sender,
    encoded: Encoded,
    /// The camera's frame after the last one that was sent.
    next: usize,
    pub sent: Vec<SentPacket>,
    /// Bytes of shares that were sent again.
    pub resent: usize,
    pub updates: Vec<SentUpdate>,
    setting: Setting,
}

impl Vehicle {
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        footage: &Footage,
        setting: &Setting,
        threshold: f64,
    ) -> anyhow::Result<Vehicle> {
        let options = EncoderOptions {
            threshold,
            frames_treated: true,
            mode: setting.mode,
            ..Default::default()
        };
        let mut encoder = Encoder::new(engine, scene, &footage.camera, options)?;
        let sender = sender(setting)?;
        if setting.updates.is_some() {
            encoder.learn(&LearnOptions::default())?;
        }
        Ok(Vehicle {
            encoder,
            sender,
            encoded: Encoded::default(),
            next: 0,
            sent: Vec::new(),
            resent: 0,
            updates: Vec::new(),
            setting: setting.clone(),
        })
    }

    /// Takes a frame; leaves it out if the link has no bytes for it.
    pub fn take(
        &mut self,
        frame: usize,
        exposed: f64,
        picture: &Picture,
        info: FrameInfo,
    ) -> anyhow::Result<()> {
        self.adopt(exposed);
        let Some(bytes) = self.sender.plan(exposed)? else { return Ok(()) };
        self.encoder.skip((frame - self.next) as u32);
        self.next = frame + 1;
        // A packet that tells the camera has as many bytes for its difference picture as others.
        let bytes = bytes + self.encoder.extra_bytes();
        self.encode(picture, info, bytes)?;
        let packet = &self.encoded.packet;
        let ready = exposed + self.setting.coding;
        let division = self.sender.push(ready, packet, None)?;
        let stats = &self.encoded.stats;
        self.sent.push(SentPacket {
            frame,
            number: stats.frame,
            exposed,
            bytes: PacketBytes::of(&division, Extent::read(packet)?.head),
            render_psnr: stats.render_psnr,
            psnr: stats.psnr,
            inter: stats.reference.is_some(),
            update: self.encoder.learnt().number(),
        });
        self.learn(ready)
    }

    /// Draws with the update that waits, once the topside holds it.
    fn adopt(&mut self, now: f64) {
        let Some(number) = self.sender.held_update() else { return };
        if self.encoder.adopt(number) {
            let sent = self.updates.iter_mut().find(|sent| sent.number == number);
            sent.into_iter().for_each(|sent| sent.adopted = Some(now));
        }
    }

    /// Learns from the last frame, and sends the update that it proves. What the sender has no room for is dropped.
    fn learn(&mut self, now: f64) -> anyhow::Result<()> {
        let Some(price) = self.sender.update_price() else { return Ok(()) };
        self.encoder.learn_more(price)?;
        let Some(update) = self.encoder.take_update() else { return Ok(()) };
        match self.sender.push_update(now, &update) {
            Err(ModemError::UpdatesFull { .. } | ModemError::UpdateTooLong { .. }) => {
                self.encoder.drop_update();
                return Ok(());
            }
            pushed => pushed?,
        }
        let number = self.encoder.waiting_update().unwrap_or(0);
        let (bytes, proven) = (update.len(), now);
        self.updates.push(SentUpdate { number, bytes, proven, adopted: None });
        Ok(())
    }

    /// Bytes on the link of the updates' pieces.
    pub fn piece_bytes(&self) -> usize {
        self.sender.statistics().piece_bytes as usize
    }

    /// Encodes a frame in so many bytes. A packet that also tells the camera may take more: what does not fit its
    /// shares is cut off.
    fn encode(&mut self, picture: &Picture, info: FrameInfo, bytes: usize) -> Result<(), Error> {
        self.encoder.set_rate(Some(Rate::Bytes(bytes)));
        match self.encoder.encode_into(picture, info, &mut self.encoded) {
            Err(Error::Budget { needed, .. }) => {
                self.encoder.set_rate(Some(Rate::Bytes(needed)));
                self.encoder.encode_into(picture, info, &mut self.encoded)
            }
            done => done,
        }
    }

    /// The next share that is due at `now`.
    pub fn next_share(&mut self, now: f64) -> Option<&[u8]> {
        self.sender.next(now).map(|(_, share)| share)
    }

    /// When the next share is due, seconds.
    pub fn due(&self) -> Option<f64> {
        self.sender.due()
    }

    pub fn process_report(&mut self, now: f64, report: &Report) -> Result<(), ModemError> {
        for (frame, _) in report.packets().filter(|(_, packet)| packet.state == PacketState::Kept) {
            self.encoder.acknowledge(frame);
        }
        self.resent += self.sender.process_report(now, report)?.bytes;
        Ok(())
    }
}

/// The sender of a setting; fails if the setting cannot be.
pub fn sender(setting: &Setting) -> Result<Sender, ModemError> {
    let control = RateControlOptions {
        bit_rate: setting.bit_rate,
        mtu: setting.mtu,
        overhead: setting.overhead,
        latency: setting.latency,
        delay: setting.coding + setting.propagation,
        spread: setting.spread,
        frame_rate: setting.frame_rate,
        min_bytes: setting.min_bytes,
        max_shares: setting.shares,
        loss: setting.assumed,
        user: None,
    };
    Sender::new(SenderOptions {
        control,
        stream: 0,
        protection: Protection::Layers,
        expect_reports: setting.return_delay.is_some(),
        updates: setting.updates,
    })
}

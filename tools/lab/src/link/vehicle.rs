//! The vehicle's side: frames to shares, reports to protection.

use std::sync::Arc;

use nvsprior::modem::{
    Interleaver, Loss, ModemError, RateControl, RateControlOptions, Sharer, Sharing,
};
use nvsprior::packet::Extent;
use nvsprior::render::Scene;
use nvsprior::tracking::Known;
use nvsprior::{Encoded, Encoder, EncoderOptions, Engine, Error, Picture, Rate};

use super::topside::TopsideReport;
use super::{Footage, Setting};

/// A packet that was sent.
pub struct SentPacket {
    /// The camera's frame.
    pub frame: usize,
    /// Its number in the packet.
    pub number: u32,
    /// When the frame was exposed, seconds.
    pub exposed: f64,
    pub bytes: PacketBytes,
    pub render_psnr: f64,
    /// Of the whole packet.
    pub psnr: f64,
    /// When its last share is due, seconds.
    last_due: f64,
    /// Its shares, to be sent again.
    shares: Vec<Vec<u8>>,
    /// Shares that give a picture.
    first: usize,
    resent: bool,
}

/// What the bytes of a packet are for.
#[derive(Clone, Copy, Debug, Default)]
pub struct PacketBytes {
    /// Latent part, and the camera where it is sent.
    pub latent: usize,
    pub residual: usize,
    /// What the shares say of themselves and of the layers.
    pub headers: usize,
    pub parity: usize,
    /// Shares that were sent once more.
    pub resent: usize,
}

impl PacketBytes {
    /// Of a packet whose first `picture` bytes make a picture.
    fn of(sharing: &Sharing, picture: usize, packet: usize) -> PacketBytes {
        let chunks: usize = sharing.layers().iter().map(|layer| layer.chunk).sum();
        let of_packet = packet.min(sharing.capacity());
        PacketBytes {
            latent: picture,
            residual: of_packet - picture,
            headers: sharing.count() * (sharing.share_len() - chunks),
            parity: sharing.count() * chunks - of_packet,
            resent: 0,
        }
    }

    pub fn total(&self) -> usize {
        self.latent + self.residual + self.headers + self.parity + self.resent
    }
}

/// Share of the loss before in what is believed after a report.
const MEMORY: f64 = 0.7;

pub struct Vehicle {
    encoder: Encoder,
    control: RateControl,
    encoded: Encoded,
    sharer: Sharer,
    interleaver: Interleaver,
    /// The camera's frame after the last one that was sent.
    next: usize,
    pub sent: Vec<SentPacket>,
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
        let options = EncoderOptions { threshold, frames_treated: true, ..Default::default() };
        Ok(Vehicle {
            encoder: Encoder::new(engine, scene, &footage.camera, options)?,
            control: rate_control(setting)?,
            encoded: Encoded::default(),
            sharer: Sharer::default(),
            interleaver: Interleaver::new(setting.spread)?,
            next: 0,
            sent: Vec::new(),
            setting: setting.clone(),
        })
    }

    /// Takes a frame; tells whether it is sent, and is not left out.
    pub fn take(
        &mut self,
        frame: usize,
        exposed: f64,
        picture: &Picture,
        known: Known,
    ) -> anyhow::Result<bool> {
        let Some(budget) = self.control.plan(exposed) else { return Ok(false) };
        let Ok(most) = self.control.most(budget) else { return Ok(false) };
        self.encoder.skip((frame - self.next) as u32);
        self.next = frame + 1;
        self.encode(picture, known, most.capacity())?;
        let packet = &self.encoded.packet;
        let made = picture_len(packet)?;
        // The first packet tells the camera, too. If the budget does not hold that, it takes more for once.
        let sharing = match self.control.divide(budget, made, packet.len()) {
            Ok(sharing) => sharing,
            Err(_) => self.control.divide(3 * budget, made, packet.len())?,
        };
        self.sharer.share(packet, &sharing, 0, None)?;
        let ready = exposed + self.setting.coding;
        self.control.sent(ready, self.control.cost(&sharing));
        self.interleaver.push(ready, &self.sharer);
        let stats = &self.encoded.stats;
        self.sent.push(SentPacket {
            frame,
            number: stats.frame,
            exposed,
            bytes: PacketBytes::of(&sharing, made, packet.len()),
            render_psnr: stats.render_psnr,
            psnr: stats.psnr,
            first: sharing.layers()[0].threshold,
            shares: (0..self.sharer.count()).map(|k| self.sharer.get(k).to_vec()).collect(),
            last_due: ready + self.setting.spread,
            resent: false,
        });
        Ok(true)
    }

    /// Encodes a frame in so many bytes. A packet that also tells the camera may take more: what does not fit its shares is
    /// cut off.
    fn encode(&mut self, picture: &Picture, known: Known, bytes: usize) -> Result<(), Error> {
        self.encoder.set_rate(Some(Rate::Bytes(bytes)));
        match self.encoder.encode_into(picture, known, &mut self.encoded) {
            Err(Error::Budget { needed, .. }) => {
                self.encoder.set_rate(Some(Rate::Bytes(needed)));
                self.encoder.encode_into(picture, known, &mut self.encoded)
            }
            done => done,
        }
    }

    /// The next share that is due at `now`.
    pub fn next_share(&mut self, now: f64) -> Option<&[u8]> {
        self.interleaver.next(now).map(|(_, share)| share)
    }

    /// When the next share is due, seconds.
    pub fn due(&self) -> Option<f64> {
        self.interleaver.due()
    }

    /// Takes a report. Returns shares to send again, those of pictures that can still be shown in time.
    pub fn hear(&mut self, now: f64, report: &TopsideReport) -> anyhow::Result<Vec<Vec<u8>>> {
        if let Some(measured) = report.loss {
            let loss = self.control.options().loss;
            let share = MEMORY * loss.share + (1.0 - MEMORY) * measured;
            self.control.set_loss(Loss { share: share.min(0.9), ..loss })?;
        }
        let deadline = self.setting.latency - self.setting.propagation;
        let mut again = Vec::new();
        let told = |sent: &SentPacket| sent.last_due + self.setting.propagation < report.time;
        for sent in self.sent.iter_mut().filter(|sent| !sent.resent && told(sent)) {
            let Some(arrived) = report.short_of(sent.number) else { continue };
            let short = sent.first.saturating_sub(arrived.len());
            let missing = sent.shares.iter().enumerate().filter(|(k, _)| !arrived.contains(k));
            let needed: Vec<_> = missing.take(short).map(|(_, share)| share.clone()).collect();
            let bytes: usize = needed.iter().map(|share| share.len() + self.setting.overhead).sum();
            let seconds = bytes as f64 * 8.0 / self.setting.bit_rate;
            if needed.is_empty() || now + seconds > sent.exposed + deadline {
                continue;
            }
            self.control.sent(now, bytes);
            sent.bytes.resent += needed.iter().map(Vec::len).sum::<usize>();
            sent.resent = true;
            again.extend(needed);
        }
        Ok(again)
    }
}

/// The rate control of a setting; fails if the setting cannot be.
pub fn rate_control(setting: &Setting) -> Result<RateControl, ModemError> {
    RateControl::new(RateControlOptions {
        bit_rate: setting.bit_rate,
        mtu: setting.mtu,
        overhead: setting.overhead,
        latency: setting.latency,
        delay: setting.coding + setting.propagation,
        spread: setting.spread,
        frame_rate: setting.frame_rate,
        least: setting.least,
        most_shares: setting.shares,
        loss: setting.assumed,
        user: None,
    })
}

/// Bytes at the start of a packet that make a picture: those before the residual.
fn picture_len(packet: &[u8]) -> anyhow::Result<usize> {
    let latent = Extent::read(packet)?.latent;
    let fixed = nvsprior::packet::sound_len(&packet[..packet.len() - 1]);
    Ok(fixed.max(latent))
}

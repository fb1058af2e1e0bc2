//! The vehicle's side: frames to shares, reports to protection.

use std::sync::Arc;

use nvsprior::modem::{
    Loss, ModemError, PacketState, RateControlOptions, Report, Sender, SenderOptions, Sharing,
};
use nvsprior::packet::Extent;
use nvsprior::render::Scene;
use nvsprior::tracking::Known;
use nvsprior::{Encoded, Encoder, EncoderOptions, Engine, Error, Picture, Rate};

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
    /// Its shares count in the loss that was measured.
    counted: bool,
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
/// Fewest shares that tell of a loss.
const LEAST_COUNTED: usize = 16;

pub struct Vehicle {
    encoder: Encoder,
    sender: Sender,
    encoded: Encoded,
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
        let options = EncoderOptions {
            threshold,
            frames_treated: true,
            mode: setting.mode,
            ..Default::default()
        };
        Ok(Vehicle {
            encoder: Encoder::new(engine, scene, &footage.camera, options)?,
            sender: sender(setting)?,
            encoded: Encoded::default(),
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
        let Some(bytes) = self.sender.plan(exposed)? else { return Ok(false) };
        self.encoder.skip((frame - self.next) as u32);
        self.next = frame + 1;
        self.encode(picture, known, bytes)?;
        let packet = &self.encoded.packet;
        let ready = exposed + self.setting.coding;
        let sharing = self.sender.push(ready, packet, None)?;
        let stats = &self.encoded.stats;
        let shares = self.sender.shares();
        self.sent.push(SentPacket {
            frame,
            number: stats.frame,
            exposed,
            bytes: PacketBytes::of(&sharing, Extent::read(packet)?.head, packet.len()),
            render_psnr: stats.render_psnr,
            psnr: stats.psnr,
            first: sharing.layers()[0].threshold,
            shares: (0..shares.count()).map(|k| shares.get(k).to_vec()).collect(),
            last_due: ready + self.setting.spread,
            resent: false,
            counted: false,
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
        self.sender.next(now).map(|(_, share)| share)
    }

    /// When the next share is due, seconds.
    pub fn due(&self) -> Option<f64> {
        self.sender.due()
    }

    /// Takes a report. Returns shares to send again, those of pictures that can still be shown in time.
    pub fn hear(&mut self, now: f64, report: &Report) -> anyhow::Result<Vec<Vec<u8>>> {
        for (number, _) in report.packets().filter(|(_, told)| told.state == PacketState::Kept) {
            self.encoder.acknowledge(self.frame_near(number));
        }
        self.measure_loss(report)?;
        Ok(self.send_again(now, report)?)
    }

    /// The frame of a number modulo 2¹⁶, near the newest one.
    fn frame_near(&self, number: u32) -> u32 {
        let newest = self.sent.last().map_or(0, |sent| sent.number);
        newest.wrapping_add_signed(i32::from(number.wrapping_sub(newest) as i16))
    }

    /// The packets that the topside could have all of when it wrote a report: those whose last share was sent before the
    /// first of the newest packet that it has.
    fn settled(&self, report: &Report) -> Vec<usize> {
        let newest = self.frame_near(report.newest());
        let from = self.sent.iter().find(|sent| sent.number == newest);
        let from = from.map_or(f64::NEG_INFINITY, |sent| sent.last_due - self.setting.spread);
        let settled = move |sent: &SentPacket| sent.last_due < from;
        (0..self.sent.len()).filter(|k| settled(&self.sent[*k])).collect()
    }

    /// Counts the shares of packets that no report told of before, and lets the protection follow.
    fn measure_loss(&mut self, report: &Report) -> Result<(), ModemError> {
        let (mut sent, mut arrived) = (0, 0);
        for k in self.settled(report) {
            let packet = &mut self.sent[k];
            let Some(told) = report.packet(packet.number).filter(|_| !packet.counted) else {
                continue;
            };
            packet.counted = true;
            sent += packet.shares.len();
            arrived += told.arrived.min(packet.shares.len());
        }
        if sent < LEAST_COUNTED {
            return Ok(());
        }
        let measured = 1.0 - arrived as f64 / sent as f64;
        let loss = self.sender.control().options().loss;
        let chance = MEMORY * loss.chance + (1.0 - MEMORY) * measured;
        self.sender.set_loss(Loss { chance: chance.min(0.9), ..loss })
    }

    fn send_again(&mut self, now: f64, report: &Report) -> Result<Vec<Vec<u8>>, ModemError> {
        let deadline = self.setting.latency - self.setting.propagation;
        let mut again = Vec::new();
        for k in self.settled(report) {
            let sent = &mut self.sent[k];
            let Some(told) = report.packet(sent.number).filter(|_| !sent.resent) else { continue };
            let short = match told.state {
                PacketState::Nothing => sent.first,
                PacketState::Part => sent.first.saturating_sub(told.shares.arrived()),
                PacketState::Whole | PacketState::Kept => continue,
            };
            let shares = sent.shares.iter().enumerate();
            let missing = shares.filter(|(k, _)| !told.shares.contains(*k));
            let needed: Vec<_> = missing.take(short).map(|(_, share)| share.clone()).collect();
            let bytes: usize = needed.iter().map(|share| share.len() + self.setting.overhead).sum();
            let seconds = bytes as f64 * 8.0 / self.setting.bit_rate;
            if needed.is_empty() || now + seconds > sent.exposed + deadline {
                continue;
            }
            self.sender.count(now, bytes)?;
            sent.bytes.resent += needed.iter().map(Vec::len).sum::<usize>();
            sent.resent = true;
            again.extend(needed);
        }
        Ok(again)
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
        least: setting.least,
        most_shares: setting.shares,
        loss: setting.assumed,
        user: None,
    };
    Sender::new(SenderOptions { control, stream: 0 })
}

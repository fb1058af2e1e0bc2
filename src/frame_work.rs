//! All that one frame takes on the host, from the camera's picture to the packet: one owner of its buffers.

use std::sync::Arc;
use std::time::Instant;

use crate::image::{Mask, psnr_of_mse};
use crate::packet::{Latent, RENDER_PART_LEN, RenderCheck, Residual, SESSION_PART_LEN, Session};
use crate::residual::{
    Acknowledged, InStream, Interest, ResidualEncoder, ResidualSetup, StreamFrame, Structure,
    Viewpoint,
};
use crate::tracking::StepTime;
use crate::truth::{Base, Compared, TruthEncoder};
use crate::{Encoded, Error, FrameInfo, FrameStats, Packet, Picture, Pose, Rate};

/// A frame on its way through the encoder. Buffers are kept from frame to frame.
///
/// A caller fills `frame` and `info`. The search fills all but `encoded`, and coding that.
#[derive(Default)]
pub struct FrameWork {
    /// The camera's picture; after the search as the prior's preprocessing left it, with the render where it is masked.
    pub frame: Picture,
    pub info: FrameInfo,
    /// Camera frames left out before it.
    pub left_out: u32,
    /// Which pixels count; `None`: all do.
    pub mask: Option<Arc<Mask>>,
    pub interest: Option<Arc<Interest>>,
    pub render: Picture,
    pub latent: Option<Latent>,
    /// What the packet is about.
    pub session: Option<Session>,
    /// The packet states it.
    pub states_session: bool,
    /// Whether the packet has a check of the render.
    pub has_render_check: bool,
    pub rate: Option<Rate>,
    /// See [`Encoder::set_steady_bytes`](crate::Encoder::set_steady_bytes).
    pub is_steady: bool,
    pub residual: Option<ResidualSetup>,
    /// A truth map is wanted.
    pub has_truth: bool,
    /// What it may be predicted from; `None`: it is coded by itself.
    pub stream: Option<TrackedStream>,
    /// Depths of the render; in streams only.
    pub depths: Vec<f32>,
    pub pose: Pose,
    /// Where the time of coding is noted; `None`: nowhere.
    pub coding: Option<StepTime>,
    /// As far as they are known.
    pub stats: FrameStats,
    pub encoded: Encoded,
}

/// What a frame of a stream may be predicted from.
#[derive(Clone, Copy)]
pub struct TrackedStream {
    pub viewpoint: Viewpoint,
    pub structure: Structure,
    pub acknowledged: Acknowledged,
    /// Frames before it are forgotten.
    pub first: bool,
}

impl FrameWork {
    /// Makes one that has room for every frame of a size.
    pub fn with_room(width: u32, height: u32) -> FrameWork {
        let picture = || Picture::new(width, height);
        let encoded = Encoded::with_room(width, height);
        FrameWork { frame: picture(), render: picture(), encoded, ..FrameWork::default() }
    }

    /// Codes the frame's difference picture. Writes the packet and the picture that the topside will show to `encoded`.
    pub fn code(&mut self, coders: &mut Coders) -> Result<(), Error> {
        let begun = self.coding.as_ref().map(StepTime::now);
        let mut encoded = std::mem::take(&mut self.encoded);
        let coded = self.code_into(coders, &mut encoded);
        self.encoded = encoded;
        if let (Some(coding), Some(begun)) = (&self.coding, begun) {
            coding.note(begun, 1);
        }
        coded
    }

    fn code_into(&mut self, coders: &mut Coders, encoded: &mut Encoded) -> Result<(), Error> {
        let since = Instant::now();
        coders.residual.set_interest(self.interest.as_ref());
        let latent = self.latent.ok_or(Error::NoStart { frame: self.stats.frame })?;
        let rate_kept = self.write_packet(latent, coders, encoded)?;
        encoded.pose = self.pose;
        std::mem::swap(&mut encoded.stats, &mut self.stats);
        let [render_psnr, psnr] =
            [&self.render, &encoded.picture].map(|picture| self.psnr(picture));
        let interest_psnr = self.interest_psnr(&encoded.picture);
        let stats = &mut encoded.stats;
        stats.bytes = encoded.packet.len();
        stats.latent_bytes = latent.encoded_len();
        (stats.render_psnr, stats.psnr) = (render_psnr, psnr);
        stats.interest_psnr = interest_psnr;
        stats.rate_kept = rate_kept;
        stats.code_milliseconds = since.elapsed().as_secs_f64() * 1e3;
        stats.milliseconds = stats.refine_milliseconds + stats.code_milliseconds;
        std::mem::swap(&mut encoded.render, &mut self.render);
        // The picture that was swapped in has room for the next frame, so that nothing is allocated.
        self.render.resize(self.frame.width, self.frame.height);
        self.stats.renders.clear();
        self.stats.renders.reserve(stats.renders.len());
        Ok(())
    }

    /// A picture's PSNR against what counts of the frame, dB.
    fn psnr(&self, picture: &Picture) -> f64 {
        match &self.mask {
            Some(mask) => psnr_of_mse(mask.mse(picture, &self.frame)),
            None => picture.psnr(&self.frame),
        }
    }

    /// A picture's PSNR over the pixels that count most, dB; `None`: all count the same.
    fn interest_psnr(&self, picture: &Picture) -> Option<f64> {
        let interest = self.interest.as_deref()?;
        let size = (picture.width, picture.height);
        let (mut error, mut values) = (0.0, 0);
        let pixels = picture.data.chunks_exact(3).zip(self.frame.data.chunks_exact(3));
        for (at, (shown, wanted)) in (0..).zip(pixels) {
            let (x, y) = (at % size.0, at / size.0);
            let counts = self.mask.as_ref().is_none_or(|mask| mask.data[at as usize]);
            if counts && interest.is_greatest(x, y, size) {
                let off = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
                error += shown.iter().zip(wanted).map(off).sum::<f64>();
                values += 3;
            }
        }
        (values > 0).then(|| psnr_of_mse(error / 65_025.0 / f64::from(values)))
    }

    /// Bytes that the packet takes beside those of a steady one.
    fn extra_bytes(&self) -> usize {
        /// The pose of a packet with a session part has the compact code, which is longer by so many bytes.
        const LONGER_LATENT: usize = 4;
        let session = if self.states_session { LONGER_LATENT + SESSION_PART_LEN } else { 0 };
        session + if self.has_render_check { RENDER_PART_LEN } else { 0 }
    }

    /// The rate as the coder knows it: it measures the PSNR over all pixels, of which those that are masked have no
    /// error to speak of.
    fn coders_rate(&self) -> Option<Rate> {
        match (self.rate, &self.mask) {
            (Some(Rate::Psnr(target)), Some(mask)) => {
                Some(Rate::Psnr(target + psnr_of_mse(mask.share())))
            }
            (rate, _) => rate,
        }
    }

    /// Returns whether the rate was kept.
    fn write_packet(
        &mut self,
        latent: Latent,
        coders: &mut Coders,
        encoded: &mut Encoded,
    ) -> Result<bool, Error> {
        let render = self.has_render_check.then(|| RenderCheck::of(&self.render));
        let session = self.session.filter(|_| self.states_session);
        let packet = Packet { latent, session, render, residual: Residual::None, truth: None };
        let Some(mut rate) = self.coders_rate() else {
            encoded.picture.clone_from(&self.render);
            packet.write(&mut encoded.packet)?;
            return Ok(true);
        };
        let needed = packet.encoded_len();
        if let (Rate::Bytes(bytes), true) = (&mut rate, self.is_steady) {
            *bytes = (*bytes + self.extra_bytes()).max(needed);
        }
        if let Rate::Bytes(budget) = rate
            && budget < needed
        {
            return Err(Error::Budget { budget, needed });
        }
        if self.stream.as_ref().is_none_or(|stream| stream.first) {
            coders.residual.forget();
        }
        let mut bytes = 0;
        if let Some(truth) = &mut coders.truth {
            if self.states_session {
                // The topside may lack what came before.
                truth.forget();
            }
            bytes = reserved(truth.needed(), rate);
        }
        let mut reserved = Reserved { bytes, is_last: false };
        loop {
            match self.write_with(packet, rate, reserved, coders, encoded)? {
                WriteOutcome::Done { reached } => return Ok(reached),
                WriteOutcome::TruthNeeds(bytes) => reserved = Reserved { bytes, is_last: true },
            }
        }
    }

    /// Codes the difference picture, and writes the packet. If the truth map needs more than what is reserved for it,
    /// nothing is written, unless that is the last word: it is then coarser.
    fn write_with(
        &mut self,
        packet: Packet,
        rate: Rate,
        reserved: Reserved,
        coders: &mut Coders,
        encoded: &mut Encoded,
    ) -> Result<WriteOutcome, Error> {
        let Coders { residual, truth } = coders;
        let (frame, render) = (&self.frame, &self.render);
        let others = packet.encoded_len() + reserved.bytes;
        let in_stream = self.stream.as_ref().map(|stream| InStream {
            frame: StreamFrame {
                frame: self.stats.frame,
                viewpoint: &stream.viewpoint,
                depths: &self.depths,
            },
            structure: stream.structure,
            acknowledged: &stream.acknowledged,
        });
        let coded = match &in_stream {
            Some(stream) => residual.encode_in_stream(frame, render, rate, others, stream)?,
            None => residual.encode(frame, render, rate, others)?,
        };
        let mut packet = Packet { residual: coded.residual, ..packet };
        let reached = coded.reached;
        encoded.picture.clone_from(coded.reconstruction);
        self.stats.truth_bytes = 0;
        if let Some(truth) = truth {
            let base = match packet.residual {
                Residual::None | Residual::Omitted => Base::Picture,
                Residual::Stream { reference: Some(_), .. } => Base::Unknown,
                _ => Base::Render(render),
            };
            let (picture, mask) = (&encoded.picture, self.mask.as_deref());
            let compared = Compared { frame, picture, base, mask };
            let limit = truth_limit(&packet, rate);
            let more = self::reserved(truth.compare(self.stats.frame, &compared), rate);
            if more > limit.max(reserved.bytes) && !reserved.is_last {
                return Ok(WriteOutcome::TruthNeeds(more));
            }
            let bare = packet.encoded_len();
            packet.truth = truth.encode(self.stats.frame, limit);
            self.stats.truth_bytes = packet.encoded_len() - bare;
        }
        packet.write(&mut encoded.packet)?;
        self.stats.reference = reference_of(&packet.residual, self.stats.frame);
        if let Some(stream) = in_stream {
            residual.keep(&stream.frame, &self.render);
        }
        Ok(WriteOutcome::Done { reached })
    }
}

/// Bytes of a budget that are kept for the truth map.
#[derive(Clone, Copy)]
struct Reserved {
    bytes: usize,
    /// They stay as they are.
    is_last: bool,
}

/// What came of writing a packet.
enum WriteOutcome {
    Done {
        reached: bool,
    },
    /// The truth map needs so many bytes of the budget.
    TruthNeeds(usize),
}

/// Most bytes of a truth map in a packet of so many: 8 %, but six, which a small packet needs for any map at all.
fn truth_share(packet: usize) -> usize {
    const PERCENT: usize = 8;
    const LEAST: usize = 6;
    (PERCENT * packet / 100).max(LEAST)
}

/// Bytes of a budget that are kept for a truth map that needs so many.
fn reserved(needed: usize, rate: Rate) -> usize {
    match rate {
        Rate::Bytes(budget) => needed.min(truth_share(budget)),
        Rate::Quality(_) | Rate::Psnr(_) => 0,
    }
}

/// Most bytes of a packet's truth map.
fn truth_limit(packet: &Packet, rate: Rate) -> usize {
    match rate {
        Rate::Bytes(budget) => packet.truth_room(budget).min(truth_share(budget)),
        Rate::Quality(_) | Rate::Psnr(_) => truth_share(packet.encoded_len()),
    }
}

fn reference_of(residual: &Residual, frame: u32) -> Option<u32> {
    match residual {
        Residual::Stream { reference: Some(reference), .. } => {
            Some(frame.wrapping_sub(reference.distance.into()))
        }
        _ => None,
    }
}

/// Codes what a packet holds beside the pose.
pub struct Coders {
    residual: ResidualEncoder,
    /// `None`: no truth maps are wanted.
    truth: Option<TruthEncoder>,
}

impl Coders {
    pub fn new(setup: &ResidualSetup, has_truth: bool) -> Coders {
        let truth = has_truth.then(|| TruthEncoder::new(setup.width, setup.height));
        Coders { residual: ResidualEncoder::new(setup), truth }
    }

    /// Forgets what difference pictures may be predicted from. Truth maps go on.
    pub fn begin_streams(&mut self, setup: &ResidualSetup) {
        self.residual = ResidualEncoder::new(setup);
    }
}

/// Codes frames. Keeps the coders for as long as frames ask for the same.
#[derive(Default)]
pub struct Coder(Option<(ResidualSetup, Coders)>);

impl Coder {
    /// Whether the frame needs other coders than the one before.
    pub fn changes(&self, work: &FrameWork) -> bool {
        let same = |(own, _): &(ResidualSetup, _)| {
            work.residual.as_ref().is_some_and(|setup| own.is_as(setup))
        };
        !self.0.as_ref().is_some_and(same)
    }

    /// See [`FrameWork::code`].
    pub fn code(&mut self, work: &mut FrameWork) -> Result<(), Error> {
        let setup = work.residual.take().ok_or(Error::NoStart { frame: work.stats.frame })?;
        let (_, coders) = match self.0.take() {
            Some(same) if same.0.is_as(&setup) => self.0.insert(same),
            _ => {
                let coders = Coders::new(&setup, work.has_truth);
                self.0.insert((setup, coders))
            }
        };
        work.code(coders)
    }
}

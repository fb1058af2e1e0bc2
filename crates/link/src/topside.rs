//! The topside's end: modem frames in, pictures out.

use std::sync::Arc;

use nvsprior::render::Scene;
use nvsprior::{Camera, Decoded, Decoder, Engine, Error, Picture, Pose};

use super::codec::LinkDecoder;
use super::error::LinkError;
use super::options::TopsideOptions;
use super::screen::{Done, Screen, Shown};
use super::topside_link::{TopsideLink, Worth};

/// The topside's end of a link: a decoder, and all that brings its packets.
///
/// Give it what the modem received; take pictures, reports and events: see [the rooms' page](super).
pub struct Topside<D = Decoder> {
    link: TopsideLink,
    screen: Screen,
    decoder: D,
    /// What is decoded.
    ahead: Decoded,
    decoded: Decoded,
    shown: Option<Shown>,
    refusal: Option<Error>,
}

/// What [`Topside::show`] shows of a camera frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recalled {
    /// What came of its own packet.
    Own,
    /// The prior at a pose between those of frames that came.
    Between,
    /// The picture before.
    Held,
    /// None has come.
    Nothing,
}

impl Topside {
    /// Makes it.
    ///
    /// # Errors
    /// As [`TopsideLink::new`].
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        options: &TopsideOptions,
    ) -> Result<Topside, LinkError> {
        Topside::with(Decoder::new(engine, scene), options)
    }
}

impl<D: LinkDecoder> Topside<D> {
    /// Makes it with a decoder of the caller's.
    ///
    /// # Errors
    /// As [`TopsideLink::new`].
    pub fn with(mut decoder: D, options: &TopsideOptions) -> Result<Topside<D>, LinkError> {
        let link = TopsideLink::new(options)?;
        if let Some(camera) = link.camera() {
            // If it cannot be, the vehicle is asked for it.
            let _ = decoder.add_camera(camera);
        }
        Ok(Topside {
            screen: Screen::new(options, &link),
            link,
            decoder,
            ahead: Decoded::default(),
            decoded: Decoded::default(),
            shown: None,
            refusal: None,
        })
    }

    /// Takes what the modem received: see [`TopsideLink::receive`].
    ///
    /// # Errors
    /// As there. That is no failure of the link.
    pub fn receive(
        &mut self,
        now: f64,
        bytes: &[u8],
    ) -> Result<(Worth, Option<(u32, bool)>), LinkError> {
        let (worth, grown) = self.link.receive(now, bytes)?;
        self.screen.note(self.link.last(), grown, &self.link);
        self.screen.hold(&self.link, &mut self.decoder);
        Ok((worth, grown))
    }

    /// Decodes what came, until there is another picture to show: the picture, and what is known of it. `None`: there
    /// is none now. Ask again until then.
    ///
    /// # Errors
    /// If the device fails, or the time is not finite. Packets that cannot be decoded are no failure:
    /// [`Topside::refusal`] tells.
    pub fn picture(&mut self, now: f64) -> Result<Option<(&Decoded, &Shown)>, LinkError> {
        let now = self.link.at(now)?;
        while let Some(work) = self.screen.next(now, &mut self.link, &self.decoder) {
            let outcome = work.perform(&self.link, &mut self.decoder, &mut self.ahead);
            let (link, decoder) = (&self.link, &self.decoder);
            match self.screen.done(now, work, outcome, &mut self.ahead, link, decoder) {
                Err(error @ Error::Vulkan(_)) => return Err(error.into()),
                Err(error) => self.refusal = Some(error),
                Ok(Done::Nothing) => self.refusal = None,
                Ok(Done::Picture(mut shown)) => {
                    self.refusal = None;
                    shown.time = self.link.told(shown.time);
                    self.link.set_camera(&shown.camera);
                    std::mem::swap(&mut self.decoded, &mut self.ahead);
                    let shown = self.shown.insert(shown);
                    return Ok(Some((&self.decoded, shown)));
                }
            }
        }
        Ok(None)
    }

    /// The picture that was shown last.
    pub fn shown(&self) -> Option<(&Decoded, &Shown)> {
        Some((&self.decoded, self.shown.as_ref()?))
    }

    /// Why packets that come are not shown; `None`: they are.
    pub fn refusal(&self) -> Option<&Error> {
        self.refusal.as_ref()
    }

    /// What there is of a camera frame by its number: with [`Playout::OnDemand`](super::Playout::OnDemand). A frame
    /// that did not come is drawn at a pose between those of frames that did and of which the vehicle is certain, at
    /// most `reach` frames before and after it. The picture stays as it is unless one was shown.
    ///
    /// # Errors
    /// If the device fails, or a packet cannot be decoded.
    pub fn show(&mut self, frame: u32, reach: u32) -> Result<(Recalled, &Picture), LinkError> {
        let recalled = self.recall(frame, reach)?;
        Ok((recalled, &self.decoded.picture))
    }

    fn recall(&mut self, frame: u32, reach: u32) -> Result<Recalled, Error> {
        let held =
            if self.decoded.picture.data.is_empty() { Recalled::Nothing } else { Recalled::Held };
        if self.screen.take_ready(frame, &mut self.decoded) {
            return Ok(Recalled::Own);
        }
        if let Some(packet) = self.link.packet(frame) {
            return match self.decoder.decode(packet.bytes, &mut self.decoded) {
                Err(error) if is_pose_not_held(&error) => Ok(held),
                decoded => decoded.map(|()| Recalled::Own),
            };
        }
        let Some(pose) = self.pose_between(frame, reach)? else { return Ok(held) };
        match self.decoder.draw(&pose, &mut self.decoded.picture)? {
            true => Ok(Recalled::Between),
            false => Ok(Recalled::Nothing),
        }
    }

    /// The pose of a frame that did not come, between those of frames that did.
    fn pose_between(&self, frame: u32, reach: u32) -> Result<Option<Pose>, Error> {
        let pose = |number: u32| -> Result<Option<(u32, Pose)>, Error> {
            let Some(packet) = self.link.packet(number) else { return Ok(None) };
            match self.decoder.pose_of(packet.bytes) {
                Err(error) if is_pose_not_held(&error) => Ok(None),
                told => told.map(|(pose, certain)| certain.then_some((number, pose))),
            }
        };
        let first = |numbers: &mut dyn Iterator<Item = u32>| -> Result<Option<(u32, Pose)>, Error> {
            for number in numbers {
                if let Some(found) = pose(number)? {
                    return Ok(Some(found));
                }
            }
            Ok(None)
        };
        let before = first(&mut (1..=reach).map_while(|back| frame.checked_sub(back)))?;
        let after = first(&mut (1..=reach).map(|ahead| frame + ahead))?;
        let (Some((from, start)), Some((to, end))) = (before, after) else { return Ok(None) };
        let part = f64::from(frame - from) / f64::from(to - from);
        Ok(Some(start.between(&end, part)))
    }

    /// The report that is due now, for the return channel; `None`: none is.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn report(&mut self, now: f64) -> Result<Option<&[u8]>, LinkError> {
        let (screen, decoder) = (&self.screen, &self.decoder);
        let holds = |frame| decoder.holds_pose(frame);
        self.link.report(now, |frame| screen.kept(frame), Some(holds), screen.lacks_start())
    }

    /// The decoder: its cameras, its filter.
    pub fn decoder(&mut self) -> &mut D {
        &mut self.decoder
    }

    /// The vehicle's camera, if it is known.
    pub fn camera(&self) -> Option<&Camera> {
        self.decoder.camera().or(self.link.camera())
    }

    /// The end without its decoder: what is due next, region, user bytes, events, state, statistics. What the modem
    /// received goes to [`Topside::receive`].
    pub fn link(&mut self) -> &mut TopsideLink {
        &mut self.link
    }
}

fn is_pose_not_held(error: &Error) -> bool {
    matches!(error, Error::Packet(nvsprior::packet::PacketError::PoseNotHeld { .. }))
}

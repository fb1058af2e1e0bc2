//! The topside's end of the link, as the console sees it.

use std::sync::Arc;

use nvsprior::render::Scene;
use nvsprior::{Camera, Decoded, Engine, Error};
use nvsprior_link::{
    ClockSource, LinkError, Playout, Region, Topside, TopsideEvent, TopsideLink, TopsideOptions,
    Worth,
};

use super::missing::Refusal;
use crate::state_file::StateFile;

/// Modem frames of a packet that there is room for.
const SHARES: usize = 256;
/// Most pixels of a picture.
const PIXELS: u32 = 1 << 22;

/// The picture that is shown.
pub struct Shown<'a> {
    pub decoded: &'a Decoded,
    pub camera: Camera,
    /// Counts pictures.
    pub number: u64,
    /// When the modem frame came after which it was decoded, UTC.
    pub arrived: f64,
    /// When its frame was exposed, UTC; without a clock when its packet began to come.
    pub exposed: f64,
    pub clock: Option<ClockSource>,
    pub is_clock_off: bool,
    /// From which age on it is old, seconds.
    pub old: f64,
    /// Modem frames of its packet that came, and that were sent.
    pub shares: (usize, Option<usize>),
    /// Bytes of its packet that came.
    pub bytes: usize,
    pub complete: bool,
}

pub struct Pictures {
    topside: Topside,
    /// Pictures so far.
    count: u64,
    newest_time: f64,
    /// Where the state is stored; `None`: there are no keys.
    state: Option<StateFile>,
}

impl Pictures {
    /// `filter`: pictures go through the display filter.
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        link: TopsideOptions,
        filter: bool,
        state: Option<StateFile>,
    ) -> anyhow::Result<Pictures> {
        let mut topside = Topside::new(engine, scene, &link)?;
        topside.decoder().set_pixel_limit(PIXELS);
        topside.decoder().set_filter(filter)?;
        Ok(Pictures { topside, count: 0, newest_time: 0.0, state })
    }

    /// How a console's end is set up.
    pub fn options(mtu: usize) -> TopsideOptions {
        let (playout, max_shares, is_utc) = (Playout::Newest, Some(SHARES), true);
        TopsideOptions { playout, max_shares, is_utc, ..TopsideOptions::new(mtu) }
    }

    pub fn shown(&self) -> Option<Shown<'_>> {
        let (decoded, shown) = self.topside.shown()?;
        Some(Shown {
            decoded,
            camera: shown.camera,
            number: self.count,
            arrived: shown.time,
            exposed: shown.time - shown.age,
            clock: shown.clock,
            is_clock_off: shown.is_clock_off,
            old: shown.old,
            shares: shown.shares,
            bytes: shown.bytes,
            complete: shown.complete,
        })
    }

    /// Why packets that come are not shown.
    pub fn refusal(&self) -> Option<Refusal> {
        self.topside.refusal().map(Refusal::from)
    }

    /// The vehicle's camera, if it is known.
    pub fn camera(&self) -> Option<&Camera> {
        self.topside.camera()
    }

    /// The vehicle's camera, as it was before a restart.
    pub fn add_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        self.topside.decoder().add_camera(camera)
    }

    /// The end without its decoder.
    pub fn link(&mut self) -> &mut TopsideLink {
        self.topside.link()
    }

    /// Takes a modem frame that came at a time, UTC. `None`: it is none, or of no use.
    pub fn take(&mut self, time: f64, bytes: &[u8]) -> Option<Worth> {
        self.newest_time = self.newest_time.max(time);
        self.topside.receive(self.newest_time, bytes).ok().map(|(worth, _)| worth)
    }

    /// Decodes what has come. `true`: there is another picture to show.
    ///
    /// # Errors
    /// If the device fails.
    pub fn decode(&mut self) -> Result<bool, LinkError> {
        let before = self.count;
        while self.topside.picture(self.newest_time)?.is_some() {
            self.count += 1;
        }
        Ok(self.count > before)
    }

    /// What the vehicle is told, as a modem frame; `None`: nothing is to be told now.
    pub fn report(&mut self, now: f64) -> Option<&[u8]> {
        self.topside.report(now).ok()?
    }

    /// What the pilot looks at.
    pub fn set_region(&mut self, region: Option<Region>) {
        self.topside.link().set_region(region);
    }

    /// Stores what a topside with keys needs to start again.
    ///
    /// # Errors
    /// Once, if it cannot be written.
    pub fn store(&mut self) -> anyhow::Result<()> {
        let mut is_due = false;
        while let Some(event) = self.topside.link().event() {
            is_due |= event == TopsideEvent::Store;
        }
        let Some(file) = self.state.as_mut().filter(|_| is_due) else { return Ok(()) };
        let mut state = Vec::new();
        self.topside.link().state(&mut state);
        let written = file.write(&state);
        if written.is_err() {
            self.state = None;
        }
        Ok(written?)
    }
}

#[cfg(test)]
pub(super) mod tests;

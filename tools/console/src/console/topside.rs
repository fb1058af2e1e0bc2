//! The topside: modem frames to pictures, reports to the vehicle, and what the page is told.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::Context;
use nvsprior::{Engine, Prior};
use nvsprior_link::{Region, TopsideOptions as LinkOptions, VERY_OLD, Worth};
use nvsprior_runs::png_of;
use tokio::sync::watch;

use super::clock::Clock;
use super::disk;
use super::event::{Arrived, Asked, Command, Event};
use super::input::ReturnPath;
use super::keeper::Keeper;
use super::link_log::LinkLog;
use super::missing::{Missing, PriorState, ThisSide, Watch};
use super::overlay::MemoryView;
use super::pictures::{Pictures, Shown};
use super::resume::{Resume, ResumeState};
use super::scene_views::SceneViews;
use super::state::{Alarm, LinkState, PictureState, PoseState, State, clock_name};
use super::video::Video;
use crate::journal::{Journal, utc};
use crate::state_file::StateFile;

pub struct TopsideOptions {
    /// Name of the prior's file.
    pub prior_file: String,
    /// How the link's end is set up: [`Pictures::options`].
    pub link: LinkOptions,
    pub source: String,
    pub clock: Clock,
    pub return_path: ReturnPath,
    pub keeper: Keeper,
    /// `None`: this is no dive that goes on.
    pub resume: Option<Resume>,
    pub journal: Journal,
    pub video: Option<Video>,
    /// Pictures go through the display filter.
    pub filter: bool,
    /// Which key this side has, for the pilot.
    pub key: Option<String>,
    /// Keeps which modem frames came, with keys.
    pub state: Option<StateFile>,
}

/// What the page gets.
#[derive(Clone)]
pub struct Published {
    /// [`State`] as JSON.
    pub state: Arc<str>,
    /// PNG; none before the first picture.
    pub picture: Arc<[u8]>,
    pub chase: Arc<[u8]>,
    /// Each page that is open holds a receiver.
    pub pages: watch::Sender<()>,
}

impl Published {
    fn none() -> Published {
        let none: Arc<[u8]> = Arc::new([]);
        Published {
            state: "{}".into(),
            picture: none.clone(),
            chase: none,
            pages: watch::Sender::new(()),
        }
    }
}

/// Seconds of not being certain after which the vehicle is called lost.
const SEARCHING: f64 = 3.0;
/// The newest so many are kept.
const ALARMS: usize = 8;
/// The page is told at least so often.
const TICK: Duration = Duration::from_millis(250);
/// Events that are dealt with before the page is told.
const AT_ONCE: usize = 256;

/// All of the console's state.
pub struct Topside {
    /// See [`State::run`].
    run: String,
    side: ThisSide,
    options: TopsideOptions,
    pictures: Pictures,
    has_keys: bool,
    views: SceneViews,
    memory: MemoryView,
    log: LinkLog,
    /// Who sent the last modem frame that checks vouch for, and when it came.
    peer: Option<SocketAddr>,
    last_proven: Option<f64>,
    watch: Watch,
    /// The cause that was told last.
    missing: Option<&'static str>,
    stopped: Option<String>,
    counts: Counts,
    uncertain_since: Option<f64>,
    region: Option<Region>,
    note: Option<String>,
    note_page: Option<String>,
    alarms: Vec<Alarm>,
    portable: bool,
    publisher: watch::Sender<Published>,
    published: Published,
}

#[derive(Default)]
struct Counts {
    bytes: u64,
    frames: u64,
    garbage: u64,
    reports: u64,
}

impl Topside {
    pub fn new(
        engine: &Engine,
        prior: &Prior,
        mut options: TopsideOptions,
    ) -> anyhow::Result<(Topside, watch::Receiver<Published>)> {
        let scene = engine.upload(prior).context("uploading the prior")?;
        let views = SceneViews::new(engine, prior, &scene)?;
        let (publisher, receiver) = watch::channel(Published::none());
        let identity = scene.id().to_string();
        let mut topside = Topside {
            run: format!("{:x}", utc().to_bits()),
            side: ThisSide {
                prior: PriorState { file: options.prior_file.clone(), identity },
                key: options.key.clone(),
                has_return_path: options.return_path.is_some(),
            },
            has_keys: options.link.keys.is_some(),
            pictures: Pictures::new(
                engine,
                &scene,
                options.link.clone(),
                options.filter,
                options.state.take(),
            )?,
            views,
            memory: MemoryView::new(engine, prior)?,
            log: LinkLog::default(),
            peer: None,
            last_proven: None,
            watch: Watch::new(options.clock.now()),
            missing: None,
            stopped: None,
            counts: Counts::default(),
            uncertain_since: None,
            region: None,
            note: None,
            note_page: None,
            alarms: Vec::new(),
            portable: engine.device().portable,
            publisher,
            published: Published::none(),
            options,
        };
        topside.begin();
        topside.publish()?;
        Ok((topside, receiver))
    }

    /// Takes over from a console that ended in this dive.
    fn begin(&mut self) {
        let PriorState { file, identity } = &self.side.prior;
        let start = format!("{}, with {file} ({identity})", self.options.source);
        let now = self.now();
        self.options.journal.note(now, "start", &start);
        let resume = self.options.resume.as_ref();
        let kept = resume.and_then(|resume| resume.read(now, identity, self.side.key.as_deref()));
        let Some(ResumeState { camera, region, is_recording, .. }) = kept else { return };
        if let Some(camera) = &camera {
            // If it cannot be, the vehicle is asked for it.
            let _ = self.pictures.add_camera(camera);
        }
        self.region = region;
        let mut text = "the console was started again and goes on".to_owned();
        if region.is_some() {
            text += ", with the region of interest";
        }
        if is_recording {
            // Between the two files something is missing, and the pilot is to know.
            let done = self.obey(Command::Record(true));
            let done = done.unwrap_or_else(|error| format!("the recording has ended: {error}"));
            self.alarm("recording", format!("the console was started again: {done}"));
        }
        self.tell("restart", text);
    }

    /// Tells what failed; it stays on the page until it is seen.
    fn alarm(&mut self, event: &str, text: String) {
        let now = self.now();
        self.options.journal.tell(now, event, &text);
        self.alarms.push(Alarm { time: now, text });
        let spare = self.alarms.len().saturating_sub(ALARMS);
        self.alarms.drain(..spare);
    }

    /// Tells the pilot, the terminal and the log what happens now.
    fn tell(&mut self, event: &str, text: String) {
        let now = self.now();
        self.options.journal.tell(now, event, &text);
        self.note = Some(text);
    }

    pub fn source(&self) -> &str {
        &self.options.source
    }

    /// The plan view, as PNG.
    pub fn plan_picture(&self) -> Arc<[u8]> {
        self.views.plan_picture()
    }

    /// Works until it fails.
    pub fn run(mut self, events: &Receiver<Event>) -> anyhow::Result<()> {
        // It goes on from event to event: a flood of frames of no use must not keep the page from being told.
        let mut deadline = Instant::now() + TICK;
        loop {
            match events.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => anyhow::bail!("input and page have ended"),
            }
            for event in events.try_iter().take(AT_ONCE) {
                self.take(event);
            }
            let is_due = Instant::now() >= deadline;
            if is_due {
                deadline = Instant::now() + TICK;
            }
            self.show(is_due)?;
        }
    }

    /// Decodes what came and shows it, and tells the vehicle. `is_due`: the page is told even if nothing is new.
    fn show(&mut self, is_due: bool) -> anyhow::Result<()> {
        self.keep_numbers();
        if is_due {
            self.keep_for_restart();
        }
        let is_new = self.pictures.decode()?;
        if is_new {
            self.take_picture()?;
        }
        self.report();
        if is_new || is_due || self.note.is_some() {
            self.publish()?;
        }
        Ok(())
    }

    /// Keeps what a topside with keys needs to start again. If it cannot be written, the pilot is told, once.
    fn keep_numbers(&mut self) {
        if let Err(error) = self.pictures.store() {
            let text = format!("before a start again, give both sides the next --epoch: {error}");
            self.alarm("disk", text);
        }
    }

    fn set_region(&mut self, region: Option<Region>) {
        self.region = region;
        self.pictures.set_region(region);
    }

    /// Keeps what another run of the console goes on with.
    fn keep_for_restart(&mut self) {
        let (resume, heard) = (self.options.resume.as_mut(), self.last_proven);
        let Some((resume, time)) = resume.zip(heard) else { return };
        let kept = ResumeState {
            time,
            prior: self.side.prior.identity.clone(),
            key: self.side.key.clone(),
            camera: self.pictures.camera().copied(),
            region: self.region,
            is_recording: self.options.keeper.recorded(time).is_some(),
        };
        if let Err(error) = resume.keep(kept) {
            self.alarm("disk", format!("{error:#}"));
        }
    }

    fn now(&self) -> f64 {
        self.options.clock.now()
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Arrived(arrived) => self.take_frame(&arrived),
            Event::Stopped(why) => {
                self.options.journal.tell(self.options.clock.now(), "source", &why);
                self.stopped = Some(why);
            }
            Event::Resumed => {
                self.options.journal.tell(self.options.clock.now(), "source", "it is there again");
                self.stopped = None;
            }
            Event::Command(Asked { page, command }) => {
                let event = match command {
                    Command::Region(_) => "region",
                    Command::Record(_) => "recording",
                    Command::Snapshot => "snapshot",
                };
                self.note_page = page;
                match self.obey(command) {
                    Ok(note) => self.tell(event, note),
                    Err(error) => self.alarm(event, format!("failed: {error}")),
                }
                // What the pilot wants is not to wait for the next look.
                self.keep_for_restart();
            }
        }
    }

    fn take_frame(&mut self, arrived: &Arrived) {
        let Arrived { time, bytes, from } = arrived;
        let worth = self.pictures.take(*time, bytes);
        self.counts.bytes += bytes.len() as u64;
        self.counts.frames += 1;
        self.log.came(*time, bytes.len());
        if let Err(error) = self.options.keeper.keep(*time, bytes) {
            self.alarm("disk", format!("the recording has ended: {error}"));
        }
        let is_proven = match worth {
            None => Some(false),
            Some(Worth::Unproven) => None,
            Some(Worth::Proven) => Some(true),
        };
        self.watch.came(*time, is_proven);
        self.counts.garbage += u64::from(worth.is_none());
        if worth == Some(Worth::Proven) {
            if self.last_proven.is_none() {
                self.options.journal.tell(*time, "vehicle", "the vehicle is heard");
            }
            (self.peer, self.last_proven) = (*from, Some(*time));
        }
    }

    /// Does what the pilot wants; tells what it came to.
    fn obey(&mut self, command: Command) -> std::io::Result<String> {
        let now = self.now();
        match command {
            Command::Region(region) => {
                self.set_region(region);
                Ok(match (region, self.options.return_path.is_some()) {
                    (_, false) => "no return channel: the vehicle does not hear of it".into(),
                    (Some(_), true) => "region of interest sent".into(),
                    (None, true) => "region of interest ended".into(),
                })
            }
            Command::Record(on) => {
                let path = self.options.keeper.record(now, on)?;
                let what = if on { "recording to" } else { "recorded:" };
                Ok(path.map_or("nothing was recorded".into(), |path| {
                    format!("{what} {}", path.display())
                }))
            }
            Command::Snapshot => {
                let Published { state, picture, .. } = &self.published;
                if picture.is_empty() {
                    return Ok("no picture has come yet".into());
                }
                let path = self.options.keeper.snapshot(now, picture, state)?;
                Ok(format!("snapshot: {}", path.display()))
            }
        }
    }

    /// Takes the picture that was decoded last.
    fn take_picture(&mut self) -> anyhow::Result<()> {
        let Some(shown) = self.pictures.shown() else { return Ok(()) };
        let now = self.options.clock.now();
        self.log.shown(now);
        self.watch.shown(now, shown.old * VERY_OLD);
        match shown.decoded.uncertain {
            true => _ = self.uncertain_since.get_or_insert(now),
            false => self.uncertain_since = None,
        }
        self.views.take(&shown);
        self.memory.take(&shown)?;
        self.published.picture = png_of(&shown.decoded.picture)?.into();
        if let Some(chase) = self.views.draw_chase(&shown)? {
            self.published.chase = png_of(chase)?.into();
        }
        Ok(())
    }

    /// Tells the vehicle what came, and what the pilot wants.
    fn report(&mut self) {
        let now = self.now();
        if !self.options.return_path.is_some() {
            return;
        }
        let Some(report) = self.pictures.report(now) else { return };
        self.options.return_path.send(report, self.peer);
        self.counts.reports += 1;
    }

    fn publish(&mut self) -> anyhow::Result<()> {
        let now = self.now();
        self.log.count(now, self.pictures.link().statistics());
        if let Err(error) = self.options.keeper.flush() {
            self.alarm("disk", format!("the recording has ended: {error}"));
        }
        let missing = self.missing(now);
        let state = self.state(now, missing);
        if let Some((video, shown)) = self.options.video.as_ref().zip(self.pictures.shown()) {
            video.show(&shown, state.overlay.clone(), state.pose);
        }
        self.published.state = serde_json::to_string(&state)?.into();
        self.publisher.send_replace(self.published.clone());
        (self.note, self.note_page) = (None, None);
        Ok(())
    }

    /// What is missing for a picture. Terminal and log are told if it is another than before.
    fn missing(&mut self, now: f64) -> Option<Missing> {
        let refusal = self.pictures.refusal();
        let missing = self.watch.missing(now, refusal.as_ref(), &self.side);
        // Why nothing comes is known then.
        let missing = missing.filter(|_| self.stopped.is_none());
        let cause = missing.as_ref().map(|missing| missing.cause);
        if cause != std::mem::replace(&mut self.missing, cause) {
            let text = missing.as_ref().map(|missing| {
                let Missing { what, seconds, advice, .. } = missing;
                format!("{what}, for {seconds:.0} s. {advice}")
            });
            let text = text.unwrap_or("pictures come again".into());
            self.options.journal.tell(now, cause.unwrap_or("pictures"), &text);
        }
        missing
    }

    fn state(&mut self, now: f64, missing: Option<Missing>) -> State {
        let link = self.link_state(now);
        let shown = self.pictures.shown();
        let shown = shown.as_ref();
        let uncertain_for = self.uncertain_since.map_or(0.0, |since| now - since);
        let views = self.views.state(now, shown);
        let keeper = &self.options.keeper;
        let (recorded, free) = (keeper.recorded(now), keeper.free());
        let mut warnings = self.warnings(shown);
        warnings.extend(free.and_then(|free| disk::warning(free, recorded.as_ref())));
        State {
            run: self.run.clone(),
            prior: self.side.prior.clone(),
            now,
            speed: self.options.clock.speed(),
            pages: self.published.pages.receiver_count(),
            source: self.options.source.clone(),
            stopped: self.stopped.clone(),
            picture: shown.map(|shown| picture_state(shown, now)),
            pose: match (shown.is_some(), self.uncertain_since) {
                (false, _) => PoseState::Waiting,
                (true, None) => PoseState::Certain,
                (true, Some(_)) if uncertain_for < SEARCHING => PoseState::Searching,
                (true, Some(_)) => PoseState::Lost,
            },
            uncertain_for,
            link,
            plan: views.plan,
            chase: views.chase,
            path: views.path,
            region: self.region.map(|region| region.edges.map(|edge| f64::from(edge) / 255.0)),
            free,
            recorded,
            missing,
            note: self.note.clone(),
            note_page: self.note_page.clone(),
            warnings,
            alarms: self.alarms.clone(),
            overlay: shown.map(|_| self.memory.overlay(now)),
        }
    }

    fn link_state(&mut self, now: f64) -> LinkState {
        let statistics = self.pictures.link().statistics();
        LinkState {
            silence: self.last_proven.map(|last| (now - last).max(0.0)),
            bit_rate: self.log.bit_rate(),
            pictures_per_second: self.log.picture_rate(),
            loss: self.log.loss(),
            bytes: self.counts.bytes,
            frames: self.counts.frames,
            garbage: self.counts.garbage,
            foreign: self.has_keys.then_some(statistics.foreign),
            replayed: self.has_keys.then_some(statistics.replayed),
            packets: statistics.completed,
            reports: self.options.return_path.is_some().then_some(self.counts.reports),
            seconds: self.log.seconds().map(|second| (second.bytes, second.loss())).collect(),
        }
    }

    /// Why what is shown may not be what the vehicle saw.
    fn warnings(&self, shown: Option<&Shown>) -> Vec<String> {
        let mut warnings = Vec::new();
        if !self.portable {
            warnings.push(
                "This device is not portable: its picture may differ from the vehicle's.".into(),
            );
        }
        if let Some(decoded) = shown.map(|shown| shown.decoded) {
            if decoded.same_render == Some(false) {
                warnings.push("The render is not the vehicle's: do not trust this picture.".into());
            } else if self.portable && !decoded.portable {
                warnings
                    .push("The vehicle's device is not portable: the picture may differ.".into());
            }
            if let Some(damage) = &decoded.damage {
                warnings.push(format!("Not all of the picture came: {damage}"));
            }
        }
        warnings.extend(self.options.video.as_ref().and_then(Video::trouble));
        warnings
    }
}

fn picture_state(shown: &Shown, now: f64) -> PictureState {
    let picture = &shown.decoded.picture;
    PictureState {
        number: shown.number,
        frame: shown.decoded.frame,
        width: picture.width,
        height: picture.height,
        age: (now - shown.exposed).max(0.0),
        limits: [shown.old, shown.old * VERY_OLD],
        clock: shown.clock.map(clock_name),
        is_clock_off: shown.is_clock_off,
        arrived: shown.arrived,
        shares: [Some(shown.shares.0), shown.shares.1],
        bytes: shown.bytes,
        complete: shown.complete,
        has_residual: shown.decoded.rows > 0,
        filtered: shown.decoded.filtered,
        known: shown.decoded.known.map(|known| [known.position, known.rotation.to_degrees()]),
    }
}

#[cfg(test)]
mod soak;

//! Vehicle, channel and topside in time.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::path::Path;
use std::sync::Arc;

use nvsprior::Engine;
use nvsprior::render::Scene;
use nvsprior::tracking::FrameInfo;
use nvsprior_link::vehicle::{CameraFrame, SentPacket, Vehicle};

use super::Setting;
use super::channel::LoggedChannel;
use super::footage::Footage;
use super::report::{LinkRun, Moment};
use super::topside::Topside;

/// What happens at a time.
enum Event {
    Exposed(usize),
    /// A share may be due.
    Due,
    Arrived(Vec<u8>),
    Report,
    Reported(Vec<u8>),
    Displayed(usize),
}

struct At {
    time: f64,
    /// In the order in which they were planned, if times are equal.
    order: usize,
    event: Event,
}

impl Ord for At {
    /// The earliest is the greatest.
    fn cmp(&self, other: &At) -> Ordering {
        other.time.total_cmp(&self.time).then(other.order.cmp(&self.order))
    }
}

impl PartialOrd for At {
    fn partial_cmp(&self, other: &At) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for At {
    fn eq(&self, other: &At) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for At {}

#[derive(Default)]
struct Agenda {
    heap: BinaryHeap<At>,
    planned: usize,
}

impl Agenda {
    fn add(&mut self, time: f64, event: Event) {
        self.heap.push(At { time, order: self.planned, event });
        self.planned += 1;
    }
}

pub struct Simulation<'a> {
    footage: &'a Footage,
    setting: Setting,
    vehicle: Vehicle,
    packets: Vec<SentPacket>,
    topside: Topside,
    plan: Agenda,
    /// When the next modem frame is looked for, seconds.
    next_due: f64,
    /// When the run ends, seconds: a vehicle without reports never has nothing to send.
    end: f64,
    moments: Vec<Moment>,
    /// Folder for what the pilot sees.
    pub frames_out: Option<&'a Path>,
}

impl<'a> Simulation<'a> {
    pub fn new(
        engine: &Engine,
        scene: &Arc<Scene>,
        footage: &'a Footage,
        setting: Setting,
        threshold: f64,
    ) -> anyhow::Result<Simulation<'a>> {
        let camera = footage.camera(0);
        Ok(Simulation {
            footage,
            vehicle: Vehicle::new(
                engine,
                scene,
                camera,
                &setting.vehicle(threshold),
                setting.keys.as_ref(),
            )?,
            packets: Vec::new(),
            topside: Topside::new(engine, scene, footage.cameras(), &setting)?,
            setting,
            plan: Agenda::default(),
            next_due: f64::INFINITY,
            end: 0.0,
            moments: Vec::new(),
            frames_out: None,
        })
    }

    /// Runs so many camera frames. `done` is called after each one is shown.
    pub fn run(mut self, frames: usize, mut done: impl FnMut()) -> anyhow::Result<LinkRun> {
        let seconds = frames as f64 / self.setting.fps;
        self.end = seconds + self.setting.latency;
        let mut channel = LoggedChannel::new(&self.setting, seconds);
        for frame in 0..frames {
            let exposed = frame as f64 / self.setting.fps;
            self.plan.add(exposed, Event::Exposed(frame));
            self.plan.add(exposed + self.setting.latency, Event::Displayed(frame));
        }
        if self.setting.return_delay.is_some() {
            let every = self.setting.report_every;
            let mut time = every;
            while time < seconds {
                self.plan.add(time, Event::Report);
                time += every;
            }
        }
        while let Some(At { time, event, .. }) = self.plan.heap.pop() {
            match event {
                Event::Exposed(frame) => self.expose(frame, time)?,
                Event::Due if time == self.next_due => {
                    self.next_due = f64::INFINITY;
                    while let Some((_, share)) = self.vehicle.next_share(time) {
                        send(&mut self.plan, &mut channel, time, share);
                    }
                    self.plan_due(time);
                }
                // Something was due before it, and has planned anew.
                Event::Due => {}
                Event::Arrived(share) => self.topside.take(time, &share)?,
                Event::Report => self.report(time, &mut channel)?,
                Event::Reported(report) => {
                    let (report, _) = self.vehicle.read_report(&report)?;
                    self.vehicle.process_report(time, &report)?;
                    self.plan_due(time);
                }
                Event::Displayed(frame) => {
                    self.display(frame)?;
                    done();
                }
            }
        }
        let worst_second = channel.worst_second();
        let repaired = self.topside.repaired();
        Ok(LinkRun {
            setting: self.setting,
            seconds,
            region_part: self.footage.region_part(),
            moments: self.moments,
            resent: self.vehicle.resent,
            packets: self.packets,
            pictures: self.topside.pictures,
            repaired,
            worst_second,
            beside: Vec::new(),
        })
    }

    fn expose(&mut self, frame: usize, now: f64) -> anyhow::Result<()> {
        let hint = if frame == 0 { self.footage.first.hint } else { None };
        let info = FrameInfo { hint, time: Some(now) };
        let (camera, picture) = (self.footage.camera(frame), self.footage.picture(frame));
        if self.vehicle.encoder().camera() != camera {
            self.vehicle.encoder().set_camera(camera)?;
        }
        let taken = CameraFrame { number: frame, exposed: now, picture, info, user: None };
        let ready = now + self.setting.coding;
        if let Some(packet) = self.vehicle.take(&taken, || ready)? {
            self.packets.push(packet);
        }
        self.plan_due(now);
        Ok(())
    }

    /// Looks for the next modem frame when it is due.
    fn plan_due(&mut self, now: f64) {
        let due = self.vehicle.due().map(|due| due.max(now));
        if let Some(due) = due.filter(|due| *due < self.next_due && *due <= self.end) {
            self.next_due = due;
            self.plan.add(due, Event::Due);
        }
    }

    fn report(&mut self, now: f64, channel: &mut LoggedChannel) -> anyhow::Result<()> {
        let Some(report) = self.topside.report()? else { return Ok(()) };
        if self.setting.half_duplex {
            channel.occupy(now, report.len());
        }
        let delay = self.setting.return_delay.unwrap_or(0.0);
        self.plan.add(now + delay, Event::Reported(report));
        Ok(())
    }

    /// What the pilot sees of a camera frame.
    fn display(&mut self, frame: usize) -> anyhow::Result<()> {
        let (shown, picture) = self.topside.show(frame as u32)?;
        if let Some(folder) = self.frames_out {
            nvsprior_runs::write_png(&folder.join(format!("{frame:04}.png")), picture)?;
        }
        let wanted = self.footage.as_large_as(frame, picture)?;
        let region = self.footage.region(frame).map(|region| region.psnr(picture, wanted));
        self.moments.push(Moment { frame, shown, psnr: picture.psnr(wanted), region });
        Ok(())
    }
}

fn send(plan: &mut Agenda, channel: &mut LoggedChannel, now: f64, share: &[u8]) {
    if let Some(arrival) = channel.send(now, share.len()).arrival {
        plan.add(arrival, Event::Arrived(share.to_vec()));
    }
}

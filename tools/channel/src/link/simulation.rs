//! Vehicle, channel and topside in time.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};
use std::sync::Arc;

use nvsprior::render::Scene;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Engine, Picture};
use nvsprior_link::keys::Keys;
use nvsprior_link::modem::Division;
use nvsprior_link::{CameraFrame, Recalled, Topside, Vehicle};
use nvsprior_runs::FrameFolder;

use super::channel::LoggedChannel;
use super::footage::Footage;
use super::report::{LinkRun, Moment};
use super::sent::{PacketBytes, SentPacket};
use super::setting::{PACKETS, Setting};

/// What happens at a time.
enum Event {
    Exposed(usize),
    /// A share may be due.
    Due,
    /// The link, which others use too, is free for a modem frame.
    Slot,
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
    /// By packet: when its first picture could be shown, and when all of it, seconds.
    pictures: BTreeMap<u32, (f64, Option<f64>)>,
    plan: Agenda,
    /// When the next modem frame is looked for, seconds.
    next_due: f64,
    /// Modem frames that are the vehicle's turn, if it shares the link.
    turns: f64,
    /// When the run ends, seconds: a vehicle without reports never has nothing to send.
    end: f64,
    moments: Vec<Moment>,
    /// Folder for what the pilot sees.
    pub frames_out: Option<&'a mut FrameFolder>,
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
                setting.encoder(threshold),
                &setting.vehicle(),
            )?,
            packets: Vec::new(),
            topside: {
                let mut topside = Topside::new(engine, scene, &setting.topside())?;
                for camera in footage.cameras() {
                    topside.decoder().add_camera(camera)?;
                }
                topside
            },
            pictures: BTreeMap::new(),
            setting,
            plan: Agenda::default(),
            next_due: f64::INFINITY,
            turns: 0.0,
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
        if self.setting.pull.is_some() {
            self.plan.add(0.0, Event::Slot);
        }
        while let Some(At { time, event, .. }) = self.plan.heap.pop() {
            match event {
                Event::Exposed(frame) => self.expose(frame, time)?,
                Event::Due if time == self.next_due => {
                    self.next_due = f64::INFINITY;
                    let link = self.vehicle.link();
                    while let Some(frame) = link.transmit(time, self.setting.mtu)? {
                        send(&mut self.plan, &mut channel, time, frame);
                    }
                    self.plan_due(time);
                }
                // Something was due before it, and has planned anew.
                Event::Due => {}
                Event::Slot => self.take_slot(time, &mut channel)?,
                Event::Arrived(frame) => self.arrive(time, &frame)?,
                Event::Report => self.report(time, &mut channel)?,
                Event::Reported(report) => {
                    self.vehicle.link().receive(time, &report)?;
                    self.plan_due(time);
                }
                Event::Displayed(frame) => {
                    self.display(frame)?;
                    done();
                }
            }
        }
        let worst_second = channel.worst_second();
        let repaired = self.repaired();
        Ok(LinkRun {
            setting: self.setting,
            seconds,
            region_part: self.footage.region_part(),
            moments: self.moments,
            resent: self.vehicle.link().resent_bytes() as usize,
            packets: self.packets,
            pictures: self.pictures,
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
        let taken = CameraFrame { exposed: now, picture, info, user: &[] };
        let ready = now + self.setting.coding;
        if let Some(division) = self.vehicle.frame(now, &taken, || ready)? {
            let sent = self.sent(frame, now, &division)?;
            self.packets.push(sent);
        }
        self.plan_due(now);
        Ok(())
    }

    fn sent(
        &mut self,
        frame: usize,
        exposed: f64,
        division: &Division,
    ) -> anyhow::Result<SentPacket> {
        let overhead = self.vehicle.link().sender().options().overhead;
        let tag = self.setting.keys.as_ref().map_or(0, Keys::overhead);
        let encoded = self.vehicle.encoded();
        let (packet, stats) = (&encoded.packet, &encoded.stats);
        Ok(SentPacket {
            frame,
            number: stats.frame,
            exposed,
            bytes: PacketBytes::of(division, packet, stats.truth_bytes, (overhead, tag))?,
            render_psnr: stats.render_psnr,
            psnr: stats.psnr,
            inter: stats.reference.is_some(),
        })
    }

    /// A modem frame comes to the topside.
    fn arrive(&mut self, now: f64, frame: &[u8]) -> anyhow::Result<()> {
        let (_, grown) = self.topside.receive(now, frame)?;
        if let Some((number, is_whole)) = grown {
            let picture = self.pictures.entry(number).or_insert((now, None));
            if is_whole {
                picture.1 = Some(now);
            }
        }
        // What is whole is decoded ahead, in streams.
        while self.topside.picture(now)?.is_some() {}
        Ok(())
    }

    /// Packets so far that are whole although modem frames of them are missing.
    fn repaired(&mut self) -> u64 {
        let newest = self.pictures.last_key_value().map_or(0, |(newest, _)| *newest);
        let link = self.topside.link();
        let recent = newest.saturating_sub(PACKETS as u32 - 1)..=newest;
        let repaired = recent.filter(|number| {
            link.packet(*number)
                .is_some_and(|packet| packet.complete && Some(packet.arrived) < packet.sent)
        });
        let repaired = repaired.count() as u64;
        link.statistics().repaired + repaired
    }

    /// Gives a modem frame's time on the link to whose turn it is. Others always have something to send.
    fn take_slot(&mut self, now: f64, channel: &mut LoggedChannel) -> anyhow::Result<()> {
        let mtu = self.setting.mtu;
        self.turns += self.setting.pull.unwrap_or(1.0);
        let own = match self.turns >= 1.0 {
            true => {
                self.turns -= 1.0;
                self.vehicle.link().transmit(now, mtu)?
            }
            false => None,
        };
        let end = match own {
            Some(frame) => {
                let sent = channel.send(now, frame.len());
                if let Some(arrival) = sent.arrival {
                    self.plan.add(arrival, Event::Arrived(frame.to_vec()));
                }
                sent.end
            }
            None => channel.send(now, mtu).end,
        };
        if end <= self.end {
            self.plan.add(end, Event::Slot);
        }
        Ok(())
    }

    /// Looks for the next modem frame when it is due.
    fn plan_due(&mut self, now: f64) {
        let due = self.vehicle.link().due().map(|due| due.max(now));
        if let Some(due) = due.filter(|due| *due < self.next_due && *due <= self.end) {
            self.next_due = due;
            self.plan.add(due, Event::Due);
        }
    }

    fn report(&mut self, now: f64, channel: &mut LoggedChannel) -> anyhow::Result<()> {
        let Some(report) = self.topside.report(now)?.map(<[u8]>::to_vec) else { return Ok(()) };
        if self.setting.half_duplex {
            channel.occupy(now, report.len());
        }
        let delay = self.setting.return_delay.unwrap_or(0.0);
        self.plan.add(now + delay, Event::Reported(report));
        Ok(())
    }

    /// What the pilot sees of a camera frame.
    fn display(&mut self, frame: usize) -> anyhow::Result<()> {
        let (shown, picture) = self.topside.show(frame as u32, self.setting.reach_frames())?;
        let grey;
        let picture = match shown {
            Recalled::Nothing => {
                let wanted = self.footage.camera(0);
                grey = grey_picture(wanted.width, wanted.height);
                &grey
            }
            _ => picture,
        };
        if let Some(folder) = &mut self.frames_out {
            folder.write_picture(&format!("{frame:04}"), picture)?;
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

/// What the pilot sees before the first picture.
fn grey_picture(width: u32, height: u32) -> Picture {
    let mut picture = Picture::new(width, height);
    picture.data.fill(128);
    picture
}

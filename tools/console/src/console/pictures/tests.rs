//! A vehicle and the console's pictures, over a link that loses modem frames. Time is counted, not waited for.

use nvsprior::random::Random;
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior::{EncoderOptions, Picture, Prior};
use nvsprior_basin::{CAMERA, Conditions, DemoFrame, PRIOR, Run};
use nvsprior_channel::forth_and_back;
use nvsprior_link::modem::Loss;
use nvsprior_link::{AgeLimit, CameraFrame, Vehicle, VehicleOptions};

use super::*;

pub const MTU: usize = 64;
pub const FRAME_RATE: f64 = 3.0;
/// Frames of T2 that are gone through forth and back. They show a box that the prior does not.
const FRAMES: usize = 12;
const LOSS: f32 = 0.1;

/// A vehicle at three frames a second.
pub fn options() -> VehicleOptions {
    VehicleOptions {
        delay: 0.1,
        spread: Some(0.0),
        min_bytes: 100,
        loss: Loss { chance: f64::from(LOSS), burst: 1.0 },
        is_utc: true,
        ..VehicleOptions::new(MTU, 16_000.0, FRAME_RATE)
    }
}

pub fn encoder() -> EncoderOptions {
    EncoderOptions { threshold: 1e-2, ..Default::default() }
}

/// Both ends.
struct Link {
    vehicle: Vehicle,
    pictures: Pictures,
    random: Random,
    frames: Vec<DemoFrame>,
    /// Pictures of packets that came in full.
    whole: usize,
    /// By how much the vehicle's clock is ahead.
    ahead: f64,
    /// Whether reports go back.
    reports: bool,
}

impl Link {
    fn new() -> Link {
        let engine = Engine::new(&Default::default()).unwrap();
        let prior = Prior::from_bytes(PRIOR, "the demo's prior", &Default::default()).unwrap();
        let scene = engine.upload(&prior).unwrap();
        let link = Pictures::options(MTU);
        Link {
            vehicle: Vehicle::new(&engine, &scene, &CAMERA, encoder(), &options()).unwrap(),
            pictures: Pictures::new(&engine, &scene, link, false, None).unwrap(),
            random: Random::new(7),
            frames: nvsprior_basin::inspection_run(Run::T2, FRAMES, Conditions::CALM).collect(),
            whole: 0,
            ahead: 0.0,
            reports: true,
        }
    }

    /// Sends a camera frame, and takes what arrives before the next one.
    fn step(&mut self, number: usize) {
        let exposed = number as f64 / FRAME_RATE;
        let frame = &self.frames[forth_and_back(number, FRAMES)];
        let hint = (number == 0).then(|| Hint::of(frame.pose));
        let own = exposed + self.ahead;
        let info = FrameInfo { time: Some(own), hint };
        let taken = CameraFrame { exposed: own, picture: &frame.picture, info, user: &[] };
        let is_sent = self.vehicle.frame(own, &taken, || own).unwrap().is_some();
        let (sent, expected) =
            (self.vehicle.encoded().stats.frame, self.vehicle.encoded().picture.clone());
        for part in 0..10 {
            let now = exposed + f64::from(part) / 10.0 / FRAME_RATE;
            while let Some(frame) = self.vehicle.link().transmit(now + self.ahead, MTU).unwrap() {
                if self.random.within(0.0, 1.0) >= LOSS {
                    assert!(self.pictures.take(now, frame).is_some());
                }
            }
            self.pictures.decode().unwrap();
            if let Some(report) = self.pictures.report(now).filter(|_| self.reports) {
                self.vehicle.link().receive(now + self.ahead, report).unwrap();
            }
        }
        if is_sent {
            self.compare(sent, &expected);
        }
    }

    fn compare(&mut self, number: u32, expected: &Picture) {
        let Some(shown) = self.pictures.shown() else { return };
        if shown.decoded.frame != number || !shown.complete {
            return;
        }
        assert!(shown.decoded.picture == *expected, "frame {number}");
        let limit = AgeLimit::of(self.vehicle.link().sender().options());
        assert_eq!(shown.old, limit.seconds());
        self.whole += 1;
    }
}

#[test]
fn whole_pictures_are_those_of_the_vehicle() {
    let mut link = Link::new();
    (0..20).for_each(|number| link.step(number));
    assert!(link.whole > 10, "{} whole pictures", link.whole);
}

#[test]
fn a_clock_of_the_vehicle_that_is_days_off_is_told_until_reports_reach_it() {
    for (ahead, is_off) in [(0.0, false), (3.0 * 86_400.0, true), (-86_400.0, true), (5.0, true)] {
        let mut link = Link::new();
        (link.ahead, link.reports) = (ahead, false);
        (0..3).for_each(|number| link.step(number));
        let shown = link.pictures.shown().expect("a picture");
        assert_eq!((shown.is_clock_off, shown.clock.is_none()), (is_off, is_off), "{ahead}");
        link.reports = true;
        (3..8).for_each(|number| link.step(number));
        let shown = link.pictures.shown().expect("a picture");
        assert_eq!((shown.is_clock_off, shown.clock), (false, Some(ClockSource::Reports)));
    }
}

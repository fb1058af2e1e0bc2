//! A vehicle and the console's pictures, over a link that loses modem frames. Time is counted, not waited for.

use nvsprior::modem::{Loss, Protection, RateControlOptions, Report, SenderOptions};
use nvsprior::random::Random;
use nvsprior::residual::Tune;
use nvsprior::tracking::{FrameInfo, Hint};
use nvsprior::{Mode, Picture, Prior};
use nvsprior_basin::{CAMERA, Conditions, DemoFrame, PRIOR, Run};
use nvsprior_link::age_limit::AgeLimit;
use nvsprior_link::exposure::{self, EXPOSURE_LEN};
use nvsprior_link::forth_and_back;
use nvsprior_link::vehicle::{CameraFrame, Vehicle, VehicleOptions};

use super::*;

pub const MTU: usize = 64;
pub const FRAME_RATE: f64 = 3.0;
/// Frames of T2 that are gone through forth and back. They show a box that the prior does not.
const FRAMES: usize = 12;
const LOSS: f32 = 0.1;

/// A vehicle at three frames a second.
pub fn options() -> VehicleOptions {
    let control = RateControlOptions {
        bit_rate: 16_000.0,
        mtu: MTU,
        overhead: 0,
        latency: 1.5,
        delay: 0.1,
        spread: 0.0,
        frame_rate: FRAME_RATE,
        min_bytes: 100,
        max_shares: 16,
        loss: Loss { chance: f64::from(LOSS), burst: 1.0 },
        user: Some(EXPOSURE_LEN),
    };
    let protection = Protection::Layers;
    let sender = SenderOptions { control, stream: 0, protection, expect_reports: true };
    let mode = Mode::Intra;
    VehicleOptions {
        sender,
        mode,
        tune: Tune::Psnr,
        threshold: 1e-2,
        frames_treated: false,
        truth: true,
        predict_poses: true,
    }
}

/// Both ends.
struct Link {
    vehicle: Vehicle,
    pictures: Pictures,
    random: Random,
    frames: Vec<DemoFrame>,
    /// Pictures of packets that came in full.
    whole: usize,
}

impl Link {
    fn new() -> Link {
        let engine = Engine::new(&Default::default()).unwrap();
        let prior = Prior::from_bytes(PRIOR, "the demo's prior", &Default::default()).unwrap();
        let scene = engine.upload(&prior).unwrap();
        Link {
            vehicle: Vehicle::new(&engine, &scene, &CAMERA, &options(), None).unwrap(),
            pictures: Pictures::new(&engine, &scene, MTU, false, None).unwrap(),
            random: Random::new(7),
            frames: nvsprior_basin::inspection_run(Run::T2, FRAMES, Conditions::CALM).collect(),
            whole: 0,
        }
    }

    /// Sends a camera frame, and takes what arrives before the next one.
    fn step(&mut self, number: usize) {
        let exposed = number as f64 / FRAME_RATE;
        let frame = &self.frames[forth_and_back(number, FRAMES)];
        let hint = (number == 0).then(|| Hint::of(frame.pose));
        let user = exposure::written(
            exposed,
            ClockSource::Reports,
            AgeLimit::of(&options().sender.control),
        );
        let taken = CameraFrame {
            number,
            exposed,
            picture: &frame.picture,
            info: FrameInfo { time: Some(exposed), hint },
            user: Some(&user),
        };
        let sent = self.vehicle.take(&taken, || exposed).unwrap();
        let expected = self.vehicle.picture().clone();
        for part in 0..10 {
            let now = exposed + f64::from(part) / 10.0 / FRAME_RATE;
            while let Some((_, share)) = self.vehicle.next_share(now) {
                if self.random.within(0.0, 1.0) >= LOSS {
                    assert_ne!(self.pictures.take(now, share), Worth::Garbage);
                }
            }
            self.pictures.decode().unwrap();
        }
        if let Some(sent) = sent {
            self.compare(sent.number, &expected);
        }
        self.report(exposed);
    }

    fn compare(&mut self, number: u32, expected: &Picture) {
        let Some(shown) = self.pictures.shown() else { return };
        if shown.decoded.frame != number || !shown.complete {
            return;
        }
        assert!(shown.decoded.picture == *expected, "frame {number}");
        assert_eq!(shown.old, AgeLimit::of(&options().sender.control).seconds());
        self.whole += 1;
    }

    fn report(&mut self, now: f64) {
        let message = PilotMessage { sent: exposure::stamp(now), announce: false, region: None };
        let Some(report) = self.pictures.report(&message) else { return };
        let (report, _) = Report::read(&report).unwrap();
        self.vehicle.process_report(now, &report).unwrap();
    }
}

#[test]
fn whole_pictures_are_those_of_the_vehicle() {
    let mut link = Link::new();
    (0..20).for_each(|number| link.step(number));
    assert!(link.whole > 10, "{} whole pictures", link.whole);
}

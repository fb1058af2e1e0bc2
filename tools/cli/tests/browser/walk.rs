//! A random walk over what may go wrong on a link, and a page that is looked at twice a second: `make console-walk`.
//! `MINUTES=2` ends it sooner, `SEED=7` repeats one.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use nvsprior::random::Random;
use serde_json::Value;

use crate::desk::{Desk, FRAMES_PER_SECOND};
use crate::page::Page;

/// No limit of a picture's age is longer, seconds.
const LIMIT: f64 = 30.0;
/// After so many seconds of calm all is well again: the programs start, a report comes through, and then ten.
const HEALED: f64 = 25.0;
/// So long a page may take to draw what it was told, or to note that nobody answers.
const SETTLED: f64 = 5.0;

const SEEN: &str = "JSON.stringify({
    run, isConnected, picture: state && state.picture, prior: state && state.prior.file,
    drawn: images.picture ? loaded.picture : null, age: byId('age').textContent,
    label: byId('age-label').textContent, marked: !images.picture || byId('stage').dataset.level === '2',
    map: images.plan && ((canvas) => {
        [canvas.width, canvas.height] = [images.plan.width, images.plan.height];
        canvas.getContext('2d').drawImage(images.plan, 0, 0);
        return checksum(canvas);
    })(document.createElement('canvas')),
})";

struct Walk {
    desk: Desk,
    page: Page,
    /// When vehicles began: each counts its frames from then on.
    began: Vec<Instant>,
    /// When each picture was exposed at the latest: by run of the console, and number.
    exposed: BTreeMap<(String, u64), Instant>,
    maps: BTreeMap<&'static str, Value>,
    /// The prior of the console that runs, and when it was started or killed.
    prior: Option<&'static str>,
    touched: Instant,
    /// When the page last showed what it was told.
    settled: Instant,
    /// Since when all is as it should be.
    calm: Option<Instant>,
}

#[test]
#[ignore = "takes half an hour: make console-walk"]
fn nothing_passes_for_newer_or_for_another_place() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<f64>().unwrap());
    let seed = number("SEED").unwrap_or_else(|| std::process::id().into());
    let minutes = number("MINUTES").unwrap_or(30.0);
    println!("walk: SEED={seed} MINUTES={minutes}");
    let (mut random, desk) = (Random::new(seed as u64), Desk::start());
    desk.make_key("stranger.key");
    let (page, now) = (Page::open(&desk.page), Instant::now());
    let (began, exposed, maps) = Default::default();
    let (prior, calm) = (Some("prior.ply"), Some(now));
    let mut walk =
        Walk { desk, page, began, exposed, maps, prior, touched: now, settled: now, calm };
    walk.look_for(HEALED + 5.0);
    while now.elapsed().as_secs_f64() < 60.0 * minutes {
        let (step, wait) = (random.within(0.0, 7.0) as usize, f64::from(random.within(0.0, 9.0)));
        println!("{:7.1} s: step {step}, {wait:.1} s", now.elapsed().as_secs_f64());
        walk.calm = None;
        walk.step(step, wait);
        walk.calm = Some(Instant::now());
        // Half of the steps come before all is well again.
        walk.look_for(if wait < 4.5 { wait } else { HEALED + 5.0 });
    }
    assert!(walk.exposed.len() > 10, "{} pictures", walk.exposed.len());
}

impl Walk {
    fn step(&mut self, step: usize, wait: f64) {
        match step {
            0 => self.console_again("prior.ply", "", wait),
            1 | 2 => {
                let wrong = [("other.ply", ""), ("prior.ply", "--key stranger.key --epoch 1")];
                self.console_again(wrong[step - 1].0, wrong[step - 1].1, wait);
                self.look_for(SETTLED + wait);
                self.console_again("prior.ply", "", wait / 2.0);
            }
            3 => {
                self.desk.stop_vehicle();
                self.look_for(wait);
                self.desk.restart_vehicle(8000);
            }
            4 | 5 => {
                self.desk.cut_the_link();
                self.look_for(if step == 4 { wait } else { LIMIT + SETTLED + wait });
                self.desk.mend_the_link();
            }
            _ => self.desk.flood(),
        }
    }

    fn console_again(&mut self, prior: &'static str, more: &str, wait: f64) {
        self.desk.stop_console();
        (self.prior, self.touched) = (None, Instant::now());
        self.look_for(wait);
        self.desk.begin_console(prior, more);
        (self.prior, self.touched) = (Some(prior), Instant::now());
    }

    fn look_for(&mut self, seconds: f64) {
        let start = Instant::now();
        while start.elapsed().as_secs_f64() < seconds {
            std::thread::sleep(Duration::from_millis(500));
            self.began.extend(self.desk.vehicle_began());
            let now = Instant::now();
            let seen = serde_json::from_str(self.page.value(SEEN).as_str().unwrap()).unwrap();
            if let Some(fault) = self.fault(&seen, now) {
                self.page.save("walk");
                panic!("{fault}: {seen:#}");
            }
        }
    }

    /// What is wrong about what is seen.
    fn fault(&mut self, seen: &Value, now: Instant) -> Option<&'static str> {
        let since = |then: Instant| now.saturating_duration_since(then).as_secs_f64();
        let (picture, is_marked) = (&seen["picture"], seen["marked"] == true);
        if seen["drawn"] == picture["number"] {
            self.settled = now;
        }
        let exposed = self.exposed(seen, now);
        let true_age = exposed.map_or(0.0, since);
        let text = seen["age"].as_str()?;
        let age: f64 = text.trim_start_matches("≥ ").trim_end_matches(" s").parse().unwrap_or(0.0);
        let limit = picture["limits"][1].as_f64().unwrap_or(LIMIT);
        let is_by_vehicle = seen["label"].as_str()?.contains("vehicle's clock");
        let is_exempt = text.starts_with('≥') || is_by_vehicle;
        let is_well = self.calm.is_some_and(|calm| since(calm) > HEALED);
        let is_late = since(self.touched) > SETTLED;
        let faults = [
            (!picture.is_null() && exposed.is_none(), "no vehicle has taken this frame yet"),
            (!is_exempt && age < true_age - 1.0, "it is older than it says"),
            (true_age > limit + 1.0 && !is_marked, "it is too old, and not marked"),
            (self.prior.is_none() && is_late && !is_marked, "nobody answers: it is not marked"),
            (since(self.settled) > SETTLED && !is_marked, "it is not the one that was told of"),
            (self.is_map_of_others(seen, is_late), "it is another prior's map"),
            (is_well && (exposed.is_none() || is_by_vehicle || age > LIMIT / 2.0), "not healed"),
        ];
        faults.iter().find(|(is_so, _)| *is_so).map(|(_, fault)| *fault)
    }

    /// The map is not that of the console's prior. Before `is_late`, the page may not have heard of that one.
    fn is_map_of_others(&mut self, seen: &Value, is_late: bool) -> bool {
        let Some(prior) = self.prior.filter(|_| seen["isConnected"] == true) else { return false };
        let map = &seen["map"];
        if seen["prior"] != prior || map.is_null() {
            return is_late && seen["prior"] != prior;
        }
        self.maps.entry(prior).or_insert_with(|| map.clone()) != map
            || self.maps.iter().any(|(of, other)| *of != prior && other == map)
    }

    /// When the picture was exposed at the latest: its frame's number tells how long after its vehicle's start. Which
    /// vehicle that was is settled as the picture is first seen.
    fn exposed(&mut self, seen: &Value, now: Instant) -> Option<Instant> {
        let after = |frames| Duration::from_secs_f64(frames as f64 / FRAMES_PER_SECOND);
        let [number, frame] = ["number", "frame"].map(|what| seen["picture"][what].as_u64());
        let (picture, frame) = ((seen["run"].to_string(), number?), frame?);
        if !self.exposed.contains_key(&picture) {
            let began = self.began.iter().rev().find(|began| **began + after(frame) <= now)?;
            self.exposed.insert(picture.clone(), *began + after(frame + 1));
        }
        self.exposed.get(&picture).copied()
    }
}

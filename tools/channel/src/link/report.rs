//! What a run over the link came to.

use std::collections::BTreeMap;
use std::path::Path;

use nvsprior_link::Recalled;
use serde::Serialize;

use super::region::RegionPsnr;
use super::sent::{PacketBytes, SentPacket};
use super::setting::Setting;
use super::video::Coder;
use nvsprior_inputs::report::{Table, fixed, write_json};
use nvsprior_inputs::say;

/// What the pilot sees of a camera frame.
pub struct Moment {
    pub frame: usize,
    pub shown: Recalled,
    /// Against the camera's frame, dB.
    pub psnr: f64,
    /// The same inside and outside of what the prior does not show, if that is asked for.
    pub region: Option<RegionPsnr>,
}

pub struct LinkRun {
    pub setting: Setting,
    pub seconds: f64,
    /// Mean part of a picture that shows what the prior does not, if that is asked for.
    pub region_part: Option<f64>,
    pub moments: Vec<Moment>,
    pub packets: Vec<SentPacket>,
    /// Bytes of shares that were sent again.
    pub resent: usize,
    /// By packet: when a picture could be shown first, and when all of it.
    pub pictures: BTreeMap<u32, (f64, Option<f64>)>,
    /// Packets that became whole although shares of them were lost.
    pub repaired: u64,
    /// Most bits on the channel in any second.
    pub worst_second: f64,
    /// Video coders on the same channel.
    pub beside: Vec<Beside>,
}

/// What a video coder came to at a setting: at the best of all its frame rates and qualities.
#[derive(Serialize)]
pub struct Beside {
    pub coder: Coder,
    pub fps: f64,
    pub crf: u32,
    /// Of what the pilot sees at each camera frame, pictures that are held included, dB.
    pub shown_psnr: f64,
    /// Mean bytes of a picture on the link but the first, headers and parity included.
    pub bytes: f64,
    #[serde(rename = "sent_frames")]
    pub sent: usize,
    #[serde(rename = "lost_frames")]
    pub lost: usize,
}

fn name(shown: Recalled) -> &'static str {
    match shown {
        Recalled::Own => "own",
        Recalled::Between => "between",
        Recalled::Held => "held",
        Recalled::Nothing => "nothing",
    }
}

/// Frames in a row that count as shown for good.
const STEADY: usize = 3;

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

impl LinkRun {
    pub fn shown_psnr(&self) -> f64 {
        mean(self.moments.iter().map(|moment| moment.psnr))
    }

    /// Mean PSNR inside (0) or outside (1) of what the prior does not show, over the frames that have such a part, dB.
    fn region_psnr(&self, side: usize) -> Option<f64> {
        let values = self.moments.iter().filter_map(|moment| moment.region?[side]);
        let values: Vec<_> = values.collect();
        (!values.is_empty()).then(|| mean(values.into_iter()))
    }

    /// Seconds until what the prior does not show is shown with a PSNR, in so many frames in a row that have such a
    /// part.
    fn seconds_until(&self, psnr: f64) -> Option<f64> {
        let inside =
            self.moments.iter().filter_map(|moment| Some((moment.frame, moment.region?[0]?)));
        let inside: Vec<_> = inside.collect();
        let is_shown = |frames: &[(usize, f64)]| frames.iter().all(|(_, inside)| *inside >= psnr);
        let first = inside.windows(STEADY).find(|frames| is_shown(frames))?[0].0;
        Some(first as f64 / self.setting.fps)
    }

    /// Camera frames that are shown in a way.
    fn shown(&self, way: impl Fn(Recalled) -> bool) -> usize {
        self.moments.iter().filter(|moment| way(moment.shown)).count()
    }

    /// Frames that are shown by what came of their packets.
    fn pictures_per_second(&self) -> f64 {
        self.shown(|shown| shown == Recalled::Own) as f64 / self.seconds
    }

    /// Seconds until the first picture came.
    fn first_picture(&self) -> Option<f64> {
        self.pictures.values().map(|(first, _)| *first).reduce(f64::min)
    }

    /// Mean milliseconds from exposure to the first picture, and to the whole one.
    fn latency(&self) -> [f64; 2] {
        let times = self.packets.iter().filter_map(|packet| {
            let (first, whole) = self.pictures.get(&packet.number)?;
            Some([first - packet.exposed, whole.unwrap_or(f64::NAN) - packet.exposed])
        });
        let times: Vec<_> = times.collect();
        let whole: Vec<_> =
            times.iter().map(|[_, whole]| *whole).filter(|t| t.is_finite()).collect();
        [mean(times.iter().map(|[first, _]| *first)), mean(whole.into_iter())]
            .map(|seconds| 1000.0 * seconds)
    }

    /// Mean and greatest age of the newest picture that is there, seconds: from its exposure, at the time of each
    /// camera frame once the first picture has come.
    fn age(&self) -> [f64; 2] {
        let first =
            |packet: &SentPacket| self.pictures.get(&packet.number).map(|(first, _)| *first);
        let mut came: Vec<(f64, f64)> = self
            .packets
            .iter()
            .filter_map(|packet| Some((first(packet)?, packet.exposed)))
            .collect();
        came.sort_by(|a, b| a.0.total_cmp(&b.0));
        let frames = (0..self.moments.len()).map(|frame| frame as f64 / self.setting.fps);
        let ages: Vec<f64> = frames
            .filter_map(|now| {
                let there = came.iter().take_while(|(first, _)| *first <= now);
                Some(now - there.map(|(_, exposed)| *exposed).reduce(f64::max)?)
            })
            .collect();
        [mean(ages.iter().copied()), ages.iter().copied().fold(0.0, f64::max)]
    }

    fn bytes(&self) -> PacketBytes {
        let mut sum = PacketBytes::default();
        for PacketBytes { latent, residual, framing, truth, headers, parity, tags } in
            self.packets.iter().map(|packet| packet.bytes)
        {
            sum.latent += latent;
            sum.residual += residual;
            sum.framing += framing;
            sum.truth += truth;
            sum.headers += headers;
            sum.parity += parity;
            sum.tags += tags;
        }
        sum
    }

    /// Part of the bytes that protects the others.
    pub fn parity(&self) -> f64 {
        let bytes = self.bytes();
        bytes.parity as f64 / bytes.total().max(1) as f64
    }

    /// Packets without a picture by the time at which their frame was to be shown.
    fn lost(&self) -> usize {
        let in_time = |packet: &&SentPacket| {
            let deadline = packet.exposed + self.setting.latency;
            self.pictures.get(&packet.number).is_some_and(|(first, _)| *first <= deadline)
        };
        self.packets.len() - self.packets.iter().filter(in_time).count()
    }

    /// Most that a frame sent lies below the mean of the two beside it, dB.
    fn deepest_dip(&self) -> f64 {
        let dips = self.packets.windows(3).map(|w| (w[0].psnr + w[2].psnr) / 2.0 - w[1].psnr);
        dips.fold(0.0, f64::max)
    }
}

#[derive(Serialize)]
struct Figures<'a> {
    bit_rate: f64,
    mtu: usize,
    overhead: usize,
    propagation: f64,
    loss: f64,
    burst: f64,
    latency: f64,
    seed: u64,
    return_delay: Option<f64>,
    pull: Option<f64>,
    seconds: f64,
    shown_psnr: f64,
    age_seconds: f64,
    greatest_age_seconds: f64,
    pictures_per_second: f64,
    shown: ShownCounts,
    first_picture_seconds: Option<f64>,
    latency_ms: f64,
    whole_latency_ms: f64,
    bytes: LinkBytes,
    sent_frames: usize,
    #[serde(rename = "leaning_frames")]
    inter_frames: usize,
    lost_frames: usize,
    whole_frames: usize,
    repaired: u64,
    sent_psnr: f64,
    render_psnr: f64,
    deepest_dip: f64,
    worst_second_bits: f64,
    region_part: Option<f64>,
    region_psnr: Option<f64>,
    outside_psnr: Option<f64>,
    seconds_to_25_db: Option<f64>,
    seconds_to_30_db: Option<f64>,
    beside: &'a [Beside],
    /// Mean bytes of a packet on the link, without what is sent again.
    #[serde(skip)]
    packet_bytes: f64,
}

/// How many camera frames are shown in each way.
#[derive(Serialize)]
struct ShownCounts {
    own: usize,
    between: usize,
    held: usize,
    nothing: usize,
}

#[derive(Serialize)]
struct LinkBytes {
    #[serde(flatten)]
    packets: PacketBytes,
    resent: usize,
    total: usize,
}

impl Figures<'_> {
    fn of(run: &LinkRun) -> Figures<'_> {
        let Setting { bit_rate, mtu, overhead, propagation, loss, latency, seed, .. } = run.setting;
        let LinkRun { packets, pictures, resent, .. } = run;
        let bytes = run.bytes();
        let [latency_ms, whole_latency_ms] = run.latency();
        let [age_seconds, greatest_age_seconds] = run.age();
        let shown = |way: fn(Recalled) -> bool| run.shown(way);
        Figures {
            bit_rate,
            mtu,
            overhead,
            propagation,
            loss: loss.chance,
            burst: loss.burst,
            latency,
            seed,
            return_delay: run.setting.return_delay,
            pull: run.setting.pull,
            age_seconds,
            greatest_age_seconds,
            seconds: run.seconds,
            shown_psnr: run.shown_psnr(),
            pictures_per_second: run.pictures_per_second(),
            shown: ShownCounts {
                own: shown(|shown| shown == Recalled::Own),
                between: shown(|shown| shown == Recalled::Between),
                held: shown(|shown| shown == Recalled::Held),
                nothing: shown(|shown| shown == Recalled::Nothing),
            },
            first_picture_seconds: run.first_picture(),
            latency_ms,
            whole_latency_ms,
            bytes: LinkBytes { packets: bytes, resent: *resent, total: bytes.total() + resent },
            sent_frames: packets.len(),
            inter_frames: packets.iter().filter(|packet| packet.inter).count(),
            lost_frames: run.lost(),
            whole_frames: pictures.values().filter(|(_, whole)| whole.is_some()).count(),
            repaired: run.repaired,
            sent_psnr: mean(packets.iter().map(|packet| packet.psnr)),
            render_psnr: mean(packets.iter().map(|packet| packet.render_psnr)),
            deepest_dip: run.deepest_dip(),
            worst_second_bits: run.worst_second,
            region_part: run.region_part,
            region_psnr: run.region_psnr(0),
            outside_psnr: run.region_psnr(1),
            seconds_to_25_db: run.seconds_until(25.0),
            seconds_to_30_db: run.seconds_until(30.0),
            beside: &run.beside,
            packet_bytes: mean(packets.iter().map(|packet| packet.bytes.total() as f64)),
        }
    }
}

/// Prints a line for each setting, and one for each video coder on the same channel.
pub fn print(runs: &[LinkRun]) {
    let columns =
        ["loss", "burst", "shown dB", "sent dB", "pictures/s", "bytes", "first, s", "latency ms"];
    let counts = ["sent", "lost", "whole", "coder"];
    let mut table = Table::new(columns.into_iter().chain(counts));
    for f in runs.iter().map(Figures::of) {
        let [loss, burst] = [fixed(f.loss, 3), fixed(f.burst, 1)];
        table.push([
            loss.clone(),
            burst.clone(),
            fixed(f.shown_psnr, 2),
            fixed(f.sent_psnr, 2),
            fixed(f.pictures_per_second, 2),
            fixed(f.packet_bytes, 1),
            f.first_picture_seconds.map_or_else(String::new, |first| fixed(first, 1)),
            fixed(f.latency_ms, 0),
            f.sent_frames.to_string(),
            f.lost_frames.to_string(),
            f.whole_frames.to_string(),
            String::new(),
        ]);
        for b in f.beside {
            table.push([
                loss.clone(),
                burst.clone(),
                fixed(b.shown_psnr, 2),
                String::new(),
                fixed(b.fps, 2),
                fixed(b.bytes, 1),
                String::new(),
                String::new(),
                b.sent.to_string(),
                b.lost.to_string(),
                String::new(),
                format!("{}, CRF {}", b.coder.name(), b.crf),
            ]);
        }
    }
    table.print();
    runs.iter().for_each(print_region);
    runs.iter().for_each(print_age);
    runs.iter().for_each(print_keys);
}

/// Says what is shown of what the prior does not show.
fn print_region(run: &LinkRun) {
    let loss = fixed(run.setting.loss.chance, 3);
    if let Some((inside, outside)) = run.region_psnr(0).zip(run.region_psnr(1)) {
        say!(
            "loss {loss}: {inside:.2} dB where the prior does not show it, {outside:.2} dB elsewhere"
        );
    }
}

/// Says how old the newest picture is.
fn print_age(run: &LinkRun) {
    let [mean, greatest] = run.age();
    say!(
        "loss {}: the newest picture is {} s old on the mean, {} s at most",
        fixed(run.setting.loss.chance, 3),
        fixed(mean, 2),
        fixed(greatest, 2)
    );
}

/// Says what keys cost.
fn print_keys(run: &LinkRun) {
    let Some(keys) = &run.setting.keys else { return };
    let (bytes, tag) = (run.bytes(), keys.overhead());
    say!(
        "loss {}: {tag} bytes of number and tag in each modem frame, {:.1} % of the packets' bytes",
        fixed(run.setting.loss.chance, 3),
        100.0 * bytes.tags as f64 / bytes.total().max(1) as f64
    );
}

/// `link.json`. At its top level it has the first setting's figures.
#[derive(Serialize)]
struct Root<'a> {
    #[serde(flatten)]
    first: &'a Figures<'a>,
    settings: &'a [Figures<'a>],
}

/// Writes link.json and frames.csv.
pub fn write(folder: &Path, runs: &[LinkRun]) -> anyhow::Result<()> {
    let settings: Vec<Figures> = runs.iter().map(Figures::of).collect();
    write_json(&folder.join("link.json"), &Root { first: &settings[0], settings: &settings })?;
    let moments = runs.iter().flat_map(|o| o.moments.iter().map(move |moment| (o, moment)));
    let rows: Vec<(&LinkRun, &Moment)> = moments.collect();
    let sent = |(run, moment): &(&LinkRun, &Moment), cell: fn(&SentPacket) -> String| {
        let sent = run.packets.iter().find(|packet| packet.frame == moment.frame);
        sent.map_or(String::new(), cell)
    };
    let region = |moment: &Moment, side: usize| match moment.region.and_then(|psnr| psnr[side]) {
        Some(psnr) => fixed(psnr, 3),
        None => String::new(),
    };
    let table = Table::of(
        &rows,
        &[
            ("loss", &|(run, _)| run.setting.loss.chance.to_string()),
            ("frame", &|(_, moment)| moment.frame.to_string()),
            ("seconds", &|(o, moment)| fixed(moment.frame as f64 / o.setting.fps, 4)),
            ("shown", &|(_, moment)| name(moment.shown).to_owned()),
            ("shown_psnr", &|(_, moment)| fixed(moment.psnr, 3)),
            ("sent_bytes", &|row| sent(row, |sent| sent.bytes.total().to_string())),
            ("sent_psnr", &|row| sent(row, |sent| fixed(sent.psnr, 3))),
            ("region_psnr", &|(_, moment)| region(moment, 0)),
            ("outside_psnr", &|(_, moment)| region(moment, 1)),
            ("latent_bytes", &|row| sent(row, |sent| sent.bytes.latent.to_string())),
            ("framing_bytes", &|row| sent(row, |sent| sent.bytes.framing.to_string())),
            ("truth_bytes", &|row| sent(row, |sent| sent.bytes.truth.to_string())),
        ],
    );
    table.write_csv(&folder.join("frames.csv"))
}

//! What a run over the link came to.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};

use super::Setting;
use super::topside::Seen;
use super::vehicle::{PacketBytes, SentPacket};
use super::video::Beside;

/// What the pilot sees of a camera frame.
pub struct Moment {
    pub frame: usize,
    pub seen: Seen,
    /// Against the camera's frame, dB.
    pub psnr: f64,
}

/// A run at one setting.
pub struct Outcome {
    pub setting: Setting,
    pub seconds: f64,
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

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

impl Outcome {
    pub fn shown_psnr(&self) -> f64 {
        mean(self.moments.iter().map(|moment| moment.psnr))
    }

    /// Camera frames that are seen in a way.
    fn seen(&self, way: impl Fn(Seen) -> bool) -> usize {
        self.moments.iter().filter(|moment| way(moment.seen)).count()
    }

    /// Frames that are shown by what came of their packets.
    fn pictures_per_second(&self) -> f64 {
        self.seen(|seen| seen == Seen::Own) as f64 / self.seconds
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

    fn bytes(&self) -> PacketBytes {
        let mut sum = PacketBytes::default();
        for PacketBytes { latent, residual, headers, parity } in
            self.packets.iter().map(|packet| packet.bytes)
        {
            sum.latent += latent;
            sum.residual += residual;
            sum.headers += headers;
            sum.parity += parity;
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

    fn json(&self) -> Value {
        let Setting { bit_rate, mtu, overhead, propagation, loss, latency, seed, .. } =
            self.setting;
        let bytes = self.bytes();
        let [first, whole] = self.latency();
        let complete = self.pictures.values().filter(|(_, whole)| whole.is_some()).count();
        json!({
            "bit_rate": bit_rate,
            "mtu": mtu,
            "overhead": overhead,
            "propagation": propagation,
            "loss": loss.chance,
            "burst": loss.burst,
            "latency": latency,
            "seed": seed,
            "return_delay": self.setting.return_delay,
            "seconds": self.seconds,
            "shown_psnr": self.shown_psnr(),
            "pictures_per_second": self.pictures_per_second(),
            "shown": {
                "own": self.seen(|seen| seen == Seen::Own),
                "between": self.seen(|seen| seen == Seen::Between),
                "held": self.seen(|seen| matches!(seen, Seen::Held(_))),
                "nothing": self.seen(|seen| seen == Seen::Nothing),
            },
            "latency_ms": first,
            "whole_latency_ms": whole,
            "bytes": {
                "latent": bytes.latent,
                "residual": bytes.residual,
                "headers": bytes.headers,
                "parity": bytes.parity,
                "resent": self.resent,
                "total": bytes.total() + self.resent,
            },
            "sent_frames": self.packets.len(),
            "leaning_frames": self.packets.iter().filter(|packet| packet.inter).count(),
            "lost_frames": self.lost(),
            "whole_frames": complete,
            "repaired": self.repaired,
            "sent_psnr": mean(self.packets.iter().map(|packet| packet.psnr)),
            "render_psnr": mean(self.packets.iter().map(|packet| packet.render_psnr)),
            "deepest_dip": self.deepest_dip(),
            "worst_second_bits": self.worst_second,
            "beside": self.beside.iter().map(Beside::json).collect::<Value>(),
        })
    }
}

/// Prints a line for each setting.
pub fn print(outcomes: &[Outcome]) {
    println!(
        "{:>7} {:>6} {:>9} {:>9} {:>9} {:>8} {:>10} {:>6} {:>6} {:>6}",
        "loss",
        "burst",
        "shown dB",
        "sent dB",
        "pictures",
        "bytes",
        "latency ms",
        "sent",
        "lost",
        "whole"
    );
    for outcome in outcomes {
        let [first, _] = outcome.latency();
        let whole = outcome.pictures.values().filter(|(_, whole)| whole.is_some()).count();
        println!(
            "{:>7.3} {:>6.1} {:>9.2} {:>9.2} {:>7.2}/s {:>8.1} {:>10.0} {:>6} {:>6} {:>6}",
            outcome.setting.loss.chance,
            outcome.setting.loss.burst,
            outcome.shown_psnr(),
            mean(outcome.packets.iter().map(|packet| packet.psnr)),
            outcome.pictures_per_second(),
            mean(outcome.packets.iter().map(|packet| packet.bytes.total() as f64)),
            first,
            outcome.packets.len(),
            outcome.lost(),
            whole,
        );
        outcome.beside.iter().for_each(Beside::print);
    }
}

impl Beside {
    fn json(&self) -> Value {
        json!({
            "coder": self.coder.name(),
            "fps": self.fps,
            "crf": self.crf,
            "shown_psnr": self.shown_psnr,
            "bytes": self.bytes,
            "sent_frames": self.sent,
            "lost_frames": self.lost,
        })
    }

    fn print(&self) {
        println!(
            "{:>14} {:>9.2} {:>19.2}/s {:>8.1} {:>17} {:>6}  CRF {}",
            self.coder.name(),
            self.shown_psnr,
            self.fps,
            self.bytes,
            self.sent,
            self.lost,
            self.crf,
        );
    }
}

/// Writes link.json and frames.csv. At its top level link.json has the first setting's figures.
pub fn write(folder: &Path, outcomes: &[Outcome]) -> anyhow::Result<()> {
    let settings: Vec<Value> = outcomes.iter().map(Outcome::json).collect();
    let mut all = settings[0].clone();
    all["settings"] = settings.into();
    let path = folder.join("link.json");
    let text = serde_json::to_string_pretty(&all)?;
    std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
    let path = folder.join("frames.csv");
    let writing = || format!("writing {}", path.display());
    let mut table = csv::Writer::from_path(&path).with_context(writing)?;
    table.write_record([
        "loss",
        "frame",
        "seconds",
        "shown",
        "shown_psnr",
        "sent_bytes",
        "sent_psnr",
    ])?;
    for outcome in outcomes {
        for moment in &outcome.moments {
            let sent = outcome.packets.iter().find(|packet| packet.frame == moment.frame);
            table.write_record([
                outcome.setting.loss.chance.to_string(),
                moment.frame.to_string(),
                format!("{:.4}", moment.frame as f64 / outcome.setting.fps),
                moment.seen.name().to_owned(),
                format!("{:.3}", moment.psnr),
                sent.map_or(String::new(), |sent| sent.bytes.total().to_string()),
                sent.map_or(String::new(), |sent| format!("{:.3}", sent.psnr)),
            ])?;
        }
    }
    table.flush().with_context(writing)
}

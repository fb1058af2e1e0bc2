//! A video coder on the same channel, to compare with: its pictures over the same modem frames, losses and parity.

mod coder;
mod unit;

use crate::channel::Channel;
use nvsprior::Picture;

use super::report::{Beside, LinkRun};
use super::setting::Setting;
use coder::Coded;
pub use coder::Coder;

/// Camera frames for each frame of the video.
const DIVISORS: [usize; 7] = [1, 2, 3, 5, 8, 15, 30];
/// What a modem frame says of itself, bytes: as a share.
const HEADER: usize = 7;
/// Qualities per frame rate that are tried on the channel: the finest that the bit rate carries.
const TRIED: usize = 2;

/// A run of camera frames, coded by a video coder at all its frame rates and qualities.
pub struct Video {
    coder: Coder,
    coded: Vec<Coded>,
}

impl Video {
    /// How many codings [`Video::code`] makes.
    pub fn codings(coder: Coder) -> usize {
        DIVISORS.len() * coder.qualities().len()
    }

    /// Codes the frames, best quality first at each frame rate. `done` is called after each coding.
    pub fn code(
        coder: Coder,
        frames: &[&Picture],
        fps: f64,
        done: impl Fn(),
    ) -> anyhow::Result<Video> {
        let mut coded = Vec::new();
        for divisor in DIVISORS {
            let frames: Vec<_> = frames.iter().step_by(divisor).copied().collect();
            for crf in coder.qualities() {
                coded.push(Coded::new(coder, &frames, fps, divisor, *crf)?);
                done();
            }
        }
        Ok(Video { coder, coded })
    }

    /// The best that it can do at a run's setting, with the same part of its bytes as parity. `None`: no quality
    /// is coarse enough for the bit rate.
    pub fn beside(&self, run: &LinkRun, frames: &[&Picture]) -> anyhow::Result<Option<Beside>> {
        let parity = run.parity();
        let mut best: Option<Beside> = None;
        for divisor in DIVISORS {
            let at_rate = self.coded.iter().filter(|coded| coded.divisor == divisor);
            let fits = at_rate.filter(|coded| {
                let shares = divided(coded, &run.setting, parity).skip(1);
                let bytes: usize = shares.map(Shares::bytes).sum();
                bytes as f64 * 8.0 <= run.setting.bit_rate * run.seconds
            });
            for coded in fits.take(TRIED) {
                let beside = self.try_on(coded, run, parity, frames)?;
                if best.as_ref().is_none_or(|best| beside.shown_psnr > best.shown_psnr) {
                    best = Some(beside);
                }
            }
        }
        Ok(best)
    }

    /// Sends a coding over the channel, and sees what is shown.
    fn try_on(
        &self,
        coded: &Coded,
        run: &LinkRun,
        parity: f64,
        frames: &[&Picture],
    ) -> anyhow::Result<Beside> {
        let setting = &run.setting;
        let arrived = arrived(coded, setting, run.seconds, parity);
        let shown = coded.decode(&arrived)?;
        let mut pictures = shown.into_iter();
        let (mut seen, mut sum) = (None, 0.0);
        let gray = {
            let mut gray = Picture::new(frames[0].width, frames[0].height);
            gray.data.fill(128);
            gray
        };
        for (frame, wanted) in frames.iter().enumerate() {
            if frame % coded.divisor == 0 && arrived[frame / coded.divisor] {
                seen = pictures.next().flatten().or(seen);
            }
            sum += seen.as_ref().unwrap_or(&gray).psnr(wanted);
        }
        let bytes: usize = divided(coded, setting, parity).skip(1).map(Shares::bytes).sum();
        Ok(Beside {
            coder: self.coder,
            fps: setting.fps / coded.divisor as f64,
            crf: coded.crf,
            shown_psnr: sum / frames.len() as f64,
            bytes: bytes as f64 / (coded.units.len() - 1).max(1) as f64,
            sent: arrived.len(),
            lost: arrived.iter().filter(|arrived| !**arrived).count(),
        })
    }
}

/// A picture's modem frames: of `count`, any `threshold` yield the picture.
#[derive(Clone, Copy)]
struct Shares {
    count: usize,
    threshold: usize,
    len: usize,
    overhead: usize,
}

impl Shares {
    fn bytes(self) -> usize {
        self.count * (self.len + self.overhead)
    }
}

/// The pictures' modem frames. `parity`: part of the bytes that protects the others.
fn divided(coded: &Coded, setting: &Setting, parity: f64) -> impl Iterator<Item = Shares> {
    let (mtu, overhead) = (setting.mtu, setting.overhead);
    let mut owed = 0.0;
    coded.units.iter().map(move |unit| {
        let threshold = unit.len().div_ceil(mtu - HEADER).max(1);
        // Parts of a modem frame are owed to the next pictures.
        owed += threshold as f64 * parity / (1.0 - parity);
        let more = owed as usize;
        owed -= more as f64;
        let len = unit.len().div_ceil(threshold) + HEADER;
        Shares { count: threshold + more, threshold, len, overhead }
    })
}

/// Which pictures arrive in time. The first one is there from the start, at no cost: a codec's first picture takes
/// seconds on such a link.
fn arrived(coded: &Coded, setting: &Setting, seconds: f64, parity: f64) -> Vec<bool> {
    let mut channel = Channel::new(setting.channel(seconds));
    // When each modem frame is due: those of a picture are spread as those of a packet.
    let mut due = Vec::new();
    let shares: Vec<_> = divided(coded, setting, parity).collect();
    for (k, shares) in shares.iter().enumerate().skip(1) {
        let ready = (k * coded.divisor) as f64 / setting.fps + setting.coding;
        let steps = shares.count.saturating_sub(1).max(1) as f64;
        due.extend((0..shares.count).map(|i| (ready + setting.spread * i as f64 / steps, k)));
    }
    due.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut came = vec![0; shares.len()];
    for (time, k) in due {
        let deadline = (k * coded.divisor) as f64 / setting.fps + setting.latency;
        let arrival = channel.send(time, shares[k].len).arrival;
        came[k] += usize::from(arrival.is_some_and(|arrival| arrival <= deadline));
    }
    let enough = |(k, shares): (usize, &Shares)| k == 0 || came[k] >= shares.threshold;
    shares.iter().enumerate().map(enough).collect()
}

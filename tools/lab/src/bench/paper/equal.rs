//! A method at a given mean PSNR.

use super::coders::Method;
use super::row::{Coded, Setting};
use crate::bench::codecs::run::Run;

/// A PSNR is reached if it is as near as this, dB.
pub const TOLERANCE: f64 = 0.05;
/// It is near enough to stop, dB.
const NEAR: f64 = 0.02;
/// Most halvings of the range.
const STEPS: u32 = 9;
/// Most codings that it takes: both ends of the range, and each frame by itself, too.
pub const MAX_CODINGS: usize = STEPS as usize + 3;

/// Codes with the setting whose mean PSNR is nearest to `target`: one setting for all frames, or, if none is near
/// enough, each frame at the target by itself. Also returns whether the target is reached.
pub fn at(
    method: &dyn Method,
    frames: &Run,
    target: f64,
    done: impl Fn(),
) -> anyhow::Result<(Coded, bool)> {
    let best = with_one_setting(method, frames, target, &done)?;
    let best = match method.each(target) {
        Some(setting) if best.off.abs() > TOLERANCE => {
            let each = Point::new(method, frames, target, setting)?;
            done();
            best.or_nearer(each)
        }
        _ => best,
    };
    Ok((best.coded, best.off.abs() <= TOLERANCE))
}

/// The one setting for all frames whose mean PSNR is nearest to `target`.
pub fn setting(method: &dyn Method, frames: &Run, target: f64) -> anyhow::Result<Setting> {
    Ok(with_one_setting(method, frames, target, &|| ())?.coded.setting)
}

fn with_one_setting(
    method: &dyn Method,
    frames: &Run,
    target: f64,
    done: &dyn Fn(),
) -> anyhow::Result<Point> {
    let point = |fine| {
        let point = Point::new(method, frames, target, method.setting(fine));
        done();
        point
    };
    let mut best = point(0.0)?;
    if best.off >= 0.0 {
        return Ok(best);
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..STEPS {
        let fine = 0.5 * (low + high);
        let next = point(fine)?;
        if next.off < 0.0 {
            low = fine;
        } else {
            high = fine;
        }
        best = best.or_nearer(next);
        if best.off.abs() <= NEAR {
            return Ok(best);
        }
    }
    // Halving never comes to the end.
    Ok(if high == 1.0 { best.or_nearer(point(1.0)?) } else { best })
}

/// A setting's outcome, and how far its PSNR is above the target, dB.
struct Point {
    off: f64,
    coded: Coded,
}

impl Point {
    fn new(
        method: &dyn Method,
        frames: &Run,
        target: f64,
        setting: Setting,
    ) -> anyhow::Result<Point> {
        let coded = method.code(setting)?;
        Ok(Point { off: frames.psnr(&coded.shown) - target, coded })
    }

    fn or_nearer(self, other: Point) -> Point {
        if other.off.abs() < self.off.abs() { other } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::codecs::run::Beside;
    use nvsprior::Picture;

    /// Shows grey frames that many levels off.
    struct Off {
        coarsest: f64,
        finest: f64,
        each: bool,
    }

    impl Method for Off {
        fn setting(&self, fine: f64) -> Setting {
            Setting::Quality(self.coarsest + fine * (self.finest - self.coarsest))
        }

        fn code(&self, setting: Setting) -> anyhow::Result<Coded> {
            let off = match setting {
                Setting::Quality(off) => off,
                _ => 40.0,
            };
            // In hundredths of levels: so many of the pixels are one level further off.
            let mut picture = Picture::new(100, 1);
            for (i, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
                pixel.fill((off + i as f64 / 100.0) as u8);
            }
            let shown = vec![picture];
            Ok(Coded { setting, bytes: 1.0, encode_ms: 0.0, decode_ms: 0.0, shown })
        }

        fn each(&self, _psnr: f64) -> Option<Setting> {
            self.each.then_some(Setting::Psnr(0.0))
        }
    }

    fn found(method: &Off, target: f64) -> (f64, bool) {
        let frames =
            Run::new(vec![Picture::new(100, 1)], vec![Picture::new(100, 1)], Beside::default());
        let (coded, reached) = at(method, &frames, target, || ()).unwrap();
        (frames.psnr(&coded.shown), reached)
    }

    #[test]
    fn the_psnr_is_reached_or_said_not_to_be() {
        let method = Off { coarsest: 30.0, finest: 5.0, each: false };
        let (psnr, reached) = found(&method, 25.0);
        assert!(reached && (psnr - 25.0).abs() <= TOLERANCE, "{psnr}");
        let (psnr, reached) = found(&method, 50.0);
        assert!(!reached && (psnr - 34.15).abs() < 0.01, "the finest: {psnr}");
        let (psnr, reached) = found(&method, 10.0);
        assert!(!reached && (psnr - 18.59).abs() < 0.01, "the coarsest: {psnr}");
        let each = Off { each: true, ..method };
        let (psnr, reached) = found(&each, 16.09);
        assert!(reached && (psnr - 16.09).abs() < 0.01, "{psnr}");
    }
}

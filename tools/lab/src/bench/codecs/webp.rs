//! WebP, as packets hold it: without a container.

use nvsprior::Picture;
use nvsprior::packet::Residual;
use nvsprior::residual::{Rate, ResidualCoder, ResidualDecoder, ResidualEncoder, ResidualSetup};

use super::{Input, Mode, Outcome, Point, Run, timed};

/// Libwebp's qualities that are measured.
pub const QUALITIES: [f32; 7] = [0.0, 2.0, 6.0, 15.0, 35.0, 60.0, 85.0];

/// Codes the run at each quality.
pub fn measure(run: &Run, input: Input, done: impl Fn()) -> anyhow::Result<Vec<Point>> {
    let point = |quality| {
        let outcome = code(run.pictures(input), quality)?;
        done();
        Ok(run.point("webp", input, Mode::Intra, &outcome))
    };
    QUALITIES.into_iter().map(point).collect()
}

fn code(pictures: &[Picture], quality: f32) -> anyhow::Result<Outcome> {
    let (width, height) = (pictures[0].width, pictures[0].height);
    // The difference from grey is the picture itself.
    let mut grey = Picture::new(width, height);
    grey.data.fill(128);
    let setup = ResidualSetup::new(width, height, ResidualCoder::Webp);
    let mut encoder = ResidualEncoder::new(&setup);
    let mut decoder = ResidualDecoder::new(width, height, &setup.tables);
    let setting = f64::from(quality);
    let mut outcome =
        Outcome { setting, bytes: 0, encode_ms: 0.0, decode_ms: 0.0, decoded: Vec::new() };
    for picture in pictures {
        let rate = Rate::Quality(quality);
        let (coded, ms) = timed(|| Ok(encoder.encode(picture, &grey, rate, 0)?))?;
        outcome.encode_ms += ms;
        if let Residual::Coded { payload, .. } = coded.residual {
            outcome.bytes += payload.len();
        }
        let mut shown = grey.clone();
        let ((), ms) = timed(|| Ok(decoder.add(&coded.residual, true, &mut shown)?))?;
        outcome.decode_ms += ms;
        outcome.decoded.push(shown);
    }
    Ok(outcome)
}

//! The wavelet coder's CPU time at a size, by rate.

use nvsprior::Picture;
use nvsprior::packet::Residual;
use nvsprior::residual::{Rate, ResidualDecoder, ResidualEncoder, ResidualSetup};
use serde::Serialize;

use nvsprior_inputs::report::{Table, fixed, fixed_or_empty};

/// What is measured: a budget of bytes is a search, a quality is one coding.
const RATES: [(&str, Rate); 5] = [
    ("300 bytes", Rate::Bytes(300)),
    ("1000 bytes", Rate::Bytes(1000)),
    ("33 dB", Rate::Psnr(33.0)),
    ("quality 20", Rate::Quality(20.0)),
    ("quality 60", Rate::Quality(60.0)),
];
/// How often all frames are coded: the system counts a thread's time in steps of some milliseconds.
const REPEATS: usize = 3;

/// What coding at a rate took. Means per frame.
#[derive(Serialize)]
pub struct AtRate {
    width: u32,
    height: u32,
    rate: &'static str,
    codings: f64,
    payload_bytes: f64,
    encode_cpu_ms: Option<f64>,
    decode_cpu_ms: Option<f64>,
}

/// Whether a frame's payload has small blocks, and its bytes; `None`: none makes the render better.
type Payload = Option<(bool, Vec<u8>)>;

/// Codes frames beside their renders.
pub fn measure(
    setup: &ResidualSetup,
    frames: &[(&Picture, &Picture)],
) -> anyhow::Result<Vec<AtRate>> {
    let mut encoder = ResidualEncoder::new(setup);
    let mut decoder = ResidualDecoder::new(setup.width, setup.height, &setup.tables);
    let mut shown = Picture::new(setup.width, setup.height);
    let mean = |sum: f64| sum / frames.len() as f64;
    let at_rate = |(rate, of): (&'static str, Rate)| {
        let ((payloads, codings), encode_cpu_ms) = timed(|| encode(&mut encoder, frames, of))?;
        let ((), decode_cpu_ms) = timed(|| {
            for ((_, render), payload) in frames.iter().zip(&payloads) {
                shown.clone_from(render);
                if let Some((small_blocks, payload)) = payload {
                    let residual = Residual::Coded { small_blocks: *small_blocks, payload };
                    decoder.add(&residual, setup.portable, &mut shown)?;
                }
            }
            Ok(())
        })?;
        let bytes: usize = payloads.iter().flatten().map(|(_, payload)| payload.len()).sum();
        Ok(AtRate {
            width: setup.width,
            height: setup.height,
            rate,
            codings: mean(codings.into()),
            payload_bytes: mean(bytes as f64),
            encode_cpu_ms: encode_cpu_ms.map(mean),
            decode_cpu_ms: decode_cpu_ms.map(mean),
        })
    };
    RATES.into_iter().map(at_rate).collect()
}

/// The payloads, and how many codings they took.
fn encode(
    encoder: &mut ResidualEncoder,
    frames: &[(&Picture, &Picture)],
    rate: Rate,
) -> anyhow::Result<(Vec<Payload>, u32)> {
    let (mut payloads, mut codings) = (Vec::new(), 0);
    for (frame, render) in frames {
        let coded = encoder.encode(frame, render, rate, 0)?;
        codings += coded.probes;
        payloads.push(match coded.residual {
            Residual::Coded { small_blocks, payload } => Some((small_blocks, payload.to_vec())),
            _ => None,
        });
    }
    Ok((payloads, codings))
}

/// What work gives, and this thread's CPU time for it, milliseconds: a mean over [`REPEATS`].
fn timed<T>(mut work: impl FnMut() -> anyhow::Result<T>) -> anyhow::Result<(T, Option<f64>)> {
    // The first time brings memory in.
    let mut value = work()?;
    let begun = thread_cpu_ms();
    for _ in 0..REPEATS {
        value = work()?;
    }
    let ms = thread_cpu_ms().zip(begun).map(|(end, begun)| (end - begun) / REPEATS as f64);
    Ok((value, ms))
}

/// CPU time of this thread, milliseconds; `None` if the system does not say so.
fn thread_cpu_ms() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(stat.split_whitespace().next()?.parse::<f64>().ok()? / 1e6)
}

pub fn table<'a>(rows: impl IntoIterator<Item = &'a AtRate>) -> Table {
    Table::of(
        rows,
        &[
            ("size", &|r| format!("{}×{}", r.width, r.height)),
            ("rate", &|r| r.rate.to_owned()),
            ("codings", &|r| fixed(r.codings, 1)),
            ("payload, bytes", &|r| fixed(r.payload_bytes, 0)),
            ("encode, CPU ms", &|r| fixed_or_empty(r.encode_cpu_ms, 1)),
            ("decode, CPU ms", &|r| fixed_or_empty(r.decode_cpu_ms, 1)),
        ],
    )
}

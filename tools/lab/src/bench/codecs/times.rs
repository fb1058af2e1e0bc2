//! The wavelet coder's time, in milliseconds and in forward renders just before.

use std::path::Path;

use nvsprior::Pose;
use nvsprior::render::filter::FilterPlan;
use nvsprior::residual::wavelet::Step;
use nvsprior::residual::{Rate, ResidualDecoder, ResidualEncoder, ResidualSetup, Tune};

use super::super::context::Context;
use super::super::forward::timed;
use super::run::Run;
use nvsprior_inputs::report::{Table, fixed};
use nvsprior_inputs::statistics::{Spread, median};

/// What is measured: a quality is one coding, a budget and a PSNR are searches.
pub const RATES: [(&str, Rate); 10] = [
    ("quality 0", Rate::Quality(0.0)),
    ("quality 20", Rate::Quality(20.0)),
    ("quality 40", Rate::Quality(40.0)),
    ("100 bytes", Rate::Bytes(100)),
    ("300 bytes", Rate::Bytes(300)),
    ("1000 bytes", Rate::Bytes(1000)),
    ("31 dB", Rate::Psnr(31.0)),
    ("32 dB", Rate::Psnr(32.0)),
    ("33 dB", Rate::Psnr(33.0)),
    ("36 dB", Rate::Psnr(36.0)),
];
/// Codings of a frame, of which the median counts.
const REPEATS: usize = 3;

/// The frames' times at a rate.
pub struct Row {
    rate: &'static str,
    /// Means per frame.
    codings: f64,
    payload: f64,
    psnr: f64,
    encode: Time,
    decode: Time,
    filter: Time,
}

struct Time {
    ms: Spread,
    in_forward_renders: Spread,
}

impl Time {
    /// Of milliseconds, each with those of a forward render.
    fn of(times: &[(f64, f64)]) -> Time {
        Time {
            ms: Spread::of(times.iter().map(|(ms, _)| *ms)),
            in_forward_renders: Spread::of(times.iter().map(|(ms, forward)| ms / forward)),
        }
    }
}

/// Codes the run at each rate. `poses`: where the renders were drawn.
pub fn measure(
    context: &mut Context,
    run: &Run,
    poses: &[Pose],
    done: impl Fn(),
) -> anyhow::Result<Vec<Row>> {
    let (width, height) = (run.frames[0].width, run.frames[0].height);
    let (tables, portable) =
        (context.scene.coder_tables().clone(), context.engine.device().portable);
    let setup = ResidualSetup { width, height, tune: Tune::Psnr, tables, portable };
    let mut encoder = ResidualEncoder::new(&setup);
    let mut decoder = ResidualDecoder::new(width, height, &setup.tables);
    let plan = FilterPlan::new(context.engine.vulkan(), &context.scene)?;
    let mut filter = plan.filter(width, height)?;
    let count = run.frames.len() as f64;
    let mut rows = Vec::new();
    for (name, rate) in RATES {
        let (mut codings, mut payload, mut psnr) = (0.0, 0.0, 0.0);
        let (mut encodings, mut decodings) = (Vec::new(), Vec::new());
        let mut filterings = Vec::new();
        for (i, (frame, render)) in run.frames.iter().zip(&run.renders).enumerate() {
            let forward = context.forward.measure(&context.shots[i].camera, &poses[i])?;
            let [mut encode, mut decode, mut filtering] = [[0.0; REPEATS]; 3];
            let repeats = encode.iter_mut().zip(&mut decode).zip(&mut filtering);
            for ((encode, decode), filtering) in repeats {
                let (coded, ms) = timed(|| Ok(encoder.encode(frame, render, rate, 0)?))?;
                *encode = ms;
                let mut shown = render.clone();
                let ((), ms) = timed(|| Ok(decoder.add(&coded.residual, portable, &mut shown)?))?;
                *decode = ms;
                let step = decoder.step().map_or(0, Step::index);
                let filtered = || Ok(filter.apply(step, &render.data, &mut shown)?);
                *filtering = timed(filtered)?.1;
                let share = 1.0 / (count * REPEATS as f64);
                codings += f64::from(coded.probes) * share;
                psnr += coded.psnr * share;
                payload += coded.residual.payload().len() as f64 * share;
            }
            encodings.push((median(encode), forward));
            decodings.push((median(decode), forward));
            filterings.push((median(filtering), forward));
        }
        let [encode, decode, filter] =
            [&encodings, &decodings, &filterings].map(|times| Time::of(times));
        rows.push(Row { rate: name, codings, payload, psnr, encode, decode, filter });
        done();
    }
    Ok(rows)
}

pub fn print(rows: &[Row]) {
    println!("the wavelet coder's time; forward renders are those just before");
    let columns = [
        "rate",
        "codings",
        "payload",
        "psnr",
        "encode_ms",
        "encode_in_forward_renders",
        "decode_ms",
        "decode_in_forward_renders",
        "filter_ms",
        "filter_in_forward_renders",
    ];
    table(rows).only(&columns).print();
}

pub fn write(path: &Path, rows: &[Row]) -> anyhow::Result<()> {
    table(rows).write_csv(path)
}

fn table(rows: &[Row]) -> Table {
    let renders = |time: &Time| fixed(time.in_forward_renders.median, 3);
    let renders_p95 = |time: &Time| fixed(time.in_forward_renders.p95, 3);
    Table::of(
        rows,
        &[
            ("rate", &|r| r.rate.to_owned()),
            ("codings", &|r| fixed(r.codings, 3)),
            ("payload", &|r| fixed(r.payload, 3)),
            ("psnr", &|r| fixed(r.psnr, 3)),
            ("encode_ms", &|r| fixed(r.encode.ms.median, 3)),
            ("encode_in_forward_renders", &|r| renders(&r.encode)),
            ("encode_in_forward_renders_p95", &|r| renders_p95(&r.encode)),
            ("decode_ms", &|r| fixed(r.decode.ms.median, 3)),
            ("decode_in_forward_renders", &|r| renders(&r.decode)),
            ("decode_in_forward_renders_p95", &|r| renders_p95(&r.decode)),
            ("filter_ms", &|r| fixed(r.filter.ms.median, 3)),
            ("filter_in_forward_renders", &|r| renders(&r.filter)),
            ("filter_in_forward_renders_p95", &|r| renders_p95(&r.filter)),
        ],
    )
}

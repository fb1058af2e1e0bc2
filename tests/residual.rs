//! Difference pictures at a rate: what is coded is within it, is what the decoder gets, and says so.

use nvsprior::coder_tables::Tables;
use nvsprior::packet::{Residual, residual_part_len};
use nvsprior::residual::{
    CodedResidual, ResidualDecoder, ResidualEncoder, ResidualError, ResidualSetup,
};
use nvsprior::{Picture, Rate};

fn encoder() -> ResidualEncoder {
    ResidualEncoder::new(&ResidualSetup::new(96, 64))
}

/// A textured picture, and a render of it that is blurred, off in brightness, and blind to a blob.
fn sample() -> (Picture, Picture) {
    let (width, height) = (96, 64);
    let mut frame = Picture::new(width, height);
    let mut render = Picture::new(width, height);
    for i in 0..(width * height * 3) as usize {
        let (x, y, c) = (i / 3 % 96, i / 288, i % 3);
        let (fx, fy) = (x as f64, y as f64);
        let smooth = 110.0 + 60.0 * (0.09 * fx).sin() + 30.0 * (0.13 * fy + c as f64).cos();
        let noise = ((x * 7919 + y * 104_729) % 13) as f64 - 6.0;
        let blob = if (fx - 60.0).hypot(fy - 30.0) < 12.0 { 45.0 } else { 0.0 };
        frame.data[i] = (smooth + noise + blob) as u8;
        render.data[i] = (smooth * 0.94) as u8;
    }
    (frame, render)
}

/// What every coded residual must be: what its own numbers say, and what the decoder will get.
fn check_honest(coded: &CodedResidual, frame: &Picture, render: &Picture) {
    let mut shown = render.clone();
    let tables = Tables::generic();
    let mut decoder = ResidualDecoder::new(render.width, render.height, &tables);
    assert_eq!(decoder.add(&coded.residual, true, &mut shown), Ok(()));
    assert_eq!(shown, *coded.reconstruction);
    assert_eq!(coded.psnr, frame.psnr(coded.reconstruction));
}

fn part_len(residual: &Residual) -> usize {
    match residual {
        Residual::None | Residual::Omitted => 0,
        coded => residual_part_len(coded.payload().len()),
    }
}

#[test]
fn a_budget_is_never_exceeded_and_well_used() {
    let (frame, render) = sample();
    let overhead = 31;
    let mut encoder = encoder();
    let finest = encoder.encode(&frame, &render, Rate::Quality(100.0), 0).unwrap().psnr;
    let mut last = f64::NEG_INFINITY;
    for budget in (0..4000).step_by(53) {
        let coded = encoder.encode(&frame, &render, Rate::Bytes(budget), overhead).unwrap();
        check_honest(&coded, &frame, &render);
        let used = part_len(&coded.residual);
        assert!(used == 0 || overhead + used <= budget, "{used} of {budget}");
        assert_eq!(coded.reached, coded.residual != Residual::Omitted);
        if used > 0 {
            // The better picture is kept, if it is a little shorter.
            let share = 0.95;
            // At its finest, a coder has no use for more.
            let finest = coded.psnr > finest - 0.5;
            let min = share * (budget - overhead) as f64 - 12.0;
            assert!(finest || used as f64 > min, "{used} of {budget}");
            // Not quite monotone: a quantiser step may cost bytes and gain nothing.
            assert!(coded.psnr > last - 0.3, "{budget}: {} after {last}", coded.psnr);
            last = coded.psnr;
        } else {
            assert_eq!(last, f64::NEG_INFINITY, "nothing coded for {budget} bytes");
        }
    }
    assert!(last > frame.psnr(&render) + 8.0);
}

#[test]
fn the_wavelet_coder_has_no_cliff() {
    let (frame, render) = sample();
    let mut encoder = encoder();
    let mut last = frame.psnr(&render);
    for budget in 6..200 {
        let psnr = encoder.encode(&frame, &render, Rate::Bytes(budget), 0).unwrap().psnr;
        // The first few coefficients bring the picture's brightness.
        let jump = if budget < 20 { 4.0 } else { 0.8 };
        assert!((psnr - last).abs() < jump, "{budget} bytes: {psnr} after {last}");
        last = psnr;
    }
}

/// Smooth noise at octaves from 2 to 32 pixels, as natural pictures have it.
fn natural(x: f64, y: f64) -> f64 {
    let hash = |x: f64, y: f64, octave: u32| {
        let n = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
        let n = (n ^ octave.wrapping_mul(0xC2B2_AE3D)).wrapping_mul(0x27D4_EB2F);
        f64::from((n ^ n >> 15).wrapping_mul(0x2C1B_3C6D) >> 16) / 65_536.0 - 0.5
    };
    let octave = |octave: u32| {
        let size = f64::from(1 << octave);
        let (x, y) = (x / size, y / size);
        let (u, v) = (x.fract(), y.fract());
        let at = |dx: f64, dy: f64| hash(x.floor() + dx, y.floor() + dy, octave);
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t * t * (3.0 - 2.0 * t);
        size.sqrt() * mix(mix(at(0.0, 0.0), at(1.0, 0.0), u), mix(at(0.0, 1.0), at(1.0, 1.0), u), v)
    };
    (1..=5).map(octave).sum()
}

/// If the pose is wrong, most blocks of a fine picture are better off without the render's details, but not those of a
/// coarse picture.
#[test]
fn few_bytes_help_at_a_wrong_pose_too() {
    let (width, height) = (192, 128);
    let (mut frame, mut render) = (Picture::new(width, height), Picture::new(width, height));
    for i in 0..frame.data.len() {
        let (x, y) = ((i / 3 % 192) as f64 + 64.0, (i / 576) as f64 + 64.0);
        frame.data[i] = (116.0 + 12.0 * natural(x, y)) as u8;
        render.data[i] = (108.0 + 12.0 * natural(x + 5.0, y + 4.0)) as u8;
    }
    let setup = ResidualSetup::new(width, height);
    let mut encoder = ResidualEncoder::new(&setup);
    let alone = frame.psnr(&render);
    let mut last = alone;
    for budget in 8..100 {
        let coded = encoder.encode(&frame, &render, Rate::Bytes(budget), 0).unwrap();
        check_honest(&coded, &frame, &render);
        assert!(part_len(&coded.residual) <= budget);
        assert!(coded.psnr >= last - 0.2, "{budget} bytes: {} after {last}", coded.psnr);
        assert!(budget < 14 || coded.psnr > alone + 1.0, "{budget} bytes: {}", coded.psnr);
        last = coded.psnr;
    }
}

#[test]
fn no_room_and_no_need_are_told_apart() {
    let (frame, render) = sample();
    let mut encoder = encoder();
    let coded = encoder.encode(&frame, &render, Rate::Bytes(50), 50).unwrap();
    assert_eq!((coded.residual, coded.reached), (Residual::Omitted, false));
    assert_eq!(*coded.reconstruction, render);
    let coded = encoder.encode(&frame, &frame, Rate::Bytes(5000), 50).unwrap();
    assert_eq!((coded.residual, coded.reached), (Residual::None, true));
}

#[test]
fn a_target_is_reached_with_few_bytes() {
    let (frame, render) = sample();
    let alone = frame.psnr(&render);
    let mut encoder = encoder();
    let (mut last, mut last_len) = (0.0, 0);
    for target in [alone - 1.0, alone + 1.0, alone + 3.0, alone + 6.0, alone + 10.0, 44.0] {
        let coded = encoder.encode(&frame, &render, Rate::Psnr(target), 0).unwrap();
        check_honest(&coded, &frame, &render);
        assert!(coded.reached && coded.psnr >= target, "{} for {target}", coded.psnr);
        let len = part_len(&coded.residual);
        // In short payloads, one coefficient more or less counts for more.
        if len > 100 {
            assert!(coded.psnr <= target + 0.05, "{} for {target}", coded.psnr);
        }
        assert!(coded.psnr >= last && len >= last_len);
        assert_eq!(len == 0, target < alone);
        (last, last_len) = (coded.psnr, len);
    }
}

#[test]
fn a_target_out_of_reach_gives_the_best_and_says_so() {
    let (frame, render) = sample();
    let mut encoder = encoder();
    let coded = encoder.encode(&frame, &render, Rate::Psnr(90.0), 0).unwrap();
    assert!(!coded.reached);
    check_honest(&coded, &frame, &render);
    let best = coded.psnr;
    let finest = encoder.encode(&frame, &render, Rate::Quality(100.0), 0).unwrap();
    assert!(best >= finest.psnr - 0.01, "{best}, {}", finest.psnr);
}

#[test]
fn quality_is_one_coding() {
    let (frame, render) = sample();
    let mut encoder = encoder();
    let mut last = 0;
    for quality in [0.0, 10.0, 30.0, 80.0] {
        let coded = encoder.encode(&frame, &render, Rate::Quality(quality), 0).unwrap();
        assert_eq!(coded.probes, 1);
        check_honest(&coded, &frame, &render);
        assert!(part_len(&coded.residual) > last);
        last = part_len(&coded.residual);
    }
}

#[test]
fn refuses_bad_rates_and_sizes() {
    let (frame, render) = sample();
    let mut encoder = encoder();
    for rate in [Rate::Quality(f32::NAN), Rate::Quality(100.5), Rate::Psnr(f64::NAN)] {
        assert!(matches!(encoder.encode(&frame, &render, rate, 0), Err(ResidualError::Rate(_))));
    }
    let small = Picture::new(8, 8);
    let refused = encoder.encode(&frame, &small, Rate::Quality(50.0), 0).err();
    let size = ResidualError::Size { expected: (96, 64), found: (8, 8) };
    assert_eq!(refused, Some(size));
    let broken = Picture { data: vec![0; 5], ..render.clone() };
    let refused = encoder.encode(&broken, &render, Rate::Quality(50.0), 0).err();
    assert_eq!(refused, Some(ResidualError::Shape { width: 96, height: 64, bytes: 5 }));
}

//! Videos, made by the programs that decode them: every frame comes once, with its time, upright, and those for a
//! mapping are chosen.

mod making;

use std::path::Path;

use making::{Making, PAN, decoders, pan, rotate, shade};
use nvsprior::image::Converter;
use nvsprior_inputs::locked_folder::FolderError;
use nvsprior_inputs::progress::Progress;
use nvsprior_inputs::video::{
    ChoiceOptions, Decoder, DecoderChoice, Ended, FrameRecord, FrameSize, Record, Video,
    VideoError, VideoFrame, frames_for_mapping, rgb,
};

fn choice(decoder: Decoder) -> DecoderChoice {
    match decoder {
        Decoder::Gstreamer => DecoderChoice::Gstreamer,
        Decoder::Ffmpeg => DecoderChoice::Ffmpeg,
    }
}

fn all_frames(path: &Path, decoder: Decoder, size: FrameSize) -> (Vec<VideoFrame>, Ended) {
    let video = Video::open(path, choice(decoder)).unwrap();
    let mut reader = video.read(size).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = reader.next_frame().unwrap() {
        frames.push(frame);
    }
    (frames, reader.ended().unwrap().clone())
}

fn mean(frame: &VideoFrame) -> f64 {
    let (width, height) = frame.size();
    let picture = rgb(&mut Converter::new(width, height).unwrap(), frame).unwrap();
    picture.data.iter().map(|value| f64::from(*value)).sum::<f64>() / picture.data.len() as f64
}

#[test]
fn every_frame_comes_once_with_its_time() {
    let making = Making::new();
    let times: Vec<f64> = (0..20).map(|i| f64::from(i) * 0.1).collect();
    let steady = making.video("steady 1.mp4", (0..20).map(|i| shade(64, 36, i)), 10.0);
    // Frames at 0, 0.1, … 0.9, then three times as far apart.
    let uneven: Vec<f64> = (0..20)
        .map(|i| if i < 10 { 0.1 * f64::from(i) } else { 0.3 * f64::from(i) - 2.0 })
        .collect();
    let varies = making.uneven(&steady, "varies.mkv", "if(lt(N,10),N/10,N*0.3-2)/TB");
    for decoder in decoders() {
        for (video, times) in [(&steady, &times), (&varies, &uneven)] {
            let (frames, ended) = all_frames(video, decoder, FrameSize::Full);
            assert_eq!((frames.len(), ended), (20, Ended::Whole), "{decoder:?} {video:?}");
            for (i, (frame, time)) in frames.iter().zip(times).enumerate() {
                assert_eq!((frame.index, frame.size()), (i, (64, 36)));
                assert!((frame.time - time).abs() < 0.0011, "{decoder:?} {i}: {}", frame.time);
                let expected = making::level(i as u32);
                assert!((mean(frame) - expected).abs() < 3.0, "{decoder:?} {i}: {}", mean(frame));
            }
        }
    }
}

/// The times of a video's frames.
fn times(frames: &[VideoFrame]) -> Vec<f64> {
    frames.iter().map(|frame| (1e3 * frame.time).round() / 1e3).collect()
}

#[test]
fn every_frame_counts_whatever_its_time_is() {
    let making = Making::new();
    let place = |i: u32| making::wall((8 * i, 0), 0);
    let coded = making.video("coded.mp4", (0..24).map(place), 10.0);
    let video = making.in_order(&coded, "in order.mp4");
    let at = |step: f64, start: f64| (0..24).map(move |i| start + step * f64::from(i));
    let steady: Vec<f64> = times_of(at(0.1, 0.0));
    let cases = [
        ("back.mkv", "if(gte(N\\,12)\\,TS-1/TB\\,TS)", steady.clone(), "the times of 1"),
        ("far back.mkv", "if(gte(N\\,12)\\,TS-1.2/TB\\,TS)", steady.clone(), "the times of 12 "),
        ("zero.mkv", "0", steady.clone(), "the times of 23 "),
        ("late.mkv", "TS+3600/TB", steady.clone(), ""),
        ("forth.mkv", "if(gte(N\\,12)\\,TS+7200/TB\\,TS)", Vec::new(), ""),
    ];
    let made = cases.map(|(name, filter, expected, said)| {
        (making.remade(&video, name, filter), expected, said)
    });
    let bare = making.bare(&video, "bare.mjpeg");
    let bare = (bare, times_of(at(0.04, 0.0)), "a bare stream has no times: 25 frames");
    for (path, expected, said) in made.into_iter().chain([bare]) {
        let mut found = Vec::new();
        for decoder in decoders() {
            let (frames, ended) = all_frames(&path, decoder, FrameSize::Full);
            assert_eq!((frames.len(), ended), (24, Ended::Whole), "{decoder:?} {path:?}");
            for (i, frame) in frames.iter().enumerate() {
                let [off, other] = [i, i + 1].map(|i| off(frame, &place(i as u32)));
                let own = frame.index == i && off < 8.0 && off < 0.5 * other;
                assert!(own, "{decoder:?} {path:?} {i}: {off} {other}");
            }
            let times = times(&frames);
            assert!(times.is_sorted_by(|a, b| a < b), "{decoder:?} {path:?}: {times:?}");
            assert!(expected.is_empty() || times == expected, "{decoder:?} {path:?}: {times:?}");
            found.push(times);
            // No word of a video that is cut off.
            let video = Video::open(&path, choice(decoder)).unwrap();
            let mut reader = video.read(FrameSize::Full).unwrap();
            while reader.next_frame().unwrap().is_some() {}
            let notes = video.told(&reader, *found.last().unwrap().last().unwrap()).join("\n");
            assert_eq!(notes.is_empty(), said.is_empty(), "{decoder:?} {path:?}: {notes}");
            assert!(notes.contains(said) && !notes.contains("cut off"), "{decoder:?}: {notes}");
        }
        assert!(found.windows(2).all(|pair| pair[0] == pair[1]), "{path:?}: {found:?}");
    }
}

fn times_of(times: impl Iterator<Item = f64>) -> Vec<f64> {
    times.map(|time| (1e3 * time).round() / 1e3).collect()
}

/// Pictures of one video with good times and with times that jump are the same, by both decoders.
#[test]
fn frames_for_a_mapping_do_not_depend_on_times_that_jump() {
    let making = Making::new();
    let pan = making.video("coded.mp4", (0..40).map(|i| pan(i, 0)), 10.0);
    let steady = making.in_order(&pan, "dive.mp4");
    let back = making.remade(&steady, "dive.mkv", "if(gte(N\\,20)\\,TS-1.5/TB\\,TS)");
    let cut = std::fs::read(&back).unwrap();
    making.write("cut.mkv", &cut[..cut.len() * 7 / 10]);
    let mut all: Vec<Vec<(String, f64, Vec<u8>)>> = Vec::new();
    for decoder in decoders() {
        let options = ChoiceOptions { decoder: choice(decoder), ..ChoiceOptions::default() };
        for (name, said) in [("dive.mp4", ""), ("dive.mkv", "the times of")] {
            let (record, notes) = choose(&making, &[name], &options);
            assert_eq!(notes.is_empty(), said.is_empty(), "{decoder:?} {name}: {notes:?}");
            assert!(notes.join("\n").contains(said), "{notes:?}");
            assert!(!notes.join("\n").contains("cut off"), "{notes:?}");
            let bytes = |file: &str| std::fs::read(making.path("frames").join(file)).unwrap();
            let time = |time: f64| (1e3 * time).round() / 1e3;
            let frames = record.frames.iter();
            let frames = frames.map(|of| (of.file.clone(), time(of.time), bytes(&of.file)));
            all.push(frames.collect());
        }
        if decoder == Decoder::Ffmpeg {
            let (_, notes) = choose(&making, &["cut.mkv"], &options);
            assert!(notes.join("\n").contains("is cut off"), "{notes:?}");
        }
    }
    assert!(all[0].len() > 3);
    for other in &all[1..] {
        assert!(*other == all[0], "{:?}", all.iter().map(Vec::len).collect::<Vec<_>>());
    }
}

#[test]
fn the_longest_track_that_moves_is_taken_and_told() {
    let making = Making::new();
    let video = making.video("plain.mp4", (0..20).map(|i| shade(64, 36, i)), 10.0);
    for (name, scale) in [("small.mkv", "scale=32:18"), ("large.mkv", "scale=96:54")] {
        let covered = making.covered(name, &video, scale);
        for decoder in decoders() {
            let (frames, ended) = all_frames(&covered, decoder, FrameSize::Full);
            let found = (frames.len(), frames[0].size(), ended);
            assert_eq!(found, (20, (64, 36), Ended::Whole), "{decoder:?} {name}");
            let notes = Video::open(&covered, choice(decoder)).unwrap().notes;
            let said = match decoder {
                Decoder::Gstreamer => "track of pictures 1 is taken",
                Decoder::Ffmpeg => "track 1 (h264, 64×36) is taken",
            };
            assert!(notes.len() == 1 && notes[0].contains(said), "{notes:?}");
            assert!(Video::open(&video, choice(decoder)).unwrap().notes.is_empty());
            let reduced = all_frames(&covered, decoder, FrameSize::AtMost(40)).0;
            assert_eq!((reduced.len(), reduced[0].size().0), (20, 40), "{decoder:?} {name}");
        }
    }
    let covered = making.covered("cover.mp4", &video, "scale=32:18");
    for decoder in decoders() {
        assert_eq!(all_frames(&covered, decoder, FrameSize::Full).0.len(), 20, "{decoder:?}");
    }
}

/// How far a frame is off a picture, mean of all values.
fn off(frame: &VideoFrame, expected: &image::RgbImage) -> f64 {
    let (width, height) = frame.size();
    let picture = rgb(&mut Converter::new(width, height).unwrap(), frame).unwrap();
    let off = std::iter::zip(&picture.data, expected.as_raw()).map(|(a, b)| a.abs_diff(*b));
    off.map(u64::from).sum::<u64>() as f64 / picture.data.len() as f64
}

#[test]
fn interlaced_videos_give_one_picture_for_each_frame() {
    let making = Making::new();
    // The camera moves by so many pixels from one field to the next.
    let field = |t: u32, step: u32| making::wall((step * t, 0), 0);
    let first = |i: u32, step: u32| making::woven(&field(2 * i, step), &field(2 * i + 1, step));
    let second = |i: u32, step: u32| making::woven(&field(2 * i + 1, step), &field(2 * i, step));
    let even = making.video("even first.mp4", (0..12).map(|i| first(i, 3)), 10.0);
    let odd = making.video("odd first.mp4", (0..12).map(|i| second(i, 3)), 10.0);
    let still = making.video("still.mp4", (0..12).map(|_| field(0, 0)), 10.0);
    let [flagged, still] = [(&even, "flagged.mp4"), (&still, "flagged still.mkv")]
        .map(|(video, name)| making.flagged(video, name));
    for (video, step, late) in [(&even, 3, 0), (&odd, 3, 1), (&flagged, 3, 0), (&still, 0, 0)] {
        let mut found = Vec::new();
        for decoder in decoders() {
            let notes = Video::open(video, choice(decoder)).unwrap().notes;
            assert!(notes.len() == 1 && notes[0].starts_with("interlaced"), "{video:?}: {notes:?}");
            for size in [FrameSize::Full, FrameSize::AtMost(320)] {
                let (frames, ended) = all_frames(video, decoder, size);
                assert_eq!((frames.len(), ended), (12, Ended::Whole), "{decoder:?} {video:?}");
                for (i, frame) in frames.iter().enumerate() {
                    assert!((frame.time - 0.1 * i as f64).abs() < 0.0011, "{}", frame.time);
                    let whole = field(2 * i as u32 + late, step);
                    let combed = making::woven(&whole, &field(2 * i as u32 + 1 - late, step));
                    let combs = std::iter::zip(combed.as_raw(), whole.as_raw());
                    let combs = combs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>() as f64
                        / whole.as_raw().len() as f64;
                    let off = off(frame, &whole);
                    assert!(off < 2.0 + 0.3 * combs, "{decoder:?} {video:?} {i}: {off} {combs}");
                }
                found.push(frames.iter().map(VideoFrame::luma).collect::<Vec<_>>());
            }
        }
        assert!(found.windows(2).all(|pair| pair[0] == pair[1]), "{video:?}");
    }
    making.video("fast.mp4", (0..24).map(|i| first(i, 9)), 10.0);
    let (record, notes) = choose(&making, &["fast.mp4"], &ChoiceOptions::default());
    assert!(notes.is_empty() && record.frames.len() > 1, "{notes:?} {record:?}");
}

#[test]
fn videos_of_whole_pictures_are_not_taken_for_interlaced() {
    let making = Making::new();
    let noise = |seed: u32| move |x: u32, y: u32| (x * 7919 + y * 104_729 + seed * 31_337) % 61;
    let with_noise = |i: u32, mut picture: image::RgbImage| {
        let noise = noise(i * i + 3);
        let add = |value: &mut u8, more: u32| *value = value.saturating_add(more as u8);
        picture.enumerate_pixels_mut().for_each(|(x, y, pixel)| add(&mut pixel.0[1], noise(x, y)));
        picture
    };
    // Rows that are dark and bright by turns, as a ribbed wall has them.
    let ribbed = |i: u32, y: u32| {
        let mut picture = making::wall((4 * i, y), 0);
        picture.rows_mut().step_by(2).flatten().for_each(|pixel| pixel.0 = pixel.0.map(|v| v / 2));
        picture
    };
    let frames: [(&str, &dyn Fn(u32) -> image::RgbImage); 8] = [
        ("slow", &|i| making::wall((i, 0), 0)),
        ("fast", &|i| making::wall((23 * i, 5 * i), 0)),
        ("down", &|i| making::wall((0, i), 0)),
        ("still", &|i| with_noise(i, making::wall((0, 0), 0))),
        ("noise", &|i| with_noise(i, making::wall((2 * i, i), 0))),
        ("ribbed", &|i| ribbed(i, 0)),
        ("faster", &|i| making::wall((i * i, 0), 0)),
        ("cuts", &|i| making::wall((i, 0), i / 3)),
    ];
    for (name, frame) in frames {
        let video = making.video(&format!("{name}.mp4"), (0..12).map(frame), 10.0);
        for decoder in decoders() {
            let notes = Video::open(&video, choice(decoder)).unwrap().notes;
            assert!(notes.is_empty(), "{decoder:?} {name}: {notes:?}");
        }
    }
}

#[test]
fn rotated_videos_come_upright() {
    let making = Making::new();
    let video = making.video("lies.mp4", (0..4).map(|_| making::halves(64, 36)), 10.0);
    for (turn, size, dark) in [
        (0, (64, 36), "left"),
        (90, (36, 64), "top"),
        (180, (64, 36), "right"),
        (270, (36, 64), "bottom"),
    ] {
        let turned = rotate(&video, turn);
        for decoder in decoders() {
            let (frames, _) = all_frames(&turned, decoder, FrameSize::Full);
            assert_eq!(frames[0].size(), size, "{decoder:?} {turn}");
            let luma = frames[0].luma();
            let at = |x: u32, y: u32| luma[(y * size.0 + x) as usize] < 100;
            let sides = [
                ("left", at(2, size.1 / 2)),
                ("right", at(size.0 - 3, size.1 / 2)),
                ("top", at(size.0 / 2, 2)),
                ("bottom", at(size.0 / 2, size.1 - 3)),
            ];
            let found: Vec<&str> =
                sides.iter().filter(|(_, dark)| *dark).map(|(side, _)| *side).collect();
            assert!(found.contains(&dark), "{decoder:?} {turn}: {found:?}");
            let opposite = ["left", "right", "top", "bottom"]
                .into_iter()
                .find(|side| making::opposite(dark) == *side);
            assert!(!found.contains(&opposite.unwrap()), "{decoder:?} {turn}: {found:?}");
        }
    }
}

#[test]
fn odd_sizes_and_wide_pixels_are_read_and_reduced() {
    let making = Making::new();
    let Some(odd) = making.odd("odd.mkv") else { return };
    for decoder in decoders() {
        let (frames, ended) = all_frames(&odd, decoder, FrameSize::Full);
        // 51 × 37 pixels, each twice as wide as high.
        assert_eq!((frames.len(), ended, frames[0].size()), (5, Ended::Whole, (102, 37)));
        let (small, _) = all_frames(&odd, decoder, FrameSize::AtMost(40));
        let (width, height) = small[0].size();
        assert!(width == 40 && (14..=15).contains(&height), "{decoder:?}: {width}×{height}");
    }
}

#[test]
fn frames_that_are_asked_for_are_those_of_the_whole_video() {
    let making = Making::new();
    let steady = making.video("steady.mkv", (0..230).map(|i| shade(64, 36, i % 20)), 10.0);
    let whole = std::fs::read(&steady).unwrap();
    making.write("short.mkv", &whole[..whole.len() * 7 / 10]);
    let times = "if(lt(N,10),N/10,N*0.3-2)/TB";
    let varies = making.uneven(&making.path("steady.mp4"), "varies.mkv", times);
    for video in [steady, rotate(&making.path("steady.mp4"), 90), varies, making.path("short.mkv")]
    {
        for decoder in decoders() {
            let (all, ended) = all_frames(&video, decoder, FrameSize::Full);
            let asked = [3, 4, 57, 110, 225];
            let opened = Video::open(&video, choice(decoder)).unwrap();
            let mut reader = opened.read_some(FrameSize::Full, &asked).unwrap();
            let mut some = Vec::new();
            while let Some(frame) = reader.next_frame().unwrap() {
                some.push(frame);
            }
            for number in asked.into_iter().filter(|number| *number < all.len()) {
                let frame = some.iter().find(|frame| frame.time == all[number].time).unwrap();
                assert!(frame.luma() == all[number].luma(), "{decoder:?} {video:?} {number}");
            }
            assert_eq!(reader.ended(), Some(&ended), "{video:?}");
            let few = some.len() <= asked.len() + 3;
            assert!(few || decoder == Decoder::Gstreamer, "{} of {}", some.len(), all.len());
        }
    }
}

#[test]
fn what_is_no_video_is_told() {
    let making = Making::new();
    let open = |name: &str, decoder| Video::open(&making.path(name), choice(decoder));
    making.write("text.mp4", b"no video at all\n");
    making.write("empty.mp4", b"");
    making.video("whole.mp4", (0..30).map(|i| shade(64, 36, i)), 10.0);
    let whole = std::fs::read(making.path("whole.mp4")).unwrap();
    // Its index lies at its end.
    making.write("cut.mp4", &whole[..whole.len() / 2]);
    making.sound("sound.mkv");
    for decoder in decoders() {
        let program = decoder.program();
        let text = open("text.mp4", decoder).unwrap_err().to_string();
        assert!(
            text.contains("text.mp4: no frame can be read") && text.contains(program),
            "{text}"
        );
        let text = open("cut.mp4", decoder).unwrap_err().to_string();
        assert!(text.contains("cut off before its index was written"), "{text}");
        assert!(matches!(open("empty.mp4", decoder), Err(VideoError::Empty { .. })));
        assert!(matches!(open("none.mp4", decoder), Err(VideoError::File { .. })));
        assert!(matches!(open("sound.mkv", decoder), Err(VideoError::NoPictures { .. })));
    }
}

fn choose(making: &Making, videos: &[&str], options: &ChoiceOptions) -> (Record, Vec<String>) {
    let videos: Vec<_> = videos.iter().map(|name| making.path(name)).collect();
    let mut notes = Vec::new();
    let chosen = frames_for_mapping(&videos, &making.path("frames"), options, &mut |progress| {
        if let Progress::Warns(note) = progress {
            notes.push(note);
        }
    });
    (chosen.unwrap(), notes)
}

/// Where the pan's camera is in a frame, in widths of the picture.
fn along(index: usize) -> f64 {
    PAN * index as f64
}

#[test]
fn frames_of_a_pan_overlap_as_wanted() {
    let making = Making::new();
    making.video("pan.mp4", (0..60).map(|i| pan(i, 0)), 10.0);
    for decoder in decoders() {
        let options = ChoiceOptions { decoder: choice(decoder), ..ChoiceOptions::default() };
        let (record, notes) = choose(&making, &["pan.mp4"], &options);
        assert!(notes.is_empty() && record.finished, "{notes:?}");
        let common = |pair: &[&FrameRecord]| 1.0 - (along(pair[1].index) - along(pair[0].index));
        let first: Vec<_> = record.frames.iter().filter(|frame| frame.first).collect();
        assert!((4..=8).contains(&first.len()), "{decoder:?}: {first:?}");
        assert!(first.windows(2).all(|pair| (0.55..0.9).contains(&common(pair))), "{first:?}");
        // All of the 60 frames show something new.
        assert_eq!(record.frames.len(), 60, "{decoder:?}");
        for pair in record.frames.iter().collect::<Vec<_>>().windows(2) {
            let (expected, found) = (common(pair), pair[1].overlap.unwrap());
            assert!((found - expected).abs() < 0.05, "{decoder:?}: {found} for {expected}");
            assert!((pair[1].time - 0.1 * pair[1].index as f64).abs() < 0.0011);
        }
        for frame in &record.frames {
            let picture = image::open(making.path("frames").join(&frame.file)).unwrap().to_rgb8();
            assert_eq!(picture.dimensions(), making::SIZE);
            let drawn = pan(frame.index as u32, 0);
            let off: u64 = std::iter::zip(picture.as_raw(), drawn.as_raw())
                .map(|(a, b)| u64::from(a.abs_diff(*b)))
                .sum();
            let off = off as f64 / drawn.as_raw().len() as f64;
            assert!(off < 6.0, "{decoder:?} {}: {off}", frame.file);
        }
    }
}

#[test]
fn a_folder_of_frames_is_kept_until_something_changes() {
    let making = Making::new();
    making.video("pan.mp4", (0..40).map(|i| pan(i, 0)), 10.0);
    making.video("other pan.mp4", (40..60).map(|i| pan(i, 0)), 10.0);
    let both = ["pan.mp4", "other pan.mp4"];
    let options = ChoiceOptions::default();
    let (first, _) = choose(&making, &both, &options);
    let names: Vec<_> = first.frames.iter().map(|frame| frame.file.clone()).collect();
    assert!(names.is_sorted() && names[0].starts_with("01-pan/"), "{names:?}");
    assert!(names.last().unwrap().starts_with("02-other_pan/"), "{names:?}");
    let marked = making.path("frames").join(&names[0]);
    std::fs::write(&marked, "marked").unwrap();
    assert_eq!(choose(&making, &both, &options).0, first);
    assert_eq!(std::fs::read(&marked).unwrap(), b"marked", "it was written again");
    // A picture is gone; the run before was cut off; other options.
    let record = making.path("frames/frames.json");
    let unfinished = std::fs::read_to_string(&record)
        .unwrap()
        .replace("\"finished\": true", "\"finished\": false");
    std::fs::remove_file(&marked).unwrap();
    assert_eq!(choose(&making, &both, &options).0, first);
    assert!(marked.is_file());
    std::fs::write(&marked, "marked").unwrap();
    std::fs::write(&record, unfinished).unwrap();
    assert_eq!(choose(&making, &both, &options).0, first);
    assert_ne!(std::fs::read(&marked).unwrap(), b"marked");
    let (few, _) = choose(&making, &both, &ChoiceOptions { most: Some(3), ..options });
    assert!((2..=3).contains(&few.frames.len()), "{few:?}");
    let left = std::fs::read_dir(making.path("frames/01-pan")).unwrap().count();
    assert!(left < 3, "{left} pictures of runs before");
    // Somebody else's folder.
    std::fs::create_dir(making.path("mine")).unwrap();
    making.write("mine/notes.txt", b"mine");
    let error =
        frames_for_mapping(&[making.path("pan.mp4")], &making.path("mine"), &options, &mut |_| {});
    assert!(matches!(error, Err(VideoError::Folder(FolderError::Foreign { .. }))), "{error:?}");
}

#[test]
fn cuts_blur_and_ends_before_the_end_are_said() {
    let making = Making::new();
    // Two places, one after the other.
    let cut = (0..20).map(|i| pan(i, 0)).chain((0..20).map(|i| pan(i, 1)));
    making.video("cut.mp4", cut, 10.0);
    making.video("blurred.mp4", (0..40).map(|i| making::blurred(&pan(i, 0), 4.0)), 10.0);
    making.video("whole.mkv", (0..60).map(|i| pan(i, 0)), 10.0);
    let whole = std::fs::read(making.path("whole.mkv")).unwrap();
    making.write("short.mkv", &whole[..whole.len() * 6 / 10]);
    making.resized("sizes.mkv", &making.video("pan.mp4", (0..30).map(|i| pan(i, 0)), 10.0));
    for decoder in decoders() {
        let options = ChoiceOptions { decoder: choice(decoder), ..ChoiceOptions::default() };
        let said = |video: &str| {
            let (record, notes) = choose(&making, &[video], &options);
            (record, notes.join("\n"))
        };
        let (_, notes) = said("cut.mp4");
        assert!(notes.contains("breaks between 1.90 s and 2.0"), "{decoder:?}: {notes}");
        let (_, notes) = said("blurred.mp4");
        assert!(notes.contains("hardly any frame is sharp"), "{decoder:?}: {notes}");
        let (record, notes) = said("sizes.mkv");
        match decoder {
            Decoder::Gstreamer => {
                assert!(notes.contains("change their size after 2.9 s"), "{notes}")
            }
            Decoder::Ffmpeg => {
                assert_eq!((record.videos[0].frames, record.videos[0].width), (60, 640))
            }
        }
        let (record, notes) = said("short.mkv");
        assert!(notes.contains("cut off"), "{decoder:?}: {notes}");
        let last = record.videos[0].last;
        assert!((2.0..5.0).contains(&last) && record.frames.len() > 1, "{decoder:?}: {last}");
    }
}

//! From videos to a folder of pictures for a mapping. Each video is decoded twice: small, to choose its frames, and
//! whole, to write them.

use std::path::{Path, PathBuf};
use std::time::Instant;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use nvsprior::Camera;
use nvsprior::image::Converter;

use super::analysis::{Analysis, Facts, WIDTH};
use super::decoder::FrameSize;
use super::estimate::VideoEstimate;
use super::folder::{Asked, AskedVideo, Folder, FrameRecord, Record, VideoRecord, folder_name};
use super::frame::{VideoFrame, rgb};
use super::reader::VideoReader;
use super::select::{Break, Cause, ChoiceOptions, Overlap, Selection, add_frames, select};
use super::{Video, VideoError};
use crate::progress::{Progress, Watch};

/// JPEG's quality: it takes away less than the video's coder has, and PNG takes several times the disk.
const QUALITY: u8 = 95;
/// What is said of a video whose frames have little detail.
const BLURRED: &str = "hardly any frame is sharp, so the map may fail or be blurred; record with more light or a \
    shorter exposure, move more slowly, and clean and focus the lens";
/// Frames are written as large as they are, up to the largest picture that is read again.
const WHOLE: FrameSize = FrameSize::AtMost(Camera::MAX_SIDE);

/// Chooses frames of videos, one after the other, and writes them into a folder, unless an earlier run has.
pub fn frames_for_mapping(
    videos: &[PathBuf],
    folder: &Path,
    options: &ChoiceOptions,
    watch: Watch,
) -> Result<Record, VideoError> {
    let asked = Asked {
        videos: videos.iter().map(|path| AskedVideo::of(path)).collect::<Result<_, _>>()?,
        decoder: format!("{:?}", options.decoder).to_lowercase(),
        overlap: options.overlap,
        most: options.most,
    };
    if folder.is_dir() {
        let folder = Folder::open(folder)?;
        if folder.has(&asked) {
            return Ok(folder.record);
        }
    }
    // All are looked at before hours of work.
    let mut opened = Vec::new();
    for path in videos {
        let video = Video::open(path, options.decoder)?;
        describe(&video, watch);
        opened.push(video);
    }
    let mut folder = Folder::open(folder)?;
    let estimate = VideoEstimate::of(&opened, options);
    let unknown = "how long it takes cannot be told: the video does not say how long it is";
    watch(Progress::Says(estimate.as_ref().map_or(unknown.into(), VideoEstimate::text)));
    let (mut found, began) = (Vec::new(), Instant::now());
    for video in &opened {
        found.push(choose(video, watch)?);
    }
    let selections = select_all(&found, &asked);
    if let Some(estimate) = estimate {
        let frames = selections.iter().map(|selection| selection.choices.len()).sum();
        let left = estimate.chosen(frames, began.elapsed().as_secs_f64());
        watch(Progress::Says(left));
    }
    write(&mut folder, asked, &opened, (found, selections), watch)?;
    Ok(folder.record.clone())
}

/// Tells what is known of a video.
fn describe(video: &Video, watch: Watch) {
    let (name, header) = (video.name(), &video.header);
    let length = video.duration.map_or("unknown length".into(), |length| format!("{length:.1} s"));
    watch(Progress::Says(format!("{name}: {}×{}, {length}", header.width, header.height)));
    watch(Progress::Says(format!("  {}", video.command)));
    for note in &video.notes {
        watch(Progress::Says(format!("{name}: {note}")));
    }
    if header.high_dynamic_range {
        watch(Progress::Warns(format!(
            "{name}: high dynamic range (PQ or HLG) is taken as it is, so pictures look pale; a video of standard \
             range suits better"
        )));
    }
    if !video.others.is_empty() {
        watch(Progress::Says(format!(
            "{name}: other tracks are left alone: {}; the time stamps in frames.json join them later",
            video.others.join(", ")
        )));
    }
}

/// What was found out of a video.
struct VideoFacts {
    facts: Vec<Facts>,
    aspect: f64,
    notes: Vec<String>,
    /// Frames have the times that the decoder gives them.
    timed: bool,
}

/// Decodes a video at a small size, and judges its frames.
fn choose(video: &Video, watch: Watch) -> Result<VideoFacts, VideoError> {
    watch(Progress::Begins(format!("{}: choosing frames", video.name())));
    let mut reader = video.read(FrameSize::AtMost(WIDTH))?;
    let header = *reader.header();
    let mut analysis = Analysis::default();
    let mut facts = Vec::new();
    while let Some(frame) = reader.next_frame()? {
        facts.push(analysis.judge(&frame));
        watch(Progress::At(video.share(frame.time)));
    }
    watch(Progress::Ends);
    let notes = video.told(&reader, facts.last().map_or(0.0, |facts| facts.time));
    for note in &notes {
        watch(Progress::Warns(note.clone()));
    }
    let aspect = f64::from(header.height) / f64::from(header.width);
    Ok(VideoFacts { facts, aspect, notes, timed: reader.mended() == 0 })
}

/// Decodes the videos again, and writes what was chosen.
fn write(
    folder: &mut Folder,
    asked: Asked,
    videos: &[Video],
    (found, selections): (Vec<VideoFacts>, Vec<Selection>),
    watch: Watch,
) -> Result<(), VideoError> {
    let mut records = Vec::new();
    for (number, (video, found)) in videos.iter().zip(&found).enumerate() {
        let Selection { breaks, blurred, .. } = &selections[number];
        let mut notes = found.notes.clone();
        let blurred = blurred.then(|| format!("{}: {BLURRED}", video.name()));
        for note in told(video, breaks).into_iter().chain(blurred) {
            watch(Progress::Warns(note.clone()));
            notes.push(note);
        }
        let last = found.facts.last();
        records.push(VideoRecord {
            path: video.path.to_string_lossy().into_owned(),
            folder: folder_name(number, video),
            decoder: video.decoder.program().to_owned(),
            width: video.header.width,
            height: video.header.height,
            frames: last.map_or(0, |facts| facts.index + 1),
            last: last.map_or(0.0, |facts| facts.time),
            notes,
            other_tracks: video.others.clone(),
        });
    }
    let first = |selection: &Selection| selection.choices.iter().filter(|of| of.first).count();
    let count: usize = selections.iter().map(first).sum();
    if count < 2 {
        return Err(VideoError::TooFew { path: videos[0].path.clone(), found: count });
    }
    folder.begin(Record { finished: false, asked, videos: records, frames: Vec::new() })?;
    for (number, (video, found)) in videos.iter().zip(&found).enumerate() {
        let frames = write_video(folder, (number, video), found, &selections[number], watch)?;
        let missing = selections[number].choices.len() - frames.len();
        if missing > 0 {
            let name = video.name();
            let note = format!("{name}: {missing} chosen frames at its end cannot be read again");
            watch(Progress::Warns(note.clone()));
            folder.record.videos[number].notes.push(note);
        }
        folder.record.frames.extend(frames);
    }
    folder.record.finished = true;
    Ok(folder.write()?)
}

/// Divides the most that is wanted by what each video would have without it.
fn select_all(found: &[VideoFacts], asked: &Asked) -> Vec<Selection> {
    let wanted = Overlap::about(asked.overlap);
    let by = |found: &VideoFacts, most| select(&found.facts, found.aspect, &wanted, most);
    let mut all: Vec<Selection> = found.iter().map(|found| by(found, None)).collect();
    let count: usize = all.iter().map(|selection| selection.choices.len()).sum();
    for (found, selection) in found.iter().zip(&mut all) {
        let own = selection.choices.len();
        let most = asked.most.map(|most| (own * most / count.max(1)).max(1));
        if most.is_some_and(|most| most < own) {
            *selection = by(found, most);
        }
        add_frames(selection, &found.facts, found.aspect, (&wanted, most));
    }
    all
}

/// What is said of the places where a dive breaks, if there are any.
fn told(video: &Video, breaks: &[Break]) -> Option<String> {
    /// Of more breaks, only the number is told.
    const TOLD: usize = 5;
    let each = |Break { from, to, overlap, cause }: &Break| {
        let why = match cause {
            Cause::Jump => "the picture jumps",
            Cause::Blur => "all frames between are blurred",
        };
        format!("between {from:.2} s and {to:.2} s ({why}, {:.0} % in common)", 100.0 * overlap)
    };
    let places: Vec<String> = breaks.iter().take(TOLD).map(each).collect();
    let others = breaks.len().saturating_sub(TOLD);
    let others = if others > 0 { format!(", and {others} more times") } else { String::new() };
    (!breaks.is_empty()).then(|| {
        format!(
            "{}: the dive breaks {}{others}: unless other frames join the parts, only the largest is mapped; film a \
             way from one to the other",
            video.name(),
            places.join(", ")
        )
    })
}

fn write_video(
    folder: &Folder,
    (number, video): (usize, &Video),
    found: &VideoFacts,
    selection: &Selection,
    watch: Watch,
) -> Result<Vec<FrameRecord>, VideoError> {
    watch(Progress::Begins(format!("{}: writing frames", video.name())));
    let numbers: Vec<usize> =
        selection.choices.iter().map(|choice| found.facts[choice.at].index).collect();
    // A time that was mended depends on all frames before it.
    let mut by_number = found.timed;
    let numbers = if by_number { &numbers[..] } else { &[] };
    let mut reader = video.read_some(WHOLE, numbers)?;
    let (width, height) = (reader.header().width, reader.header().height);
    let unreadable = |error: nvsprior::image::PixelError| VideoError::NoFrame {
        path: video.path.clone(),
        said: error.to_string(),
    };
    let mut converter = Converter::new(width, height).map_err(unreadable)?;
    let mut frames = Vec::new();
    for choice in &selection.choices {
        let facts = &found.facts[choice.at];
        let mut frame = at(&mut reader, facts.time)?;
        if by_number && !frame.as_ref().is_some_and(|frame| frame.time <= facts.time + CLOSE) {
            // Of a damaged video a decoder may count other frames than before.
            (reader, by_number) = (video.read(WHOLE)?, false);
            frame = at(&mut reader, facts.time)?;
        }
        let Some(frame) = frame else { break };
        let file = format!("{}/{:06}.jpg", folder.record.videos[number].folder, facts.index);
        let picture = rgb(&mut converter, &frame).map_err(unreadable)?;
        write_jpeg(&folder.path.join(&file), &picture)?;
        watch(Progress::At(video.share(frame.time)));
        frames.push(FrameRecord {
            file,
            video: number,
            index: facts.index,
            time: facts.time,
            sharpness: facts.sharpness,
            overlap: choice.overlap,
            first: choice.first,
        });
    }
    watch(Progress::Ends);
    Ok(frames)
}

/// Times are rounded to microseconds.
const CLOSE: f64 = 2e-6;

/// Reads on to the frame of a time. Of a damaged video a decoder may give other frames than before.
fn at(reader: &mut VideoReader, time: f64) -> Result<Option<VideoFrame>, VideoError> {
    while let Some(frame) = reader.next_frame()? {
        if frame.time >= time - CLOSE {
            return Ok(Some(frame));
        }
    }
    Ok(None)
}

fn write_jpeg(path: &Path, picture: &nvsprior::Picture) -> Result<(), VideoError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode(&picture.data, picture.width, picture.height, ExtendedColorType::Rgb8)
        .map_err(std::io::Error::other)
        .and_then(|()| std::fs::write(path, bytes))
        .map_err(VideoError::write(path))
}

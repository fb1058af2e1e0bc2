//! What is known of a video before it is decoded: its length, and its tracks.

use std::io::Read;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use super::decoder::{Decoder, file_uri, protocol};
use crate::child::Running;

/// Between two looks at whether it fails.
const LOOK: Duration = Duration::from_millis(500);
/// How long a try may take.
const PATIENCE: Duration = Duration::from_secs(6);

/// What a video's file says of itself; not more than the decoder's programs find out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Probe {
    /// Seconds.
    pub duration: Option<f64>,
    /// About.
    pub frames: Option<f64>,
    /// The program's name of the codec.
    pub codec: String,
    /// The track that is taken, by its number; and what is said of the choice, if there is one.
    pub track: Option<usize>,
    pub choice: Option<String>,
    /// Frames per second.
    pub rate: Option<f64>,
    /// It is a bare stream, which has no times.
    pub untimed: bool,
    /// Whether there is a track of pictures, if that is known.
    pub has_video: Option<bool>,
    /// Tracks that are neither pictures nor sound, such as subtitles with positions.
    pub others: Vec<String>,
}

impl Probe {
    /// Asks the decoder's program; what it does not tell stays unknown.
    pub fn of(decoder: Decoder, video: &Path) -> Probe {
        match decoder {
            Decoder::Ffmpeg => ffprobe(video).unwrap_or_default(),
            Decoder::Gstreamer => gstreamer(video),
        }
    }
}

fn ffprobe(video: &Path) -> Option<Probe> {
    // The first packets tell which tracks move.
    let words = "-v error -of json -count_packets -read_intervals %+#200 -show_entries \
        format=format_name,start_time,duration:stream=index,codec_type,codec_name,codec_tag_string,width,height,\
        duration,nb_frames,nb_read_packets,avg_frame_rate:stream_disposition=attached_pic";
    let mut command = Command::new("ffprobe");
    command.args(words.split(' ')).arg(protocol(video));
    let (text, _) = said_by(command, |_| false);
    parse_ffprobe(&text)
}

/// FFmpeg's names of formats that have no times.
const BARE: [&str; 8] = ["h264", "hevc", "mjpeg", "m4v", "mpegvideo", "h263", "vc1", "obu"];

fn parse_ffprobe(text: &str) -> Option<Probe> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    let streams = json["streams"].as_array()?;
    let kind = |stream: &serde_json::Value| stream["codec_type"].as_str().unwrap_or("").to_owned();
    let pictures = |stream: &&serde_json::Value| {
        kind(stream) == "video" && stream["disposition"]["attached_pic"] != 1
    };
    let others = streams.iter().filter_map(|stream| {
        let kind = kind(stream);
        let name = ["codec_name", "codec_tag_string"].iter().find_map(|key| stream[key].as_str());
        let other = !["video", "audio", ""].contains(&kind.as_str());
        other.then(|| format!("{kind} ({})", name.unwrap_or("unknown")))
    });
    let tracks: Vec<_> = streams.iter().filter(pictures).collect();
    let (video, choice) = longest(&tracks).unzip();
    let own = video.and_then(|stream| seconds(&stream["duration"]));
    let format = string(&json["format"]["format_name"]);
    // Matroska's length counts from 0, whenever its first frame comes.
    let start = seconds(&json["format"]["start_time"]).filter(|_| format.contains("matroska"));
    let all = seconds(&json["format"]["duration"]).map(|end| end - start.unwrap_or(0.0));
    let duration = own.or(all);
    let counted = video.and_then(|stream| seconds(&stream["nb_frames"]));
    let rate = video.and_then(|stream| ratio(stream["avg_frame_rate"].as_str()?));
    let codec = video.and_then(|stream| stream["codec_name"].as_str()).unwrap_or_default();
    Some(Probe {
        duration,
        frames: counted.or_else(|| Some(duration? * rate?)),
        codec: codec.to_owned(),
        track: video.and_then(|stream| Some(stream["index"].as_u64()? as usize)),
        choice: choice.flatten(),
        rate,
        untimed: BARE.contains(&format) || format.ends_with("_pipe"),
        has_video: Some(video.is_some()),
        others: others.collect(),
    })
}

/// A number above zero that ffprobe writes as text.
fn seconds(value: &serde_json::Value) -> Option<f64> {
    value.as_str()?.parse().ok().filter(|seconds: &f64| seconds.is_finite() && *seconds > 0.0)
}

/// The longest track of pictures that moves, and what is said of it if there are others. Of those that are nearly as
/// long, the largest; of those, the first.
fn longest<'a>(
    tracks: &[&'a serde_json::Value],
) -> Option<(&'a serde_json::Value, Option<String>)> {
    /// So much of the longest is nearly as long.
    const NEARLY: f64 = 0.9;
    let length = |track: &serde_json::Value| seconds(&track["duration"]).unwrap_or(0.0);
    let moves =
        |track: &serde_json::Value| seconds(&track["nb_read_packets"]).is_none_or(|n| n > 1.0);
    let side = |track: &serde_json::Value, key: &str| track[key].as_u64().unwrap_or(0);
    let area = |track: &serde_json::Value| side(track, "width") * side(track, "height");
    let most = tracks.iter().filter(|of| moves(of)).map(|of| length(of)).fold(0.0, f64::max);
    let worth = |track: &serde_json::Value| {
        let suits = moves(track) && length(track) >= NEARLY * most;
        (suits, area(track))
    };
    let best = tracks.iter().rev().copied().max_by_key(|track| worth(track))?;
    let said = (tracks.len() > 1).then(|| {
        let name = |track: &serde_json::Value| {
            let [width, height] = ["width", "height"].map(|key| side(track, key));
            format!("{} ({}, {width}×{height})", track["index"], string(&track["codec_name"]))
        };
        let others = tracks.iter().copied().filter(|of| of["index"] != best["index"]);
        let others: Vec<String> = others.map(name).collect();
        let others = others.join(", ");
        format!("track {} is taken, the longest that moves, not {others}", name(best))
    });
    Some((best, said))
}

fn string(value: &serde_json::Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// GStreamer's command-line program tells lengths only while it plays, so it plays a moment. Now and then it hangs, or
/// misses to tell a track's kind; then it is asked again.
fn gstreamer(video: &Path) -> Probe {
    const TIMES: usize = 4;
    let mut probe = Probe::default();
    for _ in 0..TIMES {
        let (found, ended) = gstreamer_once(video);
        probe = found;
        // What it cannot read it will not read next time.
        if probe.has_video.is_some() || (ended && probe.duration.is_none()) {
            break;
        }
    }
    probe
}

/// What it tells, and whether it ended or was ended in time.
fn gstreamer_once(video: &Path) -> (Probe, bool) {
    let words = format!(
        "-v --force-position urisourcebin uri={} ! parsebin ! fakesink silent=false sync=true",
        file_uri(video)
    );
    let mut command = Command::new(Decoder::Gstreamer.program());
    command.args(words.split(' '));
    let (text, ended) = said_by(command, |text| text.lines().any(|line| position(line).is_some()));
    (parse_gstreamer(&text), ended)
}

fn parse_gstreamer(text: &str) -> Probe {
    let mut probe = Probe::default();
    let (mut tracks, mut whole): (Vec<&str>, Vec<&str>) = Default::default();
    for line in text.split(['\n', '\r']) {
        probe.duration = probe.duration.or_else(|| position(line));
        // Pads of the bin that parses, or of what follows it.
        let Some((pad, caps)) = line.split_once(": caps = ") else { continue };
        let kind = caps.split([',', ' ']).next().unwrap_or_default();
        if pad.contains("GstTypeFindElement") {
            whole.push(kind);
        }
        let parsed = pad.contains("GstParsePad") || pad.contains("fakesink");
        if parsed && kind != "NULL" && !tracks.contains(&kind) {
            tracks.push(kind);
        }
    }
    let is_video = |kind: &&str| kind.starts_with("video/") || kind.starts_with("image/");
    if !tracks.is_empty() {
        probe.has_video = Some(tracks.iter().any(is_video));
    }
    probe.codec = tracks.iter().find(|kind| is_video(kind)).copied().unwrap_or_default().to_owned();
    let rate = text.split_once("framerate=(fraction)").map_or("", |(_, rest)| rest);
    probe.rate = ratio(rate.split([',', ' ', '\n', '\r']).next().unwrap_or_default());
    // Nothing was taken apart to find the track.
    probe.untimed = whole.contains(&probe.codec.as_str());
    // The length counts from 0, whenever the first frame comes.
    let start = text.split_once("pts: ").and_then(|(_, rest)| clock(rest.split(',').next()?));
    let length = probe.duration.map(|end| end - start.unwrap_or(0.0));
    probe.duration = length.filter(|length| *length > 0.0);
    probe.frames = probe.duration.zip(probe.rate).map(|(seconds, rate)| seconds * rate);
    let others = tracks.iter().filter(|kind| !is_video(kind) && !kind.starts_with("audio/"));
    probe.others = others.map(|kind| (*kind).to_owned()).collect();
    probe
}

/// The value of a fraction such as `30000/1001`.
fn ratio(text: &str) -> Option<f64> {
    let (above, below) = text.split_once('/')?;
    let value = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

/// The length that a line such as `0:00:00.1 / 0:01:00.0 (0.2 %)` has, seconds.
fn position(line: &str) -> Option<f64> {
    let (_, rest) = line.split_once(" / ")?;
    let (length, _) = rest.split_once(" (")?;
    clock(length).filter(|seconds| *seconds > 0.0)
}

/// Seconds of a time such as `0:01:00.0`.
fn clock(text: &str) -> Option<f64> {
    let mut seconds = 0.0;
    let parts: Vec<&str> = text.split(':').collect();
    if parts.len() != 3 {
        return None;
    }
    for part in parts {
        seconds = 60.0 * seconds + part.trim().parse::<f64>().ok()?;
    }
    Some(seconds).filter(|seconds: &f64| seconds.is_finite())
}

/// What a program says on standard output until it ends or fails, or `enough` has been said; and whether that was
/// before patience ended.
fn said_by(command: Command, enough: impl Fn(&str) -> bool) -> (String, bool) {
    let Ok((mut running, mut output)) = Running::with_output(command) else {
        return (String::new(), true);
    };
    let (sender, pieces) = channel();
    let reader = std::thread::spawn(move || {
        let mut piece = [0; 4096];
        while let Ok(read @ 1..) = output.read(&mut piece) {
            if sender.send(piece[..read].to_vec()).is_err() {
                return;
            }
        }
    });
    let (mut said, end) = (Vec::new(), Instant::now() + PATIENCE);
    let mut ended = false;
    while !ended && Instant::now() < end {
        match pieces.recv_timeout(LOOK) {
            Ok(piece) => said.extend(piece),
            Err(RecvTimeoutError::Timeout) if !running.is_failing() => {}
            Err(_) => ended = true,
        }
        ended |= enough(&String::from_utf8_lossy(&said).replace('\r', "\n"));
    }
    running.kill();
    drop(pieces);
    // It ends with the pipe.
    let _ = reader.join();
    (String::from_utf8_lossy(&said).into_owned(), ended)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ffprobe_tells_tracks_and_length() {
        let text = r#"{"streams": [
            {"codec_name": "mjpeg", "codec_type": "video", "disposition": {"attached_pic": 1}},
            {"codec_name": "h264", "codec_type": "video", "duration": "12.5", "avg_frame_rate": "30000/1001",
             "disposition": {"attached_pic": 0}},
            {"codec_name": "aac", "codec_type": "audio"},
            {"codec_tag_string": "gpmd", "codec_type": "data"}], "format": {"duration": "13.0"}}"#;
        let probe = parse_ffprobe(text).unwrap();
        assert_eq!((probe.duration, probe.has_video), (Some(12.5), Some(true)));
        assert_eq!(probe.others, ["data (gpmd)"]);
        assert_eq!((probe.codec.as_str(), probe.frames.map(f64::round)), ("h264", Some(375.0)));
        let late = r#""format": {"format_name": "matroska,webm", "start_time": "9.0", "duration"#;
        let late =
            text.replace("\"duration\": \"12.5\", ", "").replace("\"format\": {\"duration", late);
        let probe = parse_ffprobe(&late).unwrap();
        assert_eq!((probe.duration, probe.rate.map(f64::round)), (Some(4.0), Some(30.0)));
        let counted = text.replace("\"duration\": \"12.5\"", "\"nb_frames\": \"300\"");
        assert_eq!(parse_ffprobe(&counted).unwrap().frames, Some(300.0));
        let sound = r#"{"streams": [{"codec_type": "audio"}], "format": {}}"#;
        assert_eq!(parse_ffprobe(sound).unwrap().has_video, Some(false));
        assert_eq!(parse_ffprobe("{"), None);
        let track = |number: usize, packets: usize, seconds: &str, width: usize| {
            format!(
                r#"{{"index": {number}, "codec_type": "video", "codec_name": "h264", "nb_read_packets": "{packets}",
                "duration": "{seconds}", "width": {width}, "height": 90}}"#
            )
        };
        // A cover, a preview, the video, a longer one that is a single picture.
        for (tracks, taken) in [
            ([track(0, 1, "0.1", 900), track(1, 90, "9.9", 160), track(2, 90, "9.8", 640)], 2),
            ([track(0, 50, "99", 160), track(1, 50, "9", 640), track(3, 1, "99", 640)], 0),
            ([track(0, 50, "N/A", 640), track(1, 50, "N/A", 640), track(3, 1, "N/A", 900)], 0),
        ] {
            let text = format!(r#"{{"streams": [{}], "format": {{}}}}"#, tracks.join(", "));
            let probe = parse_ffprobe(&text).unwrap();
            assert_eq!(probe.track, Some(taken), "{text}");
            let choice = probe.choice.unwrap();
            assert!(choice.starts_with(&format!("track {taken} (h264, ")), "{choice}");
        }
    }

    #[test]
    fn gstreamer_tells_tracks_and_length() {
        let text = "/GstPipeline:pipeline0/GstFakeSink:fakesink0.GstPad:sink: caps = video/x-h264, level=(string)3, \
            framerate=(fraction)10/1, parsed=(boolean)true\n\
            /GstPipeline:pipeline0/GstParseBin:p.GstParsePad:src_1.GstProxyPad:proxypad4: caps = text/x-raw, a\n\
            /GstPipeline:pipeline0/GstURISourceBin:u.GstGhostPad:src_0: caps = video/quicktime, variant=iso\n\
            0:00:00.0 / 99:99:99.9\r0:00:00.1 / 0:20:05.5 (0.2 %)\r";
        let probe = parse_gstreamer(text);
        assert_eq!((probe.duration, probe.has_video), (Some(1205.5), Some(true)));
        assert_eq!(probe.others, ["text/x-raw"]);
        assert_eq!((probe.rate, probe.untimed), (Some(10.0), false));
        assert_eq!((probe.codec.as_str(), probe.frames), ("video/x-h264", Some(12_055.0)));
        let late = text.replace(
            "video/x-h264,",
            "a\n last-message = chain (9 bytes, dts: none, pts: 0:20:00.5, b",
        );
        assert_eq!(parse_gstreamer(&late).duration, Some(5.0));
        let bare = "/GstURISourceBin:u/GstTypeFindElement:t.GstPad:src: caps = image/jpeg, width=(int)64\n\
            /GstPipeline:p/GstFakeSink:fakesink0.GstPad:sink: caps = image/jpeg, width=(int)64\n";
        assert!(parse_gstreamer(bare).untimed);
        assert_eq!(parse_gstreamer(""), Probe::default());
    }
}

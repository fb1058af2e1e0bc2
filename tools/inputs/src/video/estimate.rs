//! How long the way from videos to poses takes, before a frame is decoded.

use super::Video;
use super::decoder::Decoder;
use super::select::{ChoiceOptions, LEAST, MANY};
use crate::estimate::{PoseEstimate, cores, minutes, range, slower};

// Seconds of one core, measured on x86-64 cores of 2026 with H.264.
/// To decode and judge a million pixels.
const CHOOSE: f64 = 3.4e-3;
/// To decode them again, and take the frames that were chosen; GStreamer gives all of them.
const WRITE_FFMPEG: f64 = 2.1e-3;
const WRITE_GSTREAMER: f64 = 5.3e-3;
/// To decode a byte of the file, beside that.
const BYTE: f64 = 6.5e-8;
/// H.265 takes 1.7 times as long as H.264, VP9 2.1 times.
const OTHER_CODEC: f64 = 2.0;
/// Beside other work on the machine it takes so many times as long, at most.
const BUSY: f64 = 3.0;
/// Frames that are taken per second of a video if neighbours have 70 % in common: of a slow camera, and of a fast one.
const TAKEN: [f64; 2] = [0.1, 1.0];

/// What is expected of videos. Seconds on a machine without other work.
pub struct VideoEstimate {
    frames: f64,
    choose: f64,
    write: f64,
    /// Frames that are taken, at least and at most.
    taken: [usize; 2],
    size: (u32, u32),
    longest: u32,
}

impl VideoEstimate {
    /// `None` if the length of one is not known.
    pub fn of(videos: &[Video], options: &ChoiceOptions) -> Option<VideoEstimate> {
        let first = videos.first()?;
        let size = (first.header.width, first.header.height);
        let longest = options.matched;
        let mut all =
            VideoEstimate { frames: 0.0, choose: 0.0, write: 0.0, taken: [0; 2], size, longest };
        let mut seconds = 0.0;
        for video in videos {
            let (frames, header) = (video.frames?, &video.header);
            let codec = if video.codec.contains("h264") { 1.0 } else { OTHER_CODEC };
            let pixels = 1e-6 * f64::from(header.width) * f64::from(header.height);
            let work = |pixel: f64| {
                codec * (frames * pixels * pixel + video.bytes as f64 * BYTE) / cores()
            };
            let write = match video.decoder {
                Decoder::Ffmpeg => WRITE_FFMPEG,
                Decoder::Gstreamer => WRITE_GSTREAMER,
            };
            all.frames += frames;
            all.choose += work(CHOOSE);
            all.write += work(write);
            seconds += video.duration?;
        }
        let most = options.most.unwrap_or(usize::MAX).min(all.frames as usize).max(2);
        let denser = 0.3 / (1.0 - options.overlap.max(MANY));
        let (least, rate) = (LEAST.min(most), |rate: f64| (rate * denser * seconds).round());
        all.taken = TAKEN.map(|taken| (rate(taken) as usize).clamp(least, most));
        Some(all)
    }

    /// Before the first frame is decoded.
    pub fn text(&self) -> String {
        let busy = |seconds: f64| range([seconds, BUSY * seconds]);
        let poses = self.taken.map(|frames| self.poses(frames));
        let [least, most] = self.taken;
        format!(
            "about {:.0} frames: {} to choose some, {} to write them, and {} for the poses of {least} to {most} of \
             them (--frames N takes at most N); then the training, which tells its time after its first steps",
            self.frames,
            busy(self.choose),
            busy(self.write),
            range([poses[0], BUSY * poses[1]]),
        )
    }

    /// After so many frames were chosen in so many seconds.
    pub fn chosen(&self, frames: usize, seconds: f64) -> String {
        let slower = slower(seconds, self.choose);
        format!(
            "{frames} frames are taken: about {} left to write them, and {} for their poses",
            minutes(slower * self.write),
            minutes(slower * self.poses(frames)),
        )
    }

    fn poses(&self, frames: usize) -> f64 {
        PoseEstimate::of_video(frames, self.size, self.longest).seconds()
    }
}

#[cfg(test)]
mod tests {
    use nvsprior::image::Colour;

    use super::super::matroska::Header;
    use super::*;

    fn video(codec: &str, decoder: Decoder) -> Video {
        let colour = Colour::Bt601Full;
        Video {
            path: "dive.mp4".into(),
            decoder,
            way: Default::default(),
            header: Header { colour, ..Header::of_size(1920, 1080) },
            duration: Some(1_200.0),
            frames: Some(30_000.0),
            codec: codec.into(),
            bytes: 1_000_000_000,
            others: Vec::new(),
            notes: Vec::new(),
            command: String::new(),
        }
    }

    #[test]
    fn longer_videos_and_other_codecs_take_longer() {
        let options = ChoiceOptions::default();
        let of = |videos: &[Video]| VideoEstimate::of(videos, &options).unwrap();
        let one = of(&[video("h264", Decoder::Ffmpeg)]);
        // 30,000 frames of 2.07 million pixels, and a gigabyte.
        assert!((one.choose * cores() - 276.5).abs() < 1.0, "{}", one.choose);
        assert_eq!(one.taken, [450, 4_500]);
        assert!((of(&[video("hevc", Decoder::Ffmpeg)]).choose / one.choose - 2.0).abs() < 1e-9);
        assert!(of(&[video("h264", Decoder::Gstreamer)]).write > 1.5 * one.write);
        let two = [video("h264", Decoder::Ffmpeg), video("h264", Decoder::Ffmpeg)];
        assert!((of(&two).write / one.write - 2.0).abs() < 1e-9);
        let few = ChoiceOptions { most: Some(50), ..options };
        assert_eq!(VideoEstimate::of(&two, &few).unwrap().taken, [50, 50]);
        let unknown = Video { frames: None, ..video("h264", Decoder::Ffmpeg) };
        assert!(VideoEstimate::of(&[unknown], &options).is_none());
    }

    #[test]
    fn what_was_seen_corrects_what_is_left() {
        let videos = [video("h264", Decoder::Ffmpeg)];
        let mut estimate = VideoEstimate::of(&videos, &ChoiceOptions::default()).unwrap();
        (estimate.choose, estimate.write) = (120.0, 80.0);
        let text = estimate.text();
        assert!(
            text.starts_with("about 30000 frames: 2 min to 6 min to choose some, 80 s to 4 min"),
            "{text}"
        );
        assert!(estimate.chosen(498, 120.0).contains("498 frames are taken: about 80 s left"));
        assert!(estimate.chosen(498, 570.0).contains("about 5 min left"));
    }
}

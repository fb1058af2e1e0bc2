//! Key frames as text: the CSV beside a prior, and the words of a comment.

use super::KeyFrames;
use crate::Pose;
use crate::prior::PriorError;

/// The first line of a file of key frames.
const HEADER: &str = "qw,qx,qy,qz,tx,ty,tz";

/// Columns of a line.
const COLUMNS: usize = 7;

/// A quaternion whose length differs from 1 by less than this is kept bit for bit.
const AS_IT_STANDS: f64 = 1e-12;

impl KeyFrames {
    /// Reads the content of a file of key frames: the line `qw,qx,qy,qz,tx,ty,tz`, then seven finite numbers per line.
    /// Quaternions may have any length but zero. Allowed are blanks around numbers, line ends of either kind, and a
    /// last line without one. All else is an error, which names the line.
    pub fn from_csv(text: &str) -> Result<KeyFrames, PriorError> {
        let wrong = |line: usize, reason: String| PriorError::Line { line, reason };
        let mut lines = text.lines();
        let header = lines.next().unwrap_or_default();
        if header.trim_end() != HEADER {
            return Err(wrong(1, format!("must be {HEADER}")));
        }
        let mut poses = Vec::new();
        for (line, row) in (2..).zip(lines) {
            if poses.len() == KeyFrames::MAX {
                return Err(wrong(line, format!("more than {} key frames", KeyFrames::MAX)));
            }
            let fields: Vec<&str> = row.splitn(COLUMNS + 1, ',').map(str::trim).collect();
            let pose = pose_from_words(&fields).map_err(|reason| wrong(line, reason))?;
            super::fault(&pose).map_or(Ok(()), |reason| Err(wrong(line, reason.into())))?;
            poses.push(pose);
        }
        KeyFrames::new(poses)
    }

    /// The content of a file of key frames; [`from_csv`](Self::from_csv) gives them back unchanged.
    pub fn to_csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for pose in self.poses() {
            text += &words(pose).join(",");
            text.push('\n');
        }
        text
    }
}

/// A pose as seven numbers, qw to tz: the shortest that give the same f64.
pub fn words(pose: &Pose) -> [String; COLUMNS] {
    let ([w, x, y, z], t) = (pose.wxyz(), pose.translation);
    [w, x, y, z, t.x, t.y, t.z].map(|v| format!("{v:?}"))
}

/// Reads a pose from seven numbers, qw to tz. An error says what is wrong with them.
pub fn pose_from_words(words: &[&str]) -> Result<Pose, String> {
    if words.len() != COLUMNS {
        let found = if words.len() > COLUMNS { "more" } else { "fewer" };
        return Err(format!("{found} than {COLUMNS} numbers"));
    }
    let mut numbers = [0.0; COLUMNS];
    for ((number, word), name) in numbers.iter_mut().zip(words).zip(HEADER.split(',')) {
        *number = word.parse().map_err(|_| format!("{name} is no number: \"{}\"", short(word)))?;
    }
    let [w, x, y, z, t @ ..] = numbers;
    let pose = Pose::from_wxyz([w, x, y, z], t).ok_or("the numbers are no pose")?;
    // Such a length comes from rounding; dividing by it would change the pose with each reading.
    let rotation = glam::DQuat::from_xyzw(x, y, z, w);
    let stands = (rotation.length() - 1.0).abs() <= AS_IT_STANDS;
    Ok(if stands { Pose { rotation, ..pose } } else { pose })
}

/// The beginning of a word, for an error.
fn short(word: &str) -> String {
    word.chars().take(24).collect()
}

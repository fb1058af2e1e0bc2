//! Key frames as the words of a comment.

use crate::Pose;

/// What the numbers are called.
const NAMES: [&str; COLUMNS] = ["qw", "qx", "qy", "qz", "tx", "ty", "tz"];

const COLUMNS: usize = 7;

/// A quaternion whose length differs from 1 by less than this is kept bit for bit.
const AS_IT_STANDS: f64 = 1e-12;

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
    for ((number, word), name) in numbers.iter_mut().zip(words).zip(NAMES) {
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

//! What was done in a work folder: `steps.json`.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::locked_folder::FolderRecord;

/// A step that was begun.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Begun {
    pub arguments: Vec<String>,
    /// Whether it ended well.
    pub finished: bool,
    /// How long it took.
    #[serde(default)]
    pub seconds: f64,
}

/// The steps that were begun, in their order, and of which pictures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub pictures: String,
    /// All but the last are finished.
    pub steps: Vec<Begun>,
}

impl FolderRecord for Record {
    const FILE: &'static str = "steps.json";
    const KEPT: &'static str = "poses that were looked for before";
    const WORKER: &'static str = "another run, or a COLMAP that one left behind,";
}

/// What a record says of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It was finished with the same arguments.
    Finished,
    /// It was begun with the same arguments.
    Begun,
    /// It was begun with others.
    Other,
    New,
}

impl Record {
    pub fn standing(&self, step: usize, arguments: &[String]) -> Standing {
        match self.steps.get(step) {
            None => Standing::New,
            Some(begun) if begun.arguments != arguments => Standing::Other,
            Some(begun) if begun.finished => Standing::Finished,
            Some(_) => Standing::Begun,
        }
    }

    /// Notes that a step begins. What came after it does not count any more.
    pub fn begin(&mut self, step: usize, arguments: &[String]) {
        self.steps.truncate(step);
        self.steps.push(Begun { arguments: arguments.to_vec(), finished: false, seconds: 0.0 });
    }

    /// Notes that the last step ended well, in so much time.
    pub fn finish(&mut self, time: Duration) {
        if let Some(last) = self.steps.last_mut() {
            last.finished = true;
            last.seconds = time.as_secs_f64();
        }
    }

    /// How long a step took.
    pub fn seconds(&self, step: usize) -> f64 {
        self.steps.get(step).map_or(0.0, |step| step.seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_done_only_if_it_and_all_before_it_are() {
        let words = |text: &str| vec![text.to_owned()];
        let mut record = Record::default();
        assert_eq!(record.standing(0, &words("a")), Standing::New);
        record.begin(0, &words("a"));
        assert_eq!(record.standing(0, &words("a")), Standing::Begun);
        record.finish(Duration::from_secs(2));
        record.begin(1, &words("b"));
        record.finish(Duration::from_secs(2));
        assert_eq!(record.standing(0, &words("a")), Standing::Finished);
        assert_eq!(record.standing(1, &words("c")), Standing::Other);
        record.begin(0, &words("other"));
        assert_eq!(record.standing(0, &words("other")), Standing::Begun);
        assert_eq!(record.standing(1, &words("b")), Standing::New);
    }
}

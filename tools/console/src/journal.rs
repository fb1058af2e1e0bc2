//! What happens on a dive: a line for each event on the terminal, and one of JSON in the file of `--log`.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context;

#[derive(clap::Args, Default)]
pub struct LogArgs {
    /// Also append what happens to a file, a line of JSON for each event: time (UTC), side, event, text
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
}

pub struct Journal {
    side: &'static str,
    file: Option<(PathBuf, File)>,
    /// The last line could not be written.
    is_torn: bool,
}

impl LogArgs {
    pub fn open(&self, side: &'static str) -> anyhow::Result<Journal> {
        let open = |path: &Path| OpenOptions::new().append(true).create(true).open(path);
        let file = self.log.as_ref().map(|path| {
            let file = open(path).with_context(|| format!("--log {}", path.display()))?;
            anyhow::Ok((path.clone(), file))
        });
        Ok(Journal { side, file: file.transpose()?, is_torn: false })
    }
}

/// The time, UTC, seconds.
pub fn utc() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// A time, UTC in seconds, as people read it.
pub fn written(time: f64) -> String {
    let time = UNIX_EPOCH + Duration::try_from_secs_f64(time).unwrap_or_default();
    humantime::format_rfc3339_millis(time).to_string()
}

impl Journal {
    /// Tells what happened at a time, UTC, seconds.
    pub fn tell(&mut self, time: f64, event: &str, text: &str) {
        // Nobody may read it any more.
        let _ = writeln!(std::io::stdout(), "{} {}: {text}", written(time), self.side);
        self.note(time, event, text);
    }

    /// Tells the file alone. That it cannot be written does not end a dive.
    pub fn note(&mut self, time: f64, event: &str, text: &str) {
        let Some((path, file)) = &mut self.file else { return };
        let line = serde_json::json!({
            "time": written(time), "side": self.side, "event": event, "text": text
        });
        // What is left of a torn line ends, so that those after it can be read.
        let start = if self.is_torn { "\n" } else { "" };
        let written = file.write_all(format!("{start}{line}\n").as_bytes());
        if let Err(error) = &written
            && !self.is_torn
        {
            tell!("--log {}: {error}; the dive goes on", path.display());
        }
        self.is_torn = written.is_err();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_lines_of_json_and_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dive.jsonl");
        for text in ["one", "two \"quoted\"\n"] {
            let mut journal = LogArgs { log: Some(path.clone()) }.open("console").unwrap();
            journal.tell(1e9, "region", text);
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<serde_json::Value> =
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[1]["text"], "two \"quoted\"\n");
        assert_eq!(lines[0]["time"], "2001-09-09T01:46:40.000Z");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_ends_no_dive() {
        let mut journal = LogArgs { log: Some("/dev/full".into()) }.open("vehicle").unwrap();
        journal.tell(1e9, "slow", "one");
        journal.tell(1e9, "slow", "two");
        assert!(journal.is_torn);
        assert!(LogArgs { log: Some("/nowhere/log".into()) }.open("vehicle").is_err());
    }
}

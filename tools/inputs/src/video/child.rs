//! A running program: it does not outlive this run, and its last words are kept.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Lines of what it said that an error shows.
const LAST: usize = 4;
/// Longest line of these, characters.
const LINE: usize = 300;

pub struct Running {
    child: Child,
    said: Option<JoinHandle<String>>,
    failing: Arc<AtomicBool>,
}

impl Running {
    /// Starts a program. Gives back its standard output.
    pub fn start(program: &str, arguments: &[OsString]) -> std::io::Result<(Running, ChildStdout)> {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
        let missing = || std::io::Error::other("no pipe");
        let output = child.stdout.take().ok_or_else(missing)?;
        let errors = child.stderr.take().ok_or_else(missing)?;
        let failing = Arc::new(AtomicBool::new(false));
        let tell = failing.clone();
        let failed = move || tell.store(true, Ordering::Relaxed);
        let said = Some(std::thread::spawn(move || last_words(errors, failed)));
        Ok((Running { child, said, failing }, output))
    }

    /// Whether it has said that it fails. GStreamer's program then hangs now and then, in place of ending.
    pub fn is_failing(&self) -> bool {
        self.failing.load(Ordering::Relaxed)
    }

    /// Waits for its end, at most so long; then it is killed. Its status, and its last words.
    pub fn end(&mut self, patience: Duration) -> std::io::Result<(ExitStatus, String)> {
        let since = Instant::now();
        while self.child.try_wait()?.is_none() && since.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
        self.kill();
        let status = self.child.wait()?;
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        Ok((status, said))
    }

    pub fn kill(&mut self) {
        // It fails if the program has ended, which is as well.
        let _ = self.child.kill();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

/// The last lines that say something, of all that a program says; of GStreamer's, those that say what failed.
fn last_words(errors: impl Read, failing: impl Fn()) -> String {
    let mut lines = BufReader::new(errors);
    let (mut last, mut failed) = (VecDeque::new(), VecDeque::new());
    let mut bytes = Vec::new();
    while lines.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
        let text = String::from_utf8_lossy(&bytes).trim().to_owned();
        bytes.clear();
        match text.strip_prefix("ERROR: from element ").and_then(|text| text.split_once(": ")) {
            Some((_, what)) => {
                failing();
                keep(&mut failed, what);
            }
            None => keep(&mut last, &text),
        }
    }
    Vec::from(if failed.is_empty() { last } else { failed }).join(" / ")
}

fn keep(last: &mut VecDeque<String>, text: &str) {
    let text: String = text.chars().take(LINE).collect();
    if text.chars().any(char::is_alphanumeric) && !last.contains(&text) {
        last.push_back(text);
    }
    if last.len() > LAST {
        last.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_words_are_few_and_say_something() {
        let said = "one\n\n---\ntwo\ntwo\nthree\nfour\nfive\n";
        assert_eq!(last_words(said.as_bytes(), || ()), "two / three / four / five");
        let said = "ERROR: from element /GstPipeline:pipeline0/GstFileSrc:source: Resource not found.\n\
            Additional debug info:\n../plugins/elements/gstfilesrc.c(553): gst_file_src_start ()\n";
        assert_eq!(last_words(said.as_bytes(), || ()), "Resource not found.");
    }

    #[cfg(unix)]
    #[test]
    fn a_program_that_does_not_end_is_killed() {
        let (mut running, _output) = Running::start("sleep", &["100".into()]).unwrap();
        let (status, _) = running.end(Duration::from_millis(20)).unwrap();
        assert!(!status.success());
    }
}

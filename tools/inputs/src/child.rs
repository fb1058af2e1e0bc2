//! Programs that run beside this one: they do not outlive it, and their last words are kept.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Lines of what a program said that an error shows.
const LAST: usize = 6;
/// Longest line of these, characters.
const LINE: usize = 300;

pub struct Running {
    child: Child,
    said: Option<JoinHandle<String>>,
    failing: Arc<AtomicBool>,
}

impl Running {
    /// Starts a command. If its standard error is piped, its last words are kept. The command is dropped, so that a
    /// pipe that it holds ends with the program.
    pub fn start(mut command: Command) -> std::io::Result<Running> {
        let mut child = command.spawn()?;
        let failing = Arc::new(AtomicBool::new(false));
        let tell = failing.clone();
        let failed = move || tell.store(true, Ordering::Relaxed);
        let errors = child.stderr.take();
        let said = errors.map(|errors| std::thread::spawn(move || last_words(errors, failed)));
        Ok(Running { child, said, failing })
    }

    /// Starts a command. Gives back its standard output.
    pub fn with_output(mut command: Command) -> std::io::Result<(Running, ChildStdout)> {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut running = Running::start(command)?;
        let missing = || std::io::Error::other("no pipe");
        let output = running.child.stdout.take().ok_or_else(missing)?;
        Ok((running, output))
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

/// Runs a command to its end. If it fails, its last words are the inner error.
pub fn run(mut command: Command) -> std::io::Result<Result<(), String>> {
    let output = command.stdin(Stdio::null()).output()?;
    let said = [output.stdout, output.stderr].concat();
    let failed = || last_words(&said[..], || ());
    Ok(output.status.success().then_some(()).ok_or_else(failed))
}

/// A command as a user would type it.
pub fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

/// The last lines that say something.
#[derive(Default)]
pub struct LastWords(VecDeque<String>);

impl LastWords {
    pub fn add(&mut self, line: &str) {
        let text: String = line.trim().chars().take(LINE).collect();
        if text.chars().any(char::is_alphanumeric) && !self.0.contains(&text) {
            self.0.push_back(text);
        }
        if self.0.len() > LAST {
            self.0.pop_front();
        }
    }

    pub fn text(self) -> String {
        Vec::from(self.0).join(" / ")
    }
}

/// The last words of all that a program says; of GStreamer's, those that say what failed.
fn last_words(errors: impl Read, failing: impl Fn()) -> String {
    let mut lines = BufReader::new(errors);
    let (mut last, mut failed) = (LastWords::default(), LastWords::default());
    let mut bytes = Vec::new();
    while lines.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
        let text = without_address(String::from_utf8_lossy(&bytes).trim()).to_owned();
        bytes.clear();
        match text.strip_prefix("ERROR: from element ").and_then(|text| text.split_once(": ")) {
            Some((_, what)) => {
                failing();
                failed.add(what);
            }
            None => last.add(&text),
        }
    }
    if failed.0.is_empty() { last } else { failed }.text()
}

/// A line of FFmpeg's without the part that spoke, whose address is another in each run: `[h264 @ 0x1234] No frame!`.
fn without_address(line: &str) -> &str {
    match line.split_once("] ") {
        Some((part, said)) if part.starts_with('[') && part.contains(" @ 0x") => said,
        _ => line,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_words_are_few_and_say_something() {
        let said = "one\n\n---\ntwo\ntwo\nthree\nfour\nfive\nsix\nseven\n";
        assert_eq!(last_words(said.as_bytes(), || ()), "two / three / four / five / six / seven");
        let said = "ERROR: from element /GstPipeline:pipeline0/GstFileSrc:source: Resource not found.\n\
            Additional debug info:\n../plugins/elements/gstfilesrc.c(553): gst_file_src_start ()\n";
        assert_eq!(last_words(said.as_bytes(), || ()), "Resource not found.");
        let said = "[matroska,webm @ 0x55d517513940] File ended prematurely\n[1] no part\n";
        assert_eq!(last_words(said.as_bytes(), || ()), "File ended prematurely / [1] no part");
    }

    #[cfg(unix)]
    #[test]
    fn a_program_that_does_not_end_is_killed() {
        let mut sleep = Command::new("sleep");
        sleep.arg("100");
        let (mut running, _output) = Running::with_output(sleep).unwrap();
        let (status, _) = running.end(Duration::from_millis(20)).unwrap();
        assert!(!status.success());
    }
}

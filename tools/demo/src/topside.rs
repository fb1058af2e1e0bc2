//! The topside, in a process of its own. It has the prior and the packets, and no frame. Packets of the paper's system
//! are files that end in [`PAPER`].

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::Context;
use nvsprior::{Decoder, Engine, Picture, Prior};
use nvsprior_runs::{FrameKind, marked_png, read_png};

/// How the names of files with packets of the paper's system end.
pub const PAPER: &str = "paper";

/// The program's first argument if it is to be the topside. The second one is the prior.
pub const TOPSIDE: &str = "demo-topside";

/// The process, from the other side.
pub struct Topside {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
}

impl Topside {
    /// Starts this program once more.
    pub fn start(prior: &Path) -> anyhow::Result<Topside> {
        let program = std::env::current_exe().context("finding this program")?;
        let mut command = Command::new(program);
        command.arg(TOPSIDE).arg(prior).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().context("starting the topside")?;
        let (to, from) = (child.stdin.take(), child.stdout.take());
        let (to, from) = to.zip(from).context("the topside has no pipes")?;
        Ok(Topside { child, to, from: BufReader::new(from) })
    }

    /// Has it decode a packet to a PNG, and reads that.
    pub fn show(&mut self, packet: &Path, shown: &Path) -> anyhow::Result<Picture> {
        let line =
            |path: &Path| path.to_str().filter(|name| !name.contains('\n')).map(str::to_owned);
        let lines = line(packet).zip(line(shown));
        let (packet, shown_line) = lines.context("the folder's name must be text of one line")?;
        let asked = writeln!(self.to, "{packet}\n{shown_line}").and_then(|()| self.to.flush());
        let mut answer = String::new();
        let told = asked.and_then(|()| self.from.read_line(&mut answer));
        anyhow::ensure!(told.is_ok() && answer == "shown\n", "the topside failed at {packet}");
        Ok(read_png(shown)?)
    }

    /// Waits until it has ended.
    pub fn end(self) -> anyhow::Result<()> {
        let Topside { mut child, to, .. } = self;
        drop(to);
        let status = child.wait().context("waiting for the topside")?;
        anyhow::ensure!(status.success(), "the topside ended with {status}");
        Ok(())
    }
}

/// What the process does: reads a packet's path and a picture's, decodes, says so; until there are no more.
pub fn serve(prior: &Path) -> anyhow::Result<()> {
    let engine = Engine::new(&Default::default())?;
    let scene = engine.upload(&Prior::open(prior, &Default::default())?)?;
    let mut decoder = Decoder::new(&engine, &scene);
    let mut papers = nvsprior_paper::Decoder::new(&engine, &scene);
    let mut picture = Picture::default();
    let mut lines = std::io::stdin().lines();
    while let (Some(packet), Some(shown)) = (lines.next().transpose()?, lines.next().transpose()?) {
        let bytes = std::fs::read(&packet).with_context(|| format!("reading {packet}"))?;
        if Path::new(&packet).extension().is_some_and(|ending| ending == PAPER) {
            papers.decode(&bytes, &mut picture).with_context(|| packet.clone())?;
        } else {
            picture = decoder.decode(&bytes).with_context(|| packet.clone())?.picture;
        }
        let png = marked_png(&picture, Some(FrameKind::RECONSTRUCTION.mark()))?;
        std::fs::write(&shown, png).with_context(|| format!("writing {shown}"))?;
        writeln!(std::io::stdout(), "shown")?;
    }
    Ok(())
}

//! The whole job: runs are drawn, encoded, decoded by another process, compared, and put into tables.

use std::path::{Path, PathBuf};

use nvsprior::{Camera, Engine, Rate};
use nvsprior_basin::{Conditions, DemoFrame, Dive};
use nvsprior_runs::write_contact_sheet;

use crate::coding::{Coded, Coder, System};
use crate::table::{self, Figures, Table, TableRow};
use crate::topside::Topside;
use crate::{prior, webp};

/// What is to be done.
pub struct Job {
    /// Folder for runs, prior, packets, pictures and the table.
    pub out: PathBuf,
    pub camera: Camera,
    pub dives: Vec<Dive>,
    /// Frames of each run.
    pub frames: usize,
    /// How many of them are searched by the paper's BFGS, too.
    pub bfgs_frames: usize,
    /// Of the difference pictures.
    pub quality: f32,
}

pub fn run(job: &Job, engine: &Engine) -> anyhow::Result<()> {
    std::fs::create_dir_all(&job.out)?;
    let prior_file = job.out.join("prior.ply");
    let scene = engine.upload(&prior::write(&prior_file, &job.camera)?)?;
    let topside = Topside::start(&prior_file)?;
    let mut coder = Coder { engine, scene: &scene, camera: job.camera, topside };
    let mut tables = Vec::new();
    for dive in &job.dives {
        let of_run = job.tables(dive, &mut coder)?;
        of_run.iter().for_each(|table| say!("\n{table}"));
        tables.extend(of_run);
    }
    coder.topside.end()?;
    table::write(&job.out, &tables)?;
    say!("\nprior, runs, packets, pictures and contact sheets are in {}", job.out.display());
    Ok(())
}

/// Draws a dive into a folder of its run's name, with its camera file, as `nvsprior encode` reads it. Gives each frame
/// to `drawn` once its file is there.
pub fn draw_dive(
    out: &Path,
    camera: Camera,
    dive: &Dive,
    count: usize,
    drawn: impl FnMut(&DemoFrame),
) -> anyhow::Result<()> {
    let name = dive.run.name();
    let frames = nvsprior_basin::dive_by(camera, *dive, count, Conditions::CALM);
    Ok(nvsprior_basin::write_run(&out.join(name), name, camera, frames, drawn)?)
}

impl Job {
    fn tables(&self, dive: &Dive, coder: &mut Coder) -> anyhow::Result<Vec<Table>> {
        let name = dive.run.name();
        say!("\n{name}: {} frames are drawn and encoded", self.frames);
        let mut frames = Vec::new();
        draw_dive(&self.out, self.camera, dive, self.frames, |frame| frames.push(frame.clone()))?;
        let folder = self.out.join(name);
        let quality = Rate::Quality(self.quality);
        let Coded { figures, pictures } = coder.code(&folder, &frames, System::Ours, quality)?;
        write_contact_sheet(&self.out.join(format!("{name}.png")), &pictures)?;
        let all = self.compared(name, &frames, &figures, None)?;
        let part = self.bfgs_frames.min(self.frames);
        if part == 0 {
            return Ok(vec![all]);
        }
        say!("{name}: {part} of them by BFGS, as in the paper: it takes seconds for each");
        let (frames, figures) = (&frames[..part], &figures[..part]);
        let psnr = TableRow::mean_of("", figures).psnr;
        let bfgs = coder.code(&folder, frames, System::Papers, Rate::Psnr(psnr))?.figures;
        let compared = self.compared(name, frames, figures, Some(&bfgs))?;
        Ok(if part == self.frames { vec![compared] } else { vec![all, compared] })
    }

    /// The table of some frames: as WebP, by the paper's way if that was tried, and by ours.
    fn compared(
        &self,
        run: &'static str,
        frames: &[DemoFrame],
        ours: &[Figures],
        papers: Option<&[Figures]>,
    ) -> anyhow::Result<Table> {
        let ours = TableRow::mean_of("NVSPrior+iNVS+wavelet, gauss-newton", ours);
        let webp: anyhow::Result<Vec<Figures>> =
            frames.iter().map(|frame| webp::at_psnr(&frame.picture, ours.psnr)).collect();
        let mut rows = vec![TableRow::mean_of("WebP, at the PSNR of the last row", &webp?)];
        rows.extend(papers.map(|papers| TableRow::mean_of("NVSPrior+iNVS+WebP, bfgs", papers)));
        rows.push(ours);
        let is_part = frames.len() < self.frames;
        Ok(Table { camera: self.camera, run, frames: frames.len(), is_part, rows })
    }
}

//! All methods, and their rows.

use anyhow::Context as _;
use nvsprior::{Mode, Structure};
use nvsprior_inputs::args::progress;

use super::coders::{Coder, Method, OnPictures};
use super::estimator::Estimates;
use super::learned::{Learned, LearnedCoder, OF_DIFFERENCES, OF_FRAMES};
use super::ours::{Ours, Packets, Starts, packets};
use super::row::{Coded, ESTIMATORS, Entry, Row, SETTABLE, Setting, announce};
use super::runs::Runs;
use super::{equal, published};
use crate::bench::codecs::point::Input;
use crate::bench::codecs::run::Run;
use crate::bench::context::Context;
use crate::bench::perturbed::SHORT;

/// The method whose PSNR the others are compared at.
pub const ANCHOR: &str = "invs+webp";
/// A key frame of a stream is sent every so many frames.
const KEY_EVERY: u32 = 16;

/// What the rows are measured with.
pub struct Methods<'a> {
    context: &'a Context,
    runs: &'a Runs,
    webp: Coder,
    jpeg_xl: Result<Coder, String>,
    /// Settings of WebP and JPEG XL in all rows of the working points.
    settings: [Result<Setting, String>; 2],
}

impl<'a> Methods<'a> {
    /// Finds the working points: with them the frames alone have the PSNR that the paper reports. `set`: the set's
    /// name.
    pub fn new(context: &'a Context, runs: &'a Runs, set: &str) -> anyhow::Result<Methods<'a>> {
        let settings = ["webp", "jpeg-xl"].map(|_| Err(String::new()));
        let (webp, jpeg_xl) = (Coder::webp(), Coder::jpeg_xl());
        let mut methods = Methods { context, runs, webp, jpeg_xl, settings };
        let psnr = published::frame_psnr(set);
        let bar = progress(2, "working points");
        let webp = equal::setting(&*methods.required("webp")?, &runs.frames, psnr[0])?;
        bar.inc(1);
        let jpeg_xl = methods.method("jpeg-xl").and_then(|method| {
            equal::setting(method.as_ref(), &runs.frames, psnr[1]).map_err(failed)
        });
        methods.settings = [Ok(webp), jpeg_xl];
        Ok(methods)
    }

    /// The setting of a method with WebP or JPEG XL at its working point.
    fn setting(&self, name: &str) -> Result<Setting, String> {
        let [webp, jpeg_xl] = &self.settings;
        if name.ends_with("webp") { webp.clone() } else { jpeg_xl.clone() }
    }

    fn frames(&self) -> &Run {
        &self.runs.frames
    }

    /// A method of [`SETTABLE`]; or what it needs.
    fn method(&self, name: &'static str) -> Result<Box<dyn Method + '_>, String> {
        let context = self.context;
        let mode = match name {
            "ours-intra" => Some(Mode::Intra),
            "ours-stream" => Some(Mode::Stream(Structure::Chain { key_every: KEY_EVERY })),
            _ => None,
        };
        if let Some(mode) = mode {
            return Ok(Box::new(Ours { context, mode }));
        }
        let (run, input) = match name.split_once('+') {
            Some(("invs", _)) => (&self.runs.invs, Input::Difference),
            Some(("affine", _)) => {
                let affine = self.runs.affine.as_ref();
                (affine.ok_or_else(no_key_frames)?, Input::Difference)
            }
            Some(_) => {
                let affine = self.runs.affine_cnn.as_ref();
                (affine.ok_or_else(no_starts)?, Input::Difference)
            }
            None => (&self.runs.frames, Input::Frame),
        };
        let coder = match name.ends_with("webp") {
            true => &self.webp,
            false => self.jpeg_xl.as_ref().map_err(Clone::clone)?,
        };
        Ok(Box::new(OnPictures { coder, run, input }))
    }

    /// A method that nothing can be missing for.
    fn required(&self, name: &'static str) -> anyhow::Result<Box<dyn Method + '_>> {
        self.method(name).map_err(anyhow::Error::msg)
    }

    /// The row of [`ANCHOR`] at its working point.
    pub fn anchor(&self) -> anyhow::Result<Row> {
        let setting = self.setting(ANCHOR).map_err(anyhow::Error::msg)?;
        Ok(Row::new(ANCHOR, self.required(ANCHOR)?.code(setting)?, self.frames()))
    }

    /// All rows at the working points. Those of the program's own coder are at one PSNR with [`ANCHOR`].
    pub fn working(
        &self,
        equal: &[Entry],
        learned: Option<&Learned>,
        starts: Option<&Estimates>,
    ) -> anyhow::Result<Vec<Entry>> {
        let of_equal = |name: &str| equal.iter().find(|entry| entry.method() == name).cloned();
        let settable = |name: &'static str| match of_equal(name) {
            Some(entry) if name == ANCHOR || name.starts_with("ours") => Ok(entry),
            _ => self
                .entry(name, |method| method.code(self.setting(name).map_err(anyhow::Error::msg)?)),
        };
        let bar = progress(SETTABLE.len() + 1, "methods");
        let mut entries = Vec::new();
        for name in SETTABLE {
            entries.push(settable(name)?);
            bar.inc(1);
            match name {
                "jpeg-xl" => {
                    entries.extend(OF_FRAMES.iter().map(|name| self.main(name, learned)));
                }
                "ours-stream" => {
                    let intra = of_equal("ours-intra");
                    let setting =
                        intra.as_ref().and_then(Entry::row).map(|row| row.setting.clone());
                    entries.extend(self.estimators(setting, starts)?);
                    bar.inc(1);
                }
                _ => {}
            }
        }
        bar.finish_and_clear();
        entries.extend(OF_DIFFERENCES.iter().map(|name| self.main(name, learned)));
        let coders = learned.iter().flat_map(|learned| {
            let is_main = |coder: &&LearnedCoder| {
                let of_paper =
                    OF_FRAMES.iter().chain(&OF_DIFFERENCES).any(|name| *name == coder.method);
                let main = learned.main(&coder.method).filter(|_| of_paper);
                main.is_some_and(|main| std::ptr::eq(main, *coder))
            };
            learned.coders.iter().filter(move |coder| !is_main(coder))
        });
        entries.extend(coders.map(|coder| self.learned(&coder.name, coder)));
        Ok(entries)
    }

    /// The settable methods at the PSNR of [`ANCHOR`].
    pub fn equal(&self, anchor: &Row) -> anyhow::Result<Vec<Entry>> {
        let equal = |name: &'static str| {
            if name == ANCHOR {
                return Ok(Entry::measured(Row { reached: Some(true), ..anchor.clone() }));
            }
            let bar = progress(equal::MAX_CODINGS, name);
            let mut reached = false;
            let entry = self.entry(name, |method| {
                let (coded, yes) = equal::at(method, self.frames(), anchor.psnr, || bar.inc(1))?;
                reached = yes;
                Ok(coded)
            });
            Ok(match entry? {
                Entry::Measured(row) => Entry::measured(Row { reached: Some(reached), ..*row }),
                missing => missing,
            })
        };
        SETTABLE.into_iter().map(equal).collect()
    }

    /// A method's row. A program that fails is missing; the others are measured in any case.
    fn entry(
        &self,
        name: &'static str,
        code: impl FnOnce(&dyn Method) -> anyhow::Result<Coded>,
    ) -> anyhow::Result<Entry> {
        announce(name);
        let method = match self.method(name) {
            Ok(method) => method,
            Err(what) => return Ok(Entry::missing(name, what)),
        };
        match code(method.as_ref()) {
            Ok(coded) => Ok(Entry::measured(Row::new(name, coded, self.frames()))),
            Err(error) if name.ends_with("jpeg-xl") => Ok(Entry::missing(name, failed(error))),
            Err(error) => Err(error),
        }
    }

    /// The row that has a learned method's own name.
    fn main(&self, method: &str, learned: Option<&Learned>) -> Entry {
        let what =
            "not given; train and run it with tools/paper, then give its folder with --learned";
        match learned.and_then(|learned| learned.main(method)) {
            Some(coder) => self.learned(method, coder),
            None => Entry::missing(method, what),
        }
    }

    fn learned(&self, name: &str, coder: &LearnedCoder) -> Entry {
        let coded = coder.coded(&self.runs.invs);
        let parameters = coder.parameters;
        Entry::measured(Row { parameters, ..Row::new(name, coded, self.frames()) })
    }

    /// What estimators' starts are worth: how many frames are found from them, and the packets' bytes.
    fn estimators(
        &self,
        setting: Option<Setting>,
        starts: Option<&Estimates>,
    ) -> anyhow::Result<Vec<Entry>> {
        let setting = setting.context("the program's own coder was not measured")?;
        let run = |starts: &Starts| {
            packets(self.context, self.context.options(), setting.clone(), starts)
        };
        let relocalised = match self.runs.affine {
            Some(_) => Ok(run(&Starts::Nothing)?),
            None => Err(no_key_frames()),
        };
        let regressed = match starts {
            Some(starts) => Ok(run(&Starts::Given(&starts.poses))?),
            None => Err(no_starts()),
        };
        let sure = [&relocalised, &regressed];
        let others = sure.iter().filter_map(|packets| packets.as_ref().ok());
        let mut best = self.runs.found_psnr.clone();
        for packets in others {
            for (best, psnr) in best.iter_mut().zip(&packets.render_psnr) {
                *best = best.max(*psnr);
            }
        }
        let entry = |(name, packets): (&str, Result<Packets, String>)| match packets {
            Ok(Packets { coded, render_psnr }) => {
                let near = best.iter().zip(&render_psnr).filter(|(b, psnr)| *b - *psnr <= SHORT);
                let found = Some(near.count());
                Entry::measured(Row { found, ..Row::new(name, coded, self.frames()) })
            }
            Err(what) => Entry::missing(name, what),
        };
        Ok(ESTIMATORS.into_iter().zip([relocalised, regressed]).map(entry).collect())
    }
}

fn no_key_frames() -> String {
    "the prior has no key frames; make them with nvsprior key-frames".into()
}

fn no_starts() -> String {
    "not given; make its starts with tools/paper, then give the file with --starts".into()
}

fn failed(error: anyhow::Error) -> String {
    format!("failed: {error:#}")
}

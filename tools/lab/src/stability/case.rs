//! What a stability report is made of.

use std::path::PathBuf;
use std::time::Instant;

use nvsprior::Engine;
use nvsprior::tracking::Stop;

pub struct Bench {
    pub engine: Engine,
    pub quick: bool,
    pub random_cases: usize,
    pub first_seed: u64,
    /// A trained scene, if one was given.
    pub prior: Option<PathBuf>,
}

pub struct Group {
    pub name: &'static str,
    /// What it is about, for the report.
    pub about: &'static str,
    pub cases: fn(&Bench) -> Vec<Case>,
}

/// A case: what is expected, then how it is measured.
pub struct Case {
    pub name: String,
    /// A sentence.
    pub expected: &'static str,
    pub run: Run,
}

type Run = Box<dyn FnOnce(&Bench) -> anyhow::Result<Done>>;

impl Case {
    pub fn new<D: Into<Done>>(
        name: impl Into<String>,
        expected: &'static str,
        run: impl FnOnce(&Bench) -> anyhow::Result<D> + 'static,
    ) -> Case {
        let run = Box::new(move |bench: &Bench| run(bench).map(Into::into));
        Case { name: name.into(), expected, run }
    }
}

#[derive(Default)]
pub struct Done {
    pub rows: Vec<Row>,
    pub tables: Vec<Table>,
}

impl From<Vec<Row>> for Done {
    fn from(rows: Vec<Row>) -> Done {
        Done { rows, tables: Vec::new() }
    }
}

/// A table beside the rows.
pub struct Table {
    pub title: String,
    pub about: &'static str,
    pub header: Vec<&'static str>,
    pub rows: Vec<Vec<String>>,
}

pub struct Section {
    pub group: &'static Group,
    pub rows: Vec<Row>,
    pub tables: Vec<Table>,
}

/// One case on one path.
#[derive(Clone, Debug, Default)]
pub struct Row {
    pub case: String,
    pub expected: &'static str,
    /// How it was run.
    pub path: &'static str,
    /// What was not as expected.
    pub faults: Vec<String>,
    pub picture: Option<PictureError>,
    /// Error of the gradient, relative to what Cauchy–Schwarz bounds it by.
    pub gradient: Option<f64>,
    /// As `gradient`, for JᵀJ.
    pub jtj: Option<f64>,
    pub descent: Option<Descent>,
    pub milliseconds: f64,
    pub note: String,
}

/// Difference of a picture from the twin's, over all channels. It is relative to the channel's
/// largest value if that is above 1.
#[derive(Clone, Copy, Debug, Default)]
pub struct PictureError {
    pub max: f64,
    pub mean: f64,
    /// Largest change in f64 from rounding the inputs to f32.
    pub rounding: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct Descent {
    /// Mean squared error at the start, values in [0, 1].
    pub start: f64,
    /// That of the outcome.
    pub end: f64,
    pub stop: Stop,
    pub evaluations: usize,
}

impl Row {
    /// A row of a path, with the time since.
    pub fn of(path: &'static str, since: Instant) -> Row {
        let milliseconds = since.elapsed().as_secs_f64() * 1e3;
        Row { path, milliseconds, ..Row::default() }
    }

    pub fn as_expected(&self) -> bool {
        self.faults.is_empty()
    }

    /// Takes note of what does not hold.
    pub fn expect(&mut self, holds: bool, otherwise: impl FnOnce() -> String) {
        if !holds {
            self.faults.push(otherwise());
        }
    }
}

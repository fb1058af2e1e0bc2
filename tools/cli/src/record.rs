//! What a prior has learnt since it was mapped: the file `PRIOR.learnt` beside it, a line for each update.
//!
//! The first line names the prior that the record is about, so that another one in its place is not taken for it. The
//! rest is CSV: `dive,what,first_frame,last_frame,bytes,new,changed,removed,fades,x0,y0,z0,x1,y1,z1`. `what` is
//! `update N`, or `map` for a training that went on with a dive's pictures. The last six may be empty.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, ensure};
use nvsprior::prior::{Learnt, PriorError, Update, UpdateChain, UpdateError, replace_file};
use nvsprior::{Prior, PriorId};

/// What the first line says before the prior's identity.
const TITLE: &str = "# learnt by prior ";
const COLUMNS: &str =
    "dive,what,first_frame,last_frame,bytes,new,changed,removed,fades,x0,y0,z0,x1,y1,z1";
/// What `what` says of a training that went on.
const MAP: &str = "map";
/// More bytes than a record has.
const MAX_BYTES: u64 = 1 << 24;
/// Longest name of a dive, characters.
const MAX_NAME: usize = 60;

/// What was learnt at once.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The dive, by its name or number.
    pub dive: String,
    /// The update's number; `None`: a training went on.
    pub update: Option<u16>,
    /// First and last frame that it was learnt from.
    pub frames: [u32; 2],
    pub bytes: usize,
    pub new: usize,
    pub changed: usize,
    pub removed: usize,
    pub fades: usize,
    /// The box in the world that holds all of it, two corners; `None`: it is nowhere.
    pub place: Option<[[f32; 3]; 2]>,
}

/// The name of a dive: it must fit a field of the file.
pub fn dive_name(text: &str) -> Result<String, String> {
    let fits = |c: char| !c.is_control() && c != ',' && c != '"';
    match (1..=MAX_NAME).contains(&text.chars().count()) && text.chars().all(fits) {
        true => Ok(text.to_owned()),
        false => Err(format!("1 to {MAX_NAME} characters, without commas and quotation marks")),
    }
}

/// A row for each update of a chain.
pub fn rows_of(chain: &UpdateChain, dive: &str) -> Result<Vec<Row>, UpdateError> {
    let mut before = Learnt::none(chain.learnt().prior());
    let row = |update: &Update| {
        let row = Row {
            dive: dive.to_owned(),
            update: Some(update.number),
            frames: update.frames,
            bytes: update.to_bytes()?.len(),
            new: update.splats.len(),
            changed: update.changed.len(),
            removed: update.removed.len(),
            fades: update.fades.len(),
            place: place(update, &before),
        };
        before.add(update)?;
        Ok(row)
    };
    chain.updates().iter().map(row).collect()
}

/// The box of all that an update touches. `before`: what was learnt before it.
fn place(update: &Update, before: &Learnt) -> Option<[[f32; 3]; 2]> {
    let new = update.splats.iter().map(|splat| update.grid.position(splat.position));
    let changed = update.changed.iter().map(|change| change.ordinal);
    let touched = changed.chain(update.removed.iter().copied());
    let touched = touched.map(|ordinal| before.splats()[usize::from(ordinal)].position);
    let fades = update.fades.iter().flat_map(|fade| update.grid.corners(fade));
    let fades = fades.map(|corner| corner.map(|v| v as f32));
    let corners = new.chain(touched).chain(fades).map(|at| [at, at]);
    corners.reduce(|a, b| {
        let bound = |corner: usize, pick: fn(f32, f32) -> f32| {
            std::array::from_fn(|axis| pick(a[corner][axis], b[corner][axis]))
        };
        [bound(0, f32::min), bound(1, f32::max)]
    })
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, last] = self.frames;
        if self.update.is_none() {
            return write!(f, "trained on {last} pictures, {} splats more", self.new);
        }
        write!(
            f,
            "frames {first} to {last}, {} bytes: {} splats new, {} changed, {} taken back, {} fades",
            self.bytes, self.new, self.changed, self.removed, self.fades
        )?;
        match &self.place {
            Some([from, to]) => write!(f, "; from {} to {}", point(from), point(to)),
            None => Ok(()),
        }
    }
}

/// A point of the world.
fn point([x, y, z]: &[f32; 3]) -> String {
    format!("({x:.3}, {y:.3}, {z:.3})")
}

impl Row {
    /// What it is called.
    pub fn name(&self) -> String {
        self.update.map_or_else(|| MAP.to_owned(), |number| format!("update {number}"))
    }

    fn to_csv(&self) -> String {
        let Row { dive, frames: [first, last], bytes, new, changed, removed, fades, .. } = self;
        let name = self.name();
        let corners = self.place.iter().flatten().flatten().map(f32::to_string);
        let mut corners: Vec<String> = corners.collect();
        corners.resize(6, String::new());
        let corners = corners.join(",");
        format!("{dive},{name},{first},{last},{bytes},{new},{changed},{removed},{fades},{corners}")
    }

    fn from_csv(line: &str) -> anyhow::Result<Row> {
        let fields: Vec<&str> = line.split(',').collect();
        let columns = COLUMNS.split(',').count();
        ensure!(fields.len() == columns, "{} fields, not {columns}", fields.len());
        let update = match fields[1].strip_prefix("update ") {
            Some(own) => Some(number(own).with_context(|| format!("\"{}\"", fields[1]))?),
            None if fields[1] == MAP => None,
            None => anyhow::bail!("\"{}\" is neither an update nor \"{MAP}\"", fields[1]),
        };
        Ok(Row {
            dive: dive_name(fields[0]).map_err(anyhow::Error::msg)?,
            update,
            frames: [number(fields[2])?, number(fields[3])?],
            bytes: number(fields[4])?,
            new: number(fields[5])?,
            changed: number(fields[6])?,
            removed: number(fields[7])?,
            fades: number(fields[8])?,
            place: corners(&fields[9..])?,
        })
    }
}

/// The number in a field.
fn number<T>(field: &str) -> anyhow::Result<T>
where
    T: FromStr<Err: std::error::Error + Send + Sync + 'static>,
{
    field.parse().with_context(|| format!("\"{field}\""))
}

/// Two corners of a box in six fields, all of which may be empty.
fn corners(fields: &[&str]) -> anyhow::Result<Option<[[f32; 3]; 2]>> {
    if fields.iter().all(|field| field.is_empty()) {
        return Ok(None);
    }
    let finite = |field: &&str| {
        let value: f32 = number(field)?;
        ensure!(value.is_finite(), "\"{field}\" is not finite");
        Ok(value)
    };
    let numbers: Vec<f32> = fields.iter().map(finite).collect::<anyhow::Result<_>>()?;
    let corner = |first: usize| std::array::from_fn(|axis| numbers[first + axis]);
    Ok(Some([corner(0), corner(3)]))
}

fn path_beside(prior: &Path) -> PathBuf {
    prior.with_added_extension("learnt")
}

/// What a record calls a prior: its identity without coder tables, which may come later.
fn id_of(prior: &Prior) -> PriorId {
    match prior.coder_tables() {
        Some(_) => prior.clone().with_coder_tables(None).id(),
        None => prior.id(),
    }
}

/// The record beside a prior; none if there is no file. One of another prior is named, and left out.
pub fn open_beside(path: &Path, prior: &Prior) -> anyhow::Result<Vec<Row>> {
    let (beside, prior) = (path_beside(path), id_of(prior));
    if !beside.exists() {
        return Ok(Vec::new());
    }
    let named = || beside.display().to_string();
    let mut text = String::new();
    File::open(&beside)
        .and_then(|file| file.take(MAX_BYTES).read_to_string(&mut text))
        .with_context(named)?;
    let (id, rows) = parse(&text).with_context(named)?;
    if id != prior.to_string() {
        eprintln!("{}: of prior {id}, not of {prior}; it is left out", beside.display());
        return Ok(Vec::new());
    }
    Ok(rows)
}

/// The identity that a record names, and its rows.
fn parse(text: &str) -> anyhow::Result<(&str, Vec<Row>)> {
    let mut lines = text.lines();
    let id = lines.next().and_then(|line| line.strip_prefix(TITLE));
    let id = id.with_context(|| format!("no record: it does not begin with \"{TITLE}\""))?;
    ensure!(lines.next() == Some(COLUMNS), "the second line is not \"{COLUMNS}\"");
    let row = |(number, line)| Row::from_csv(line).with_context(|| format!("line {number}"));
    Ok((id, (3..).zip(lines).map(row).collect::<anyhow::Result<_>>()?))
}

fn text_of(rows: &[Row], prior: PriorId) -> String {
    let lines = rows.iter().map(|row| row.to_csv() + "\n");
    format!("{TITLE}{prior}\n{COLUMNS}\n{}", lines.collect::<String>())
}

/// Writes a record beside the prior at `path`; none if there is nothing to record.
pub fn save(rows: &[Row], path: &Path, prior: &Prior) -> Result<(), PriorError> {
    match rows.is_empty() {
        true => Ok(()),
        false => replace_file(&path_beside(path), text_of(rows, id_of(prior)).as_bytes()),
    }
}

/// Gives a prior that was made of another one the record of that.
pub fn carry(from: (&Path, &Prior), to: &Path) -> anyhow::Result<()> {
    let rows = open_beside(from.0, from.1)?;
    if rows.is_empty() {
        return Ok(());
    }
    let made = Prior::open(to, &Default::default())?;
    Ok(save(&rows, to, &made)?)
}

/// The name of the next dive if nobody gave one: how many there were, and one.
pub fn next_dive(rows: &[Row]) -> String {
    let mut dives: Vec<&str> = rows.iter().map(|row| row.dive.as_str()).collect();
    dives.dedup();
    (dives.len() + 1).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<Row> {
        let update = Row {
            dive: "2026-11-26 north".into(),
            update: Some(3),
            frames: [10, 90],
            bytes: 321,
            new: 40,
            changed: 2,
            removed: 1,
            fades: 1,
            place: Some([[-0.5, 0.25, 1e-7], [2.0, 3.5, 1e9]]),
        };
        let map = Row { dive: "2".into(), update: None, place: None, ..update.clone() };
        vec![update.clone(), Row { update: Some(4), place: None, ..update }, map]
    }

    #[test]
    fn a_record_comes_back() {
        for rows in [vec![], rows()] {
            let text = text_of(&rows, PriorId(0x5d4d_cd04));
            let (id, read) = parse(&text).unwrap();
            assert_eq!((id, read), ("5d4dcd04", rows));
        }
        assert_eq!(next_dive(&[]), "1");
        assert_eq!(next_dive(&rows()), "3");
    }

    #[test]
    fn what_is_no_record_is_refused_by_its_line() {
        let text = text_of(&rows(), PriorId(1));
        let refused = |from: &str, to: &str| {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text);
            format!("{:#}", parse(&changed).unwrap_err())
        };
        assert!(refused("# learnt", "learnt").starts_with("no record"));
        assert!(refused("dive,what", "dive").starts_with("the second line"));
        assert!(refused("update 3", "update x").starts_with("line 3: \"update x\""));
        assert!(refused("update 3", "upgrade").starts_with("line 3: \"upgrade\" is neither"));
        assert!(refused("321", "-1").starts_with("line 3: \"-1\""));
        assert!(refused("-0.5", "inf").starts_with("line 3: \"inf\" is not finite"));
        assert!(refused(",0.25", "").starts_with("line 3: 14 fields, not 15"));
        assert!(refused("0.25", "").starts_with("line 3: \"\""));
    }

    #[test]
    fn names_of_dives_fit_a_field() {
        assert_eq!(dive_name("T4 north"), Ok("T4 north".into()));
        for bad in ["", "a,b", "a\nb", "\"", &"x".repeat(61)] {
            assert!(dive_name(bad).is_err(), "{bad}");
        }
    }
}

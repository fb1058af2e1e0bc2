//! The dives that a prior was trained on since it was mapped: a record in its file, a line for each.
//!
//! It is CSV: `dive,pictures,splats`, the dive's name, the pictures of it, and the splats that it added.

use std::fmt;

use anyhow::{Context, ensure};
use nvsprior::Prior;

const COLUMNS: &str = "dive,pictures,splats";
/// Longest name of a dive, characters.
const MAX_NAME: usize = 60;

/// A dive whose pictures a prior was trained on.
#[derive(Clone, Debug, PartialEq)]
pub struct Dive {
    pub name: String,
    pub pictures: usize,
    /// Splats that came with it.
    pub splats: usize,
}

/// The name of a dive: it must fit a field of the file.
pub fn dive_name(text: &str) -> Result<String, String> {
    let fits = |c: char| !c.is_control() && c != ',' && c != '"';
    match (1..=MAX_NAME).contains(&text.chars().count()) && text.chars().all(fits) {
        true => Ok(text.to_owned()),
        false => Err(format!("1 to {MAX_NAME} characters, without commas and quotation marks")),
    }
}

impl fmt::Display for Dive {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "trained on {} pictures, {} splats more", self.pictures, self.splats)
    }
}

impl Dive {
    fn from_csv(line: &str) -> anyhow::Result<Dive> {
        let fields: Vec<&str> = line.split(',').collect();
        let [name, pictures, splats] = fields[..] else {
            anyhow::bail!("{} fields, not 3", fields.len());
        };
        let number = |field: &str| field.parse().with_context(|| format!("\"{field}\""));
        Ok(Dive {
            name: dive_name(name).map_err(anyhow::Error::msg)?,
            pictures: number(pictures)?,
            splats: number(splats)?,
        })
    }
}

/// The record of a prior; empty if there is none.
pub fn of(prior: &Prior) -> anyhow::Result<Vec<Dive>> {
    let text = prior.extras().record.as_deref();
    text.map_or(Ok(Vec::new()), |text| parse(text).context("the prior's record"))
}

fn parse(text: &str) -> anyhow::Result<Vec<Dive>> {
    let mut lines = text.lines();
    ensure!(lines.next() == Some(COLUMNS), "the first line is not \"{COLUMNS}\"");
    let dive = |(number, line)| Dive::from_csv(line).with_context(|| format!("line {number}"));
    (2..).zip(lines).map(dive).collect()
}

/// As a prior's file holds it; `None` if there is nothing to record.
pub fn text_of(dives: &[Dive]) -> Option<String> {
    let line = |Dive { name, pictures, splats }: &Dive| format!("{name},{pictures},{splats}\n");
    let lines = dives.iter().map(line).collect::<String>();
    (!dives.is_empty()).then(|| format!("{COLUMNS}\n{lines}"))
}

/// The name of the next dive if nobody gave one: its number.
pub fn next_dive(dives: &[Dive]) -> String {
    (dives.len() + 1).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dives() -> Vec<Dive> {
        let first = Dive { name: "2026-11-26 north".into(), pictures: 321, splats: 40 };
        vec![first.clone(), Dive { name: "2".into(), splats: 0, ..first }]
    }

    #[test]
    fn a_record_comes_back() {
        assert_eq!(text_of(&[]), None);
        assert_eq!(parse(&text_of(&dives()).unwrap()).unwrap(), dives());
        assert_eq!(next_dive(&[]), "1");
        assert_eq!(next_dive(&dives()), "3");
    }

    #[test]
    fn what_is_no_record_is_refused_by_its_line() {
        let text = text_of(&dives()).unwrap();
        let refused = |from: &str, to: &str| {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text);
            format!("{:#}", parse(&changed).unwrap_err())
        };
        assert!(refused("dive,pictures", "dive").starts_with("the first line"));
        assert!(refused("321", "-1").starts_with("line 2: \"-1\""));
        assert!(refused(",40", "").starts_with("line 2: 2 fields, not 3"));
        assert!(refused("2026-11-26 north", "").starts_with("line 2: 1 to 60"));
    }

    #[test]
    fn names_of_dives_fit_a_field() {
        assert_eq!(dive_name("T4 north"), Ok("T4 north".into()));
        for bad in ["", "a,b", "a\nb", "\"", &"x".repeat(61)] {
            assert!(dive_name(bad).is_err(), "{bad}");
        }
    }
}

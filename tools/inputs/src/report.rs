//! What reports are written with: JSON of anything that can be serialised, and tables as text, CSV and Markdown.

use std::fmt::{Display, Write as _};
use std::path::Path;

use anyhow::Context as _;
use serde::Serialize;

/// Writes a value as JSON. Numbers that are not finite become `null`.
pub fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)? + "\n";
    std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))
}

/// A number with so many digits after the point.
pub fn fixed(value: f64, digits: usize) -> String {
    format!("{value:.digits$}")
}

/// As [`fixed`]; empty if there is no number.
pub fn fixed_or_empty(value: Option<f64>, digits: usize) -> String {
    value.map_or(String::new(), |value| fixed(value, digits))
}

/// A column: its name, and what it has for a row.
pub type Column<'a, R> = (&'a str, &'a dyn Fn(&R) -> String);

/// Rows of cells under a header.
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new<H: Display>(header: impl IntoIterator<Item = H>) -> Table {
        Table { header: header.into_iter().map(|name| name.to_string()).collect(), rows: vec![] }
    }

    /// A row for each of `rows`.
    pub fn of<'r, R: 'r>(rows: impl IntoIterator<Item = &'r R>, columns: &[Column<R>]) -> Table {
        let mut table = Table::new(columns.iter().map(|(name, _)| name));
        for row in rows {
            table.push(columns.iter().map(|(_, cell)| cell(row)));
        }
        table
    }

    /// Adds a row, a cell for each column.
    pub fn push<C: Display>(&mut self, cells: impl IntoIterator<Item = C>) {
        self.rows.push(cells.into_iter().map(|cell| cell.to_string()).collect());
    }

    /// Some of its columns, for a screen.
    pub fn only(&self, names: &[&str]) -> Table {
        let chosen = |name: &&str| self.header.iter().position(|column| column == name);
        let places: Vec<usize> = names.iter().filter_map(chosen).collect();
        let pick = |row: &Vec<String>| places.iter().map(|place| row[*place].clone()).collect();
        Table { header: pick(&self.header), rows: self.rows.iter().map(pick).collect() }
    }

    pub fn write_csv(&self, path: &Path) -> anyhow::Result<()> {
        let write = || {
            let mut csv = csv::Writer::from_path(path)?;
            csv.write_record(&self.header)?;
            self.rows.iter().try_for_each(|row| csv.write_record(row))?;
            Ok::<_, csv::Error>(csv.flush()?)
        };
        write().with_context(|| format!("writing {}", path.display()))
    }

    /// Prints it, columns as wide as their widest cells, numbers to the right.
    pub fn print(&self) {
        say!("{}", self.text().trim_end_matches('\n'));
    }

    fn text(&self) -> String {
        let mut text = String::new();
        for row in std::iter::once(&self.header).chain(&self.rows) {
            let cell = |(column, cell): (usize, &String)| {
                let room = self.width(column) - cell.chars().count();
                let (left, right) = if self.is_number(column) { (room, 0) } else { (0, room) };
                format!("{:left$}{cell}{:right$}", "", "")
            };
            let cells: Vec<String> = row.iter().enumerate().map(cell).collect();
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{}", cells.join("  ").trim_end());
        }
        text
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | ").replace('\n', " "));
        let rule = format!("|{}\n", "---|".repeat(self.header.len()));
        line(&self.header) + &rule + &self.rows.iter().map(|row| line(row)).collect::<String>()
    }

    /// As HTML.
    pub fn html(&self) -> String {
        let line = |cells: &[String], tag: &str| {
            let cell = |text: &String| format!("<{tag}>{}</{tag}>", escaped(text));
            format!("<tr>{}</tr>\n", cells.iter().map(cell).collect::<String>())
        };
        let rows: String = self.rows.iter().map(|row| line(row, "td")).collect();
        format!("<table>\n{}{rows}</table>\n", line(&self.header, "th"))
    }

    fn cells(&self, column: usize) -> impl Iterator<Item = &str> {
        self.rows.iter().filter_map(move |row| row.get(column)).map(String::as_str)
    }

    fn width(&self, column: usize) -> usize {
        let header = self.header.get(column).map(String::as_str);
        self.cells(column).chain(header).map(|cell| cell.chars().count()).max().unwrap_or(0)
    }

    /// Whether all cells begin with a number, or have none.
    fn is_number(&self, column: usize) -> bool {
        let number = |cell: &str| {
            let first = cell.trim_start_matches(['+', '-', '−']).chars().next();
            first.is_none_or(|first| first.is_ascii_digit()) || cell == "–" || cell == "NaN"
        };
        column > 0 && self.cells(column).all(number)
    }
}

/// A text as HTML shows it.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// The part of a document from one mark to another, both included.
pub fn between<'a>(document: &'a str, begin: &str, end: &str) -> Option<&'a str> {
    let start = document.find(begin)?;
    let stop = start + document[start..].find(end)? + end.len();
    Some(&document[start..stop])
}

/// Prints a line of a report: a name, and what there is to say of it.
pub fn row(name: &str, value: String) {
    say!("{name:14} {value}");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let rows = [("near", 1.5, "a | b"), ("far away", -10.25, "c")];
        Table::of(
            &rows,
            &[
                ("name", &|row| row.0.into()),
                ("ms", &|row| fixed(row.1, 1)),
                ("note", &|row| row.2.into()),
            ],
        )
    }

    #[test]
    fn columns_are_as_wide_as_they_must_be() {
        let text = "name         ms  note\nnear        1.5  a | b\nfar away  -10.2  c\n";
        assert_eq!(table().text(), text);
    }

    #[test]
    fn some_columns_are_chosen_by_name() {
        assert_eq!(
            table().only(&["note", "name"]).text(),
            "note   name\na | b  near\nc      far away\n"
        );
    }

    #[test]
    fn markdown_has_a_rule_below_the_header() {
        let markdown = table().markdown();
        assert!(markdown.starts_with("| name | ms | note |\n|---|---|---|\n| near | 1.5 |"));
    }

    #[test]
    fn html_escapes_what_is_no_markup() {
        let html = Table::of(&["a < b & c"], &[("name", &|row| row.to_string())]).html();
        assert_eq!(
            html,
            "<table>\n<tr><th>name</th></tr>\n<tr><td>a &lt; b &amp; c</td></tr>\n</table>\n"
        );
    }

    #[test]
    fn a_part_of_a_document_is_found_by_its_marks() {
        assert_eq!(between("a [b] c", "[", "]"), Some("[b]"));
        assert_eq!(between("a [b c", "[", "]"), None);
    }

    #[test]
    fn csv_quotes_what_has_commas() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let mut table = Table::new(["a", "b"]);
        table.push(["1,5", ""]);
        table.write_csv(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "a,b\n\"1,5\",\n");
    }

    #[test]
    fn what_is_not_finite_is_null() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("values.json");
        write_json(&path, &[1.0, f64::NAN, f64::INFINITY]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text.split_whitespace().collect::<String>(), "[1.0,null,null]");
    }
}

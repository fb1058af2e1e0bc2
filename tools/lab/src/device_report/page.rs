//! `index.html`: the report on one page, without other files.

use super::schema::Report;
use super::{plots, print};
use nvsprior_inputs::report::{Table, escaped};

const STYLE: &str = "body { font-family: sans-serif; max-width: 960px; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0; }
th, td { border-bottom: 1px solid #ccc; padding: 2px 10px; text-align: left; white-space: pre-line; }
svg { max-width: 100%; height: auto; }";

/// The page.
pub fn text(report: &Report) -> anyhow::Result<String> {
    let name = report.device.as_ref().map_or("no device", |device| &device.name);
    let title = escaped(&format!("nvsprior on {name}"));
    let mut body = format!("<h1>{title}</h1>\n");
    let facts = print::facts(report);
    let facts = Table::of(
        &facts,
        &[("", &|(name, _)| (*name).to_owned()), ("", &|(_, value)| value.clone())],
    );
    body += &facts.html();
    if !report.sizes.is_empty() {
        body += "<h2>A frame</h2>\n";
        body += &plots::times(report)?;
    }
    for size in &report.sizes {
        body += &format!("<h2>{}×{}</h2>\n", size.width, size.height);
        body += &print::times(size).html();
        for rows in size.stages.chunk_by(|a, b| a.job == b.job) {
            body += &plots::stages(size, &rows[0].job)?;
        }
        body += &print::stages(size).html();
    }
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title}</title>\n\
         <style>\n{STYLE}\n</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    ))
}

#[cfg(test)]
mod tests {
    use super::super::schema::tests::report;
    use super::*;

    #[test]
    fn the_page_names_what_is_not_known() {
        let page = text(&report()).unwrap();
        for shown in [
            "nvsprior on A device",
            "host memory: the system does not tell",
            "<td>prediction</td><td>none</td>",
            "picture, 320×180: milliseconds by stage",
        ] {
            assert!(page.contains(shown), "{shown}: {page}");
        }
    }

    #[test]
    fn a_report_of_nothing_is_a_page() {
        let nothing = super::super::schema::Report {
            device: None,
            verify: None,
            ceilings: None,
            sizes: vec![],
            ..report()
        };
        assert!(text(&nothing).unwrap().contains("NOT known whether portable"));
    }
}

//! Volume curves of software for magnetic resonance images: Segment (Medviso) and cvi42 (Circle
//! Cardiovascular Imaging).
//!
//! Segment's "Export volume curve" writes the patient's name, two empty lines, and a table with the
//! header `Time[ms] Endovol[ml] Epivol[ml] Papvol RVEndovol[ml] RVEpivol[ml]`, separated by tabs
//! (`export.m` of its open-source version). cvi42's scientific report is a text of many sections in
//! UTF-16; its curves are tables with tabs whose header has a column of times, such as `Time(ms)`,
//! and whose units may be in the line below.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::delimited::{Layout, parse_layout, refused};
use crate::dialect::{Dialect, cells, sniff};
use crate::headers::{Label, find, is_unit};
use crate::number::Decimal;
use crate::text::Decoded;
use crate::wanted::{TableReading, Wanted};

/// Whether a text is a volume curve of Segment.
#[must_use]
pub fn is_segment(text: &str) -> bool {
    text.lines()
        .take(40)
        .any(|line| line.contains("Time[ms]") && line.contains("Endovol[ml]"))
}

/// Whether a text is a report of cvi42.
#[must_use]
pub fn is_cvi42(text: &str) -> bool {
    text.lines()
        .take(400)
        .any(|line| line.contains("Scientific Report") || line.contains("cvi42"))
}

/// Reads the first table of a report that has all required quantities.
#[must_use]
pub fn parse(decoded: &Decoded<'_>, file: &Path, wanted: &[Wanted], program: &str) -> TableReading {
    let lines: Vec<&str> = decoded.text.lines().collect();
    let tables = tables(&lines);
    let has = |table: &&(Dialect, String)| {
        let labels = table.0.labels(&lines);
        wanted.iter().filter(|one| one.required).all(|one| {
            let exact = |label: &Label| {
                one.names
                    .iter()
                    .any(|(name, _)| *name == label.full || (one.given && *name == label.name))
            };
            labels.iter().any(exact) || (!one.given && find(&labels, one).is_ok())
        })
    };
    let fitting: Vec<&(Dialect, String)> = tables.iter().filter(has).collect();
    let Some((dialect, section)) = fitting.first() else {
        let names: Vec<String> = tables
            .iter()
            .map(|(dialect, _)| {
                let labels = dialect.labels(&lines);
                let names: Vec<&str> = labels.iter().map(|label| label.full.as_str()).collect();
                names.join(", ")
            })
            .collect();
        let found = if names.is_empty() {
            "no table with a column of times".to_owned()
        } else {
            format!("tables with the columns {}", names.join("; "))
        };
        return refused(Problem::error(
            file,
            found,
            "a table with times and the left ventricle's volume, with units",
            "add the volume curve to the report, or name the columns in prepare.toml",
        ));
    };
    let layout = Layout {
        dialect: dialect.clone(),
        ends: true,
        warn_of_others: false,
        own: false,
    };
    let mut reading = parse_layout(decoded, file, wanted, &layout);
    if let Some(table) = &mut reading.table {
        let of = if section.is_empty() {
            String::new()
        } else {
            format!(", section `{section}`")
        };
        let several = if fitting.len() > 1 {
            format!(", the first of {} such tables", fitting.len())
        } else {
            String::new()
        };
        table.said.insert(0, format!("{program}{of}{several}"));
    }
    reading
}

/// Forms of the tables that have a column of times, with the line of text above each.
fn tables(lines: &[&str]) -> Vec<(Dialect, String)> {
    let mut found = Vec::new();
    let mut section = String::new();
    for (i, line) in lines.iter().enumerate() {
        let separator = [b'\t', b';', b',']
            .into_iter()
            .find(|separator| cells(line, *separator).len() > 1);
        let text = line.trim().trim_matches(['-', '*', '=', ' ']);
        let Some(separator) = separator else {
            if !text.is_empty() {
                section = text.to_owned();
            }
            continue;
        };
        let below = lines
            .get(i + 1)
            .map(|line| cells(line, separator))
            .unwrap_or_default();
        let units_below = below.len() > 1
            && below.iter().all(|cell| is_unit(cell))
            && below.iter().any(|cell| !cell.trim().is_empty());
        let mut dialect = Dialect {
            separator,
            decimal: Decimal::Point,
            header: Some(i),
            units_below,
            first: i + 1 + usize::from(units_below),
        };
        let time = find(&dialect.labels(lines), &Wanted::new("time"));
        if time.is_err() {
            continue;
        }
        // The decimal sign from the rows below.
        let end = lines.len().min(dialect.first + 200);
        if let Ok(seen) = sniff(&lines[dialect.first..end])
            && seen.separator == separator
        {
            dialect.decimal = seen.decimal;
        }
        found.push((dialect, section.clone()));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::decode;

    fn wanted() -> [Wanted; 2] {
        ["time", "volume"].map(Wanted::required)
    }

    fn read(text: &str, program: &str) -> TableReading {
        parse(
            &decode(text.as_bytes()).unwrap(),
            Path::new("raw/cine.txt"),
            &wanted(),
            program,
        )
    }

    #[test]
    fn a_curve_of_segment_is_read() {
        let text = "Name:\tP001\n\n\nTime[ms]\tEndovol[ml]\tEpivol[ml]\tPapvol\tRVEndovol[ml]\tRVEpivol[ml]\n\
            0.000000\t150.25\t260.1\t0.0\tNaN\tNaN\n33.500000\t148.5\t259.0\t0.0\tNaN\tNaN\n67.000000\t140.0\t255.0\t0.0\tNaN\tNaN\n";
        assert!(is_segment(text) && !is_cvi42(text));
        let table = read(text, "Segment").table.unwrap();
        assert_eq!(table.columns["time"], [0.0, 33.5, 67.0]);
        assert_eq!(table.columns["volume"], [150.25, 148.5, 140.0]);
        assert_eq!(table.line(1), 6);
    }

    #[test]
    fn the_curve_is_found_among_the_sections_of_a_report() {
        let text = "-----\nShort Axis 3D LV/RV Function (1)\n-----\n\nScientific Report Function | SAX Module\n\n\
            LV Function\n\nEDV\t150.2 \tml\nESV\t60.1 \tml\n\nFlow ROI\nPhase\tTime(ms)\tFlow(ml/s)\n1 \t0 \t10 \n2 \t30 \t20 \n3 \t60 \t5 \n\n\
            Volume curve\nPhase\tTime\tLV Endo Volume\tRV Endo Volume\n\tms\tml\tml\n1 \t0,0 \t150,2 \t160 \n2 \t30,5 \t140,5 \t150 \n3 \t61 \t120 \t140 \n\nEnd\n";
        assert!(is_cvi42(text));
        let table = read(text, "cvi42").table.unwrap();
        assert_eq!(table.columns["time"], [0.0, 30.5, 61.0]);
        assert_eq!(table.columns["volume"], [150.2, 140.5, 120.0]);
        assert!(
            table.said[0].contains("section `Volume curve`"),
            "{:?}",
            table.said
        );
        let without = text.replace("LV Endo Volume", "Myocardium");
        let told = read(&without, "cvi42").problems[0].to_string();
        assert!(told.contains("Time(ms), Flow(ml/s)"), "{told}");
    }
}

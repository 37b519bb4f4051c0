//! Readers of the files that laboratories export (docs/prepare.md).
//!
//! [`read()`] sees the format from the content, finds the columns of the wanted quantities by their
//! names and units, and reports its decisions in words. Each format has a module.

#![expect(
    clippy::result_large_err,
    reason = "a file is refused once, so that the size of its problem costs nothing"
)]
#![deny(missing_docs)]

pub mod acqknowledge;
mod clock;
mod columns;
mod compound_file;
pub mod delimited;
pub mod dialect;
pub mod edf;
pub mod excel;
mod grid;
mod headers;
pub mod labchart;
mod number;
pub mod plain;
mod samples;
mod stamps;
pub mod text;
mod told;
pub mod volume_reports;
mod wanted;
pub mod wfdb;
mod workbook_bounds;

use std::path::Path;

use cardiotwin_signals::Problem;
use cardiotwin_vocabulary::preparation::FileFormat;

pub use columns::UNREAD;
pub use number::Decimal;
pub use wanted::{Table, TableReading, Wanted};

use delimited::{Layout, binary, layout, parse_layout, refused};
use stamps::without_stamps;
use text::{Decoded, decode};

/// A file to read.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// Path of the file, for messages and for its extension.
    pub file: &'a Path,
    /// Quantities to read; the first one is time.
    pub wanted: &'a [Wanted],
    /// Format; `None` to see it from the content.
    pub format: Option<FileFormat>,
    /// Name of a workbook's sheet.
    pub sheet: Option<&'a str>,
    /// Number of a block of LabChart, from 1.
    pub block: Option<usize>,
}

/// Reads the content of a file.
/// - `beside`: reader of files that a header names
#[must_use]
pub fn read(bytes: &[u8], request: &Request<'_>, beside: &mut wfdb::Beside<'_>) -> TableReading {
    let Request { file, wanted, .. } = *request;
    if bytes.is_empty() {
        let problem = Problem::error(
            file,
            "an empty file",
            "a recording with a header",
            "export the recording again",
        );
        return refused(problem);
    }
    let decoded = decode(bytes);
    let seen = detect(bytes, decoded.as_ref(), file);
    let format = match (request.format, seen) {
        (Some(format), _) => format,
        (None, Some(format)) => format,
        (None, None) => return refused(binary(file)),
    };
    let other = |found: &str| {
        refused(Problem::error(
            file,
            found,
            format!("a file of the format {:?} in prepare.toml", format.word()),
            "correct `format`, or remove it to have the format seen from the content",
        ))
    };
    match format {
        FileFormat::Excel if excel::is_sheet(bytes) => {
            excel::parse(bytes, file, wanted, request.sheet)
        }
        FileFormat::Edf if edf::is_edf(bytes) => edf::parse(bytes, file, wanted),
        FileFormat::Excel => other("no workbook of Excel or OpenDocument"),
        FileFormat::Edf => other("no header of EDF or BDF"),
        _ => match &decoded {
            None => other("a binary file"),
            Some(decoded) => read_text(decoded, request, format, beside),
        },
    }
}

fn read_text(
    decoded: &Decoded<'_>,
    request: &Request<'_>,
    format: FileFormat,
    beside: &mut wfdb::Beside<'_>,
) -> TableReading {
    let Request { file, wanted, .. } = *request;
    let text = decoded.text.as_ref();
    let is_table = matches!(
        format,
        FileFormat::Csv | FileFormat::ExcelCsv | FileFormat::Millar
    );
    if is_table && let Some((decoded, said)) = without_stamps(decoded) {
        let mut reading = read_text(&decoded, request, format, beside);
        if let Some(table) = &mut reading.table {
            table.said.push(said);
        }
        return reading;
    }
    match format {
        FileFormat::Labchart => labchart::parse(decoded, file, wanted, request.block),
        FileFormat::Acqknowledge => acqknowledge::parse(decoded, file, wanted),
        FileFormat::Segment => {
            volume_reports::parse(decoded, file, wanted, "Segment's volume curve")
        }
        FileFormat::Cvi42 => volume_reports::parse(decoded, file, wanted, "report of cvi42"),
        FileFormat::Wfdb => wfdb::parse(text, file, wanted, beside),
        _ => match layout(text, file, wanted) {
            Ok(found) => {
                let mut reading = parse_layout(
                    decoded,
                    file,
                    wanted,
                    &Layout {
                        warn_of_others: found.warn_of_others && format != FileFormat::Millar,
                        ..found
                    },
                );
                if let Some(table) = &mut reading.table
                    && let Some(first) = table.said.first_mut()
                    && format == FileFormat::Millar
                {
                    first.insert_str(0, "text of Millar's software, ");
                }
                reading
            }
            Err(problem) => refused(problem),
        },
    }
}

/// Format of a file, from its content; `None` for a binary file of no known format.
#[must_use]
pub fn detect(bytes: &[u8], decoded: Option<&Decoded<'_>>, file: &Path) -> Option<FileFormat> {
    if excel::is_sheet(bytes) {
        return Some(FileFormat::Excel);
    }
    if edf::is_edf(bytes) {
        return Some(FileFormat::Edf);
    }
    let text = decoded?.text.as_ref();
    Some(if labchart::is_labchart(text) {
        FileFormat::Labchart
    } else if acqknowledge::is_acqknowledge(text) {
        FileFormat::Acqknowledge
    } else if volume_reports::is_segment(text) {
        FileFormat::Segment
    } else if volume_reports::is_cvi42(text) {
        FileFormat::Cvi42
    } else if wfdb::is_header(text, file) {
        FileFormat::Wfdb
    } else {
        FileFormat::Csv
    })
}

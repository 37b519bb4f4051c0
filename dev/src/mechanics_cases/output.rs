//! The output table: `t_s`, the displacement of each probe in mm and the volume of each cavity in
//! mL.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use cardiotwin_dev_solver::prescribed::Sample;

use super::error::CaseError;
use super::file::CaseFile;

/// A table that is written row by row, without buffering across rows.
pub struct Table {
    name: PathBuf,
    sink: Box<dyn std::io::Write>,
}

impl std::fmt::Debug for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Table")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl Table {
    /// Opens the file and writes the column heads.
    ///
    /// # Errors
    /// [`CaseError::Write`] when the file cannot be created or written.
    pub fn create(parsed: &CaseFile, out: Option<&Path>) -> Result<Self, CaseError> {
        let name = out.map_or_else(|| PathBuf::from("standard output"), Path::to_owned);
        let sink: Box<dyn std::io::Write> = match out {
            None => Box::new(std::io::stdout()),
            Some(path) => {
                let file = File::create(path).map_err(|source| CaseError::Write {
                    file: path.to_owned(),
                    source,
                })?;
                Box::new(BufWriter::new(file))
            }
        };
        let mut head = String::from("t_s");
        for probe in &parsed.probe {
            for axis in ["x", "y", "z"] {
                head += &format!(",{}_u{axis}_mm", probe.name);
            }
        }
        for cavity in &parsed.cavity {
            head += &format!(",{}_mL", cavity.name);
        }
        let mut table = Self { name, sink };
        table.line(&head)?;
        Ok(table)
    }

    fn line(&mut self, text: &str) -> Result<(), CaseError> {
        writeln!(self.sink, "{text}")
            .and_then(|()| self.sink.flush())
            .map_err(|source| CaseError::Write {
                file: self.name.clone(),
                source,
            })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`CaseError::Write`] when the file cannot be written.
    pub fn row(&mut self, sample: &Sample) -> Result<(), CaseError> {
        let mut text = format!("{}", (sample.t_ms * 1e3).round() / 1e6);
        for x in sample.probes_mm.iter().flatten() {
            text += &format!(",{x:.6}");
        }
        for v in &sample.cavities_mm3 {
            text += &format!(",{:.5}", v * 1e-3);
        }
        self.line(&text)
    }

    /// Flushes and closes the table.
    ///
    /// # Errors
    /// [`CaseError::Write`] when the file cannot be written.
    pub fn finish(mut self) -> Result<(), CaseError> {
        self.sink.flush().map_err(|source| CaseError::Write {
            file: self.name,
            source,
        })
    }
}

//! What the fits of the Windkessel print: table of estimates, names and lines for patient.toml.

use cardiotwin_report::results::atomic;
use cardiotwin_report::table::{Cell, Column};
use cardiotwin_schemas::afterload::{AfterloadQuantity, Determined};
use cardiotwin_schemas::organ::WindkesselParameters;
use serde::Serialize;

use super::afterload_args::AfterloadArgs;
use super::estimates;
use crate::error::CliError;
use crate::exit::Exit;
use crate::table::text;
use crate::talk::Talk;

/// Printable answer of a fit, other than its JSON.
pub(super) struct Said<'a> {
    /// Lines for patient.toml that set the fitted Windkessel.
    pub toml: &'a str,
    /// Warnings, one sentence each; `text` repeats them.
    pub warnings: &'a [String],
    /// Tables and sentences for the terminal.
    pub text: String,
}

/// Draws the plot if one was requested, and prints JSON, TOML or text as the arguments say.
pub(super) fn say(
    args: &AfterloadArgs,
    answer: &impl Serialize,
    said: &Said<'_>,
    plot: impl FnOnce() -> Option<String>,
    talk: &Talk,
) -> Result<Exit, CliError> {
    if let Some(file) = &args.plot {
        let svg = plot().unwrap_or_default();
        atomic::write(file, |out| out.write_all(svg.as_bytes()))
            .map_err(CliError::file("write", file))?;
    }
    if args.json {
        talk.json(answer)?;
    } else if args.toml {
        talk.data(said.toml)?;
    } else {
        talk.data(&said.text)?;
        talk.hint("`--toml` prints lines for patient.toml");
    }
    if args.json || args.toml {
        said.warnings
            .iter()
            .for_each(|warning| talk.say(&format!("warning: {warning}")));
    }
    Ok(Exit::Ok)
}

/// Table of the estimates. `determined` gives the word for how well an estimate is determined.
pub(super) fn estimates(
    quantities: &[AfterloadQuantity],
    confidence_level: f64,
    determined: impl Fn(&AfterloadQuantity) -> &'static str,
    talk: &Talk,
) -> String {
    let mut table = estimates::table(quantities, confidence_level);
    table.columns.push(Column::words("determined"));
    for (row, q) in std::iter::zip(&mut table.rows, quantities) {
        row.push(Cell::from(determined(q)));
    }
    text(&table, talk)
}

/// Word for how well a quantity is determined.
pub(super) fn in_a_word(determined: Determined) -> &'static str {
    match determined {
        Determined::Well => "well",
        Determined::Poorly => "poorly",
        Determined::Not => "not",
    }
}

/// R1, R2 and C (mmHg·s/mL, mmHg·s/mL, mL/mmHg) under their names in files.
#[must_use]
pub fn parameters(three: [f64; 3]) -> WindkesselParameters {
    WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: three[0],
        peripheral_resistance_mmhg_s_per_ml: three[1],
        compliance_ml_per_mmhg: three[2],
    }
}

/// A file's name as it may stand in a TOML comment: a line feed in it would end the comment.
pub(super) fn one_line(name: &str) -> String {
    name.chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

//! Tables of a robustness sweep, like Tables 3 to 10 of Jung et al. 2022.

use cardiotwin_schemas::robustness::{Condition, Moments, PatientRobustness, QuantitySpread};

use crate::table::{Column, Digits, Kind, Table, Tone, cells};

/// Spread of quantities over the samples.
///
/// - `results`: whether the quantities are results, which differ from the original's
#[must_use]
pub fn spreads(title: &str, quantities: &[QuantitySpread], results: bool) -> Table {
    let columns = [
        Column::new("quantity", Kind::Keys),
        Column::numbers("original"),
        Column::numbers("mean"),
        Column::numbers("sd").label("SD"),
        Column::numbers("min"),
        Column::numbers("max"),
        Column::figures("difference")
            .label("diff mean (SD; max)")
            .unit("%"),
        Column::figures("paper").label("paper's"),
        Column::numbers("spread").unit("%").digits(Digits::Share),
        Column::fixed("amplification", 2).label("of input's"),
    ];
    let mut table = Table::new("spreads", title.to_owned(), columns);
    for q in quantities {
        let moments = |d: Moments| {
            let (mean, most) = (percent(d.mean), percent(d.maximum));
            let sd = d.standard_deviation.map_or_else(|| "-".to_owned(), percent);
            format!("{mean} ({sd}; {most})")
        };
        let paper = q.paper.as_ref().map(|p| {
            let (mean, sd) = (p.mean_of_rel_diff_percent, p.sd_of_rel_diff_percent);
            format!("{mean} ({sd}; {})", p.max_of_rel_diff_percent)
        });
        table.rows.push(cells![
            q.name.as_str(),
            q.original,
            q.values.mean,
            q.values.standard_deviation,
            q.values.minimum,
            q.values.maximum,
            q.relative_differences.map(moments),
            paper,
            q.spread,
            q.amplification.as_ref().map(|a| a.ratio)
        ]);
    }
    let is_known = |key: &str| table.values(key).any(|value| !value.is_null());
    let [paper, amplified] = ["paper", "amplification"].map(is_known);
    table.without(|column| match column.key.as_ref() {
        "difference" => !results,
        "paper" => !paper,
        "amplification" => !amplified,
        _ => false,
    })
}

/// Errors of the fitted biomarkers: the original's, and mean and maximum of the samples'.
#[must_use]
pub fn errors(patient: &PatientRobustness) -> Table {
    let columns = [
        Column::words("results"),
        Column::new("biomarker", Kind::Keys),
        Column::numbers("original_to_measured").digits(Digits::Share),
        Column::figures("samples_to_perturbed"),
        Column::figures("samples_to_measured"),
    ];
    let title = "Errors of fitted biomarkers, mean (max) %";
    let mut table = Table::new("target-errors", title, columns);
    for e in &patient.target_errors {
        let pair = |m: &Moments| format!("{} ({})", percent(m.mean), percent(m.maximum));
        table.rows.push(cells![
            e.table.word(),
            e.biomarker.as_str(),
            e.original,
            pair(&e.to_perturbed),
            pair(&e.to_measured)
        ]);
    }
    table
}

/// Whether a condition is met, in a word with its tone.
#[must_use]
pub fn met(condition: &Condition) -> (&'static str, Tone) {
    match condition.passed {
        Some(true) => ("passed", Tone::Good),
        Some(false) => ("failed", Tone::Doubtful),
        None => ("open", Tone::Quiet),
    }
}

fn percent(share: f64) -> String {
    Digits::Share.write(&share.into())
}

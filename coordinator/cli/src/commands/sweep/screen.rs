//! Terminal output of a sensitivity analysis: ranking, indices, remarks.

use std::path::PathBuf;

use cardiotwin_engine::RunSummary;
use cardiotwin_schemas::sensitivity::{
    OutputSensitivity, RankedParameter, SensitivityRecord, SobolIndex,
};
use clap::ValueEnum;

use super::outcome::Phases;
use crate::table::Columns;
use crate::talk::{Talk, Tone, count};

/// Order of the indices in the biomarkers' columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Order {
    /// First-order indices S1.
    First,
    /// Total-effect indices ST.
    Total,
}

/// Parameters by rank: sum of total indices, ranks over the resamples, one column per biomarker,
/// reference and paper.
#[must_use]
pub fn ranking(record: &SensitivityRecord, order: Order, talk: &Talk) -> String {
    let word = match order {
        Order::First => "S1",
        Order::Total => "ST",
    };
    let mut headings: Vec<String> = [">RANK", "PARAMETER", ">SUM OF ST", ">RANKS", ">FIRST 9"]
        .iter()
        .map(|h| (*h).to_owned())
        .collect();
    headings.extend(
        record
            .outputs
            .iter()
            .map(|output| format!(">{word} {}", short(&output.name))),
    );
    if of_cell(record) {
        headings.push(">REFERENCE".to_owned());
    }
    headings.push(">PAPER".to_owned());
    let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
    let mut table = Columns::new(talk, &headings);
    for ranked in &record.ranking {
        table.toned(row(record, ranked, order));
    }
    table.text()
}

/// Whether the sweep is the cell's, for which reference values exist.
fn of_cell(record: &SensitivityRecord) -> bool {
    record.spec.design.organ.is_none()
}

fn row(
    record: &SensitivityRecord,
    ranked: &RankedParameter,
    order: Order,
) -> Vec<(String, Option<Tone>)> {
    let mut row = vec![
        (ranked.rank.to_string(), None),
        (
            ranked.name.clone(),
            ranked.paper.among_first_nine.then_some(Tone::Good),
        ),
        (
            with_half_width(ranked.sum_of_totals, ranked.half_width),
            None,
        ),
        (
            ranked
                .rank_interval
                .map_or("-".into(), |[low, high]| format!("{low}-{high}")),
            None,
        ),
        (
            ranked
                .share_among_first_nine
                .map_or("-".into(), |share| format!("{:.0} %", 100.0 * share)),
            None,
        ),
    ];
    row.extend(
        record
            .outputs
            .iter()
            .map(|output| (index_of(output, &ranked.name, order), None)),
    );
    let reference = ranked
        .reference
        .map(|r| format!("{} ({:.2})", r.rank, r.sum_of_totals));
    if of_cell(record) {
        row.push((reference.unwrap_or_else(|| "-".into()), None));
    }
    row.push((paper(ranked), None));
    row
}

fn paper(ranked: &RankedParameter) -> String {
    match (ranked.paper.among_first_nine, ranked.paper.rank) {
        (false, _) => "-".into(),
        (true, Some(rank)) => rank.to_string(),
        (true, None) => "yes".into(),
    }
}

fn index_of(output: &OutputSensitivity, name: &str, order: Order) -> String {
    let found = output.parameters.iter().find(|p| p.name == name);
    let index: Option<SobolIndex> = found.and_then(|p| match order {
        Order::First => p.first,
        Order::Total => p.total,
    });
    index.map_or("-".into(), |index| {
        with_half_width(index.value, index.half_width)
    })
}

fn with_half_width(value: f64, half_width: Option<f64>) -> String {
    let value = if value.abs() < 0.005 { 0.0 } else { value };
    half_width.map_or_else(
        || format!("{value:.2}"),
        |half_width| format!("{value:.2} ±{half_width:.2}"),
    )
}

/// Name of a biomarker without its unit.
fn short(biomarker: &str) -> &str {
    ["_kPa_per_ms", "_mmHg_per_ms", "_kPa", "_mmHg", "_ms", "_mL"]
        .iter()
        .find_map(|unit| biomarker.strip_suffix(unit))
        .unwrap_or(biomarker)
}

/// The `n` largest second-order indices of each biomarker.
#[must_use]
pub fn pairs(record: &SensitivityRecord, n: usize, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["BIOMARKER", "PARAMETER", "PARAMETER", ">S2"]);
    for output in &record.outputs {
        let mut pairs: Vec<_> = output
            .second
            .iter()
            .filter_map(|p| Some((&p.parameters, p.second?)))
            .collect();
        pairs.sort_by(|a, b| b.1.value.total_cmp(&a.1.value));
        for ([a, b], index) in pairs.into_iter().take(n) {
            let value = with_half_width(index.value, index.half_width);
            table.row([short(&output.name), a.as_str(), b.as_str(), value.as_str()]);
        }
    }
    table.text()
}

/// Half width of a total index's interval above which the ranking is not to be trusted: a tenth of the
/// variance, the size of the indices that people keep.
const WIDE: f64 = 0.1;

/// Warning where the total indices are known too roughly.
fn doubt(record: &SensitivityRecord) -> Option<String> {
    let parameters = record.outputs.iter().flat_map(|output| &output.parameters);
    let totals = || parameters.clone().filter_map(|parameter| parameter.total);
    if totals().all(|total| total.half_width.is_none()) {
        return Some(
            "warning: too few samples for intervals: read no index; take more with --samples\n"
                .to_owned(),
        );
    }
    let widths = totals().filter_map(|total| total.half_width);
    let widest = widths.fold(0.0, f64::max);
    (widest > WIDE).then(|| {
        format!(
            "warning: total indices are known to ± {widest:.2} only: take more samples (--samples); \
             four times as many halve it\n"
        )
    })
}

/// Number of samples behind the indices, and the agreement with the paper.
#[must_use]
pub fn remarks(record: &SensitivityRecord) -> String {
    let samples = &record.samples;
    let percent = |n: u64| format!("{:.1} %", 100.0 * n as f64 / samples.total.max(1) as f64);
    let by: Vec<String> = samples
        .excluded_by
        .iter()
        .map(|(name, n)| format!("{name} {}", percent(*n)))
        .collect();
    let by = if by.is_empty() {
        String::new()
    } else {
        format!(" ({})", by.join(", "))
    };
    let level = 100.0 * record.spec.analysis.confidence;
    let sum: f64 = record.outputs.iter().map(|o| o.sum_of_first).sum::<f64>()
        / record.outputs.len().max(1) as f64;
    let of_paper = record
        .ranking
        .iter()
        .take(9)
        .filter(|r| r.paper.among_first_nine)
        .count();
    let partial = if record.n_blocks < record.spec.n_blocks {
        "the first "
    } else {
        ""
    };
    let doubt = doubt(record).unwrap_or_default();
    format!(
        "{doubt}± half of the {level} % interval; RANKS: the {level} % interval of the rank; FIRST 9: \
         fraction of the resamples\n\
         {partial}{} of {} blocks, {} samples: {} physiological, {} excluded{by}, {} failed; {} not \
         periodic\n\
         first-order indices explain {:.0} % of the variance on average, interactions the rest\n\
         {of_paper} of the paper's nine are among the first nine\n",
        record.n_blocks,
        record.spec.n_blocks,
        samples.total,
        percent(samples.physiological),
        percent(samples.excluded),
        samples.failed,
        samples.not_periodic,
        100.0 * sum,
    )
}

/// Number of chunks, wall times, and paths of the files.
#[must_use]
pub fn closing(run: &RunSummary, phases: &Phases, files: &[PathBuf]) -> String {
    let done = if run.nothing_to_do() {
        "nothing to simulate".to_owned()
    } else {
        let published = usize::try_from(run.published).unwrap_or(usize::MAX);
        format!("{} of {} computed", count(published, "chunk"), run.patients)
    };
    let mut text = format!(
        "{done}; simulation {:.2} s, reading {:.2} s, analysis {:.2} s, writing {:.2} s, total {:.2} s\n",
        phases.simulate_s, phases.read_s, phases.analyse_s, phases.write_s, phases.total_s
    );
    files
        .iter()
        .for_each(|file| text.push_str(&format!("{}\n", file.display())));
    text
}

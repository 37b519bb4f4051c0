//! The page of a sensitivity analysis: figure, ranking, pairs, and the samples and settings behind
//! them.

use cardiotwin_schemas::sensitivity::{RankedParameter, SensitivityRecord, SobolIndex};
use maud::{Markup, html};

use super::figure::{heading, panel};
use crate::html::format::{fixed, symbol};
use crate::html::page;

/// Number of pairs shown for each biomarker; a file lists all of them.
const PAIRS: usize = 5;

/// HTML text of the page, which needs no network.
#[must_use]
pub fn page(record: &SensitivityRecord) -> String {
    let nav = html! {
        nav aria-label="sections" {
            div.navhead {
                a.home href="#top" { "sensitivity" }
                button.theme type="button" title="light or dark" aria-label="switch between light and dark" { "◐" }
            }
            ol {
                @for (id, name) in [("indices", "Indices"), ("ranking", "Ranking"), ("pairs", "Pairs"), ("basis", "Basis")] {
                    li { a href={ "#" (id) } { (name) } }
                }
            }
        }
    };
    let content = html! {
        div id="top" {}
        h1 { (title(record)) }
        p.lead { (summary(record)) }
        h2 id="indices" { "Indices" }
        p.key { span.first { "■ first-order index S1" } " " span.total { "■ total-effect index ST" } }
        p { (heading(record)) "." }
        @for output in &record.outputs { figure { (panel(record, output).render()) } }
        h2 id="ranking" { "Ranking" }
        (ranking(record))
        h2 id="pairs" { "Pairs" }
        (pairs(record))
        h2 id="basis" { "Basis" }
        (basis(record))
    };
    page::page("sensitivity · cardiotwin", &nav, &content).into_string()
}

fn title(record: &SensitivityRecord) -> String {
    match &record.spec.design.organ {
        None => "Sensitivity of the 0D cell".to_owned(),
        Some(organ) => format!("Sensitivity of the organ of {}", organ.patient),
    }
}

fn summary(record: &SensitivityRecord) -> String {
    let first: Vec<&str> = record
        .ranking
        .iter()
        .take(3)
        .map(|r| r.name.as_str())
        .collect();
    let nine = record
        .ranking
        .iter()
        .take(9)
        .filter(|r| r.paper.among_first_nine)
        .count();
    let partial = if record.n_blocks < record.spec.n_blocks {
        format!(
            " The sweep is not complete: {} of {} blocks.",
            record.n_blocks, record.spec.n_blocks
        )
    } else {
        String::new()
    };
    format!(
        "Most influential: {}. {nine} of the nine parameters of Jung et al. 2022 are among the first nine.{partial}",
        first.join(", ")
    )
}

fn ranking(record: &SensitivityRecord) -> Markup {
    html! {
        div.scroll tabindex="0" { table {
            thead { tr {
                th { "rank" } th { "parameter" } th { "sum of ST" } th { "ranks" } th { "among first 9" }
                @for output in &record.outputs { th { "ST " (symbol(&output.name)) } }
                @if of_cell(record) { th { "reference" } }
                th { "paper" }
            } }
            tbody { @for ranked in &record.ranking { (row(record, ranked)) } }
        } }
        p.quiet {
            "± half of the interval; ranks: interval of the rank over the resamples. Paper: the paper's nine for the cell's biomarkers."
            @if of_cell(record) { " Reference: an independent computation at the paper's settings." }
        }
    }
}

/// Whether the sweep is the cell's, for which reference values exist.
fn of_cell(record: &SensitivityRecord) -> bool {
    record.spec.design.organ.is_none()
}

fn row(record: &SensitivityRecord, ranked: &RankedParameter) -> Markup {
    let total = |output: &cardiotwin_schemas::sensitivity::OutputSensitivity| {
        output
            .parameters
            .iter()
            .find(|p| p.name == ranked.name)
            .and_then(|p| p.total)
    };
    html! { tr {
        td { (ranked.rank) }
        td { (symbol(&ranked.name)) }
        td { (value(Some(SobolIndex { value: ranked.sum_of_totals, half_width: ranked.half_width, n_blocks: 0 }))) }
        td { @if let Some([low, high]) = ranked.rank_interval { (low) "–" (high) } @else { "–" } }
        td { @if let Some(share) = ranked.share_among_first_nine { (fixed(Some(100.0 * share), 0)) " %" } @else { "–" } }
        @for output in &record.outputs { td { (value(total(output))) } }
        @if of_cell(record) { td { @if let Some(r) = ranked.reference { (r.rank) " (" (fixed(Some(r.sum_of_totals), 2)) ")" } @else { "–" } } }
        td {
            @if let Some(rank) = ranked.paper.rank { (rank) }
            @else if ranked.paper.among_first_nine { "among nine" }
            @else { "–" }
        }
    } }
}

fn value(index: Option<SobolIndex>) -> Markup {
    html! {
        (fixed(index.map(|i| i.value), 2))
        @if let Some(half) = index.and_then(|i| i.half_width) { span.quiet { " ± " (fixed(Some(half), 2)) } }
    }
}

fn pairs(record: &SensitivityRecord) -> Markup {
    html! {
        p { "The largest second-order indices of each biomarker; second_order.csv lists all." }
        div.scroll tabindex="0" { table {
            thead { tr { th { "biomarker" } th { "parameter" } th { "parameter" } th { "S2" } } }
            tbody {
                @for output in &record.outputs {
                    @let mut largest: Vec<_> = output.second.iter().filter(|p| p.second.is_some()).collect();
                    @let () = largest.sort_by(|a, b| {
                        let of = |p: &cardiotwin_schemas::sensitivity::PairIndices| p.second.map_or(0.0, |i| i.value);
                        of(b).total_cmp(&of(a))
                    });
                    @for pair in largest.into_iter().take(PAIRS) {
                        tr {
                            td { (symbol(&output.name)) }
                            td { (symbol(&pair.parameters[0])) }
                            td { (symbol(&pair.parameters[1])) }
                            td { (value(pair.second)) }
                        }
                    }
                }
            }
        } }
    }
}

fn basis(record: &SensitivityRecord) -> Markup {
    let (samples, design) = (&record.samples, &record.spec.design);
    let share = |n: u64| fixed(Some(100.0 * n as f64 / samples.total.max(1) as f64), 1);
    let points = design.scramble_seed.map_or("plain".to_owned(), |seed| {
        format!("scrambled (seed {seed})")
    });
    html! {
        p {
            (record.n_blocks) " of " (record.spec.n_blocks) " Saltelli blocks on " (points) " Sobol points, "
            (samples.total) " samples: " (share(samples.physiological)) " % physiological, "
            (share(samples.excluded)) " % excluded (their biomarkers are set to the means of the physiological samples), "
            (samples.failed) " failed, " (samples.not_periodic) " not periodic."
        }
        p {
            "Cycle " (design.cycle_length_ms) " ms, λ" sub { "0" } " " (design.lambda_0)
            @if of_cell(record) { ", cell engine " (record.arithmetic.join(", ")) }
            ", cardiotwin " (record.version) "."
        }
        div.scroll tabindex="0" { table {
            thead { tr { th { "parameter" } th { "from" } th { "to" } } }
            tbody {
                @for p in &design.parameters { tr { td { (symbol(&p.name)) } td { (p.lower) } td { (p.upper) } } }
                @for (name, value) in &design.fixed { tr { td { (symbol(name)) } td { (value) } td.quiet { "fixed" } } }
            }
        } }
    }
}

#[cfg(test)]
mod tests {
    use super::super::figure::tests::record;
    use super::*;

    #[test]
    fn a_partial_sweep_says_so_and_missing_indices_are_dashes() {
        let page = page(&record());
        assert!(page.contains("The sweep is not complete: 4 of 8 blocks."));
        assert!(page.contains("1 of the nine parameters of Jung et al. 2022"));
        assert!(page.contains("<td>–") && !page.contains("NaN"));
    }
}

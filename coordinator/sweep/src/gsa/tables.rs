//! CSV files of a sensitivity analysis. Numbers have the shortest form that reads back to the same
//! value.

use std::fmt::Write as _;

use cardiotwin_schemas::sensitivity::{SensitivityRecord, SobolIndex};

/// `indices.csv`: first-order and total index of each parameter for each biomarker, with half-widths of the intervals.
#[must_use]
pub fn indices(record: &SensitivityRecord) -> String {
    let mut text = "biomarker,parameter,S1,S1_half_width,ST,ST_half_width,blocks\n".to_owned();
    for output in &record.outputs {
        for p in &output.parameters {
            let blocks = p.total.or(p.first).map_or(0, |index| index.n_blocks);
            let _ = writeln!(
                text,
                "{},{},{},{},{blocks}",
                output.name,
                p.name,
                pair(p.first),
                pair(p.total)
            );
        }
    }
    text
}

/// `second_order.csv`: second-order index of each pair for each biomarker.
#[must_use]
pub fn second_order(record: &SensitivityRecord) -> String {
    let mut text = "biomarker,parameter_1,parameter_2,S2,S2_half_width\n".to_owned();
    for output in &record.outputs {
        for p in &output.second {
            let [a, b] = &p.parameters;
            let _ = writeln!(text, "{},{a},{b},{}", output.name, pair(p.second));
        }
    }
    text
}

/// `ranking.csv`: parameters by the sum of their total indices, next to the reference and the paper.
#[must_use]
pub fn ranking(record: &SensitivityRecord) -> String {
    let mut text = "rank,parameter,sum_of_ST,half_width,rank_low,rank_high,share_among_first_nine,reference_rank,\
                    reference_sum_of_ST,paper_nine,paper_rank\n"
        .to_owned();
    let whole = |value: Option<u32>| value.map_or_else(String::new, |value| value.to_string());
    for r in &record.ranking {
        let [low, high] = r
            .rank_interval
            .map_or([None, None], |ranks| ranks.map(Some));
        let _ = writeln!(
            text,
            "{},{},{:?},{},{},{},{},{},{},{},{}",
            r.rank,
            r.name,
            r.sum_of_totals,
            number(r.half_width),
            whole(low),
            whole(high),
            number(r.share_among_first_nine),
            whole(r.reference.map(|reference| reference.rank)),
            number(r.reference.map(|reference| reference.sum_of_totals)),
            u8::from(r.paper.among_first_nine),
            whole(r.paper.rank)
        );
    }
    text
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:?}"))
}

fn pair(index: Option<SobolIndex>) -> String {
    format!(
        "{},{}",
        number(index.map(|i| i.value)),
        number(index.and_then(|i| i.half_width))
    )
}

//! Conditions on the result of a robustness sweep, each with the value found.
//!
//! For data: a fit misses a perturbed target by at most two percentage points more than the
//! original fit misses the measured value. For guesses: the paper's own spreads (Tables 7 to 10),
//! and its largest means over the biomarkers.

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::robustness::{
    Condition, RobustnessMember, RobustnessTable, TableKind, TargetError, Uncertainty,
};
use cardiotwin_schemas::status::PatientState;

use super::paper::PAPER;

/// Share by which a fit may miss a perturbed target more than the original misses the measured one.
pub(super) const ALLOWANCE: f64 = 0.02;
/// Largest mean difference of a biomarker that the paper prints, step 1 and step 2 (Tables 8 and 10).
const PAPER_GUESS: [f64; 2] = [0.034, 0.128];

/// All conditions of one patient.
pub fn of(
    over: Uncertainty,
    tables: &[RobustnessTable],
    errors: &[TargetError],
    members: &[RobustnessMember],
) -> Vec<Condition> {
    let mut all = vec![finished(members)];
    match over {
        Uncertainty::Data => {
            for (table, words) in [
                (TableKind::Step1Biomarkers, "step 1"),
                (TableKind::Step2Biomarkers, "step 2"),
            ] {
                let errors: Vec<&TargetError> =
                    errors.iter().filter(|e| e.table == table).collect();
                all.extend(data(&errors, words));
            }
        }
        Uncertainty::Guess => {
            let biomarkers = [TableKind::Step1Biomarkers, TableKind::Step2Biomarkers];
            for (kind, limit) in biomarkers.into_iter().zip(PAPER_GUESS) {
                all.push(largest_mean(find(tables, kind), kind, limit));
            }
            all.extend(TableKind::ALL.map(|kind| printed(find(tables, kind), kind, over)));
        }
    }
    all
}

fn finished(members: &[RobustnessMember]) -> Condition {
    let over = |m: &&RobustnessMember| m.values.contains_key(&TableKind::Step2Biomarkers);
    let n = members.iter().filter(over).count();
    let names: Vec<&str> = members
        .iter()
        .filter(|m| m.state == PatientState::Failed)
        .map(|m| m.id.as_str())
        .collect();
    let failed = if names.is_empty() {
        String::new()
    } else {
        format!("; failed: {}", names.join(", "))
    };
    Condition {
        name: "every personalisation reached the verification beat".to_owned(),
        passed: members
            .iter()
            .all(|m| m.state.is_over())
            .then_some(n == members.len()),
        found: format!("{n} of {}{failed}", members.len()),
        limit: "all".to_owned(),
    }
}

fn data(errors: &[&TargetError], words: &str) -> [Condition; 3] {
    let worst = |name: String, limit: &str, sides: &dyn Fn(&TargetError) -> (f64, f64)| {
        let excess = |e: &TargetError| {
            let (error, reference) = sides(e);
            error - reference
        };
        let worst = errors.iter().max_by(|a, b| excess(a).total_cmp(&excess(b)));
        Condition {
            name,
            passed: worst.map(|e| excess(e) <= ALLOWANCE),
            found: worst.map_or_else(missing, |e| {
                let (error, reference) = sides(e);
                format!(
                    "{}: {} against {}",
                    e.biomarker,
                    percent(error),
                    percent(reference)
                )
            }),
            limit: limit.to_owned(),
        }
    };
    let to_original = "error of the original fit to the measured value + 2 points, for each \
                       biomarker";
    let mut every_sample = worst(
        format!("{words} meets perturbed targets, worst sample"),
        to_original,
        &|e| (e.to_perturbed.maximum, e.original),
    );
    every_sample.found += &beyond(errors);
    [
        worst(
            format!("{words} meets perturbed targets, mean over samples"),
            to_original,
            &|e| (e.to_perturbed.mean, e.original),
        ),
        every_sample,
        worst(
            format!("{words} follows perturbed targets, mean over samples"),
            "error of the same fits to the measured value + 2 points, for each biomarker",
            &|e| (e.to_perturbed.mean, e.to_measured.mean),
        ),
    ]
}

/// Number of samples that miss their target, for each biomarker.
fn beyond(errors: &[&TargetError]) -> String {
    let each = errors.iter().filter(|e| !e.beyond.is_empty());
    let each: Vec<String> = each
        .map(|e| format!("{} {}", e.beyond.len(), e.biomarker))
        .collect();
    if each.is_empty() {
        String::new()
    } else {
        format!("; samples beyond: {}", each.join(", "))
    }
}

fn largest_mean(table: Option<&RobustnessTable>, kind: TableKind, limit: f64) -> Condition {
    let five = Biomarker::TABLE_2.map(Biomarker::key);
    let means = table
        .into_iter()
        .flat_map(|t| &t.quantities)
        .filter(|q| five.contains(&q.name.as_str()));
    let largest = means
        .filter_map(|q| Some((q.name.as_str(), q.relative_differences?.mean)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    Condition {
        name: format!(
            "{}: largest mean difference of the paper's five biomarkers",
            kind.word()
        ),
        passed: largest.map(|(_, mean)| mean <= limit),
        found: largest.map_or_else(missing, |(name, mean)| format!("{name}: {}", percent(mean))),
        limit: format!("{}, the paper's largest", percent(limit)),
    }
}

/// Condition that each quantity's mean difference is no larger than the printed one.
fn printed(table: Option<&RobustnessTable>, kind: TableKind, over: Uncertainty) -> Condition {
    let number = kind.paper(over);
    let pairs = table
        .into_iter()
        .flat_map(|t| &t.quantities)
        .filter_map(|q| {
            let paper = PAPER.column(number, &q.name)?.mean_of_rel_diff_percent;
            Some((q.name.as_str(), 100.0 * q.relative_differences?.mean, paper))
        });
    let pairs: Vec<_> = pairs.collect();
    let beyond: Vec<String> = pairs
        .iter()
        .filter(|(_, found, paper)| *found > paper.at_most())
        .map(|(name, found, paper)| format!("{name} {found:.1} % against {paper} %"))
        .collect();
    Condition {
        name: format!(
            "{}: mean differences no larger than Table {number}'s",
            kind.word()
        ),
        passed: (!pairs.is_empty()).then_some(beyond.is_empty()),
        found: if pairs.is_empty() {
            missing()
        } else if beyond.is_empty() {
            format!("none of {} is larger", pairs.len())
        } else {
            format!(
                "{} of {} are larger: {}",
                beyond.len(),
                pairs.len(),
                beyond.join(", ")
            )
        },
        limit: format!("the mean that Table {number} prints for each quantity"),
    }
}

fn find(tables: &[RobustnessTable], kind: TableKind) -> Option<&RobustnessTable> {
    tables.iter().find(|t| t.table == kind)
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn missing() -> String {
    "no result yet".to_owned()
}

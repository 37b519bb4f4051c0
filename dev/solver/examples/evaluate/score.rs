//! Scores of the search on labelled cases.

use crate::classes::same_class;
use crate::load::Label;
use cardiotwin_discover::Discovery;
use std::collections::BTreeMap;
use std::fmt::Write;

/// A gap; not-a-number if a refit failed.
fn of(gap: Option<f64>) -> f64 {
    gap.unwrap_or(f64::NAN)
}

/// One case as a line of text.
pub fn line(id: &str, found: &Discovery, label: Option<&Label>, seconds: f64) -> String {
    let found = &found.findings;
    let truth = label.map_or(String::new(), |l| {
        let off = if l.off_catalogue {
            " off-catalogue"
        } else {
            ""
        };
        format!("[{}{off}; {}] ", l.effects.join("+"), l.band)
    });
    let ranked: Vec<String> = (found.effects.iter().take(3))
        .map(|e| {
            let mark = if e.plausible { "" } else { "!" };
            format!(
                "{}{mark} {:.1} ({:.2})",
                e.name, e.log_evidence, e.probability
            )
        })
        .collect();
    let lead = found.unexplained.as_ref().map_or(String::new(), |u| {
        format!(
            " UNEXPLAINED {} {}/{}",
            u.kind, u.place.signal, u.place.phase
        )
    });
    format!(
        "{id} {truth}-> [{}]{lead} threshold {:.1} p {:.4} nameless {:.1} gap {:.2}->{:.2} held out {:.2}->{:.2} | {} | {seconds:.1} s",
        found.accepted.join("+"),
        found.threshold,
        found.p_value,
        found.nameless_evidence,
        found.gap_before,
        found.gap_after,
        of(found.gap_heldout_before),
        of(found.gap_heldout_after),
        ranked.join(", "),
    )
}

struct Share {
    hits: usize,
    of: usize,
}

impl Share {
    fn new() -> Self {
        Self { hits: 0, of: 0 }
    }

    fn add(&mut self, hit: bool) {
        self.of += 1;
        self.hits += usize::from(hit);
    }
}

/// Scores of all cases as a table.
pub fn table(results: &[(String, Discovery)], labels: &BTreeMap<String, Label>) -> String {
    let names = [
        "singles, weak or better: right name first (accepted)",
        "singles, weak or better: right up to class",
        "singles, weak or better: among first two of the ranking",
        "nulls named (false alarms)",
        "doubles: first name one of the two",
        "doubles: both added",
        "off catalogue: unexplained or none",
        "at the limit or hard: right or none",
        "right name: held-out gap fell by 40 % (strong)",
    ];
    let mut shares: Vec<Share> = names.iter().map(|_| Share::new()).collect();
    let mut held = Vec::new();
    for (id, found) in results {
        let found = &found.findings;
        let Some(label) = labels.get(id) else {
            continue;
        };
        let first = found.accepted.first();
        let right = |name: &String| label.effects.contains(name);
        match label.effects.len() {
            0 if label.off_catalogue => shares[6].add(found.none),
            0 => shares[3].add(!found.none),
            1 if label.hard || label.band == "at the limit" => {
                shares[7].add(found.none || found.accepted.iter().all(right))
            }
            1 => {
                let truth = &label.effects[0];
                shares[0].add(first == Some(truth));
                shares[1].add(first.is_some_and(|f| same_class(f, truth)));
                shares[2].add(found.effects.iter().take(2).any(|e| e.name == *truth));
            }
            _ => {
                shares[4].add(first.is_some_and(right));
                shares[5].add(
                    label
                        .effects
                        .iter()
                        .all(|e| found.accepted.iter().any(|a| same_class(a, e))),
                );
            }
        }
        if first.is_some_and(right) {
            let (before, after) = (of(found.gap_heldout_before), of(found.gap_heldout_after));
            held.push(after);
            if label.band == "strong" {
                shares[8].add(after <= 0.6 * before);
            }
        }
    }
    let mut out = String::new();
    for (name, share) in names.iter().zip(&shares) {
        let _ = writeln!(out, "{name:56} {:3} of {:3}", share.hits, share.of);
    }
    let mean = held.iter().sum::<f64>() / held.len().max(1) as f64;
    let _ = writeln!(
        out,
        "{:56} {mean:.2} over {}",
        "right name: mean held-out gap after",
        held.len()
    );
    out
}

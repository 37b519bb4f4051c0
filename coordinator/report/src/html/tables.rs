//! Tables in a patient's section.

use std::collections::BTreeMap;

use cardiotwin_schemas::biomarkers::CELL_BIOMARKERS;
use cardiotwin_schemas::finite_element::VentricleFigures;
use cardiotwin_schemas::label::Label;
use cardiotwin_schemas::organ::{ActivationSpec, OneFibrePassive, OrganSpec};
use cardiotwin_schemas::outcome::{CellFitResult, OrganBeatResult};
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::step1::Step1Parameter;
use maud::{Markup, html};

use super::format::{fixed, percent, raw, significant, symbol};
use crate::results::PatientView;
use crate::results::comparison::relative_difference;

/// Relative distance below which a value counts as lying on a bound.
const ON_BOUND: f64 = 1e-3;

/// A table with its own scroll bar on a narrow screen.
#[must_use]
pub fn scrolling(table: &Markup) -> Markup {
    html! { div.scroll tabindex="0" { (table) } }
}

/// Cell with the unit of a key.
pub(super) fn unit(key: &str) -> Markup {
    let unit = Label::of(key).map_or("", |l| l.unit);
    html! { td.unit { (unit) } }
}

/// A signed difference in percent, shaded by its size. The number makes the colour unnecessary.
fn difference(share: Option<f64>) -> Markup {
    let class = match share.map(f64::abs) {
        Some(d) if d > 0.25 => "num diff far",
        Some(d) if d > 0.10 => "num diff off",
        _ => "num diff",
    };
    html! { td class=(class) data-value=(raw(share.map(|share| 100.0 * share))) { (percent(share)) } }
}

/// Cells with a bar that shows a value and its near-optimal interval between the bounds, and with
/// words if the value lies on a bound.
pub(super) fn bounds(
    value: f64,
    lower: f64,
    upper: f64,
    at_bound: bool,
    log: bool,
    interval: Option<[f64; 2]>,
) -> Markup {
    let within = |value: f64| {
        let share = if log && lower > 0.0 {
            (value / lower).ln() / (upper / lower).ln()
        } else {
            (value - lower) / (upper - lower)
        };
        share.clamp(0.0, 1.0)
    };
    let share = within(value);
    let word = if !at_bound {
        ""
    } else if share < 0.5 {
        "on the lower bound"
    } else {
        "on the upper bound"
    };
    html! {
        td.num { (significant(lower, 3)) }
        td.bar {
            svg viewBox="0 0 100 10" role="img" aria-label={ (fixed(Some(100.0 * share), 0)) " % of the way between the bounds" } {
                path.axis d="M4 5H96M4 2V8M96 2V8" {}
                @if let Some([from, to]) = interval {
                    path class="interval" d=(format!("M{:.1} 5H{:.1}", 4.0 + 92.0 * within(from), 4.0 + 92.0 * within(to))) {}
                }
                circle class=(if at_bound { "mark bound" } else { "mark inner" }) cx=(format!("{:.1}", 4.0 + 92.0 * share)) cy="5" r="3.4" {}
            }
        }
        td.num { (significant(upper, 3)) }
        td.flag { (word) }
    }
}

/// Whether a value lies on one of its bounds.
pub(super) fn on_bound(value: f64, [lower, upper]: [f64; 2]) -> bool {
    (value - lower).abs() <= ON_BOUND * lower.abs()
        || (value - upper).abs() <= ON_BOUND * upper.abs()
}

/// Table of the parameters that step 1 personalised; `None` before its first simulation.
#[must_use]
pub fn step1_parameters(patient: &PatientRecord) -> Option<Markup> {
    let settings = &patient.plan.settings.step1;
    let taken = match &patient.step1 {
        Some(summary) => summary.parameters,
        None => PatientView(patient).best_iteration()?.parameters,
    };
    let first = patient.iterations.first().map(|i| i.parameters.updated());
    Some(scrolling(&html! {
        table {
            caption { "Step 1: Tanh model and valves" }
            thead { tr {
                th scope="col" { "" } th.unit scope="col" { "unit" } th scope="col" { "first guess" } th scope="col" { "personalised" }
                th scope="col" { "lower" } th scope="col" { "between" } th scope="col" { "upper" } th scope="col" { "" }
            } }
            tbody {
                @for (k, (key, value)) in std::iter::zip(Step1Parameter::KEYS, taken.updated()).enumerate() {
                    tr {
                        th scope="row" { (symbol(key)) @if settings.frozen.iter().any(|f| f == key) { " (frozen)" } } (unit(key))
                        td.num { (first.map_or_else(String::new, |f| significant(f[k], 4))) }
                        td.num { b { (significant(value, 4)) } }
                        @match settings.bounds.get(key) {
                            Some(range) => (bounds(value, range[0], range[1], on_bound(value, *range), true, None)),
                            None => { td {} td {} td {} td {} }
                        }
                    }
                }
            }
        }
    }))
}

/// Decimals of a cell's biomarkers in tables, in the order of [`CELL_BIOMARKERS`].
const CELL_DECIMALS: [usize; CELL_BIOMARKERS.len()] = [2, 3, 1, 1, 1, 4];

/// Table of step 2's targets, the values that the fit reached, and the terms of its cost.
#[must_use]
pub fn cell_fit(fit: &CellFitResult) -> Markup {
    let others: BTreeMap<_, _> = fit
        .cost_terms
        .iter()
        .filter(|(name, value)| {
            CELL_BIOMARKERS.iter().all(|label| label.key != *name) && **value > 0.0
        })
        .collect();
    scrolling(&html! {
        table {
            caption { "Step 2: targets" span.quiet { ", cost " (significant(fit.cost, 3)) } }
            thead { tr {
                th scope="col" { "" } th.unit scope="col" { "unit" } th scope="col" { "target" } th scope="col" { "reached" }
                th scope="col" { "difference, %" } th scope="col" { "cost term" }
            } }
            tbody {
                @for (((key, target), reached), decimals) in fit.targets.by_name().into_iter().zip(fit.reached.values()).zip(CELL_DECIMALS) {
                    tr {
                        th scope="row" { (symbol(key)) } (unit(key))
                        td.num { (fixed(Some(target), decimals)) } td.num { (fixed(Some(reached), decimals)) }
                        (difference(relative_difference(reached, target)))
                        td.num { @if let Some(term) = fit.cost_terms.get(key) { (significant(*term, 2)) } }
                    }
                }
                @for (name, value) in others {
                    tr { th scope="row" colspan="5" { (name.replace('_', " ")) } td.num { (significant(*value, 2)) } }
                }
            }
        }
    })
}

/// Table of the passive state and loads that step 0 fitted or took from the input; `None` before
/// step 0 is done.
#[must_use]
pub fn passive_and_loads(patient: &PatientRecord) -> Option<Markup> {
    let result = &patient.step0.as_ref()?.result;
    let load = &result.circulation;
    let mut rows = match &result.organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => one_fibre(passive, activation),
        OrganSpec::External(organ) => one_fibre(&organ.passive, &organ.activation),
        OrganSpec::FiniteElement(organ) => finite_element(&organ.figures),
    };
    rows.extend([
        (
            "left atrial pressure",
            load.left_atrial_pressure_mmhg,
            "mmHg",
            "left_atrial_pressure_mmHg",
        ),
        (
            "characteristic resistance",
            load.afterload.characteristic_resistance_mmhg_s_per_ml,
            "mmHg·s/mL",
            "characteristic_resistance_mmHg_s_per_mL",
        ),
        (
            "peripheral resistance",
            load.afterload.peripheral_resistance_mmhg_s_per_ml,
            "mmHg·s/mL",
            "peripheral_resistance_mmHg_s_per_mL",
        ),
        (
            "compliance",
            load.afterload.compliance_ml_per_mmhg,
            "mL/mmHg",
            "compliance_mL_per_mmHg",
        ),
        (
            "Windkessel pressure at the start",
            load.initial_windkessel_pressure_mmhg,
            "mmHg",
            "initial_windkessel_pressure_mmHg",
        ),
    ]);
    // Keys of estimates may contain their table, as in `afterload.compliance_mL_per_mmHg`, or name
    // a whole table.
    let estimated = |key: &str| {
        result.estimates.iter().any(|e| {
            let last = e.key.rsplit('.').next().unwrap_or_default();
            last == key
                || (last == "afterload"
                    && key.contains("_mL")
                    && (key.contains("resistance") || key.contains("compliance")))
        })
    };
    Some(scrolling(&html! {
        table {
            caption { "Step 0: passive state and loads" }
            tbody {
                @for (name, value, unit, key) in rows {
                    tr {
                        th scope="row" title=(key) { (name) }
                        td.num { (significant(value, 4)) } td.unit { (unit) }
                        td.flag { @if estimated(key) { "estimated" } }
                    }
                }
                @for effect in &load.effects {
                    tr { th scope="row" { "effect: " (effect.name) } td.num {} td.unit {} td.flag { "accepted" @if patient.plan.is_unconfirmed { ", not confirmed on held-out data" } } }
                }
            }
        }
    }))
}

/// Name, value, unit, key.
type Row = (&'static str, f64, &'static str, &'static str);

fn one_fibre(passive: &OneFibrePassive, activation: &ActivationSpec) -> Vec<Row> {
    vec![
        (
            "wall volume",
            passive.wall_volume_ml,
            "mL",
            "wall_volume_mL",
        ),
        (
            "unloaded volume",
            passive.unloaded_volume_ml,
            "mL",
            "unloaded_volume_mL",
        ),
        (
            "end-diastolic volume",
            passive.end_diastolic_volume_ml,
            "mL",
            "end_diastolic_volume_mL",
        ),
        (
            "end-diastolic pressure",
            passive.end_diastolic_pressure_mmhg,
            "mmHg",
            "end_diastolic_pressure_mmHg",
        ),
        (
            "passive stiffness",
            passive.stiffness_kpa,
            "kPa",
            "stiffness_kPa",
        ),
        ("passive exponent", passive.exponent, "", "passive_exponent"),
        ("activation onset", activation.onset_ms, "ms", "onset_ms"),
        ("activation spread", activation.spread_ms, "ms", "spread_ms"),
    ]
}

fn finite_element(figures: &VentricleFigures) -> Vec<Row> {
    vec![
        ("nodes of the mesh", figures.nodes as f64, "", "nodes"),
        ("tetrahedra", figures.elements as f64, "", "elements"),
        ("mean edge", figures.mean_edge_mm, "mm", "mean_edge_mm"),
        (
            "wall volume",
            figures.wall_volume_ml,
            "mL",
            "wall_volume_mL",
        ),
        (
            "image volume",
            figures.image_volume_ml,
            "mL",
            "image_volume_mL",
        ),
        (
            "image pressure",
            figures.image_pressure_mmhg,
            "mmHg",
            "image_pressure_mmHg",
        ),
        (
            "unloaded volume",
            figures.unloaded_volume_ml,
            "mL",
            "unloaded_volume_mL",
        ),
        (
            "end-diastolic volume",
            figures.end_diastolic_volume_ml,
            "mL",
            "end_diastolic_volume_mL",
        ),
        (
            "end-diastolic pressure",
            figures.end_diastolic_pressure_mmhg,
            "mmHg",
            "end_diastolic_pressure_mmHg",
        ),
        (
            "passive stiffness",
            figures.stiffness_kpa,
            "kPa",
            "stiffness_kPa",
        ),
        (
            "factor of the exponents",
            figures.exponent_factor,
            "",
            "exponent_factor",
        ),
        ("activation onset", figures.onset_ms, "ms", "onset_ms"),
        ("activation spread", figures.spread_ms, "ms", "spread_ms"),
    ]
}

/// Sentences about the physiological checks that a simulation failed.
#[must_use]
pub fn failed_checks(what: &str, beat: &OrganBeatResult) -> Vec<Markup> {
    let failed = beat.checks.iter().filter(|c| !c.passed);
    failed
        .map(|c| html! { b { (what) ": " (c.name) } " failed: found " (c.found) ", expected " (c.expected) "." })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_on_a_bound_is_told_from_one_beside_it() {
        assert!(
            on_bound(1e-4, [1e-4, 1.0])
                && on_bound(1.0005, [1e-4, 1.0])
                && on_bound(-1.2, [-3.6, -1.2])
        );
        assert!(!on_bound(1.1e-4, [1e-4, 1.0]) && !on_bound(0.5, [1e-4, 1.0]));
    }
}

//! Table of the cell's parameters: step 2's fit next to the twin, with the twin's place between its
//! bounds.

use cardiotwin_schemas::outcome::{CellFitResult, FittedParameter};
use cardiotwin_schemas::record::PatientRecord;
use maud::{Markup, html};

use super::format::{significant, symbol};
use super::tables::{bounds, on_bound, scrolling, unit};
use crate::results::twin::moved_in_the_organ;

/// Value of a parameter with the bounds of the search that it came from.
struct Placed {
    value: f64,
    range: [f64; 2],
    at_bound: bool,
    /// Whether the search moved the logarithm.
    log: bool,
    /// Ends of the near-optimal interval, which is one of step 2's fit.
    near: Option<[f64; 2]>,
}

impl Placed {
    fn of_fit(p: &FittedParameter) -> Self {
        Self {
            value: p.value,
            range: [p.lower, p.upper],
            at_bound: p.at_bound,
            log: false,
            near: p.near_optimal.map(|near| [near.lower, near.upper]),
        }
    }

    /// The twin's value between the bounds of step 3; `None` if step 3 does not move the parameter.
    fn of_twin(patient: &PatientRecord, name: &str) -> Option<Self> {
        let value = *moved_in_the_organ(patient)?.get(name)?;
        let range = *patient.plan.settings.step3.bounds.get(name)?;
        Some(Self {
            value,
            range,
            at_bound: on_bound(value, range),
            log: true,
            near: None,
        })
    }

    fn cells(&self) -> Markup {
        let [lower, upper] = self.range;
        bounds(self.value, lower, upper, self.at_bound, self.log, self.near)
    }
}

/// The table. Where parameters were searched in the organ, place and bounds are the twin's, and
/// parameters that only this search moved, such as those of the valves, follow.
#[must_use]
pub fn table(patient: &PatientRecord, fit: &CellFitResult) -> Markup {
    let moved = moved_in_the_organ(patient);
    let has_twin = moved.is_some();
    let fitted = fit.parameters.iter().map(|p| {
        let twin = Placed::of_twin(patient, &p.name);
        let placed = twin.unwrap_or_else(|| Placed::of_fit(p));
        (p.name.as_str(), Some(p), placed)
    });
    let is_fitted = |name: &str| fit.parameters.iter().any(|p| p.name == name);
    let others = moved
        .into_iter()
        .flat_map(|moved| moved.keys())
        .filter(|name| !is_fitted(name))
        .filter_map(|name| Some((name.as_str(), None, Placed::of_twin(patient, name)?)));
    let rows: Vec<_> = fitted.chain(others).collect();
    let n_on_bounds = rows.iter().filter(|(.., placed)| placed.at_bound).count();
    let n_rows = rows.len();
    scrolling(&html! {
        table {
            caption {
                @if has_twin { "Twin: Land and Rice models, valves" } @else { "Step 2: Land and Rice models" }
                @if n_on_bounds > 0 { span.quiet { ", " (n_on_bounds) " of " (n_rows) " on a bound" } }
                @if let Some(found) = &fit.identifiability {
                    span.quiet {
                        "; near-optimal" @if has_twin { " in step 2's fit" } @else { " (thick line)" }
                        ": with these values and all other parameters refitted, a cost of at most "
                        (significant(found.threshold, 3)) " is reached"
                        @if !found.complete { "; some intervals may be wider" }
                    }
                }
            }
            thead { tr {
                th scope="col" { "" } th.unit scope="col" { "unit" }
                @if has_twin { th scope="col" { "step 2" } th scope="col" { "twin" } } @else { th scope="col" { "fitted" } }
                th scope="col" { "lower" } th scope="col" { "between" } th scope="col" { "upper" } th scope="col" { "" }
                @if fit.identifiability.is_some() { th scope="col" { "near-optimal" } th scope="col" { "" } }
            } }
            tbody {
                @for (name, p, placed) in &rows {
                    tr {
                        th scope="row" { (symbol(name)) } (unit(name))
                        @if has_twin { td.num { (p.map_or_else(|| "\u{2013}".to_owned(), |p| significant(p.value, 4))) } }
                        td.num { b { (significant(placed.value, 4)) } }
                        (placed.cells())
                        @if fit.identifiability.is_some() {
                            @let near = p.and_then(|p| p.near_optimal);
                            td.num { @if let Some(near) = near { (significant(near.lower, 3)) " to " (significant(near.upper, 3)) } }
                            td.flag { @if let Some(near) = near { (near.mark.as_str()) } }
                        }
                    }
                }
            }
        }
    })
}

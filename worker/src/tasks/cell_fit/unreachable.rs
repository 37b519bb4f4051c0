//! Describes the targets that a fit did not reach, and the changes that would reach them.

use cardiotwin_schemas::biomarkers::CellBiomarkers;
use cardiotwin_schemas::outcome::FittedParameter;

use crate::nodal::number;

/// Relative difference within which a target counts as reached.
const REACHED: f64 = 0.1;
/// Smallest share of the miss that a move past a bound must remove for the parameter to be named.
const HELPS: f64 = 0.1;
/// Largest number of parameters that are named.
const NAMED: usize = 3;

/// The cell with one parameter moved past the bound on which it lies.
#[derive(Debug, Clone)]
pub struct Beyond {
    /// Name of the parameter.
    pub name: String,
    /// Bound on which it lies.
    pub bound: f64,
    /// Value past the bound.
    pub value: f64,
    /// Biomarkers of the cell with this value.
    pub reached: CellBiomarkers,
}

/// Value past the bound on which a parameter lies, a tenth of the interval further. A positive
/// parameter stays positive.
#[must_use]
pub fn past_the_bound(parameter: &FittedParameter) -> Option<f64> {
    let step = 0.1 * (parameter.upper - parameter.lower);
    let upper =
        (parameter.upper - parameter.value).abs() < (parameter.value - parameter.lower).abs();
    let value = match (upper, parameter.lower > 0.0) {
        (true, _) => parameter.upper + step,
        (false, true) => parameter.lower - step.min(0.5 * parameter.lower),
        (false, false) => parameter.lower - step,
    };
    parameter.at_bound.then_some(value)
}

/// One sentence for each target that the optimum misses by more than 10 %.
///
/// - `a_p_kpa`: the fitted passive stiffness; `smax_ref_kpa`: the fixed value, `None` if it was
///   fitted
#[must_use]
pub fn describe(
    targets: &CellBiomarkers,
    reached: &CellBiomarkers,
    beyond: &[Beyond],
    smax_ref_kpa: Option<f64>,
    a_p_kpa: f64,
) -> Vec<String> {
    let rows = targets.by_name().into_iter().zip(reached.values());
    let missed = rows
        .enumerate()
        .filter(|(_, ((_, target), value))| ((value - target) / target).abs() > REACHED);
    missed
        .map(|(idx, ((name, target), value))| {
            let difference = 100.0 * (value - target) / target;
            let mut text = format!("{name}: {} aimed at, {} reached ({difference:+.0} %)", short(target), short(value));
            match (name, smax_ref_kpa) {
                ("Sa_max_kPa", Some(smax_ref)) => {
                    // Active and passive stress are in equilibrium. If both are scaled alike, the
                    // stress scales and the stretch stays the same.
                    let scale = target / value;
                    text.push_str(&format!(
                        "; Smax_ref is held at {} kPa, {} kPa with a_p {} kPa would reach it at the same stretch and durations",
                        short(smax_ref),
                        short(scale * smax_ref),
                        short(scale * a_p_kpa),
                    ));
                }
                _ => text.push_str(&wider(idx, target, value, beyond)),
            }
            text
        })
        .collect()
}

/// Names the bounds that keep the fit from the target at position `idx`.
fn wider(idx: usize, target: f64, value: f64, beyond: &[Beyond]) -> String {
    let miss = (value - target).abs();
    let gain = |change: &Beyond| (miss - (change.reached.values()[idx] - target).abs()) / miss;
    let mut helping: Vec<(f64, &Beyond)> =
        beyond.iter().map(|change| (gain(change), change)).collect();
    helping.retain(|(gain, _)| *gain >= HELPS);
    helping.sort_by(|a, b| b.0.total_cmp(&a.0));
    if helping.is_empty() {
        return "; not limited by a bound: the model cannot combine it with the other targets"
            .to_owned();
    }
    let named = helping.iter().take(NAMED).map(|(gain, change)| {
        let side = if change.value > change.bound {
            "upper"
        } else {
            "lower"
        };
        format!(
            "{} past its {side} bound {} (a bound of {} would close {:.0} % of the gap)",
            change.name,
            short(change.bound),
            short(change.value),
            100.0 * gain,
        )
    });
    format!("; nearer with {}", named.collect::<Vec<_>>().join(", "))
}

/// Formats a number with four significant digits.
fn short(value: f64) -> String {
    let scale = 10f64.powi(3 - value.abs().max(1e-12).log10().floor() as i32);
    number((value * scale).round() / scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGETS: CellBiomarkers = CellBiomarkers {
        sa_max_kpa: 120.0,
        dsadt_max_kpa_per_ms: 2.0,
        std30_ms: 200.0,
        std50_ms: 250.0,
        std90_ms: 340.0,
        lambda_min: 0.83,
    };

    fn parameter(value: f64, lower: f64, at_bound: bool) -> FittedParameter {
        FittedParameter {
            name: "n".to_owned(),
            value,
            lower,
            upper: 11.0,
            at_bound,
            near_optimal: None,
        }
    }

    #[test]
    fn what_is_reached_is_not_mentioned() {
        let reached = CellBiomarkers {
            sa_max_kpa: 115.0,
            ..TARGETS
        };
        assert!(describe(&TARGETS, &reached, &[], Some(120.0), 50.0).is_empty());
    }

    #[test]
    fn a_missing_stress_names_the_scale_that_reaches_it() {
        let reached = CellBiomarkers {
            sa_max_kpa: 80.0,
            ..TARGETS
        };
        let texts = describe(&TARGETS, &reached, &[], Some(120.0), 50.0);
        assert_eq!(texts.len(), 1);
        assert!(
            texts[0].starts_with("Sa_max_kPa: 120 aimed at, 80 reached (-33 %)"),
            "{}",
            texts[0]
        );
        assert!(
            texts[0].contains("held at 120 kPa, 180 kPa with a_p 75 kPa"),
            "{}",
            texts[0]
        );
    }

    #[test]
    fn a_missing_duration_names_the_bounds_that_stand_in_its_way() {
        let reached = CellBiomarkers {
            std30_ms: 150.0,
            ..TARGETS
        };
        let beyond = |name: &str, std30_ms| Beyond {
            name: name.to_owned(),
            bound: 7.0,
            value: 7.4,
            reached: CellBiomarkers {
                std30_ms,
                ..TARGETS
            },
        };
        let changes = [
            beyond("helps", 160.0),
            beyond("harms", 140.0),
            beyond("helps_more", 180.0),
        ];
        let texts = describe(&TARGETS, &reached, &changes, Some(120.0), 50.0);
        assert_eq!(texts.len(), 1);
        let end = "; nearer with helps_more past its upper bound 7 (a bound of 7.4 would close 60 % of the gap), \
                   helps past its upper bound 7 (a bound of 7.4 would close 20 % of the gap)";
        assert!(texts[0].ends_with(end), "{}", texts[0]);
        let texts = describe(&TARGETS, &reached, &[], Some(120.0), 50.0);
        assert!(texts[0].contains("not limited by a bound"), "{}", texts[0]);
    }

    #[test]
    fn past_a_bound_is_a_tenth_of_the_interval_and_never_through_zero() {
        assert_eq!(past_the_bound(&parameter(11.0, 1.0, true)), Some(12.0));
        assert_eq!(past_the_bound(&parameter(1.0, 1.0, true)), Some(0.5));
        assert_eq!(past_the_bound(&parameter(-9.0, -9.0, true)), Some(-11.0));
        assert_eq!(past_the_bound(&parameter(5.0, 1.0, false)), None);
    }
}

//! Coordinates of the moved parameters for searches and samplers, and the limit of cells that an
//! organ tolerates.

use std::collections::BTreeMap;

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::posterior::TruncatedNormal;
use cardiotwin_calibrate::space_mapping::Prior;
use cardiotwin_models::contraction::LAMBDA_CAP;
use cardiotwin_schemas::organ::cell_default;
use cardiotwin_schemas::task::{MovedParameter, OrganBeatSpec};

/// A moved parameter. Its coordinate is the logarithm of its magnitude.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Name of the parameter, with its unit.
    pub name: String,
    sign: f64,
    /// Bounds of the coordinate.
    pub interval: Interval,
    /// Prior distribution of the coordinate.
    pub prior: Prior,
}

impl Axis {
    fn new(name: &str, moved: &MovedParameter) -> Self {
        let [a, b, centre] = [moved.lower, moved.upper, moved.centre].map(|value| value.abs().ln());
        let interval = Interval::new(a.min(b), a.max(b));
        Self {
            name: name.to_owned(),
            sign: moved.upper.signum(),
            interval,
            prior: Prior {
                centre: interval.clamp(centre),
                width: moved.log_sd,
            },
        }
    }

    /// Prior distribution of the coordinate, truncated to its bounds.
    #[must_use]
    pub fn truncated(&self) -> TruncatedNormal {
        TruncatedNormal::new(self.prior, self.interval)
    }

    /// Value of the parameter, in the unit of its name.
    #[must_use]
    pub fn value(&self, x: f64) -> f64 {
        self.sign * x.exp()
    }
}

/// Axes of the moved parameters, in the order of their names.
#[must_use]
pub fn axes(parameters: &BTreeMap<String, MovedParameter>) -> Vec<Axis> {
    parameters
        .iter()
        .map(|(name, moved)| Axis::new(name, moved))
        .collect()
}

/// Parameter values by name at a point.
#[must_use]
pub fn named(axes: &[Axis], x: &[f64]) -> BTreeMap<String, f64> {
    axes.iter()
        .zip(x)
        .map(|(axis, x)| (axis.name.clone(), axis.value(*x)))
        .collect()
}

/// Point of the parameter values, with the prior's centre for a missing value.
#[must_use]
pub fn point(axes: &[Axis], values: &BTreeMap<String, f64>) -> Vec<f64> {
    axes.iter()
        .map(|axis| {
            values
                .get(&axis.name)
                .map_or(axis.prior.centre, |v| v.abs().ln())
        })
        .collect()
}

/// Whether Ca50 stays above the resting calcium at any stretch that the model allows. With another
/// cell, the organ's weakest nodes may stretch further than in any earlier beat.
#[must_use]
pub fn is_sensitive(beat: &OrganBeatSpec) -> bool {
    cell_value(beat, "beta_1_uM") > least_length_dependence(beat)
}

/// The point, with β₁ moved to the weakest length dependence that [`is_sensitive`] accepts where it
/// would be too strong; `None` if the bounds of β₁ exclude that. A search then slides along this
/// limit instead of ending there.
#[must_use]
pub fn tolerated(beat: &OrganBeatSpec, axes: &[Axis], x: &[f64]) -> Option<Vec<f64>> {
    let trial = beat.with_parameters(&named(axes, x));
    if is_sensitive(&trial) {
        return Some(x.to_vec());
    }
    let j = axes.iter().position(|axis| axis.name == "beta_1_uM")?;
    // A little inside, so that rounding does not decide.
    let limit = 0.999 * least_length_dependence(&trial);
    let mut moved = x.to_vec();
    moved[j] = limit.abs().ln();
    let is_within = limit < 0.0 && axes[j].interval.clamp(moved[j]) == moved[j];
    is_within.then_some(moved)
}

/// β₁ \[µM\] at which Ca50 reaches the resting calcium at the largest stretch.
fn least_length_dependence(beat: &OrganBeatSpec) -> f64 {
    (cell_value(beat, "Ca_res_uM") - cell_value(beat, "Ca50_ref_uM")) / (LAMBDA_CAP - 1.0)
}

/// Value of a cell's parameter, which is the default where the beat has none of its own.
fn cell_value(beat: &OrganBeatSpec, name: &str) -> f64 {
    let given = beat
        .contraction
        .cell_parameters()
        .and_then(|cell| cell.get(name).copied());
    given.or_else(|| cell_default(name)).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::sweep::organ::tests::beat;
    use cardiotwin_schemas::organ::ValveParameters;
    use cardiotwin_schemas::step3::Step3Settings;

    #[test]
    fn an_insensitive_cell_gets_the_strongest_length_dependence_that_is_tolerated() {
        let names = ["Ca50_ref_uM", "beta_1_uM"];
        let settings = Step3Settings {
            parameters: names.map(str::to_owned).to_vec(),
            ..Step3Settings::default()
        };
        let mut moved = settings.moved(&ValveParameters::default());
        for parameter in moved.values_mut() {
            (parameter.lower, parameter.upper) = if parameter.upper < 0.0 {
                (-4.0, -0.5)
            } else {
                (0.3, 1.2)
            };
        }
        let (beat, axes) = (beat(), axes(&moved));
        let x = |ca50: f64, beta: f64| vec![ca50.ln(), f64::ln(-beta)];
        assert_eq!(tolerated(&beat, &axes, &x(0.8, -2.0)), Some(x(0.8, -2.0)));
        let rest = cell_value(&beat, "Ca_res_uM");
        let found = tolerated(&beat, &axes, &x(0.4, -3.9)).expect("a length dependence");
        let limit = (rest - 0.4) / (LAMBDA_CAP - 1.0);
        assert!((axes[1].value(found[1]) / limit - 0.999).abs() < 1e-9);
        assert!(is_sensitive(&beat.with_parameters(&named(&axes, &found))));
        assert_eq!(
            tolerated(&beat, &axes, &x(rest + 0.02, -2.0)),
            None,
            "the bounds exclude it"
        );
    }
}

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
    let value = |name: &str| {
        let given = beat
            .contraction
            .cell_parameters()
            .and_then(|cell| cell.get(name).copied());
        given.or_else(|| cell_default(name)).unwrap_or(f64::NAN)
    };
    value("Ca50_ref_uM") + value("beta_1_uM") * (LAMBDA_CAP - 1.0) > value("Ca_res_uM")
}

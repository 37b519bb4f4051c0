//! Small calibration errors that every measurement has (offset of the pressure, shift and factor of the volume): part of the
//! model discrepancy while a model is fitted, and estimated afterwards, so that predictions can be compared with the data.

use crate::forward::Prediction;
use crate::noise::{Whitener, slopes};
use crate::problem::Data;
use serde::{Deserialize, Serialize};

/// Posterior means of the calibration errors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[allow(non_snake_case)]
pub struct Calibration {
    /// Measured minus true pressure \[mmHg\].
    pub pressure_offset_mmHg: f64,
    /// Delay of the frames relative to the pressure \[ms\].
    pub volume_delay_ms: f64,
    /// Measured over true volume, minus one.
    pub volume_excess: f64,
}

/// Largest error, in prior standard deviations. A larger one has a name in the catalogue.
const LARGEST_SD: f64 = 2.0;

/// Posterior mean of the amplitude of an error with the given shape and prior standard deviation
/// `sd`.
///
/// It is sd² hᵀ C⁻¹ r, because the covariance includes the error already. It is limited to errors
/// too small for a name.
fn amplitude(whitener: &Whitener<'_>, shape: &[f64], residual: &[f64], sd: f64) -> f64 {
    let (h, r) = (whitener.whiten(shape), whitener.whiten(residual));
    let mean = sd * sd * h.iter().zip(&r).map(|(h, r)| h * r).sum::<f64>();
    mean.clamp(-LARGEST_SD * sd, LARGEST_SD * sd)
}

impl Calibration {
    /// Estimates the errors from the residuals of a beat.
    #[must_use]
    pub fn of(data: &Data, beat: &Prediction) -> Self {
        let (p, v) = (&data.pressure, &data.volume);
        let (model_p, model_v) = (
            beat.sampled(&beat.pressure_mmhg, &p.time_ms),
            beat.sampled(&beat.volume_ml, &v.time_ms),
        );
        let (rp, rv) = (p.residual(&model_p), v.residual(&model_v));
        let (white_p, white_v) = (p.whitener(&model_p), v.whitener(&model_v));
        let discrepancy = &data.error_model;
        // A delay changes the frames by minus their slope.
        let delayed: Vec<f64> = slopes(&v.time_ms, &v.value, crate::noise::VOLUME_SLOPE_MS)
            .iter()
            .map(|s| -s)
            .collect();
        Self {
            pressure_offset_mmHg: amplitude(
                &white_p,
                &vec![1.0; p.len()],
                &rp,
                discrepancy.offset_mmhg,
            ),
            volume_delay_ms: amplitude(&white_v, &delayed, &rv, discrepancy.shift_ms),
            volume_excess: amplitude(&white_v, &model_v, &rv, discrepancy.scale),
        }
    }

    /// The beat as measured with these errors. Quantities that are not measured do not change.
    #[must_use]
    pub fn apply(&self, beat: &Prediction) -> Prediction {
        let n = beat.volume_ml.len();
        let delayed = |i: usize| {
            beat.at(
                &beat.volume_ml,
                i as f64 * beat.step_ms - self.volume_delay_ms,
            )
        };
        Prediction {
            pressure_mmhg: beat
                .pressure_mmhg
                .iter()
                .map(|p| p + self.pressure_offset_mmHg)
                .collect(),
            volume_ml: (0..n)
                .map(|i| delayed(i) * (1.0 + self.volume_excess))
                .collect(),
            ..beat.clone()
        }
    }
}

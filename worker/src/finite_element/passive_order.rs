//! Description of a search for the passive state that rank 0 sends to the other ranks.

use cardiotwin_mechanics::organ::{PassiveFit, PassiveJob, RightPressure, WallParameters};
use cardiotwin_schemas::finite_element::WallSettings;
use serde::{Deserialize, Serialize};

use super::right_ventricle::StoredRightPressure;
use super::wall;

/// Description of a search that rank 0 sends to the other ranks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassiveOrder {
    wall: WallSettings,
    /// Kind of the fit, with its numbers in the order of the variant's fields.
    fit: (Fit, Vec<f64>),
    slope: Option<[[f64; 2]; 2]>,
    steepened_by: Option<f64>,
    /// Pressure of the right ventricle.
    right_pressure: Option<StoredRightPressure>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Fit {
    ImageUnloaded,
    Given,
    ThreePoints,
    Unloaded,
}

impl PassiveOrder {
    /// Describes a job. `settings` must give the job's wall, except for its law.
    pub(super) fn of(job: &PassiveJob, settings: &WallSettings) -> Self {
        let fit = match job.target {
            PassiveFit::ImageUnloaded {
                end_diastolic_pressure_kpa,
            } => (Fit::ImageUnloaded, vec![end_diastolic_pressure_kpa]),
            PassiveFit::Given {
                image_pressure_kpa,
                end_diastolic_pressure_kpa,
            } => (
                Fit::Given,
                vec![image_pressure_kpa, end_diastolic_pressure_kpa],
            ),
            PassiveFit::ThreePoints {
                image_pressure_kpa,
                end_diastolic_pressure_kpa,
                end_diastolic_volume_mm3,
                unloaded_volume_mm3,
            } => {
                let pressures = [image_pressure_kpa, end_diastolic_pressure_kpa];
                (
                    Fit::ThreePoints,
                    [pressures, [end_diastolic_volume_mm3, unloaded_volume_mm3]].concat(),
                )
            }
            PassiveFit::Unloaded {
                end_diastolic_pressure_kpa,
                unloaded_volume_mm3,
            } => (
                Fit::Unloaded,
                vec![end_diastolic_pressure_kpa, unloaded_volume_mm3],
            ),
        };
        let wall = wall::with_muscle(settings, job.wall.muscle);
        let right_pressure = job
            .wall
            .right_pressure
            .as_ref()
            .map(StoredRightPressure::from);
        Self {
            wall,
            fit,
            slope: job.slope,
            steepened_by: job.steepened_by,
            right_pressure,
        }
    }

    pub(super) fn job(&self) -> PassiveJob {
        let of = |k: usize| self.fit.1.get(k).copied().unwrap_or(f64::NAN);
        let target = match self.fit.0 {
            Fit::ImageUnloaded => PassiveFit::ImageUnloaded {
                end_diastolic_pressure_kpa: of(0),
            },
            Fit::Given => PassiveFit::Given {
                image_pressure_kpa: of(0),
                end_diastolic_pressure_kpa: of(1),
            },
            Fit::ThreePoints => PassiveFit::ThreePoints {
                image_pressure_kpa: of(0),
                end_diastolic_pressure_kpa: of(1),
                end_diastolic_volume_mm3: of(2),
                unloaded_volume_mm3: of(3),
            },
            Fit::Unloaded => PassiveFit::Unloaded {
                end_diastolic_pressure_kpa: of(0),
                unloaded_volume_mm3: of(1),
            },
        };
        // Exponents are those of the settings' own law.
        let right_pressure = self.right_pressure.as_ref().map(RightPressure::from);
        let wall = WallParameters {
            right_pressure,
            ..wall::parameters(&self.wall, 1.0, 0.0)
        };
        PassiveJob {
            wall,
            target,
            slope: self.slope,
            steepened_by: self.steepened_by,
        }
    }
}

//! Pressure of a passive right ventricle, from step 0's specification through to the beat.

use cardiotwin_mechanics::organ::{PressureCourse, RightPressure};
use cardiotwin_schemas::finite_element::RightPressureSpec;
use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{Continuation, Quantity, resample};
use cardiotwin_units::{MMHG_PER_KPA, Ms};

use super::FiniteElementError;
use crate::error::TaskError;
use crate::inputs::read_trace;

/// Reads the right ventricle's pressure for a known end-diastolic pressure of the left ventricle.
///
/// # Errors
/// [`TaskError`] when the trace cannot be read or resampled, [`FiniteElementError::RightPressure`]
/// when step 0 could not load both ventricles together.
pub fn read(
    spec: &RightPressureSpec,
    cycle_ms: f64,
    end_diastolic_pressure_mmhg: f64,
) -> Result<RightPressure, TaskError> {
    let course = match spec {
        RightPressureSpec::Constant { pressure_mmhg } => {
            PressureCourse::constant(pressure_mmhg / MMHG_PER_KPA)
        }
        RightPressureSpec::Trace { file } => {
            let trace = read_trace(file, Quantity::Pressure)?;
            let trace = resample(&trace, Continuation::periodic(Ms(cycle_ms)), STEP)?;
            let kpa = trace
                .values()
                .iter()
                .map(|mmhg| mmhg / MMHG_PER_KPA)
                .collect();
            PressureCourse {
                time_ms: trace.time_ms().to_vec(),
                kpa,
                cycle_ms,
            }
        }
    };
    let at_end_diastole_mmhg = course.at(0.0) * MMHG_PER_KPA;
    if at_end_diastole_mmhg != 0.0 && end_diastolic_pressure_mmhg <= 0.0 {
        let (left_mmhg, right_mmhg) = (end_diastolic_pressure_mmhg, at_end_diastole_mmhg);
        return Err(FiniteElementError::RightPressure {
            left_mmhg,
            right_mmhg,
        }
        .into());
    }
    let per_left = if at_end_diastole_mmhg == 0.0 {
        0.0
    } else {
        at_end_diastole_mmhg / end_diastolic_pressure_mmhg
    };
    Ok(RightPressure { course, per_left })
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use cardiotwin_schemas::hash::sha256_hex;
    use cardiotwin_schemas::task::InputFile;

    use super::*;

    #[test]
    fn a_trace_is_taken_at_its_times_and_its_start_is_end_diastole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("right.csv");
        let mut text = "time_ms,pressure_mmHg\n".to_owned();
        for t in (0..=600).step_by(10) {
            let p = 5.0 + 20.0 * (std::f64::consts::PI * f64::from(t) / 600.0).sin().powi(2);
            writeln!(text, "{t},{p}").unwrap();
        }
        std::fs::write(&path, &text).unwrap();
        let file = InputFile {
            name: "right".to_owned(),
            path,
            sha256: sha256_hex(text.as_bytes()),
        };
        let spec = RightPressureSpec::Trace { file };
        let right = read(&spec, 600.0, 10.0).unwrap();
        assert!((right.per_left - 0.5).abs() < 1e-12);
        for (t, mmhg) in [(0.0, 5.0), (300.0, 25.0), (600.0, 5.0), (900.0, 25.0)] {
            assert!(
                (right.course.at(t) * MMHG_PER_KPA - mmhg).abs() < 1e-6,
                "{t} ms"
            );
        }
        let stored = serde_json::to_value(&right).unwrap();
        for key in ["time_ms", "pressure_kpa", "cycle_ms", "per_left"] {
            assert!(stored.get(key).is_some(), "{key}");
        }
        assert_eq!(
            serde_json::from_value::<RightPressure>(stored).unwrap(),
            right
        );
        assert!(
            read(&spec, 600.0, 0.0)
                .unwrap_err()
                .to_string()
                .contains("end-diastolic")
        );
        let none = read(
            &RightPressureSpec::Constant { pressure_mmhg: 0.0 },
            600.0,
            0.0,
        )
        .unwrap();
        assert_eq!((none.per_left, none.course.at(1.0)), (0.0, 0.0));
    }
}

//! Elastance of one patient: the twin's from virtual loads, next to estimates from the patient's own beat.

use super::arterial::arterial_elastance_mmhg_per_ml;
use super::beat::Beat;
use super::internal_resistance::InternalResistance;
use super::line::{EndSystolicLine, PreloadRecruitableStrokeWork};
use super::normal::{ELASTANCE_MMHG_PER_ML, PRELOAD_RECRUITABLE_STROKE_WORK_MMHG};
use super::single_beat::{Recording, bilinear, isovolumic_maximum, normalised_elastance};
use serde::Serialize;

/// A value, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Outcome<T> {
    /// The value.
    Found(T),
    /// No value.
    None {
        /// Reason, in words.
        reason: String,
    },
}

impl<T> Outcome<T> {
    fn of<S, E: std::fmt::Display>(result: Result<S, E>, value: impl FnOnce(S) -> T) -> Self {
        match result {
            Ok(found) => Self::Found(value(found)),
            Err(error) => Self::None {
                reason: error.to_string(),
            },
        }
    }
}

/// A line's slope and intercept with their standard errors, which two beats do not have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LineValues {
    /// Slope: Ees \[mmHg/mL\] or Mw \[mmHg\].
    pub slope: f64,
    /// Standard error of the slope, in its unit.
    pub slope_standard_error: Option<f64>,
    /// Intercept V0 or Vw \[mL\].
    #[serde(rename = "intercept_mL")]
    pub intercept_ml: f64,
    /// Standard error of the intercept \[mL\].
    #[serde(rename = "intercept_standard_error_mL")]
    pub intercept_standard_error_ml: Option<f64>,
    /// Standard deviations by which the slope lies above the mean of [`super::normal`]; dimensionless.
    pub slope_z_score: f64,
}

/// The twin's values, from its beats at virtual loads.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TwinElastance {
    /// End-systolic line, slope in mmHg/mL.
    #[serde(rename = "end_systolic_line_mmHg_per_mL")]
    pub end_systolic_line: Outcome<LineValues>,
    /// Preload-recruitable stroke work, slope in mmHg.
    #[serde(rename = "preload_recruitable_stroke_work_mmHg")]
    pub preload_recruitable_stroke_work: Outcome<LineValues>,
    /// Internal resistance with the line's V0 \[mmHg s/mL\].
    #[serde(rename = "internal_resistance_mmHg_s_per_mL")]
    pub internal_resistance_mmhg_s_per_ml: Outcome<f64>,
    /// Effective arterial elastance of the first beat \[mmHg/mL\].
    #[serde(rename = "arterial_elastance_mmHg_per_mL")]
    pub arterial_elastance_mmhg_per_ml: Outcome<f64>,
}

/// Ees of the patient's own beat by each method \[mmHg/mL\].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SingleBeatElastance {
    /// Chen et al. 2001.
    #[serde(rename = "normalised_elastance_mmHg_per_mL")]
    pub normalised_elastance: Outcome<f64>,
    /// Hayashi et al. 2000.
    #[serde(rename = "bilinear_mmHg_per_mL")]
    pub bilinear: Outcome<f64>,
    /// ten Brinke et al. 2010.
    #[serde(rename = "isovolumic_maximum_mmHg_per_mL")]
    pub isovolumic_maximum: Outcome<f64>,
}

impl TwinElastance {
    /// Values of a twin's beats.
    ///
    /// - `fillings`: beats of other fillings, the first at rest; the lines go through these, as in an
    ///   occlusion of the vena cava
    /// - `afterloads`: beats of other afterloads, which the internal resistance needs too: loops of filling
    ///   alone are alike
    #[must_use]
    pub fn of(fillings: &[Beat], afterloads: &[Beat]) -> Self {
        let beats = fillings;
        let line = EndSystolicLine::through(beats);
        let all: Vec<Beat> = fillings.iter().chain(afterloads).cloned().collect();
        let with_line = |f: &dyn Fn(&EndSystolicLine) -> Result<f64, String>| match &line {
            Ok(line) => Outcome::of(f(line), |value| value),
            Err(error) => Outcome::None {
                reason: error.to_string(),
            },
        };
        Self {
            internal_resistance_mmhg_s_per_ml: with_line(&|line| {
                InternalResistance::of(&all, line.intercept_ml)
                    .map(|found| found.resistance_mmhg_s_per_ml)
                    .map_err(|error| error.to_string())
            }),
            arterial_elastance_mmhg_per_ml: with_line(&|line| {
                Ok(arterial_elastance_mmhg_per_ml(&beats[0], line.points[0]))
            }),
            end_systolic_line: Outcome::of(line.clone(), |line| LineValues {
                slope: line.elastance_mmhg_per_ml,
                slope_standard_error: line.standard_errors.map(|errors| errors[0]),
                intercept_ml: line.intercept_ml,
                intercept_standard_error_ml: line.standard_errors.map(|errors| errors[1]),
                slope_z_score: ELASTANCE_MMHG_PER_ML.z_score(line.elastance_mmhg_per_ml),
            }),
            preload_recruitable_stroke_work: Outcome::of(
                PreloadRecruitableStrokeWork::through(beats),
                |work| LineValues {
                    slope: work.slope_mmhg,
                    slope_standard_error: work.standard_errors.map(|errors| errors[0]),
                    intercept_ml: work.intercept_ml,
                    intercept_standard_error_ml: work.standard_errors.map(|errors| errors[1]),
                    slope_z_score: PRELOAD_RECRUITABLE_STROKE_WORK_MMHG.z_score(work.slope_mmhg),
                },
            ),
        }
    }
}

impl SingleBeatElastance {
    /// Estimates of a patient's recording.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        Self {
            normalised_elastance: Outcome::of(
                normalised_elastance::Estimate::of(recording),
                |found| found.elastance_mmhg_per_ml,
            ),
            bilinear: Outcome::of(bilinear::Estimate::of(recording), |found| {
                found.elastance_mmhg_per_ml
            }),
            isovolumic_maximum: Outcome::of(
                isovolumic_maximum::Estimate::of(recording.beat),
                |found| found.elastance_mmhg_per_ml,
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model_heart::Heart;
    use super::*;

    #[test]
    fn a_twin_with_two_loads_is_written_whole() {
        let heart = Heart::default();
        let less = Heart {
            filling_mmhg: 7.0,
            // With filling alone the loops of a linear model are alike, and hold no resistance.
            peripheral_mmhg_s_per_ml: 0.9,
            ..heart
        };
        let twin = TwinElastance::of(&[heart.beat(), less.beat()], &[]);
        let json = serde_json::to_value(&twin).unwrap();
        let line = &json["end_systolic_line_mmHg_per_mL"];
        assert!(
            (line["slope"].as_f64().unwrap() - 2.3).abs() < 0.02,
            "{json}"
        );
        assert!(
            (line["intercept_mL"].as_f64().unwrap() - 12.0).abs() < 0.5,
            "{json}"
        );
        assert!(line["slope_standard_error"].is_null(), "{json}");
        let resistance = json["internal_resistance_mmHg_s_per_mL"].as_f64().unwrap();
        assert!(resistance.abs() < 2e-3, "{json}");
        assert!(
            json["preload_recruitable_stroke_work_mmHg"]["slope"]
                .as_f64()
                .unwrap()
                > 30.0
        );
        assert!(
            json["arterial_elastance_mmHg_per_mL"].as_f64().unwrap() > 1.0,
            "{json}"
        );
    }

    #[test]
    fn what_is_missing_has_its_reason() {
        let beat = Heart::default().beat();
        let twin = TwinElastance::of(std::slice::from_ref(&beat), &[]);
        let Outcome::None { reason } = twin.end_systolic_line else {
            panic!("{twin:?}");
        };
        assert!(reason.contains("at least 2 beats"), "{reason}");
        let estimates = SingleBeatElastance::of(&Recording {
            beat: &beat,
            qrs_begins_ms: None,
            arterial_systolic_mmhg: Some(120.0),
            arterial_diastolic_mmhg: None,
        });
        let json = serde_json::to_value(&estimates).unwrap();
        let reason = |key: &str| json[key]["reason"].as_str().unwrap().to_owned();
        assert_eq!(
            reason("normalised_elastance_mmHg_per_mL"),
            "the begin of the QRS complex is missing"
        );
        assert_eq!(
            reason("bilinear_mmHg_per_mL"),
            "the diastolic arterial pressure is missing"
        );
        assert!(json["isovolumic_maximum_mmHg_per_mL"].is_f64(), "{json}");
    }
}

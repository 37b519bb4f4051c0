//! The organ with the cell as the model of a sweep: beats in the organ's law, or of the patient's
//! one-fibre ventricle.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use cardiotwin_schemas::organ::is_parameter;
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::sweep::{CellDesign, ORGAN_SAMPLES_HEADING, SweptOrgan};
use cardiotwin_schemas::task::OrganBeatSpec;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::model::Model;
use crate::error::TaskError;
use crate::tasks::organ_beat::{ReducedOrgan, reduced, reduced_beat};
use crate::tasks::surrogate::known_surrogate;

/// Base beat, from which the samples differ in the swept parameters.
pub(super) struct Beats {
    beat: OrganBeatSpec,
    organ: ReducedOrgan,
    swept: Vec<String>,
}

impl Beats {
    /// # Errors
    /// [`TaskError`] when the beat is outside the range of the models, or a parameter belongs
    /// neither to the cell nor to the valves.
    pub(super) fn of(design: &CellDesign, swept_organ: &SweptOrgan) -> Result<Self, TaskError> {
        let SweptOrgan { beat, law, .. } = swept_organ;
        let swept: Vec<String> = design.parameters.iter().map(|p| p.name.clone()).collect();
        if let Some(name) = swept
            .iter()
            .chain(design.fixed.keys())
            .find(|name| !is_parameter(name))
        {
            return Err(TaskError::UnknownParameter { name: name.clone() });
        }
        let organ = known_surrogate(beat, law.as_ref())?;
        let beat = beat.with_parameters(&design.fixed);
        // Reports errors that are common to all samples: an invalid effect, loads
        // outside the range of the models.
        reduced(&beat, &organ)?;
        Ok(Self { beat, organ, swept })
    }

    fn line(&self, row: &[f64]) -> String {
        let parameters: BTreeMap<String, f64> = self
            .swept
            .iter()
            .cloned()
            .zip(row.iter().copied())
            .collect();
        match reduced_beat(&self.beat.with_parameters(&parameters), &self.organ) {
            Ok(Some(beat)) => finished(&beat),
            Ok(None) => "diverged,,,,,,,,".to_owned(),
            Err(error) => {
                tracing::debug!(%error, "a sample without meaning");
                "refused,,,,,,,,".to_owned()
            }
        }
    }
}

/// Line of a completed beat. `{:?}` gives the shortest form of a number that parses back to the
/// same value.
fn finished(beat: &OrganBeatResult) -> String {
    let mut line = "finished".to_owned();
    for (_, value) in beat.biomarkers.of_organ() {
        line.push(',');
        if let Some(value) = value {
            // Writing to a `String` cannot fail.
            let _ = write!(line, "{value:?}");
        }
    }
    line + if beat.failed_valve().is_some() {
        ",1"
    } else {
        ",0"
    }
}

impl Model for Beats {
    const HEADING: &'static str = ORGAN_SAMPLES_HEADING;
    /// About 50 ms of work.
    const BLOCKS_AT_ONCE: usize = 1;

    /// Results are the same bit for bit on every processor.
    fn arithmetic(&self) -> &'static str {
        "portable"
    }

    fn lines(
        &mut self,
        rows: &[Vec<f64>],
        pool: Option<&ThreadPool>,
    ) -> Result<Vec<String>, TaskError> {
        let line = |row: &Vec<f64>| self.line(row);
        Ok(match pool {
            Some(pool) => pool.install(|| rows.par_iter().map(line).collect()),
            None => rows.iter().map(line).collect(),
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::context::Context;
    use cardiotwin_schemas::organ_law::LawKnowledge;
    use cardiotwin_schemas::outcome::TaskResult;
    use cardiotwin_schemas::sweep::SweptParameter;
    use cardiotwin_schemas::task::CellSweepSpec;

    /// A beat of the one-fibre ventricle with Land's cell.
    pub(crate) fn beat() -> OrganBeatSpec {
        let beat: Result<OrganBeatSpec, _> = serde_json::from_value(serde_json::json!({
            "cycle_length_ms": 700.0, "time_step_ms": 2.0, "shortest_step_ms": 0.015625, "newton_iterations": 60,
            "organ": {"fidelity": "reduced",
                "passive": {"wall_volume_mL": 90.0, "unloaded_volume_mL": 60.0, "end_diastolic_volume_mL": 120.0,
                            "end_diastolic_pressure_mmHg": 9.0, "stiffness_kPa": 0.5, "exponent": 9.24},
                "activation": {"spread_ms": 40.0, "groups": 16, "onset_ms": 20.0}},
            "circulation": {"afterload": {"characteristic_resistance_mmHg_s_per_mL": 0.03,
                "peripheral_resistance_mmHg_s_per_mL": 0.9, "compliance_mL_per_mmHg": 1.2},
                "initial_windkessel_pressure_mmHg": 70.0, "left_atrial_pressure_mmHg": 7.0},
            "valves": {}, "contraction": {"model": "land2017-rice", "parameters": {}, "lambda_0": 1.1},
            "beats": {"mode": "fixed", "n": 1}, "measured_end_diastolic_volume_mL": 120.0
        }));
        beat.unwrap()
    }

    fn spec() -> CellSweepSpec {
        let swept = |name: &str, lower, upper| SweptParameter {
            name: name.into(),
            lower,
            upper,
        };
        CellSweepSpec {
            design: CellDesign {
                parameters: vec![
                    swept("Smax_ref_kPa", 100.0, 400.0),
                    swept("R_AV_f_mmHg_s_per_mL", 1e-3, 0.1),
                ],
                skip_points: 0,
                scramble_seed: None,
                cycle_length_ms: 700.0,
                lambda_0: 1.1,
                fixed: BTreeMap::from([("phi".to_owned(), 2.0)]),
                tolerance: 1e-4,
                organ: Some(Box::new(SweptOrgan {
                    patient: "p1".into(),
                    beat: beat(),
                    law: None,
                })),
            },
            first_block: 1,
            n_blocks: 2,
        }
    }

    fn samples(spec: &CellSweepSpec, threads: u32) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let result = super::super::run(spec, &mut Context::plain(folder.path(), threads)).unwrap();
        let TaskResult::CellSweep(result) = result else {
            panic!("a sweep's result")
        };
        assert_eq!(
            (result.n_samples, result.n_periodic + result.n_refused),
            (12, 12)
        );
        let text = std::fs::read_to_string(folder.path().join("samples.csv")).unwrap();
        text.lines().map(str::to_owned).collect()
    }

    #[test]
    fn a_line_holds_the_beat_of_the_row_s_parameters_on_any_number_of_threads() {
        lines_hold_beats_of(&spec());
    }

    #[test]
    fn beats_of_an_organ_with_a_law_are_simulated_in_it() {
        let mut in_law = spec();
        // No beat yet: the law of the prior.
        in_law.design.organ.as_mut().unwrap().law = Some(LawKnowledge::default());
        assert_ne!(samples(&in_law, 1), samples(&spec(), 1));
        lines_hold_beats_of(&in_law);
    }

    fn lines_hold_beats_of(spec: &CellSweepSpec) {
        let lines = samples(spec, 1);
        assert_eq!(
            (lines[0].as_str(), lines.len()),
            (ORGAN_SAMPLES_HEADING, 13)
        );
        assert_eq!(samples(spec, 3), lines);
        let organ = spec.design.organ.as_ref().unwrap();
        let reduced = known_surrogate(&organ.beat, organ.law.as_ref()).unwrap();
        let row = &super::super::design(spec, 3).unwrap().rows(1..3)[7];
        let parameters = [
            ("Smax_ref_kPa", row[0]),
            ("R_AV_f_mmHg_s_per_mL", row[1]),
            ("phi", 2.0),
        ];
        let parameters = parameters
            .map(|(name, value)| (name.to_owned(), value))
            .into();
        let beat = reduced_beat(&organ.beat.with_parameters(&parameters), &reduced)
            .unwrap()
            .unwrap();
        let fields: Vec<&str> = lines[8].split(',').collect();
        assert_eq!(&fields[..3], ["2", "1", "finished"]);
        let number = |at: usize| fields[at].parse::<f64>().ok();
        assert_eq!(
            (number(3), number(9)),
            (beat.biomarkers.p_max_mmhg, beat.biomarkers.sv_ml)
        );
    }

    #[test]
    fn a_cell_without_meaning_is_a_line_and_an_unknown_parameter_an_error() {
        let mut refused = spec();
        refused.design.fixed.insert("r_S".into(), 1.5);
        assert!(
            Beats::of(&refused.design, refused.design.organ.as_ref().unwrap()).is_err(),
            "no beat at all"
        );
        let mut some = spec();
        some.design.parameters[1] = SweptParameter {
            name: "r_S".into(),
            lower: 0.2,
            upper: 1.5,
        };
        let lines = samples(&some, 1);
        assert!(
            lines.iter().any(|line| line.ends_with("refused,,,,,,,,")),
            "{lines:?}"
        );
        assert!(
            lines.iter().any(|line| line.contains("finished")),
            "{lines:?}"
        );
        some.design.parameters[0].name = "a_p_kPa".into();
        let said = super::super::run(
            &some,
            &mut Context::plain(tempfile::tempdir().unwrap().path(), 1),
        )
        .unwrap_err();
        assert!(said.to_string().contains("`a_p_kPa`"), "{said}");
    }
}

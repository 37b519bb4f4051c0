//! Comparison of simulated with measured values: relative differences, means over the cohort, and
//! the paper's means.

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::record::{IterationRecord, PatientRecord, Step1Quality, TaskRecord};

/// A stage whose beat is compared with the measured one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Step 1: the iterate that was taken.
    Step1,
    /// Step 1: the first iterate within the tolerance, which is the paper's stopping rule.
    Step1FirstConverged,
    /// Step 2: the verification beat.
    Step2,
    /// Step 3: the beat that was taken, which is the verification beat if no better one was found.
    Step3,
}

impl Step {
    /// The steps that tables compare with the measurement.
    pub const ALL: [Self; 3] = [Self::Step1, Self::Step2, Self::Step3];

    /// Key in files.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::Step1 | Self::Step1FirstConverged => "step1",
            Self::Step2 => "step2",
            Self::Step3 => "step3",
        }
    }

    /// Name for readers.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Step1 | Self::Step1FirstConverged => "step 1",
            Self::Step2 => "step 2",
            Self::Step3 => "step 3",
        }
    }
}

/// Mean relative differences of step 1 in Jung et al. 2022, percent, in the order of
/// [`Biomarker::TABLE_2`].
pub const PAPER_STEP1_PERCENT: [f64; Biomarker::TABLE_2.len()] = [5.4, 13.6, 7.7, 1.4, 10.0];
/// Mean relative differences of step 2 in Jung et al. 2022, percent, in the same order.
pub const PAPER_STEP2_PERCENT: [f64; Biomarker::TABLE_2.len()] = [5.5, 22.5, 39.9, 2.9, 11.1];

/// (simulated − measured) / measured; `None` if it is not finite.
#[must_use]
pub fn relative_difference(simulated: f64, measured: f64) -> Option<f64> {
    let difference = (simulated - measured) / measured;
    difference.is_finite().then_some(difference)
}

/// Mean and standard deviation of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanSd {
    /// Arithmetic mean of the values.
    pub mean: f64,
    /// Standard deviation with n − 1; `None` for a single value.
    pub sd: Option<f64>,
    /// Number of present, finite values.
    pub n: usize,
}

impl MeanSd {
    /// Statistics of the present finite values; `None` without any.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = Option<f64>>) -> Option<Self> {
        let values: Vec<f64> = values
            .into_iter()
            .flatten()
            .filter(|v| v.is_finite())
            .collect();
        let n = values.len();
        if n == 0 {
            return None;
        }
        let mean = values.iter().sum::<f64>() / n as f64;
        let sd = (n > 1).then(|| {
            (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64).sqrt()
        });
        // The standard deviation of equal values is the rounding error of their mean, which stands
        // for zero.
        let sd = sd.map(|sd| if sd < 1e-14 * mean.abs() { 0.0 } else { sd });
        Some(Self { mean, sd, n })
    }
}

/// Mean and standard deviation of the absolute relative differences of a biomarker over patients, percent.
///
/// - `converged_only`: whether only patients whose step 1 converged count
#[must_use]
pub fn mean_error(
    patients: &[PatientRecord],
    step: Step,
    biomarker: Biomarker,
    converged_only: bool,
) -> Option<MeanSd> {
    let counted =
        (patients.iter().map(PatientView)).filter(|view| !converged_only || view.step1_converged());
    let percent = |share: f64| 100.0 * share.abs();
    MeanSd::of(counted.map(|view| view.relative_difference(step, biomarker).map(percent)))
}

/// Methods that evaluate a patient's record.
#[derive(Debug, Clone, Copy)]
pub struct PatientView<'a>(pub &'a PatientRecord);

impl<'a> PatientView<'a> {
    /// The iterate that step 1 took, or the best one so far if step 1 has not ended.
    #[must_use]
    pub fn best_iteration(self) -> Option<&'a IterationRecord> {
        let iterations = &self.0.iterations;
        match &self.0.step1 {
            Some(summary) => iterations
                .iter()
                .find(|i| i.number == summary.best_iteration),
            None => iterations
                .iter()
                .filter(|i| {
                    i.run
                        .as_ref()
                        .is_some_and(|run| run.result.failed_valve().is_none())
                })
                .filter(|i| i.cost.is_some_and(f64::is_finite))
                .min_by(|a, b| {
                    a.cost
                        .unwrap_or(f64::INFINITY)
                        .total_cmp(&b.cost.unwrap_or(f64::INFINITY))
                }),
        }
    }

    /// The simulation that represents a step.
    #[must_use]
    pub fn beat(self, step: Step) -> Option<&'a TaskRecord<OrganBeatResult>> {
        match step {
            Step::Step1 => self.best_iteration()?.run.as_ref(),
            Step::Step1FirstConverged => {
                let first = self.0.step1.as_ref()?.first_converged?;
                self.0
                    .iterations
                    .iter()
                    .find(|i| i.number == first)?
                    .run
                    .as_ref()
            }
            Step::Step2 => self.0.verification.as_ref(),
            Step::Step3 => self.0.step3.as_ref().and_then(|_| self.0.twin()),
        }
    }

    /// Measured biomarkers: from the traces once step 0 has read them, before that as given in the
    /// patient's file.
    #[must_use]
    pub fn measured(self) -> &'a Biomarkers {
        self.0
            .step0
            .as_ref()
            .map_or(&self.0.plan.step0.biomarkers, |r| &r.result.measured)
    }

    /// The steps that the patient's tables show: step 3 only if there is one.
    #[must_use]
    pub fn steps(self) -> &'static [Step] {
        &Step::ALL[..2 + usize::from(self.0.step3.is_some())]
    }

    /// Simulated biomarkers of a step.
    #[must_use]
    pub fn simulated(self, step: Step) -> Option<&'a Biomarkers> {
        self.beat(step).map(|r| &r.result.biomarkers)
    }

    /// Relative difference of one biomarker, signed; 0.1 is 10 %.
    #[must_use]
    pub fn relative_difference(self, step: Step, biomarker: Biomarker) -> Option<f64> {
        relative_difference(
            self.simulated(step)?.get(biomarker)?,
            self.measured().get(biomarker)?,
        )
    }

    /// Biomarkers of the twin's beat that the verdict does not judge and that are off by more than its widest
    /// tolerance, in words; `None` without any, or without a verdict.
    #[must_use]
    pub fn off_outside_the_verdict(self) -> Option<String> {
        self.0.verdict.as_ref()?;
        let (twin, measured) = (&self.0.twin()?.result.biomarkers, self.measured());
        let tolerances = self.0.plan.settings.verification.tolerance_percent;
        let judged = tolerances.of_biomarkers();
        let widest = judged
            .iter()
            .fold(0.0, |a: f64, (_, percent)| a.max(*percent));
        let is_judged = |b: &Biomarker| judged.iter().any(|(one, _)| one == b);
        let others = Biomarker::ALL.into_iter().filter(|b| !is_judged(b));
        let off = others.filter_map(|b| {
            let percent = 100.0 * relative_difference(twin.get(b)?, measured.get(b)?)?;
            (percent.abs() > widest).then(|| format!("{} {percent:+.0} %", b.key()))
        });
        let off: Vec<String> = off.collect();
        (!off.is_empty()).then(|| {
            format!(
                "the verdict does not judge, but the twin misses by more than its widest tolerance of \
                 {widest} %: {}",
                off.join(", ")
            )
        })
    }

    /// The beat that step 3 took, if it is not the verification beat.
    #[must_use]
    pub fn step3_beat(self) -> Option<&'a TaskRecord<OrganBeatResult>> {
        self.beat(Step::Step3).filter(|_| {
            self.0
                .step3
                .as_ref()
                .is_some_and(|step3| step3.best_iteration > 0)
        })
    }

    /// Whether step 1's result is within the tolerance.
    #[must_use]
    pub fn step1_converged(self) -> bool {
        self.0
            .step1
            .as_ref()
            .is_some_and(|s| s.quality == Step1Quality::Converged)
    }

    /// Name, key, generation and provenance of every published task, in the order of the workflow.
    #[must_use]
    pub fn tasks(self) -> Vec<(String, &'a str, u32, &'a Provenance)> {
        fn entry<'a, T>(
            name: &str,
            record: &'a TaskRecord<T>,
        ) -> (String, &'a str, u32, &'a Provenance) {
            (
                name.to_owned(),
                record.key.as_str(),
                record.generation,
                &record.provenance,
            )
        }
        let mut tasks = Vec::new();
        tasks.extend(self.0.step0.as_ref().map(|r| entry("step 0", r)));
        tasks.extend(self.0.law.as_ref().map(|r| entry("law of pilots", r)));
        for iteration in &self.0.iterations {
            tasks.extend(
                iteration
                    .proposal
                    .as_ref()
                    .map(|r| entry(&format!("step 1, proposal {}", iteration.number), r)),
            );
            tasks.extend(
                iteration
                    .run
                    .as_ref()
                    .map(|r| entry(&format!("step 1, iteration {}", iteration.number), r)),
            );
        }
        tasks.extend(self.0.targets.as_ref().map(|r| entry("targets", r)));
        tasks.extend(self.0.cell_fit.as_ref().map(|r| entry("step 2", r)));
        tasks.extend(
            self.0
                .organ_fit
                .as_ref()
                .map(|r| entry("step 2 in the organ", r)),
        );
        tasks.extend(
            self.0
                .verification
                .as_ref()
                .map(|r| entry("verification", r)),
        );
        for iteration in &self.0.step3_iterations {
            tasks.extend(
                iteration
                    .proposal
                    .as_ref()
                    .map(|r| entry(&format!("step 3, proposal {}", iteration.number), r)),
            );
            tasks.extend(
                iteration
                    .run
                    .as_ref()
                    .map(|r| entry(&format!("step 3, iteration {}", iteration.number), r)),
            );
        }
        tasks.extend(self.0.posterior.as_ref().map(|r| entry("posterior", r)));
        tasks
    }

    /// Wall time of all finished tasks, those without a record of their own included, s; `None`
    /// before the first one.
    #[must_use]
    pub fn wall_s(self) -> Option<f64> {
        let other = Some(self.0.other_wall_s).filter(|wall_s| *wall_s > 0.0);
        self.tasks()
            .iter()
            .map(|(_, _, _, p)| p.wall_s)
            .chain(other)
            .reduce(|a, b| a + b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sd_is_that_of_a_sample() {
        let found = MeanSd::of([Some(2.0), None, Some(4.0), Some(f64::NAN), Some(9.0)]).unwrap();
        assert_eq!((found.mean, found.n), (5.0, 3));
        assert!((found.sd.unwrap() - 13.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(
            MeanSd::of([Some(3.0)]),
            Some(MeanSd {
                mean: 3.0,
                sd: None,
                n: 1
            })
        );
        assert_eq!(MeanSd::of([None]), None);
    }

    #[test]
    fn differences_keep_their_sign_and_zero_is_no_reference() {
        assert_eq!(relative_difference(-1.5, -2.0), Some(-0.25));
        assert_eq!(relative_difference(1.0, 0.0), None);
    }

    #[test]
    fn computing_time_is_that_of_every_task_of_the_record() {
        fn walls(value: &serde_json::Value) -> f64 {
            match value {
                serde_json::Value::Object(map) => map
                    .iter()
                    .filter(|(key, _)| *key != "before")
                    .map(|(key, value)| match (key.as_str(), value.as_f64()) {
                        ("wall_s" | "other_wall_s", Some(wall)) => wall,
                        _ => walls(value),
                    })
                    .sum(),
                serde_json::Value::Array(list) => list.iter().map(walls).sum(),
                _ => 0.0,
            }
        }
        let file = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../schemas/tests/golden/run-record.json"
        );
        let mut json: serde_json::Value =
            serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        let patients = json["patients"].as_array_mut().unwrap();
        let proposal = patients
            .iter()
            .find_map(|p| p.pointer("/step3_iterations/0/proposal"))
            .unwrap()
            .clone();
        patients[0]["organ_fit"] = proposal;
        patients[0]["other_wall_s"] = 3.5.into();
        let run: cardiotwin_schemas::record::RunRecord =
            serde_json::from_value(json.clone()).unwrap();
        for (patient, json) in run
            .patients
            .iter()
            .zip(json["patients"].as_array().unwrap())
        {
            let told = PatientView(patient).wall_s().unwrap_or(0.0);
            assert!(
                (told - walls(json)).abs() < 1e-9,
                "{told} s of {} s",
                walls(json)
            );
        }
        assert!(
            run.patients
                .iter()
                .any(|patient| patient.posterior.is_some())
        );
    }
}

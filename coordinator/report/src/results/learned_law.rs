//! The organ's law of a patient and the beats that taught.

use cardiotwin_schemas::organ_law::{LawBeatFit, LawSamples, LearnedLaw};
use cardiotwin_schemas::record::PatientRecord;

use super::{PatientView, Source};

/// Largest difference of two volumes or pressures \[mL, mmHg\] that are the same sample.
const SAME: f64 = 1e-6;

/// The last law that the patient's tasks learned; `None` for the one-fibre ventricle as surrogate, and
/// for results of earlier programs.
#[must_use]
pub fn learned_law(patient: &PatientRecord) -> Option<&LearnedLaw> {
    let of_posterior = (patient.posterior.iter()).filter_map(|t| t.result.learned_law.as_ref());
    let of_step3 = (patient.step3_iterations.iter().rev())
        .filter_map(|i| i.proposal.as_ref())
        .chain(&patient.organ_fit)
        .filter_map(|t| t.result.learned_law.as_ref());
    let of_step1 = (patient.iterations.iter().rev())
        .filter_map(|i| i.proposal.as_ref()?.result.learned_law.as_ref());
    of_posterior.chain(of_step3).chain(of_step1).next()
}

/// A beat that taught.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Teacher {
    /// Its name, such as `step 1, iteration 2`.
    pub name: String,
    /// Its step.
    pub source: Source,
    /// Whether the step took it as its result.
    pub taken: bool,
}

/// The beats that taught a law, in its order.
#[must_use]
pub fn teachers(patient: &PatientRecord, law: &LearnedLaw) -> Vec<Teacher> {
    let best = PatientView(patient).best_iteration().map(|i| i.number);
    let of_step1 = patient.iterations.iter().map(|i| {
        let teacher = Teacher {
            name: format!("step 1, iteration {}", i.number),
            source: Source::Step1,
            taken: Some(i.number) == best,
        };
        (teacher, i.run.as_ref())
    });
    let verification = Teacher {
        name: "verification".to_owned(),
        source: Source::Step2,
        taken: true,
    };
    let best = patient.step3.as_ref().map(|step3| step3.best_iteration);
    let of_step3 = patient.step3_iterations.iter().map(|i| {
        let teacher = Teacher {
            name: format!("step 3, beat {}", i.number),
            source: Source::Step3,
            taken: Some(i.number) == best,
        };
        (teacher, i.run.as_ref())
    });
    let beats: Vec<(Teacher, &LawSamples)> = of_step1
        .chain([(verification, patient.verification.as_ref())])
        .chain(of_step3)
        .filter_map(|(teacher, run)| Some((teacher, run?.result.law.as_ref()?)))
        .collect();
    let named = |(fit, number): (&LawBeatFit, u32)| {
        let found = beats.iter().find(|(_, samples)| is_of(fit, samples));
        found.map_or_else(
            || Teacher {
                name: format!("beat {number}"),
                source: Source::Step1,
                taken: false,
            },
            |(teacher, _)| teacher.clone(),
        )
    };
    law.beats.iter().zip(1..).map(named).collect()
}

/// Whether the samples are those of the beat.
fn is_of(fit: &LawBeatFit, samples: &LawSamples) -> bool {
    let same = |a: &[f64], b: &[f64]| {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME)
    };
    same(&fit.volume_ml, &samples.volume_ml) && same(&fit.pressure_mmhg, &samples.pressure_mmhg)
}

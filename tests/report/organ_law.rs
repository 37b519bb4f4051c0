//! The organ's law in a patient's section: curves, beats that taught, errors.

use cardiotwin_report::results::{learned_law, teachers};
use cardiotwin_schemas::organ_law::{
    LawBeatFit, LawCurve, LawError, LawSamples, LearnedLaw, N_LAW_SAMPLES,
};
use cardiotwin_schemas::outcome::{Step1ProposalResult, Step3ProposalResult};
use cardiotwin_schemas::record::{PatientRecord, Step3IterationRecord, TaskRecord};

use crate::browser::Browser;
use crate::{html, in_3d, words};

/// Pressure of an invented law \[mmHg\] at a volume \[mL\] and a stress \[kPa\].
fn pressure(volume_ml: f64, stress_kpa: f64) -> f64 {
    8.0 * (volume_ml / 150.0).powi(8) + 2.5 * stress_kpa * (1.0 + 120.0 / volume_ml).ln()
}

/// A beat that is off the law by `error` times the shape of a sine \[mmHg\].
fn samples(stroke_ml: f64, peak_kpa: f64, error: f64) -> LawSamples {
    let mut samples = LawSamples::default();
    for k in 0..N_LAW_SAMPLES {
        let phase = std::f64::consts::TAU * k as f64 / N_LAW_SAMPLES as f64;
        let volume = 150.0 - 0.5 * stroke_ml * (1.0 - phase.cos());
        let stress = peak_kpa * (1.25 * phase).sin().max(0.0).powi(2);
        samples.volume_ml.push(volume);
        samples.active_stress_kpa.push(stress);
        let pressure = pressure(volume, stress) - error * phase.sin();
        samples.pressure_mmhg.push(pressure);
    }
    samples
}

fn fit(samples: &LawSamples) -> LawBeatFit {
    let points = samples.volume_ml.iter().zip(&samples.active_stress_kpa);
    let law: Vec<f64> = points.map(|(v, t)| pressure(*v, *t)).collect();
    LawBeatFit {
        volume_ml: samples.volume_ml.clone(),
        pressure_mmhg: samples.pressure_mmhg.clone(),
        before: LawError {
            rms_mmhg: 1.5,
            worst_mmhg: 3.25,
        },
        after: LawError::of(&law, &samples.pressure_mmhg),
        law_pressure_mmhg: law,
    }
}

fn law(beats: &[&LawSamples]) -> LearnedLaw {
    let volume_ml: Vec<f64> = (0..49).map(|k| 45.0 + 3.0 * f64::from(k)).collect();
    let curve = |active_stress_kpa: f64| LawCurve {
        active_stress_kpa,
        pressure_mmhg: volume_ml
            .iter()
            .map(|volume| pressure(*volume, active_stress_kpa))
            .collect(),
    };
    LearnedLaw {
        prior_organs: 12,
        learned_from: None,
        curves: [0.0, 10.0, 20.0, 40.0, 60.0, 80.0].map(curve).to_vec(),
        beats: beats.iter().map(|samples| fit(samples)).collect(),
        volume_ml,
    }
}

fn recorded<T, U>(like: &TaskRecord<T>, result: U) -> TaskRecord<U> {
    TaskRecord {
        key: like.key.clone(),
        generation: 1,
        directory: like.directory.clone(),
        artefacts: Vec::new(),
        provenance: like.provenance.clone(),
        result,
    }
}

/// Gives the patient a law that step 1's first beat and the verification taught, in the first
/// proposal of step 3.
pub fn teach(patient: &mut PatientRecord) {
    let (first, second) = (samples(85.0, 55.0, 0.8), samples(95.0, 62.0, 0.4));
    patient.iterations[0].run.as_mut().unwrap().result.law = Some(first.clone());
    let verification = patient.verification.as_mut().unwrap();
    verification.result.law = Some(second.clone());
    let proposal = Step3ProposalResult {
        parameters: Default::default(),
        predicted: verification.result.biomarkers,
        predicted_cost: 0.01,
        predicted_misfit: 1.0,
        from_iteration: None,
        trust_radius: None,
        step: None,
        correction: Default::default(),
        law_beats: Some(2),
        learned_law: Some(law(&[&first, &second])),
        reduced_beats: 3000,
    };
    let proposal = recorded(verification, proposal);
    patient.step3_iterations = vec![Step3IterationRecord {
        number: 1,
        parameters: Default::default(),
        proposal: Some(proposal),
        run: None,
        failure: None,
        misfit: None,
        verdict: None,
    }];
    propose(patient, Some(law(&[])));
}

/// Gives the patient's first simulation a proposal that was made in a law.
pub fn propose(patient: &mut PatientRecord, learned_law: Option<LearnedLaw>) {
    let iteration = &mut patient.iterations[0];
    let run = iteration.run.as_ref().unwrap();
    let proposal = Step1ProposalResult {
        parameters: iteration.parameters,
        predicted: run.result.biomarkers,
        predicted_cost: 0.01,
        predicted_misfit: 1.0,
        from_iteration: None,
        trust_radius: None,
        step: None,
        correction: Default::default(),
        law_beats: Some(0),
        learned_law,
        reduced_beats: 400,
    };
    iteration.proposal = Some(recorded(run, proposal));
}

#[test]
fn the_law_is_drawn_with_the_beats_that_taught_and_its_errors() {
    let (_folder, out) = in_3d::written();
    let page = html(&out);
    let text = words(&page);
    for expected in [
        "This law was learned from 2 beats (start: the program's law of 12 hearts).",
        "law at constant active stress step 1, iteration 1",
        "40 kPa",
        "law − beat (mmHg)",
        "step 1, iteration 1 80 1.50 3.25 0.57 0.80",
        "verification 80 1.50 3.25 0.28 0.40",
        "all 160 – – 0.45 0.80",
        "No picture: the proposals were computed by a version of the program that stored none.",
    ] {
        assert!(text.contains(expected), "missing: {expected}\n{text}");
    }
    for name in ["law at 40 kPa", "law, verification", "step 1, iteration 1"] {
        assert!(page.contains(&format!("data-name=\"{name}\"")), "{name}");
    }
    assert!(!page.contains("NaN"));
}

#[test]
fn the_law_of_the_last_task_is_taken_and_unknown_beats_have_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let mut patient = in_3d::run(folder.path()).patients.remove(0);
    let of = |patient: &PatientRecord| {
        let law = learned_law(patient).unwrap();
        let names = teachers(patient, law).into_iter().map(|t| t.name);
        names.collect::<Vec<_>>()
    };
    assert_eq!(of(&patient), ["step 1, iteration 1", "verification"]);
    patient.verification.as_mut().unwrap().result.law = None;
    assert_eq!(of(&patient), ["step 1, iteration 1", "beat 2"]);
    patient.organ_fit = patient.step3_iterations.remove(0).proposal;
    assert_eq!(of(&patient).len(), 2);
    patient.organ_fit = None;
    assert!(of(&patient).is_empty(), "the law of the first proposal");
    patient.iterations[0].proposal = None;
    assert!(learned_law(&patient).is_none());
}

#[test]
fn the_law_is_seen_in_both_themes_and_on_a_narrow_screen() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = in_3d::written();
    let script = r#"const svg = document.querySelector("svg.plot:has(.line.law)");
      const box = svg.getBoundingClientRect();
      const lines = [...svg.querySelectorAll(".line")].filter((l) => l.getAttribute("d"));
      const outside = lines.filter((l) => { const b = l.getBoundingClientRect();
        return b.left < box.left || b.right > box.right || b.top < box.top || b.bottom > box.bottom; });
      const back = getComputedStyle(document.body).backgroundColor;
      const unseen = lines.filter((l) => ["none", back].includes(getComputedStyle(l).stroke));
      return { w: box.width, n: lines.length, outside: outside.length, unseen: unseen.length,
        wide: document.documentElement.scrollWidth > innerWidth };"#;
    for (fragment, window) in [
        ("#light", (1400, 3000)),
        ("#dark", (1400, 3000)),
        ("", (390, 3000)),
    ] {
        let found = browser.measure(&out, fragment, window, script);
        let number = |name: &str| found[name].as_f64().unwrap();
        assert!(number("w") > 300.0 && number("n") >= 9.0, "{found}");
        assert!(
            number("outside") == 0.0 && number("unseen") == 0.0 && found["wide"] == false,
            "{found}"
        );
    }
}

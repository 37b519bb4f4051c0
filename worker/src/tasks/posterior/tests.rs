use std::collections::BTreeMap;

use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::ValveParameters;
use cardiotwin_schemas::outcome::Determination;
use cardiotwin_schemas::patient::Noise;
use cardiotwin_schemas::posterior::{PosteriorResult, PosteriorSettings, TwinBeat};
use cardiotwin_schemas::samples::BeatSamples;
use cardiotwin_schemas::step3::Step3Settings;

use super::*;
use crate::tasks::organ_beat::reduced_beat;
use crate::tasks::surrogate::surrogate;
use crate::tasks::sweep::organ::tests::beat;

/// A heart with its own cell, two of whose parameters are uncertain.
fn spec(names: &[&str]) -> PosteriorSpec {
    let beat = beat().with_parameters(&BTreeMap::from([("Smax_ref_kPa".to_owned(), 200.0)]));
    let organ = surrogate(&beat, None, None).expect("a one-fibre ventricle");
    let simulated = reduced_beat(&beat, &organ)
        .expect("parameters")
        .expect("a beat");
    let step3 = Step3Settings {
        parameters: names.iter().map(|n| (*n).to_owned()).collect(),
        ..Default::default()
    };
    let cell = beat.contraction.cell_parameters().cloned();
    PosteriorSpec {
        parameters: step3.moved(&ValveParameters::default()),
        twin: TwinBeat {
            parameters: step3.values(cell.as_ref(), &ValveParameters::default()),
            biomarkers: simulated.biomarkers,
            samples: simulated.samples.clone(),
        },
        measured: simulated.biomarkers,
        samples: simulated.samples,
        noise: Noise {
            pressure_rms_mmhg: Some(1.0),
            volume_rms_ml: Some(2.0),
            ..Noise::default()
        },
        uncertainty_percent: step3.uncertainty_percent.clone(),
        settings: PosteriorSettings {
            draws: 60,
            ..PosteriorSettings::default()
        },
        law: None,
        prior: None,
        seed: 1,
        beat,
    }
}

fn sampled(spec: &PosteriorSpec, threads: u32) -> PosteriorResult {
    let folder = tempfile::tempdir().expect("a folder");
    let result = run(spec, &mut Context::plain(folder.path(), threads)).expect("a posterior");
    let TaskResult::Posterior(result) = result else {
        panic!("a posterior's result")
    };
    *result
}

#[test]
fn traces_determine_the_strength_and_the_draws_do_not_depend_on_threads() {
    let spec = spec(&["Smax_ref_kPa", "gamma_W_per_ms"]);
    let result = sampled(&spec, 1);
    assert_eq!(sampled(&spec, 3), result);
    let strength = &result.parameters["Smax_ref_kPa"];
    assert_eq!(
        (strength.mark, strength.twin),
        (Determination::Determined, 200.0)
    );
    assert!(
        strength.posterior.p5 < 200.0 && 200.0 < strength.posterior.p95,
        "{strength:?}"
    );
    assert!(
        strength.posterior.p95 / strength.posterior.p5 < 1.2,
        "{strength:?}"
    );
    assert_eq!(result.sampling.doubt(), None, "{:?}", result.sampling);
    assert_eq!(
        (
            result.draws.len(),
            result.correlations.len(),
            result.pressure_mmhg.p50.len()
        ),
        (60, 2, 40)
    );
    let within = (0..40).filter(|k| {
        let (band, twin) = (&result.pressure_mmhg, spec.twin.samples.pressure_mmhg[*k]);
        band.p5[*k] - 0.2 <= twin && twin <= band.p95[*k] + 0.2
    });
    assert_eq!(within.count(), 40, "the twin is the data");
    let pressure = &result.biomarkers["P_max_mmHg"];
    assert!(
        pressure.p5 < pressure.p50 && pressure.p50 < pressure.p95,
        "{pressure:?}"
    );
    assert_eq!(result.deviations.pressure_discrepancy_mmhg, 0.0);
}

#[test]
fn a_twin_that_misses_its_traces_is_less_sure() {
    let mut sure = spec(&["Smax_ref_kPa"]);
    // Rates of pressure count in addition to the traces. Without them, the traces alone determine
    // the width.
    sure.measured = Biomarkers::default();
    let mut off = sure.clone();
    off.samples.pressure_mmhg.iter_mut().for_each(|p| *p += 5.0);
    let [sure, off] = [&sure, &off].map(|spec| sampled(spec, 2));
    assert!((off.deviations.pressure_discrepancy_mmhg - 24.0_f64.sqrt()).abs() < 1e-6);
    let width = |result: &PosteriorResult| {
        let spread = result.parameters["Smax_ref_kPa"].posterior;
        (spread.p95 / spread.p5).ln()
    };
    assert!(
        width(&off) > 1.5 * width(&sure),
        "{} {}",
        width(&off),
        width(&sure)
    );
}

#[test]
fn without_traces_measured_biomarkers_count() {
    let mut spec = spec(&["Smax_ref_kPa"]);
    spec.samples = BeatSamples::default();
    let result = sampled(&spec, 1);
    let strength = &result.parameters["Smax_ref_kPa"];
    assert!(
        strength.posterior.p5 < 200.0 && 200.0 < strength.posterior.p95,
        "{strength:?}"
    );
    assert_eq!(strength.mark, Determination::Determined);
    spec.measured = Biomarkers::default();
    let nothing = sampled(&spec, 1).parameters["Smax_ref_kPa"];
    assert_eq!(
        nothing.mark,
        Determination::NotDetermined,
        "nothing was measured: {nothing:?}"
    );
}

#[test]
fn a_twin_without_a_beat_of_the_one_fibre_ventricle_gets_an_uncorrected_posterior() {
    let mut spec = spec(&["Smax_ref_kPa", "Ca_res_uM"]);
    // With these parameters the one-fibre ventricle has no whole beat, but it has one on the way to
    // the prior's centre.
    spec.twin.parameters = BTreeMap::from([
        ("Smax_ref_kPa".to_owned(), 40.0),
        ("Ca_res_uM".to_owned(), 5.0),
    ]);
    let result = sampled(&spec, 1);
    assert!(result.sampling.is_uncorrected);
    let said = result.sampling.doubt().expect("a doubt");
    assert!(said.contains("no beat corrects it"), "{said}");
    // The data are a beat of this ventricle, so that its own mode agrees with them.
    assert!(result.deviations.pressure_discrepancy_mmhg < 1.0);
    let strength = &result.parameters["Smax_ref_kPa"].posterior;
    assert!(strength.p5 < 200.0 && 200.0 < strength.p95, "{strength:?}");
}

//! Effects that pressure and volume do not show, or do not tell from others, in patients of another
//! formulation: each is named with the measurement that shows it, and not without it.

#[path = "../examples/validation/visibility.rs"]
#[allow(dead_code)]
mod visibility;

use cardiotwin_discover::{Measured, Reduced, Settings, discover};
use cardiotwin_validation::{Hearts, Measurement, Plan, PlannedCase};
use cardiotwin_vocabulary::findings::{Findings, SearchSettings};

/// A case of the development seed, by its number among the singles.
fn planned(number: usize) -> PlannedCase {
    let mut cases = Plan::Singles.cases(number, 901, Hearts::Elastance);
    cases.pop().expect("numbers begin at one")
}

/// The case as measured, with further measurements.
fn measured(planned: &PlannedCase, made: &[Measurement]) -> Measured {
    let case = planned.make().expect("a plausible patient");
    let beats = planned.beats(&case, made).expect("beats that settle");
    visibility::with_noise(&case, &planned.further(&case, &beats, made))
}

/// Searches a part of the catalogue, to save time.
fn search(measured: &Measured, effects: &[&str]) -> Findings {
    let settings = Settings {
        search: SearchSettings {
            effects: effects.iter().map(|name| (*name).to_owned()).collect(),
            ..SearchSettings::default()
        },
        ..Settings::default()
    };
    discover(measured, &Reduced::new(measured), &settings)
        .expect("a base fit")
        .findings
}

/// Without the measurement the hidden effect does not stand alone; with it, it does.
fn shown_by(kind: Measurement, number: usize, rivals: &[&str]) -> [Findings; 2] {
    let planned = planned(number);
    let truth = planned.effects[0].0;
    let effects = [&[truth], rivals].concat();
    let stands_alone = |found: &Findings| found.accepted == [truth] && found.confusable.is_empty();
    let without = search(&measured(&planned, &[]), &effects);
    assert!(!stands_alone(&without), "{truth}: {:?}", without.accepted);
    let with = search(&measured(&planned, &[kind]), &effects);
    assert!(
        stands_alone(&with),
        "{truth}: {:?}, rivals {:?}",
        with.accepted,
        with.confusable
    );
    [without, with]
}

#[test]
fn aortic_pressure_shows_a_mild_stenosis() {
    let [without, with] = shown_by(Measurement::AorticPressure, 20, &["wave_reflection"]);
    assert!(without.none && !with.effects[0].artefact);
    // The answer says how well the model follows the new trace.
    let of_aorta = |found: &Findings| {
        found
            .places
            .iter()
            .any(|place| place.signal == "aortic_pressure" && place.unit == "mmHg")
    };
    assert!(of_aorta(&with) && !of_aorta(&without));
}

#[test]
fn mitral_flow_tells_a_septal_defect_from_mitral_regurgitation() {
    let rivals = ["mitral_regurgitation", "volume_scaling"];
    let [without, _] = shown_by(Measurement::MitralFlow, 24, &rivals);
    assert!(
        !without
            .accepted
            .contains(&"ventricular_septal_defect".to_owned())
    );
    // The program asks for the measurement that decides.
    assert_eq!(
        without.deciding_measurement[0],
        "mitral flow trace by flow MRI or Doppler"
    );
}

#[test]
fn times_of_valves_and_qrs_tell_slow_relaxation_from_dyssynchrony() {
    for kind in [Measurement::ValveTimes, Measurement::Qrs] {
        let [without, _] = shown_by(kind, 22, &["dyssynchrony"]);
        assert_eq!(without.accepted, ["dyssynchrony"]);
    }
}

//! Effects that pressure and volume do not show, or do not tell from others, in patients of another
//! formulation: each is named with the measurement that shows it, and not without it.

#[path = "support/visibility.rs"]
#[allow(dead_code)]
mod visibility;

use cardiotwin_discover::{Measured, Reduced, Settings, discover};
use cardiotwin_validation::{Hearts, Measurement, Plan, PlannedCase};
use cardiotwin_vocabulary::findings::{Findings, SearchSettings};

/// A case of a development seed, by its number among the singles.
fn planned((seed, number): (u64, usize)) -> PlannedCase {
    let mut cases = Plan::Singles.cases(number, seed, Hearts::Elastance);
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
fn shown_by(kind: Measurement, case: (u64, usize), rivals: &[&str]) -> [Findings; 2] {
    let planned = planned(case);
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
    let [without, with] = shown_by(Measurement::AorticPressure, (901, 20), &["wave_reflection"]);
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
    let [without, _] = shown_by(Measurement::MitralFlow, (901, 24), &rivals);
    assert!(without.none, "{:?}", without.accepted);
    // The program asks for the measurement that decides.
    assert_eq!(
        without.deciding_measurement[0],
        "mitral flow trace by flow MRI or Doppler"
    );
}

#[test]
fn times_of_valves_and_qrs_tell_slow_relaxation_from_dyssynchrony() {
    for kind in [Measurement::ValveTimes, Measurement::Qrs] {
        let [without, _] = shown_by(kind, (901, 22), &["dyssynchrony"]);
        assert_eq!(without.accepted, ["dyssynchrony"]);
    }
}

#[test]
fn aortic_flow_shows_a_leak_of_the_aortic_valve() {
    let rivals = ["mitral_regurgitation", "atrial_kick", "pressure_offset"];
    let [without, _] = shown_by(Measurement::AorticFlow, (902, 3), &rivals);
    // Without the flow the answer is both leaks.
    let class: Vec<_> = without.classes.iter().map(|class| &class.effects).collect();
    assert_eq!(class, [&["aortic_regurgitation", "mitral_regurgitation"]]);
    assert!(without.classes[0].probability > 0.9);
}

#[test]
fn a_beat_under_a_lower_load_shows_a_stiff_wall() {
    let rivals = ["pericardial_constraint", "atrial_kick", "pressure_offset"];
    let [without, _] = shown_by(Measurement::Loaded, (901, 7), &rivals);
    assert!(without.none);
}

#[test]
fn atrial_pressure_confirms_a_shifted_zero_and_shows_a_weak_kick() {
    let rivals = [
        "pericardial_constraint",
        "viscoelasticity",
        "passive_stiffening",
    ];
    let planned = planned((901, 15));
    let truth = planned.effects[0].0;
    let effects = [&[truth], &rivals[..]].concat();
    for kinds in [&[][..], &[Measurement::AtrialPressure]] {
        let found = search(&measured(&planned, kinds), &effects);
        assert_eq!(found.accepted, [truth]);
        assert!(found.confusable.is_empty() && found.classes.is_empty());
    }
    let [without, _] = shown_by(
        Measurement::AtrialPressure,
        (901, 49),
        &["aortic_regurgitation", "viscoelasticity"],
    );
    assert!(without.none);
}

#[test]
fn strain_tells_a_factor_of_all_volumes_from_a_leak() {
    let rivals = ["mitral_regurgitation", "ventricular_septal_defect"];
    let [without, _] = shown_by(Measurement::Strain, (901, 16), &rivals);
    assert_eq!(without.accepted, ["volume_scaling"]);
}

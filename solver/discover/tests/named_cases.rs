//! Cases made by another model than the one that is fitted: the names are those of the labels.

#[path = "../examples/evaluate/load.rs"]
mod load;

use cardiotwin_discover::{Reduced, Settings, discover};
use std::path::Path;

fn accepted(id: &str) -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases");
    let measured = load::measured(&folder.join("patients").join(id)).unwrap();
    let found = discover(&measured, &Reduced::new(&measured), &Settings::default()).unwrap();
    let label = &load::labels(&folder).unwrap()[id];
    assert!(!label.hard && !label.off_catalogue && label.band != "at the limit");
    // None of the cases that were set aside is a test.
    assert!(
        load::part(&load::cases(&folder).unwrap(), "aside")
            .unwrap()
            .is_empty()
    );
    assert_eq!(found.none, found.accepted.is_empty());
    if let Some(first) = found.accepted.first() {
        assert_eq!(*first, found.effects[0].name);
        let (before, after) = (found.gap_heldout_before, found.gap_heldout_after);
        assert!(after < before && after < 1.5, "{before} {after}");
    }
    assert_eq!(found.none, label.effects.is_empty(), "{:?}", found.accepted);
    found.accepted
}

#[test]
fn nothing_is_missing() {
    assert!(accepted("dev-008").is_empty());
}

#[test]
fn volume_lags_pressure() {
    assert_eq!(accepted("dev-013"), ["pv_misalignment"]);
}

#[test]
fn the_atrium_contracts() {
    assert_eq!(accepted("dev-019"), ["atrial_kick"]);
}

#[test]
fn relaxation_is_slow() {
    assert_eq!(accepted("dev-020"), ["delayed_relaxation"]);
}

#[test]
fn the_catheter_rings() {
    assert_eq!(accepted("dev-025"), ["catheter_response"]);
}

#[test]
fn the_ventricle_leaks_in_systole() {
    let names = accepted("dev-040");
    assert!(
        names == ["mitral_regurgitation"] || names == ["ventricular_septal_defect"],
        "{names:?}"
    );
}

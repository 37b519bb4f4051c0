//! Tests of acceptances and reversals, which leave the measured data unchanged.

use cardiotwin_findings::{effect, finding, kick, nothing};

use super::*;
use crate::discovery::case;

fn current(folder: &Path) -> ModelOverlay {
    toml::from_str(&std::fs::read_to_string(folder.join(FILE)).unwrap()).unwrap()
}

fn kept(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn acceptances_are_versions_and_are_undone_one_by_one() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let first = case("P1", "task-1", &kick());
    assert_eq!(accept(folder, &first, "then").unwrap(), Change::Written(1));
    assert_eq!(accept(folder, &first, "later").unwrap(), Change::Same(1));
    let overlay = current(folder);
    let acceptance = overlay.accepted.as_ref().unwrap();
    assert_eq!(
        (overlay.effects[0].name.as_str(), overlay.written.as_str()),
        ("atrial_kick", "then")
    );
    assert_eq!(
        (
            overlay.from["discover"].as_str(),
            acceptance.before,
            acceptance.seed
        ),
        ("task-1", None, 1)
    );
    assert_eq!(
        acceptance.evidence[0].interval["amplitude_mmHg"],
        [6.25, 9.5]
    );
    assert!(overlay.afterload.is_some() && overlay.passive.is_some() && overlay.tanh.is_none());

    let artefact = finding(vec![effect("pressure_offset", 30.0, true)], 1);
    assert_eq!(
        accept(folder, &case("P1", "task-2", &artefact), "now").unwrap(),
        Change::Written(2)
    );
    let overlay = current(folder);
    assert!(overlay.effects.is_empty() && overlay.corrections[0].name == "pressure_offset");
    assert_eq!(kept(folder), ["model.toml", "model.v1.toml"]);

    assert_eq!(revert(folder, "now").unwrap(), Change::Written(3));
    let overlay = current(folder);
    assert_eq!(
        (
            overlay.effects[0].name.as_str(),
            overlay.from["discover"].as_str()
        ),
        ("atrial_kick", "task-1")
    );
    assert_eq!(revert(folder, "now").unwrap(), Change::Removed);
    assert_eq!(
        kept(folder),
        ["model.v1.toml", "model.v2.toml", "model.v3.toml"]
    );
    let refused = revert(folder, "now").unwrap_err();
    assert!(
        matches!(refused, OverlayError::NothingAccepted { .. }),
        "{refused}"
    );
    assert_eq!(accept(folder, &first, "again").unwrap(), Change::Written(4));
}

#[test]
fn nothing_found_writes_nothing_and_a_file_of_another_kind_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(
        accept(dir.path(), &case("P1", "t", &nothing()), "now").unwrap(),
        Change::Nothing
    );
    assert!(kept(dir.path()).is_empty());
    std::fs::write(dir.path().join(FILE), "not = [a model").unwrap();
    assert!(matches!(
        accept(dir.path(), &case("P1", "t", &kick()), "now"),
        Err(OverlayError::Format { .. })
    ));
    assert_eq!(
        std::fs::read_to_string(dir.path().join(FILE)).unwrap(),
        "not = [a model"
    );
}

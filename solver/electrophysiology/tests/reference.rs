//! Action potentials from rest and under pacing, compared with Myokit's implementation of the
//! model.

#[path = "common/action_potential.rs"]
mod action_potential;

/// Tolerances for steps of 0.025 ms, about twice the observed differences: 0.5 mV beyond 1 ms from
/// the upstroke, 0.2 ms of duration.
fn check(name: &str, cycle_ms: f64, n_beats: usize) {
    let found = action_potential::compare(name, cycle_ms, n_beats, 0.025);
    assert!(
        found.away_mv < 0.5 && found.peak_mv < 0.5,
        "{name}: {found:?}"
    );
    assert!(found.upstroke_ms.abs() < 0.025, "{name}: {found:?}");
    assert!(
        found.apd90_off_ms.abs() < 0.2 && (200.0..400.0).contains(&found.apd90_ms),
        "{name}: {found:?}"
    );
    assert!(found.rest_mv.abs() < 0.05, "{name}: {found:?}");
    assert!(found.calcium < 0.003, "{name}: {found:?}");
}

#[test]
fn the_first_action_potential_from_rest_is_myokits() {
    check("rest", 600.0, 1);
}

#[test]
fn paced_at_1000_ms_the_action_potential_is_myokits() {
    check("cycle-1000ms", 1000.0, 8);
}

#[test]
fn paced_at_600_ms_the_action_potential_is_myokits() {
    check("cycle-600ms", 600.0, 10);
}

#[test]
fn shorter_steps_come_closer() {
    let [usual, short] =
        [0.025, 0.00625].map(|step_ms| action_potential::compare("rest", 600.0, 1, step_ms));
    assert!(
        short.peak_mv < 0.4 * usual.peak_mv && short.peak_mv < 0.1,
        "{usual:?} {short:?}"
    );
    assert!(short.away_mv < 0.1, "{short:?}");
}

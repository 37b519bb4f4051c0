//! Ctrl-C, kill -9, and two coordinators at once.

use rustix::process::Signal;

use crate::support::{Cohort, PATIENTS, Running, published};

/// Asserts that results published before a stop are still published by the same attempts, and that
/// the run reaches its end.
fn goes_on(cohort: &Cohort) {
    let before: Vec<_> = PATIENTS
        .iter()
        .map(|id| published(&cohort.patient(id)))
        .collect();
    assert!(
        before.iter().any(|tasks| tasks.len() >= 3),
        "something was done before the stop: {before:?}"
    );
    // A shorter step 2, so that the end comes soon. Earlier steps do not depend on it.
    cohort.edit(
        "cohort.toml",
        "max_generations = 1000000",
        "max_generations = 1",
    );
    cohort.call(&["run", "--no-report"]).expect(0);
    for (id, before) in PATIENTS.iter().zip(before) {
        let after = published(&cohort.patient(id));
        for task in before
            .iter()
            .filter(|(step, ..)| step != "step-2" && step != "verification")
        {
            assert!(
                after.contains(task),
                "{id} {task:?} was done again: {after:?}"
            );
        }
    }
}

fn stop_in_step_2(cohort: &Cohort, how: impl FnOnce(&mut Running)) -> crate::support::Said {
    let mut running = cohort.start(&["--no-report", "--workers", "1"]);
    cohort.wait_for_step("step-2");
    how(&mut running);
    running.end()
}

#[test]
fn two_interrupts_stop_now_and_the_same_command_goes_on() {
    let cohort = Cohort::slow();
    let said = stop_in_step_2(&cohort, |running| {
        running.signal(Signal::INT);
        // Signals in quick succession may be merged into one.
        running.wait_for_words("Ctrl-C again stops now");
        running.signal(Signal::INT);
    });
    let said = said.expect(130);
    assert!(said.err.contains("Ctrl-C again stops now"), "{}", said.err);
    assert!(
        said.err.contains("`cardiotwin run` goes on"),
        "{}",
        said.err
    );
    goes_on(&cohort);
}

#[test]
fn one_interrupt_stops_cleanly_and_starts_nothing_new() {
    let cohort = Cohort::slow();
    let done = || PATIENTS.map(|id| published(&cohort.patient(id)));
    let mut before = Default::default();
    // The only worker is busy for good, so any task that appears after this was begun after the
    // interrupt.
    let said = stop_in_step_2(&cohort, |running| {
        before = done();
        running.signal(Signal::TERM);
    });
    said.expect(130);
    assert_eq!(done(), before);
    assert!(
        cohort.call(&["status", "--json"]).json()["counts"]["done"].is_null(),
        "it stopped before the end"
    );
    goes_on(&cohort);
}

#[test]
fn a_killed_coordinator_loses_nothing() {
    let cohort = Cohort::slow();
    stop_in_step_2(&cohort, |running| running.signal(Signal::KILL)).expect(-1);
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["coordinator_running"], false);
    goes_on(&cohort);
}

#[test]
fn the_second_coordinator_is_told_who_the_first_is() {
    let cohort = Cohort::slow();
    let running = cohort.start(&["--no-report", "--workers", "1"]);
    cohort.wait_for_step("step-2");
    let said = cohort.call(&["run"]).expect(4);
    assert!(
        said.err.contains(&format!("process {}", running.pid())),
        "{}",
        said.err
    );
    cohort.call(&["status"]).expect(0);
    running.signal(Signal::INT);
    running.signal(Signal::INT);
    running.end().expect(130);
}

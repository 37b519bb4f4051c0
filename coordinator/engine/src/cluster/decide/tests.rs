//! Tables of decisions: an observation and a state give effects. No folder, clock or scheduler takes
//! part.

mod desk;

use cardiotwin_schemas::failure::{FailureCause, FailureClass};
use cardiotwin_slurm::answers::submit::Submission as Answer;
use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::state::SlurmState;
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::patient::Patient;

use super::{AttemptSeen, Effect};
use desk::{Desk, accounted, job_name, queued};

/// What became of the patient of a job.
#[derive(Debug, PartialEq, Eq)]
enum Fate {
    /// The job is left alone.
    InItsJob,
    /// Another job was submitted, which avoids these nodes.
    Again(Vec<String>),
    Cancelled,
    Failed(FailureClass, Option<FailureCause>),
}

fn fate(desk: &Desk, first: &str) -> Fate {
    match &desk.state.books.patient(0).row.state {
        Patient::Cancelled { .. } => return Fate::Cancelled,
        Patient::Failed { failure, .. } => return Fate::Failed(failure.class, failure.cause),
        _ => {}
    }
    let rows = desk.state.books.jobs().rows();
    match rows.values().find(|row| row.name != first) {
        Some(row) => Fate::Again(row.spec.exclude.clone()),
        None => Fate::InItsJob,
    }
}

#[test]
fn a_waiting_patient_is_submitted_in_one_turn_and_its_number_committed_in_the_next() {
    let mut desk = Desk::new(1);
    let turns = desk.tick();
    let [submission, rest] = &turns[..] else {
        panic!("{turns:?}")
    };
    assert!(
        matches!(submission[..], [Effect::Submit { .. }]),
        "{turns:?}"
    );
    assert_eq!(rest[..], []);
    assert!(desk.state.books.outbox().is_empty());
    assert_eq!(desk.tick(), [vec![]], "a quiet tick has no effects");
}

#[test]
fn what_follows_from_what_slurm_says_of_a_job_that_began_an_attempt() {
    use Fate::{Again, Cancelled, Failed, InItsJob};
    let (own, site, bug) = (Some(desk::UID), FailureClass::Site, FailureClass::Bug);
    let refused = Some(FailureCause::Refused);
    let again = || Again(Vec::new());
    for (state, reason, by, log, expected) in [
        (SlurmState::Running, "None", None, "", InItsJob),
        (SlurmState::Pending, "Priority", None, "", InItsJob),
        (SlurmState::Completed, "None", None, "", again()),
        (SlurmState::Timeout, "TimeLimit", None, "", again()),
        (
            SlurmState::NodeFail,
            "None",
            None,
            "",
            Again(vec!["n4".into()]),
        ),
        (SlurmState::Preempted, "None", None, "", again()),
        (SlurmState::Cancelled, "None", own, "", Cancelled),
        (
            SlurmState::Cancelled,
            "DependencyNeverSatisfied",
            own,
            "",
            again(),
        ),
        (
            SlurmState::Cancelled,
            "None",
            own,
            "oom_kill event",
            again(),
        ),
        (SlurmState::Failed, "NonZeroExitCode", None, "", again()),
        (
            SlurmState::Failed,
            "NonZeroExitCode",
            None,
            "panicked at x.rs",
            Failed(bug, None),
        ),
        (
            SlurmState::Failed,
            "BadConstraints",
            None,
            "",
            Failed(site, refused),
        ),
    ] {
        let mut desk = Desk::new(1);
        let first = desk.run_first_job();
        desk.queue = Ok(vec![queued(&first, &state, reason)]);
        desk.accounting = Ok(vec![accounted(&first, &state, reason, by)]);
        desk.log_tail = log.to_owned();
        let turns = desk.tick();
        let case = format!("{state:?} {reason} {by:?} {log:?}: {turns:#?}");
        assert_eq!(fate(&desk, &first), expected, "{case}");
        let has_ended = expected != InItsJob;
        let fence = Effect::Fence((first.clone(), 0));
        assert_eq!(turns[0].contains(&fence), has_ended, "{case}");
        let revokes = |effects: &Vec<Effect>| matches!(effects[..], [Effect::Revoke { .. }]);
        let revoked = turns.iter().position(revokes);
        assert_eq!(revoked, has_ended.then_some(1), "{case}");
        let submits = |effect: &Effect| matches!(effect, Effect::Submit { .. });
        let submitted = turns.iter().position(|effects| effects.iter().any(submits));
        let is_repeated = matches!(expected, Again(_));
        assert_eq!(submitted, is_repeated.then_some(2), "after both: {case}");
    }
}

#[test]
fn a_cancellation_without_a_name_is_open_for_a_grace_time_and_then_slurms() {
    let mut desk = Desk::new(1);
    desk.state.settings.slurm.grace_s = 60;
    let first = desk.run_first_job();
    let cancelled = SlurmState::Cancelled;
    desk.queue = Ok(vec![queued(&first, &cancelled, "None")]);
    for (pass_s, expected) in [
        (0, Fate::InItsJob),
        (60, Fate::InItsJob),
        (1, Fate::Again(vec![])),
    ] {
        desk.pass(pass_s);
        desk.tick();
        assert_eq!(fate(&desk, &first), expected, "after {pass_s} s more");
    }
}

#[test]
fn a_job_out_of_sight_is_given_up_after_the_grace_time_and_a_silent_queue_is_no_sight() {
    let mut desk = Desk::new(1);
    desk.state.settings.slurm.grace_s = 60;
    let first = desk.run_first_job();
    desk.queue = Err(desk::silence("squeue"));
    for _ in 0..2 {
        desk.pass(1000);
        assert_eq!(desk.tick().concat(), [], "silence says nothing");
    }
    assert_eq!(fate(&desk, &first), Fate::InItsJob);
    desk.queue = Ok(Vec::new());
    desk.tick();
    desk.pass(60);
    desk.tick();
    assert_eq!(fate(&desk, &first), Fate::InItsJob);
    desk.pass(1);
    desk.tick();
    assert_eq!(fate(&desk, &first), Fate::Again(vec![]));
}

#[test]
fn an_outcome_that_was_published_before_the_revocation_counts() {
    let mut desk = Desk::new(1);
    let first = desk.run_first_job();
    let attempt = desk.state.present_attempt(0).unwrap();
    let timeout = SlurmState::Timeout;
    desk.queue = Ok(vec![queued(&first, &timeout, "TimeLimit")]);
    desk.after_revocation
        .push(AttemptSeen::Ended(desk.success(&attempt)));
    desk.tick();
    let next = desk.state.books.patient(0).row.state.clone();
    assert!(
        matches!(&next, Patient::Working { task, .. } if *task != attempt.task),
        "{next:?}"
    );
    assert_eq!(fate(&desk, &first), Fate::Again(vec![]));
    let id = desk.state.books.patient(0).row.id;
    let allotment = desk.state.books.jobs().allotment(id);
    assert_eq!(
        (allotment.infrastructure, allotment.free),
        (0, 1),
        "it got further"
    );
}

#[test]
fn what_follows_from_an_answer_of_sbatch() {
    let text = |code, stdout: &str, stderr: &str| Output {
        exit: Exit::Code(code),
        stdout: stdout.to_owned(),
        stderr: stderr.to_owned(),
    };
    let said = |message: &str| {
        text(
            1,
            "",
            &format!("sbatch: error: Batch job submission failed: {message}\n"),
        )
    };
    let timed_out = Output {
        exit: Exit::TimedOut,
        ..text(0, "", "")
    };
    // Of two patients in jobs of their own: submissions tried, elements taken, actions left for the
    // next tick, patients failed.
    for (answer, expected) in [
        (text(0, "7\n", ""), (2, 2, 0, 0)),
        (said("Requested reservation not usable now"), (1, 0, 2, 0)),
        (said("Invalid qos specification"), (2, 0, 0, 2)),
        (timed_out, (1, 0, 1, 0)),
    ] {
        let mut desk = Desk::new(2);
        let kind = cardiotwin_slurm::answers::submit::read(&answer);
        desk.sbatch = answer;
        let effects = desk.tick().concat();
        let submits = |effect: &&Effect| matches!(effect, Effect::Submit { .. });
        let submissions = |action: &&(i64, Action)| matches!(action.1, Action::SubmitJob { .. });
        let patients = desk.state.books.patients().iter();
        let failed = patients.filter(|p| matches!(p.row.state, Patient::Failed { .. }));
        let found = (
            effects.iter().filter(submits).count(),
            desk.state.submitted,
            desk.state.books.outbox().iter().filter(submissions).count(),
            failed.count(),
        );
        assert_eq!(found, expected, "{kind:?}");
        let holds = desk.state.report.holds.is_some();
        assert_eq!(holds, expected.2 > 0, "{kind:?}");
        let is_doubtful = matches!(kind, Answer::Doubtful { .. });
        assert_eq!(desk.state.report.silent, u32::from(is_doubtful), "{kind:?}");
    }
}

#[test]
fn fences_come_before_submissions_and_cancellations_after_them() {
    let mut desk = Desk::new(2);
    desk.run_first_job();
    let unwanted = job_name(&desk, 1);
    let attempt = desk.state.present_attempt(0).unwrap();
    let books = &mut desk.state.books;
    let spec = books.jobs().rows()[&unwanted].spec.clone();
    books.put_action(Action::CancelJob {
        job: unwanted.clone(),
        element: 0,
    });
    books.intend_job("ct-x".to_owned(), spec);
    books.put_action(Action::Stop { attempt });
    books.put_action(Action::FenceJob {
        job: unwanted,
        element: 0,
    });
    books.flush();
    desk.state.phase = super::Phase::Outbox;
    let first = desk.state.effects();
    assert!(
        matches!(
            first[..],
            [
                Effect::Stop { .. },
                Effect::FenceByAction { .. },
                Effect::Submit { .. }
            ]
        ),
        "{first:?}"
    );
    let turns = desk.finish();
    assert!(matches!(turns[1][..], [Effect::Cancel { .. }]), "{turns:?}");
}

#[test]
fn a_reported_end_needs_no_scheduler() {
    let mut desk = Desk::new(1);
    let first = desk.run_first_job();
    desk.queue = Err(desk::silence("squeue"));
    desk.report_end(&first);
    let turns = desk.tick();
    assert_eq!(turns[0], [Effect::Fence((first.clone(), 0))]);
    let report = &desk.state.report;
    assert_eq!(report.lingering.len(), 1, "Slurm may still show it");
    assert!(
        report.holds.is_some(),
        "without a queue nothing is submitted"
    );
}

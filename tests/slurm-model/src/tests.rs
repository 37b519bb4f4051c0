use std::collections::BTreeMap;

use proptest::prelude::*;

use super::{Behaviour, Fault, Limits, Model, Settings};
use cardiotwin_slurm::answers::{Exit, Output, accounting, queue, submit};
use cardiotwin_slurm::commands;
use cardiotwin_slurm::job::JobName;
use cardiotwin_slurm::job_status::{JobStatus, Unknown, Wanted, of};
use cardiotwin_slurm::state::SlurmState;

#[allow(dead_code)] // the names of all answers are for the parsers
#[path = "../../../coordinator/slurm/tests/recorded/read.rs"]
mod recorded;

fn script(name: &str, more: &str) -> String {
    format!("#!/bin/bash\n#SBATCH --job-name={name}\n#SBATCH --no-requeue\n{more}true\n")
}

fn submit_as(
    model: &mut Model,
    name: &str,
    more: &str,
    fault: Option<Fault>,
) -> submit::Submission {
    let text = script(name, more);
    submit::read(&model.answer(
        &commands::submit(".", "job.sh"),
        |_| Some(text.clone()),
        fault,
    ))
}

fn ask(model: &mut Model, fault: Option<Fault>) -> (Output, Output) {
    let none = |_: &str| None;
    let since = model.now() - 100_000;
    (
        model.answer(&commands::queue(), none, fault),
        model.answer(&commands::accounting(&[], since), none, None),
    )
}

fn status_of(model: &mut Model, name: &str) -> JobStatus {
    let (queued, accounted) = ask(model, None);
    let (queued, accounted) = (queue::read(&queued).ok(), accounting::read(&accounted).ok());
    of(
        Wanted {
            name,
            element: None,
        },
        queued.as_ref(),
        accounted.as_ref(),
    )
}

/// The model refuses with the exact messages of the real Slurm.
#[test]
fn it_speaks_as_the_real_slurm_does() {
    let mut settings = Settings::default();
    let limits = Limits {
        max_queued: Some(64),
        walltime_s: Some(1200),
        ..Limits::default()
    };
    settings.qos = BTreeMap::from([("normal".to_owned(), limits)]);
    let mut model = Model::new(settings);
    let mut said = |more: &str, fault| {
        let text = script("ct-x", more);
        let output = model.answer(
            &commands::submit(".", "job.sh"),
            |_| Some(text.clone()),
            fault,
        );
        (output.exit, output.stderr)
    };
    for (more, fault, name) in [
        ("#SBATCH --time=01:00:00\n", None, "sbatch-refused-walltime"),
        (
            "#SBATCH --time=00:10:00\n#SBATCH --array=0-64\n",
            None,
            "sbatch-refused-submit-limit",
        ),
        ("#SBATCH --array=0-1001\n", None, "sbatch-refused-array"),
        ("#SBATCH --nodes=64\n", None, "sbatch-refused-nodes"),
        ("#SBATCH --qos=nowhere\n", None, "sbatch-refused-qos"),
        ("#SBATCH --no-such-option\n", None, "sbatch-refused-option"),
        ("", Some(Fault::TimeoutAfter), "sbatch-frozen"),
        ("", Some(Fault::Down), "sbatch-no-slurmctld"),
    ] {
        let real = recorded::output(name);
        assert_eq!(said(more, fault), (real.exit, real.stderr), "{name}");
    }
    let down = model.answer(&commands::queue(), |_| None, Some(Fault::Down));
    assert_eq!(down, recorded::output("squeue-no-slurmctld"));
    let empty = Model::new(Settings::default()).answer(&commands::queue(), |_| None, None);
    let real = recorded::output("squeue-mixed");
    assert_eq!(
        empty.stdout.lines().next(),
        real.stdout.lines().next(),
        "the same header"
    );
}

#[test]
fn a_submission_that_timed_out_is_found_by_its_name() {
    let mut model = Model::new(Settings::default());
    let answer = submit_as(&mut model, "ct-a", "", Some(Fault::TimeoutAfter));
    assert!(matches!(answer, submit::Submission::Doubtful { .. }));
    assert!(matches!(status_of(&mut model, "ct-a"), JobStatus::Alive(_)));
    let answer = submit_as(&mut model, "ct-b", "", Some(Fault::TimeoutBefore));
    assert!(matches!(answer, submit::Submission::Doubtful { .. }));
    let unknown = JobStatus::Unknown(Unknown::NotListed {
        queue_answered: true,
        accounting_answered: true,
    });
    assert_eq!(status_of(&mut model, "ct-b"), unknown);
}

#[test]
fn endings_reach_the_queue_at_once_and_the_database_later() {
    let mut model = Model::new(Settings::default());
    model.behaviours.insert(
        "ct-long".to_owned(),
        Behaviour {
            seconds: 9999,
            code: 0,
            signal: 0,
        },
    );
    model.behaviours.insert(
        "ct-oom".to_owned(),
        Behaviour {
            seconds: 5,
            code: 0,
            signal: 125,
        },
    );
    submit_as(&mut model, "ct-long", "#SBATCH --time=00:02:00\n", None);
    submit_as(&mut model, "ct-oom", "", None);
    model.advance(6);
    let JobStatus::Ended(oom) = status_of(&mut model, "ct-oom") else {
        panic!("it has ended")
    };
    assert_eq!(
        (oom.state.clone(), oom.exit),
        (SlurmState::OutOfMemory, None),
        "the database does not know yet"
    );
    model.advance(150);
    let JobStatus::Ended(oom) = status_of(&mut model, "ct-oom") else {
        panic!("it has ended")
    };
    assert_eq!(oom.exit.map(|exit| exit.signal), Some(125));
    assert!(
        matches!(status_of(&mut model, "ct-long"), JobStatus::Ended(ended) if ended.state == SlurmState::Timeout)
    );
    model.advance(1000); // the queue has forgotten both jobs
    assert!(
        matches!(status_of(&mut model, "ct-long"), JobStatus::Ended(ended) if ended.state == SlurmState::Timeout)
    );
}

#[test]
fn a_lost_node_does_not_end_its_processes() {
    let mut model = Model::new(Settings::default());
    submit_as(&mut model, "ct-a", "", None);
    model.advance(2);
    model.lose_node(1);
    model.advance(5);
    assert!(
        matches!(status_of(&mut model, "ct-a"), JobStatus::Ended(ended) if ended.may_have_orphans() && ended.nodes == "n1")
    );
    assert_eq!(model.runs()[0].ended, None, "the zombie works on");
    model.advance(100);
    assert!(
        model.runs()[0].completed,
        "and comes to its end, fenced or not"
    );
}

#[test]
fn limits_hold_jobs_back_and_say_so() {
    let mut settings = Settings::default();
    settings.qos.insert(
        "few".to_owned(),
        Limits {
            max_running: Some(1),
            ..Limits::default()
        },
    );
    let mut model = Model::new(settings);
    for name in ["ct-1", "ct-2"] {
        submit_as(&mut model, name, "#SBATCH --qos=few\n", None);
    }
    submit_as(&mut model, "ct-array", "#SBATCH --array=0-3%2\n", None);
    model.advance(2);
    let JobStatus::Alive(second) = status_of(&mut model, "ct-2") else {
        panic!("it waits")
    };
    assert_eq!(
        second.why.expect("a reason").words,
        "the QoS's limit on running jobs"
    );
    assert_eq!(model.runs().len(), 3, "one of the QoS, two of the array");
}

/// A client that follows the rules: intent first, lookup after doubt, and another submission only
/// when complete answers of the queue and of the database, both after a grace time, do not list the
/// name.
struct Client {
    name: String,
    doubtful_since: Option<i64>,
    submitted: bool,
}

impl Client {
    const GRACE_S: i64 = 30;

    fn tick(&mut self, model: &mut Model, fault: Option<Fault>) {
        if self.submitted {
            return;
        }
        if let Some(since) = self.doubtful_since {
            let (queued, accounted) = ask(model, fault);
            let (queued, accounted) =
                (queue::read(&queued).ok(), accounting::read(&accounted).ok());
            match of(
                Wanted {
                    name: &self.name,
                    element: None,
                },
                queued.as_ref(),
                accounted.as_ref(),
            ) {
                JobStatus::Unknown(Unknown::NotListed {
                    queue_answered: true,
                    accounting_answered: true,
                }) if model.now() - since > Self::GRACE_S => {
                    self.doubtful_since = None;
                }
                JobStatus::Unknown(_) => {}
                _ => self.submitted = true,
            }
            return;
        }
        match submit_as(model, &self.name, "", fault) {
            submit::Submission::Accepted { .. } => self.submitted = true,
            submit::Submission::Doubtful { .. } => self.doubtful_since = Some(model.now()),
            submit::Submission::Refused(_) => {}
        }
    }
}

fn any_fault() -> impl Strategy<Value = Option<Fault>> {
    prop_oneof![
        3 => Just(None),
        1 => Just(Some(Fault::TimeoutAfter)),
        1 => Just(Some(Fault::TimeoutBefore)),
        1 => Just(Some(Fault::KilledAfter)),
        1 => Just(Some(Fault::Down)),
        1 => "[a-z0-9|\n]{0,40}".prop_map(|text| Some(Fault::Garbage(text))),
        1 => (0_usize..400).prop_map(|at| Some(Fault::Cut(at))),
        1 => Just(Some(Fault::Banner("* maintenance on Tuesday *".to_owned()))),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever the answers, a name runs at most once, and once the answers are good it has run.
    #[test]
    fn a_careful_client_never_runs_a_job_twice(
        steps in proptest::collection::vec((any_fault(), 0_i64..40), 1..25),
    ) {
        let mut model = Model::new(Settings::default());
        let mut clients = (0..3).map(|i| Client { name: format!("ct-{i}"), doubtful_since: None, submitted: false }).collect::<Vec<_>>();
        for (fault, seconds) in steps {
            for client in &mut clients {
                client.tick(&mut model, fault.clone());
            }
            model.advance(seconds);
        }
        for _ in 0..4 {
            for client in &mut clients {
                client.tick(&mut model, None);
            }
            model.advance(Client::GRACE_S + 70);
        }
        for client in &clients {
            let runs = model.runs().iter().filter(|run| run.name == client.name).collect::<Vec<_>>();
            prop_assert_eq!(runs.len(), 1, "{}: {:?}", client.name, runs);
            prop_assert!(runs[0].completed);
            prop_assert!(JobName::new(&client.name).is_ok());
        }
    }

    /// Time, cancellations, preemptions and crashes of the controller in any order: a job is shown
    /// as alive or ended exactly if it runs or not, except for errors that the real Slurm makes as
    /// well.
    #[test]
    fn what_the_answers_say_is_what_happens(events in proptest::collection::vec((0_u8..5, 0_u32..6, 0_i64..90), 1..40)) {
        let mut model = Model::new(Settings::default());
        let mut n = 0;
        let mut crashed = false;
        for (event, which, seconds) in events {
            let name = format!("ct-{which}");
            match event {
                0 | 1 => {
                    submit_as(&mut model, &format!("ct-{n}"), "", None);
                    n += 1;
                }
                2 => {
                    let name = JobName::new(&name).expect("a name");
                    model.answer(&commands::cancel_name(&name), |_| None, None);
                }
                3 => model.preempt(&name),
                _ => {
                    model.crash_controller();
                    crashed = true;
                }
            }
            model.advance(seconds);
            for i in 0..n {
                let name = format!("ct-{i}");
                let lives = model.runs().iter().any(|run| run.name == name && run.ended.is_none());
                match status_of(&mut model, &name) {
                    JobStatus::Alive(alive) => prop_assert!(!alive.runs || lives, "{} runs", name),
                    JobStatus::Ended(_) => prop_assert!(!lives, "{} has ended", name),
                    JobStatus::Unknown(_) => prop_assert!(crashed || seconds < 3, "{} is unknown", name),
                }
            }
        }
    }
}

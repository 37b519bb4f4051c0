//! Recorded answers of a real Slurm, replayed to the tick.

use cardiotwin_slurm::answers::{Exit, Output, submit};
use cardiotwin_slurm_model::Settings;

use super::lab::Lab;
use super::{long_noops, noops};

#[path = "../../../../slurm/tests/recorded/read.rs"]
mod read;

fn renamed(answer: &Output, from: &str, to: &str) -> Output {
    let field = |name: &str| format!("|{name}|");
    Output {
        stdout: answer.stdout.replace(&field(from), &field(to)),
        ..answer.clone()
    }
}

/// What follows from a recorded job whose driver died at its first attempt: jobs submitted so far,
/// patients cancelled, patients failed.
#[tokio::test]
async fn what_follows_from_recorded_ends_of_jobs() {
    let panic = "thread 'main' panicked at driver.rs:1:1:\n";
    let killed = "slurmstepd: error: Detected 1 oom_kill event in StepId=7.batch";
    let (ended, no_database) = ("sacct-ended", "sacct-no-slurmdbd");
    for (name, accounting, log, expected) in [
        ("ct-walltime", ended, "", (2, 0, 0)),
        ("ct-node", ended, "", (2, 0, 0)),
        ("ct-memory", ended, killed, (2, 0, 0)),
        ("ct-exit3", ended, "", (2, 0, 0)),
        ("ct-exit3", ended, panic, (1, 0, 1)),
        ("ct-short", ended, "", (2, 0, 0)),
        ("ct-person", ended, "", (1, 1, 0)),
        ("ct-person", ended, killed, (2, 0, 0)),
        ("ct-after", ended, "", (2, 0, 0)),
        ("ct-walltime", no_database, "", (2, 0, 0)),
        ("ct-person", no_database, "", (1, 0, 0)),
    ] {
        let mut lab = Lab::new(noops(1), Settings::default());
        lab.tick().await;
        lab.pass(2);
        lab.drive(|| Some((0, true))).await;
        let run = lab.slurm.model.lock().unwrap().runs()[0].name.clone();
        let folder = lab.run_dir().join("slurm").join(&run);
        std::fs::write(folder.join("slurm-1.log"), log).unwrap();
        let (queue, accounts) = (read::output("squeue-ended"), read::output(accounting));
        let answers = (renamed(&queue, name, &run), renamed(&accounts, name, &run));
        *lab.slurm.replay.lock().unwrap() = Some(answers);
        let summary = lab.tick().await;
        let found = (lab.n_asked("sbatch"), summary.cancelled, summary.failed);
        assert_eq!(found, expected, "{name} {accounting} {log:?}");
    }
}

/// Of two jobs the first meets a recorded answer of sbatch. In the end every patient is done, unless
/// Slurm refused its job for good.
#[tokio::test]
async fn what_follows_from_recorded_answers_to_submissions() {
    for name in read::names("sbatch-") {
        let mut lab = Lab::new(long_noops(2), Settings::default()).without_arrays();
        let answer = read::output(&name);
        let is_refused = matches!(
            submit::read(&answer),
            submit::Submission::Refused(refusal) if !refusal.may_pass()
        );
        *lab.slurm.submission.lock().unwrap() = Some(answer);
        lab.tick().await;
        for _ in 0..3 {
            lab.pass(30);
            lab.tick().await;
        }
        let summary = lab.finish().await;
        let refused = usize::from(is_refused);
        assert_eq!(
            (summary.done, summary.failed),
            (2 - refused, refused),
            "{name}"
        );
    }
}

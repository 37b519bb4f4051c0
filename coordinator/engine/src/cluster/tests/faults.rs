//! Faults of `sacct` and `scancel`: a command that fails is repeated, and a faulty answer is not
//! trusted.

use cardiotwin_slurm::commands;
use cardiotwin_slurm::job::JobName;
use cardiotwin_slurm_model::{Fault, Settings};

use super::lab::Lab;
use super::noops;
use crate::cancel;

fn every_fault() -> [Fault; 7] {
    [
        Fault::TimeoutAfter,
        Fault::TimeoutBefore,
        Fault::KilledAfter,
        Fault::Garbage("???".into()),
        Fault::Cut(40),
        Fault::Banner("Welcome\n".into()),
        Fault::Down,
    ]
}

/// A job that is not wanted any more ends, whatever became of the first `scancel`.
#[tokio::test]
async fn a_faulty_scancel_is_asked_again() {
    for fault in every_fault() {
        let lab = Lab::new(noops(1), Settings::default());
        lab.tick().await;
        lab.pass(2);
        cancel(&lab.run_dir(), None).await.unwrap();
        lab.fault("scancel", fault.clone());
        let mut summary = lab.tick().await;
        assert_eq!(lab.n_asked("scancel"), 1, "{fault:?}");
        for _ in 0..5 {
            lab.pass(1);
            summary = lab.tick().await;
        }
        assert_eq!((summary.cancelled, summary.jobs), (1, 0), "{fault:?}");
        // The cancellation is repeated if it had no effect. If only the answer was lost, the job is
        // seen to have ended.
        let has_no_effect = matches!(fault, Fault::TimeoutBefore | Fault::Down);
        assert_eq!(lab.n_asked("scancel") > 1, has_no_effect, "{fault:?}");
        let runs = lab.slurm.model.lock().unwrap().runs().to_vec();
        assert!(
            runs[0].ended.is_some() && !runs[0].completed,
            "{fault:?}: {runs:?}"
        );
    }
}

/// A person cancelled the job. Only accounting names the person, and its first answer is faulty:
/// before a proper answer the patient is neither failed nor submitted again.
#[tokio::test]
async fn a_faulty_sacct_blames_nobody() {
    for fault in every_fault() {
        let mut lab = Lab::new(noops(1), Settings::default());
        lab.settings.grace_s = 3600;
        lab.tick().await;
        lab.pass(5);
        let name = lab.slurm.model.lock().unwrap().runs()[0].name.clone();
        let by_hand = commands::cancel_name(&JobName::new(&name).unwrap());
        lab.slurm
            .model
            .lock()
            .unwrap()
            .answer(&by_hand, |_| None, None);
        lab.pass(5);
        lab.fault("sacct", fault.clone());
        let first = lab.tick().await;
        assert_eq!(lab.n_asked("sacct"), 1, "{fault:?}");
        assert_eq!(first.failed, 0, "{fault:?}");
        lab.pass(30);
        let summary = lab.tick().await;
        let found = (summary.cancelled, summary.failed, summary.jobs);
        assert_eq!(found, (1, 0, 0), "{fault:?}");
        assert_eq!(lab.n_asked("sbatch"), 1, "{fault:?}");
    }
}

//! Canceller of a job that Slurm shows as CANCELLED: a person, whose wish holds, or Slurm itself,
//! which counts as a failure of the site.
//!
//! A controller that lost its state hands out numbers again. If it finds the earlier job of a
//! number on its node, it cancels the new job as that starts. The new job had a node, ran for 0 s,
//! and never ran its script. It is `CANCELLED by` the controller's own user, often seconds after the
//! queue shows it as such. CANCELLED alone therefore does not show that a person cancelled the job.
//! The rules, in this order:
//! 1. Accounting names the job's own user, who is not root: a person. Another named user is a
//!    person as well, an administrator, unless the job was cancelled as it started, as above: then
//!    it was Slurm. Of a job over several nodes the first one may have run the script before
//!    another one refused the job; a cancellation in root's name after 0 s is therefore always
//!    Slurm's.
//! 2. Accounting shows the job as cancelled and names no user: Slurm.
//! 3. Accounting shows the job as live, does not list it, or does not answer: it is asked again,
//!    for one grace time or more.
//! 4. After that, or at once on a site without accounting, the job's own evidence decides: a job
//!    that never had a node, or whose processes were asked to end, was cancelled by a person. Slurm
//!    sends SIGTERM for `scancel`, but a controller that lost its state also sends it to jobs that
//!    it no longer knows. This is why the wait for accounting is long on a site that has it.
//! 5. Without any such evidence it was Slurm, once the grace time is over.

use crate::job_status::{Accounting, Ended};
use crate::state::SlurmState;

/// Evidence from the job's own folder, and the state of the inquiry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OwnTraces {
    /// Whether the job's script started the driver.
    pub began: bool,
    /// Whether the job's processes were asked to end, other than by the warning before the
    /// walltime.
    pub asked_to_end: bool,
    /// User id of the submitter.
    pub uid: u32,
    /// Whether the site has no accounting.
    pub no_accounting: bool,
    /// Whether the wait for lagging sources is over.
    pub waited: bool,
}

/// Canceller of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Canceller {
    /// A person cancelled the job, so it stays cancelled.
    Person,
    /// Slurm cancelled the job, which is a failure of the site.
    Slurm,
    /// The canceller is not known yet: look again.
    Unclear,
}

/// Decides who cancelled a job that the queue or accounting shows as CANCELLED and that the
/// coordinator did not cancel.
#[must_use]
pub fn by_whom(ended: &Ended, own: OwnTraces) -> Canceller {
    debug_assert_eq!(ended.state, SlurmState::Cancelled);
    let at_its_start = ended.began == Some(true)
        && ended.elapsed_s == Some(0)
        && (!own.began || ended.cancelled_by == Some(0));
    // Slurm cancels jobs that it was about to start; waiting jobs are cancelled by people.
    let person = own.asked_to_end || ended.began == Some(false);
    match (ended.accounting, ended.cancelled_by) {
        (_, Some(uid)) if uid == own.uid && uid != 0 => Canceller::Person,
        (_, Some(_)) if !at_its_start => Canceller::Person,
        (_, Some(_)) | (Accounting::Agrees, None) => Canceller::Slurm,
        (Accounting::Silent, None) if person && own.no_accounting => Canceller::Person,
        _ if !own.waited => Canceller::Unclear,
        _ if person => Canceller::Person,
        _ => Canceller::Slurm,
    }
}

#[cfg(test)]
mod tests {
    use super::{Accounting, Canceller, OwnTraces, by_whom};
    use crate::job::JobId;
    use crate::job_status::Ended;
    use crate::state::SlurmState;

    const OWN_UID: u32 = 1001;

    fn cancelled(accounting: Accounting, cancelled_by: Option<u32>, ran_s: Option<u64>) -> Ended {
        Ended {
            id: JobId::single(7),
            state: SlurmState::Cancelled,
            exit: None,
            reason: "None".to_owned(),
            cancelled_by,
            began: Some(ran_s.is_some()),
            elapsed_s: ran_s,
            nodes: if ran_s.is_some() {
                "n1".to_owned()
            } else {
                String::new()
            },
            accounting,
        }
    }

    /// Covers every combination, so that each one is decided on purpose.
    #[test]
    fn who_it_was_by_all_that_can_be_known() {
        let sources = [
            (Accounting::Agrees, Some(OWN_UID), false),
            (Accounting::Agrees, Some(0), false),
            (Accounting::Agrees, None, false),
            (Accounting::Disagrees, None, false),
            (Accounting::Unaware, None, false),
            (Accounting::Silent, None, false),
            (Accounting::Silent, None, true),
        ];
        let stories = [
            ("never had a node", None, false, false),
            ("at its start", Some(0), false, false),
            ("its driver ran", Some(9), true, false),
            ("its driver was asked to end", Some(9), true, true),
        ];
        let mut table = String::new();
        for (accounting, by, no_accounting) in sources {
            for (story, ran_s, began, asked_to_end) in stories {
                let ended = cancelled(accounting, by, ran_s);
                let own = OwnTraces {
                    began,
                    asked_to_end,
                    uid: OWN_UID,
                    no_accounting,
                    waited: false,
                };
                let who = |waited| by_whom(&ended, OwnTraces { waited, ..own });
                let by = by.map(|uid| format!(", by {uid}")).unwrap_or_default();
                let source = format!(
                    "{accounting:?}{by}{}",
                    if no_accounting { ", none" } else { "" }
                );
                table += &format!(
                    "{source:<16} {story:<28} {:<8} {:?}\n",
                    format!("{:?}", who(false)),
                    who(true)
                );
                assert_ne!(who(true), Canceller::Unclear, "it is decided at last");
            }
        }
        insta::assert_snapshot!(table);
    }

    /// The controller runs as root, and the submitter is root as well.
    #[test]
    fn root_is_named_for_what_slurm_does_too() {
        let own = OwnTraces {
            uid: 0,
            ..OwnTraces::default()
        };
        assert_eq!(
            by_whom(&cancelled(Accounting::Agrees, Some(0), Some(0)), own),
            Canceller::Slurm
        );
        assert_eq!(
            by_whom(&cancelled(Accounting::Agrees, Some(0), Some(5)), own),
            Canceller::Person
        );
        let begun = OwnTraces { began: true, ..own };
        assert_eq!(
            by_whom(&cancelled(Accounting::Agrees, Some(0), Some(0)), begun),
            Canceller::Slurm,
            "another node of the job refused it"
        );
    }
}

//! Elements of jobs that outlive their drivers: a driver has written that it ended, and Slurm still
//! shows its element as running.
//!
//! Such an element holds its nodes, and in an array with a throttle it keeps others from starting. It
//! is said and cancelled after the grace time.

use cardiotwin_slurm::job_status::{JobStatus, Wanted};
use cardiotwin_slurm::state::SlurmState;
use cardiotwin_store::cluster_jobs::Lingering;

use super::State;

impl State {
    /// Notes that an element ended by its drivers' word.
    pub(super) fn note_lingering(&mut self, name: &str, element: usize) {
        let element = self.wanted(name, element).element;
        self.report.lingering.push(Lingering {
            name: name.to_owned(),
            element,
            since_ms: self.books.now_ms(),
            id: None,
            is_cancelled: false,
        });
    }

    /// Looks for lingering elements in the queue's answer: forgets those that are gone, and marks
    /// those for cancellation that stay for longer than the grace time.
    pub(super) fn take_lingering(&mut self) {
        let now_ms = self.books.now_ms();
        let grace_ms = if self.ends_all { -1 } else { self.grace_ms() };
        let mut to_cancel = Vec::new();
        self.report.lingering.retain_mut(|one| {
            let (name, element) = (one.name.as_str(), one.element);
            let wanted = Wanted { name, element };
            let JobStatus::Alive(alive) = self.inquiry.status_by_queue(wanted) else {
                return false;
            };
            if alive.state != SlurmState::Running {
                return false; // It is about to leave.
            }
            one.id = Some(alive.id.to_string());
            if now_ms - one.since_ms > grace_ms {
                to_cancel.push(alive.id);
                one.is_cancelled = true;
            }
            true
        });
        self.lingering = to_cancel;
    }

    /// Whether an element may still live whose drivers have ended.
    pub fn has_lingering(&self) -> bool {
        !self.report.lingering.is_empty()
    }
}

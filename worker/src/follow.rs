//! The part of the ranks other than 0 in the work of a team.

use crate::call::Call;
use crate::error::TaskError;
use crate::finite_element::{passive, tissue};
use crate::tasks::organ_beat;
use crate::team::Team;

impl Team {
    /// Takes part in rank 0's calls until rank 0 dismisses the team. All other ranks call this.
    ///
    /// # Errors
    /// [`TaskError`] of this rank. The launcher then has to end all ranks.
    pub fn follow(&self) -> Result<(), TaskError> {
        while let Some(call) = self.next_call() {
            match call {
                Call::Beat(spec, about) => organ_beat::serve(&spec, &about, self)?,
                Call::Tissue => tissue::serve(self),
                Call::PassiveState(job) => passive::serve(&job, self),
            }
        }
        Ok(())
    }
}

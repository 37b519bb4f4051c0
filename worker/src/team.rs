//! Ranks of other processes: rank 0 does a task as it would alone, and calls the others to step 0 and to a beat in 3D.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cardiotwin_linalg::parallel::Communicator;
use cardiotwin_schemas::task::OrganBeatSpec;
use serde::{Deserialize, Serialize};

use crate::error::TaskError;
use crate::finite_element::passive::{self, PassiveOrder};
use crate::finite_element::stored::About;
use crate::finite_element::tissue;
use crate::tasks::organ_beat;

/// What rank 0 calls the others to; the mesh comes from it, too.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) enum Call {
    /// A beat of the ventricle that a file is about.
    Beat(Box<OrganBeatSpec>, Box<About>),
    /// Fibres and activation times.
    Tissue,
    /// Unloading and fit of a passive law.
    PassiveState(Box<PassiveOrder>),
}

/// A group of ranks.
#[derive(Debug, Clone)]
pub struct Team {
    comm: Arc<dyn Communicator>,
    amid: Arc<AtomicBool>,
}

/// Work that all ranks share. When it is dropped, other than by a panic, the others wait for the next.
#[derive(Debug)]
pub(crate) struct Session(Arc<AtomicBool>);

impl Session {
    /// The ranks did not come together: the others cannot be reached any more.
    pub fn lose(self) {
        std::mem::forget(self);
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.0.store(false, Ordering::Relaxed);
        }
    }
}

impl Team {
    /// The ranks that `comm` joins.
    #[must_use]
    pub fn new(comm: Arc<dyn Communicator>) -> Self {
        Self {
            comm,
            amid: Arc::default(),
        }
    }

    /// Ranks.
    #[must_use]
    pub fn n_ranks(&self) -> usize {
        self.comm.n_ranks()
    }

    /// The communicator, for several owners.
    #[must_use]
    pub fn shared_comm(&self) -> Arc<dyn Communicator> {
        Arc::clone(&self.comm)
    }

    /// The ranks' communicator.
    #[must_use]
    pub fn comm(&self) -> Box<dyn Communicator> {
        Box::new(Arc::clone(&self.comm))
    }

    /// Whether rank 0 left the others amid their work: they wait for something that does not come, and whoever launched the
    /// ranks has to end them.
    #[must_use]
    pub fn is_amid(&self) -> bool {
        self.amid.load(Ordering::Relaxed)
    }

    /// Calls the other ranks; for rank 0.
    pub(crate) fn begin(&self, call: &Call) -> Session {
        let words = serde_json::to_vec(call).expect("a call is JSON");
        self.amid.store(true, Ordering::Relaxed);
        self.comm.order(&mut [words.len() as f64]);
        let mut words: Vec<f64> = words.into_iter().map(f64::from).collect();
        self.comm.broadcast(&mut words);
        Session(Arc::clone(&self.amid))
    }

    /// Lets the other ranks go; for rank 0, which is not amid shared work.
    pub fn dismiss(&self) {
        self.comm.order(&mut [0.0]);
    }

    /// Helps until rank 0 lets go; for the other ranks.
    ///
    /// # Errors
    /// [`TaskError`] of this rank: whoever launched the ranks has to end all.
    pub fn follow(&self) -> Result<(), TaskError> {
        loop {
            let mut length = [0.0];
            self.comm.order(&mut length);
            if length[0] == 0.0 {
                return Ok(());
            }
            let mut words = vec![0.0; length[0] as usize];
            self.comm.broadcast(&mut words);
            let words: Vec<u8> = words.into_iter().map(|word| word as u8).collect();
            match serde_json::from_slice(&words).expect("rank 0 sends a call") {
                Call::Beat(spec, about) => organ_beat::serve(&spec, &about, self)?,
                Call::Tissue => tissue::serve(self),
                Call::PassiveState(order) => passive::serve(&order, self),
            }
        }
    }
}

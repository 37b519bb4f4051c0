//! Teams of ranks in several processes. Rank 0 executes the task as it would alone; the other ranks
//! take part in step 0 and in 3D beats when rank 0 calls them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cardiotwin_linalg::parallel::Communicator;
use cardiotwin_protocol::process;

use crate::call::Call;

/// A group of ranks.
#[derive(Debug, Clone)]
pub struct Team {
    comm: Arc<dyn Communicator>,
    amid: Arc<AtomicBool>,
    nodes: Arc<Vec<String>>,
}

/// Work in which all ranks take part. Unless a panic drops it, the other ranks wait for the next
/// call once it is dropped.
#[derive(Debug)]
pub(crate) struct Session(Arc<AtomicBool>);

impl Session {
    /// Gives up the other ranks after a failure to start the shared work, because they cannot be
    /// reached any more.
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
    /// The ranks that `comm` connects.
    #[must_use]
    pub fn new(comm: Arc<dyn Communicator>) -> Self {
        Self {
            comm,
            amid: Arc::default(),
            nodes: Arc::default(),
        }
    }

    /// Tells rank 0 the names of the nodes on which the ranks are. All ranks call this.
    #[must_use]
    pub fn that_knows_its_nodes(self) -> Self {
        let mut nodes = gather_texts(self.comm.as_ref(), &process::node()).unwrap_or_default();
        nodes.dedup();
        Self {
            nodes: Arc::new(nodes),
            ..self
        }
    }

    /// Names of the nodes on which the ranks are, rank 0's first; empty if they were not asked.
    #[must_use]
    pub fn nodes(&self) -> &[String] {
        &self.nodes
    }

    /// Number of ranks in the team, rank 0 included.
    #[must_use]
    pub fn n_ranks(&self) -> usize {
        self.comm.n_ranks()
    }

    /// Communicator of the ranks, for shared ownership.
    #[must_use]
    pub fn shared_comm(&self) -> Arc<dyn Communicator> {
        Arc::clone(&self.comm)
    }

    /// Communicator of the ranks, for a solver that owns it.
    #[must_use]
    pub fn comm(&self) -> Box<dyn Communicator> {
        Box::new(Arc::clone(&self.comm))
    }

    /// Whether rank 0 left its work before the end. The other ranks then wait for messages that
    /// will not come, and the launcher has to end them.
    #[must_use]
    pub fn is_amid(&self) -> bool {
        self.amid.load(Ordering::Relaxed)
    }

    /// Sends a call to the other ranks. Only rank 0 calls this.
    pub(crate) fn begin(&self, call: &Call) -> Session {
        let words = serde_json::to_vec(call).expect("a call is JSON");
        self.amid.store(true, Ordering::Relaxed);
        self.comm.order(&mut [words.len() as f64]);
        let mut words: Vec<f64> = words.into_iter().map(f64::from).collect();
        self.comm.broadcast(&mut words);
        Session(Arc::clone(&self.amid))
    }

    /// Ends [`Self::follow`] on the other ranks. Only rank 0 calls this, while no work is shared.
    pub fn dismiss(&self) {
        self.comm.order(&mut [0.0]);
    }

    /// Next call of rank 0; `None` if rank 0 dismisses the team. All other ranks call this.
    pub(crate) fn next_call(&self) -> Option<Call> {
        let mut length = [0.0];
        self.comm.order(&mut length);
        if length[0] == 0.0 {
            return None;
        }
        let mut words = vec![0.0; length[0] as usize];
        self.comm.broadcast(&mut words);
        let words: Vec<u8> = words.into_iter().map(|word| word as u8).collect();
        Some(serde_json::from_slice(&words).expect("rank 0 sends a call"))
    }
}

/// Texts of all ranks, in their order, on rank 0; `None` on the others. All ranks call this.
pub fn gather_texts(comm: &dyn Communicator, text: &str) -> Option<Vec<String>> {
    let bytes: Vec<f64> = text.bytes().map(f64::from).collect();
    let texts = comm.gather(&bytes)?.into_iter().map(|bytes| {
        let bytes: Vec<u8> = bytes.into_iter().map(|byte| byte as u8).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    });
    Some(texts.collect())
}

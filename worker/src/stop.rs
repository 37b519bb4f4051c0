//! Requests to stop by SIGTERM, SIGINT or SIGUSR2. Tasks check for them where they can interrupt their work.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Flag that asks a task to stop, or to write a checkpoint.
#[derive(Debug, Clone, Default)]
pub struct StopFlag {
    stop: Arc<AtomicBool>,
    checkpoint: Arc<AtomicBool>,
}

impl StopFlag {
    /// A flag that SIGTERM, SIGINT and SIGUSR2 raise instead of killing the process. SIGUSR1
    /// requests a checkpoint.
    ///
    /// Launchers of MPI pass SIGUSR2 on to the ranks, whereas SIGTERM makes them kill the ranks.
    ///
    /// # Errors
    /// When the kernel refuses the signal handler.
    pub fn on_signals() -> std::io::Result<Self> {
        let flag = Self::default();
        use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
        for signal in [SIGTERM, SIGINT, SIGUSR2] {
            signal_hook::flag::register(signal, Arc::clone(&flag.stop))?;
        }
        signal_hook::flag::register(SIGUSR1, Arc::clone(&flag.checkpoint))?;
        Ok(flag)
    }

    /// Requests a stop as SIGTERM does.
    pub fn raise(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Whether a stop was requested.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Whether a checkpoint was requested since the last call.
    #[must_use]
    pub fn take_checkpoint(&self) -> bool {
        self.checkpoint.swap(false, Ordering::Relaxed)
    }
}

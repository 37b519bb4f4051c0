//! Threads of batches.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error;

/// The last pool with the process and the number of threads that it was made for. A process that
/// Python forked has none of its parent's threads and needs a pool of its own.
static POOL: Mutex<Option<(u32, usize, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs `work` outside of Python's lock, on `threads` threads (0: one for each core) or, with one
/// thread, on the calling one.
///
/// # Errors
/// `ModelError` when the threads cannot be started.
pub fn run<R: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce() -> R + Send,
) -> PyResult<R> {
    if threads == 1 {
        return Ok(py.detach(work));
    }
    let pool = pool(threads)?;
    Ok(py.detach(|| pool.install(work)))
}

fn pool(threads: usize) -> PyResult<Arc<ThreadPool>> {
    let process = std::process::id();
    let mut last = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((of, n, pool)) = &*last
        && (*of, *n) == (process, threads)
    {
        return Ok(Arc::clone(pool));
    }
    let made = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|source| error::model(&source))?;
    let made = Arc::new(made);
    if let Some((of, _, pool)) = last.replace((process, threads, Arc::clone(&made)))
        && of != process
    {
        // Its threads stayed in the parent: nobody could wait for their end.
        std::mem::forget(pool);
    }
    Ok(made)
}

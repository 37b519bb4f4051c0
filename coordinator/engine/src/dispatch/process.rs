//! Signals to workers, and the identity of this process.

pub use cardiotwin_protocol::process::lives_here;
use cardiotwin_protocol::process::start_ticks;
use cardiotwin_schemas::progress::Claim;
use rustix::process::{Pid, Signal};

/// Id of the user as whom this process runs and submits jobs.
pub fn own_uid() -> u32 {
    rustix::process::getuid().as_raw()
}

/// The claim of this process.
pub fn claim_of_this_process() -> Claim {
    cardiotwin_protocol::process::claim_of_this_process(cardiotwin_store::clock::now_utc())
}

/// Signals a worker and its process group. A worker leads a group of its own, or, as an MPI rank,
/// may be in its launcher's group.
pub fn signal_group(pid: u32, start: u64, signal: Signal) {
    let by_force = signal == Signal::KILL;
    let Some(pid) = living(pid, start) else {
        return;
    };
    // A process that ends in between has done what the signal asks for.
    let _ = match rustix::process::getpgid(Some(pid)) {
        Ok(group) if group == pid => rustix::process::kill_process_group(pid, signal),
        // A request goes to the process alone, which ends its own children. Our own group is never
        // signalled.
        Ok(group) if by_force && group != rustix::process::getpgrp() => {
            rustix::process::kill_process_group(group, signal)
        }
        _ => rustix::process::kill_process(pid, signal),
    };
}

/// Signals one process, such as a launcher.
pub fn signal_process(pid: u32, start: u64, signal: Signal) {
    if let Some(pid) = living(pid, start) {
        let _ = rustix::process::kill_process(pid, signal);
    }
}

/// Id of a process; `None` if it is gone or its id was given to another one.
fn living(pid: u32, start: u64) -> Option<Pid> {
    (start_ticks(pid) == Some(start))
        .then(|| i32::try_from(pid).ok().and_then(Pid::from_raw))
        .flatten()
}

//! Signals to workers, and who we are to the system.

pub use cardiotwin_protocol::process::lives_here;
use cardiotwin_protocol::process::start_ticks;
use cardiotwin_schemas::progress::Claim;
use rustix::process::{Pid, Signal};

/// The user as whom we run, and so submit.
pub fn own_uid() -> u32 {
    rustix::process::getuid().as_raw()
}

/// The claim of this process.
pub fn claim_of_this_process() -> Claim {
    cardiotwin_protocol::process::claim_of_this_process(crate::clock::now_utc())
}

/// Signals a worker and all of its process group: each worker leads one, or, as an MPI rank, may be in its launcher's.
pub fn signal_group(pid: u32, start: u64, by_force: bool) {
    if start_ticks(pid) != Some(start) {
        return; // gone, or its number was given to another
    }
    let signal = if by_force { Signal::KILL } else { Signal::TERM };
    let Some(pid) = i32::try_from(pid).ok().and_then(Pid::from_raw) else {
        return;
    };
    // A process that ends in between is what was wanted.
    let _ = match rustix::process::getpgid(Some(pid)) {
        Ok(group) if group == pid => rustix::process::kill_process_group(pid, signal),
        // Kindly, it alone: it ends what belongs to it. Never our own group.
        Ok(group) if by_force && group != rustix::process::getpgrp() => {
            rustix::process::kill_process_group(group, signal)
        }
        _ => rustix::process::kill_process(pid, signal),
    };
}

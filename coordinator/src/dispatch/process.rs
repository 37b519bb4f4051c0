//! Processes by their identity: a pid means nothing without its start time and the host's boot.

use std::sync::OnceLock;

use cardiotwin_schemas::progress::Claim;
use rustix::process::{Pid, Signal};

/// This host's name.
pub fn host() -> &'static str {
    static HOST: OnceLock<String> = OnceLock::new();
    HOST.get_or_init(|| {
        rustix::system::uname()
            .nodename()
            .to_string_lossy()
            .into_owned()
    })
}

/// Identity of this host's present life; empty where the system does not tell.
pub fn boot_id() -> &'static str {
    static BOOT: OnceLock<String> = OnceLock::new();
    BOOT.get_or_init(|| {
        std::fs::read_to_string("/proc/sys/kernel/random/boot_id")
            .unwrap_or_default()
            .trim()
            .to_owned()
    })
}

/// Start time in clock ticks since boot of a living process; none when it is gone or only waits to be reaped.
pub fn start_ticks(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the command in parentheses and may hold blanks; state is field 3, start time field 22.
    let mut fields = stat[stat.rfind(')')? + 1..].split_ascii_whitespace();
    let state = fields.next()?;
    if matches!(state, "Z" | "X" | "x") {
        return None;
    }
    fields.nth(18)?.parse().ok()
}

/// As whom we run, and so submit.
pub fn own_uid() -> u32 {
    rustix::process::getuid().as_raw()
}

/// This process's claim.
pub fn claim_of_this_process() -> Claim {
    let pid = std::process::id();
    Claim {
        host: host().into(),
        boot_id: boot_id().into(),
        pid,
        pid_start_ticks: start_ticks(pid).unwrap_or_default(),
        at: crate::clock::now_utc(),
    }
}

/// Whether the process that made a claim on this host lives.
pub fn lives(claim: &Claim) -> bool {
    claim.boot_id == boot_id() && start_ticks(claim.pid) == Some(claim.pid_start_ticks)
}

/// Whether the process that made a claim lives; `None` where it was made on another host, or before a reboot of one
/// that cannot be told from another.
pub fn lives_here(claim: &Claim) -> Option<bool> {
    (claim.host == host() && !boot_id().is_empty()).then(|| lives(claim))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_known_by_pid_and_start_and_a_zombie_is_dead() {
        let mut child = std::process::Command::new("sleep")
            .arg("60")
            .spawn()
            .unwrap();
        let start = start_ticks(child.id()).unwrap();
        let claim = |pid_start_ticks| Claim {
            host: host().into(),
            boot_id: boot_id().into(),
            pid: child.id(),
            pid_start_ticks,
            at: String::new(),
        };
        assert!(lives(&claim(start)));
        assert!(
            !lives(&claim(start + 1)),
            "another process with the same number"
        );
        assert!(!lives(&Claim {
            boot_id: "another life".into(),
            ..claim(start)
        }));
        let claim = claim(start);
        child.kill().unwrap();
        // Not reaped yet: a zombie for the kernel, dead for us as soon as the signal arrived.
        while lives(&claim) {
            std::thread::yield_now();
        }
        child.wait().unwrap();
    }
}

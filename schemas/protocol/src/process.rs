//! Identity of processes. A pid is unique only together with the start time of its process and the
//! boot of its host.

use std::fs;
use std::sync::OnceLock;

use cardiotwin_schemas::progress::Claim;

/// Name of this host.
#[must_use]
pub fn host() -> &'static str {
    static HOST: OnceLock<String> = OnceLock::new();
    HOST.get_or_init(|| {
        rustix::system::uname()
            .nodename()
            .to_string_lossy()
            .into_owned()
    })
}

/// Name of this node of a cluster; outside of a cluster the name of the host.
#[must_use]
pub fn node() -> String {
    std::env::var("SLURMD_NODENAME").unwrap_or_else(|_| host().to_owned())
}

/// Identity of this host's present boot; empty if the system does not provide one.
#[must_use]
pub fn boot_id() -> &'static str {
    static BOOT: OnceLock<String> = OnceLock::new();
    BOOT.get_or_init(|| {
        fs::read_to_string("/proc/sys/kernel/random/boot_id")
            .unwrap_or_default()
            .trim()
            .to_owned()
    })
}

/// Fields of `/proc/PID/stat` after the command's name, which may contain spaces and brackets. The
/// first field is the state.
#[must_use]
pub fn stat_fields(stat: &str) -> Vec<&str> {
    stat.rsplit_once(')')
        .map(|(_, rest)| rest.split_ascii_whitespace().collect())
        .unwrap_or_default()
}

/// Start time of a living process in clock ticks since boot (field 22 of its stat file); `None` if
/// the process has ended or is a zombie.
#[must_use]
pub fn start_ticks(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let fields = stat_fields(&stat);
    if matches!(fields.first(), Some(&"Z" | &"X" | &"x")) {
        return None;
    }
    fields.get(19)?.parse().ok()
}

/// The claim of this process.
///
/// - `at`: the present time, UTC, RFC 3339
#[must_use]
pub fn claim_of_this_process(at: String) -> Claim {
    let pid = std::process::id();
    Claim {
        host: host().into(),
        boot_id: boot_id().into(),
        pid,
        pid_start_ticks: start_ticks(pid).unwrap_or_default(),
        at,
        nodes: Vec::new(),
    }
}

/// Whether the process that made a claim on this host is alive.
#[must_use]
pub fn lives(claim: &Claim) -> bool {
    claim.boot_id == boot_id() && start_ticks(claim.pid) == Some(claim.pid_start_ticks)
}

/// Whether the process that made a claim is alive; `None` if the claim was made on another host or
/// if this host provides no boot identity.
#[must_use]
pub fn lives_here(claim: &Claim) -> Option<bool> {
    (claim.host == host() && !boot_id().is_empty()).then(|| lives(claim))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_with_brackets_and_spaces_does_not_shift_the_fields() {
        let fields = stat_fields("12 (a) b) c) S 1 2 3");
        assert_eq!(fields, ["S", "1", "2", "3"]);
    }

    #[test]
    fn a_process_is_known_by_pid_and_start_and_a_zombie_is_dead() {
        assert_eq!(start_ticks(u32::MAX), None);
        assert_eq!(boot_id().len(), 36);
        let mut child = std::process::Command::new("sleep")
            .arg("60")
            .spawn()
            .unwrap();
        let start = start_ticks(child.id()).unwrap();
        let claim = |pid_start_ticks| Claim {
            pid: child.id(),
            pid_start_ticks,
            ..claim_of_this_process(String::new())
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
        // The child has not been reaped yet: it is a zombie for the kernel, but counts as dead as
        // soon as the signal has arrived.
        while lives(&claim) {
            std::thread::yield_now();
        }
        child.wait().unwrap();
    }
}

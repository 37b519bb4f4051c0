//! What the kernel says of this process and of others, from `/proc`.

use std::fs;
use std::path::Path;

/// Clock ticks a second in `/proc/PID/stat`: fixed in Linux's interface to user space on every platform we build for.
const TICKS_PER_SECOND: f64 = 100.0;

/// Host name; empty where the kernel does not tell.
#[must_use]
pub fn host() -> String {
    line("/proc/sys/kernel/hostname")
}

/// Identity of the host's present boot.
#[must_use]
pub fn boot_id() -> String {
    line("/proc/sys/kernel/random/boot_id")
}

fn line(path: &str) -> String {
    fs::read_to_string(path)
        .unwrap_or_default()
        .trim()
        .to_owned()
}

/// Fields of `/proc/PID/stat` after the command's name, which may itself hold spaces and brackets; state comes first.
fn stat_fields(stat: &str) -> Vec<&str> {
    stat.rsplit_once(')')
        .map(|(_, rest)| rest.split_ascii_whitespace().collect())
        .unwrap_or_default()
}

/// Start time of a process in clock ticks since boot (field 22 of its stat file), if it exists and is not a zombie.
#[must_use]
pub fn start_ticks(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(Path::new("/proc").join(pid.to_string()).join("stat")).ok()?;
    let fields = stat_fields(&stat);
    if matches!(fields.first(), Some(&"Z" | &"X")) {
        return None;
    }
    fields.get(19)?.parse().ok()
}

/// Processor time of this process so far, user and system, all threads, in seconds (resolution 10 ms).
#[must_use]
pub fn cpu_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat_fields(&stat);
    let ticks = |idx: usize| {
        fields
            .get(idx)
            .and_then(|text| text.parse::<f64>().ok())
            .unwrap_or(0.0)
    };
    (ticks(11) + ticks(12)) / TICKS_PER_SECOND
}

/// Largest resident set of this process so far, in MB (1e6 bytes).
#[must_use]
pub fn peak_memory_mb() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|text| text.split_ascii_whitespace().next()?.parse::<f64>().ok());
    kib.unwrap_or(0.0) * 1024.0 / 1e6
}

/// Makes [`peak_memory_mb`] count anew, where the kernel lets this process.
pub fn forget_peak_memory() {
    // "5" resets the high-water mark (proc(5), clear_refs); where that is refused the mark stays.
    let _ = fs::write("/proc/self/clear_refs", "5");
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
    fn this_process_lives_and_uses_memory() {
        assert!(start_ticks(std::process::id()).is_some());
        assert_eq!(start_ticks(u32::MAX), None);
        assert!(peak_memory_mb() > 0.5);
        assert_eq!(boot_id().len(), 36);
    }
}

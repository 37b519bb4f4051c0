//! Processor time and memory of this process, from `/proc`.

use std::fs;

use cardiotwin_protocol::process::stat_fields;

/// Clock ticks per second in `/proc/PID/stat`. Linux fixes this number in its user-space interface
/// on every platform that we build for.
const TICKS_PER_SECOND: f64 = 100.0;

/// Processor time of this process so far, summed over all threads, user and system \[s\]. The
/// resolution is 10 ms.
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

/// Largest resident set of this process so far \[MB\] (1e6 bytes).
#[must_use]
pub fn peak_memory_mb() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|text| text.split_ascii_whitespace().next()?.parse::<f64>().ok());
    kib.unwrap_or(0.0) * 1024.0 / 1e6
}

/// Restarts the measurement of [`peak_memory_mb`], if the kernel permits it.
pub fn forget_peak_memory() {
    // "5" resets the high-water mark (proc(5), clear_refs). If the kernel refuses, the old mark
    // stays.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_uses_memory() {
        assert!(peak_memory_mb() > 0.5);
    }
}

//! Checks of the machine: processor, memory, compilers.

use std::path::Path;

use cardiotwin_engine::first_line;

use super::finding::{Finding, Level};

/// Memory that is ample for a beat on the default mesh and the coordinator next to it, MB.
const ENOUGH_MEMORY_MB: f64 = 500.0;

/// Checks processor, memory and compilers.
pub fn look() -> Vec<Finding> {
    vec![processor(), memory(), compilers()]
}

fn processor() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let value = |key: &str| {
        let line = info.lines().find(|line| line.starts_with(key))?;
        line.split_once(':')
            .map(|(_, value)| value.trim().to_owned())
    };
    let model = value("model name").unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    let flags = value("flags").unwrap_or_default();
    let has = |flag: &str| flags.split(' ').any(|found| found == flag);
    let best = match () {
        () if has("avx512f") => "avx512",
        () if has("avx2") && has("fma") => "avx2",
        () => "portable",
    };
    let found = format!("{model}, usable cores: {cores}, cell engine: {best}");
    match best {
        "portable" => Finding::bad(
            "processor",
            Level::Warning,
            found,
            "step 2 and sweeps are 2 to 3 times slower without AVX2",
        ),
        _ => Finding::ok("processor", found),
    }
}

fn memory() -> Finding {
    let info = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let kib = |key: &str| {
        let line = info.lines().find(|line| line.starts_with(key))?;
        line.split_ascii_whitespace().nth(1)?.parse::<f64>().ok()
    };
    let Some((total, free)) = kib("MemTotal:").zip(kib("MemAvailable:")) else {
        return Finding::bad(
            "memory",
            Level::Note,
            "this system does not report its memory",
            "",
        );
    };
    let (total, free) = (1.024e-3 * total, 1.024e-3 * free);
    let found = format!("{:.1} GB, {:.1} GB available", 1e-3 * total, 1e-3 * free);
    match free < ENOUGH_MEMORY_MB {
        true => Finding::bad(
            "memory",
            Level::Warning,
            found,
            "set executor.workers to 1, or use a smaller mesh",
        ),
        false => Finding::ok("memory", found),
    }
}

/// Compilers are needed only to build from source.
fn compilers() -> Finding {
    let found: Vec<String> = ["cc", "cargo", "mpicc"]
        .iter()
        .filter_map(|name| first_line(name, &["--version"]))
        .collect();
    let wanted = Path::new("Cargo.toml").exists();
    match (found.is_empty(), wanted) {
        (false, _) => Finding::ok("compilers", found.join("; ")),
        (true, false) => Finding::bad(
            "compilers",
            Level::Note,
            "none",
            "only needed to build from source",
        ),
        (true, true) => Finding::bad(
            "compilers",
            Level::Warning,
            "none",
            "`make deps` installs the build dependencies",
        ),
    }
}

//! Arguments of the examples' commands, `--name value`.

/// Names and values of a command's arguments.
///
/// - `arguments`: those that are left of the command line
pub fn pairs(
    mut arguments: impl Iterator<Item = String>,
) -> impl Iterator<Item = Result<(String, String), String>> {
    std::iter::from_fn(move || {
        let flag = arguments.next()?;
        let value = arguments.next().ok_or(format!("{flag} needs a value"));
        Some(value.map(|value| (flag, value)))
    })
}

/// The value of an argument that counts something.
pub fn number(flag: &str, value: &str) -> Result<usize, String> {
    value.parse().map_err(|e| format!("{flag} {value}: {e}"))
}

/// Limits the threads of this process.
pub fn limit_threads(jobs: usize) -> Result<(), String> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .build_global()
        .map_err(|e| e.to_string())
}

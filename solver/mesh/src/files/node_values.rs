//! Files with one number per node on each line, such as activation times \[ms\] in CARP's `.dat`.
//! Lines that begin with `#` are comments.

use super::error::{MeshFileError, read_text, write_bytes};
use super::text::Lines;
use std::fmt::Write as _;
use std::path::Path;

/// Reads one finite number for each of `n_nodes` nodes, in the order of the nodes.
///
/// # Errors
/// [`MeshFileError`] with file and line, also if the number of values differs from `n_nodes`.
pub fn read(file: &Path, n_nodes: usize) -> Result<Vec<f64>, MeshFileError> {
    parse(&read_text(file)?, file, n_nodes)
}

/// [`read`] from the content of a file.
///
/// # Errors
/// Same as for [`read`].
pub fn parse(text: &str, file: &Path, n_nodes: usize) -> Result<Vec<f64>, MeshFileError> {
    let mut lines = Lines::new(text, file);
    let mut values = Vec::with_capacity(n_nodes);
    while let Some(line) = lines.next() {
        if line.text.starts_with('#') {
            continue;
        }
        if values.len() == n_nodes {
            return Err(line.error(format!(
                "the end of the file after {n_nodes} numbers, one for each node"
            )));
        }
        let [value] = line.floats("one number for each node")?;
        values.push(value);
    }
    if values.len() < n_nodes {
        return Err(MeshFileError::content(
            file,
            format!("{} numbers", values.len()),
            format!("{n_nodes}, one for each node"),
        ));
    }
    Ok(values)
}

/// Writes a comment that names the values, then one value per line.
///
/// # Errors
/// [`MeshFileError::Write`] if the file cannot be written.
pub fn write(file: &Path, comment: &str, values: &[f64]) -> Result<(), MeshFileError> {
    let mut text = format!("# {comment}\n");
    for value in values {
        let _ = writeln!(text, "{value}");
    }
    write_bytes(file, text.as_bytes())
}

//! `nodal.csv`: active stress, calcium and stretch of every node of a simulated organ over its last beat.
//!
//! Wide: one row a time, a column a node and quantity. Two comments before the header hold each node's activation time
//! and its weight in medians:
//!
//! ```text
//! # activation_ms: 12.5,15.2
//! # weight: 0.5,0.5
//! time_ms,Sa_kPa[1],Sa_kPa[2],Ca_uM[1],Ca_uM[2],lambda[1],lambda[2]
//! 0,0,0,0.15,0.15,1,1
//! ```
//! A contraction model without calcium has no `Ca_uM` columns.

use std::fmt::Write as _;
use std::io;

use cardiotwin_models::beat::{BeatTraces, NodalTraces};

/// Times and nodal traces of a beat, and whether calcium is among them.
#[derive(Debug, Clone, PartialEq)]
pub struct NodalBeat {
    /// The beat, of which only times and nodes are filled.
    pub beat: BeatTraces,
    /// Whether the file has calcium; the traces hold zeros otherwise.
    pub has_calcium: bool,
}

/// Why a file is not one of nodal traces.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NodalError {
    /// No activation times in the first line.
    #[error("line 1 must be `# activation_ms: …` with one time a node, but is `{found}`")]
    Activation {
        /// The line's beginning.
        found: String,
    },
    /// No weights in the second line, or not one a node.
    #[error("line 2 must be `# weight: …` with {n_nodes} numbers, but is `{found}`")]
    Weight {
        /// Nodes by the first line.
        n_nodes: usize,
        /// The line's beginning.
        found: String,
    },
    /// Other columns than those of so many nodes.
    #[error("line 3 must name the columns of {n_nodes} nodes, but is `{found}`")]
    Header {
        /// Nodes by the first line.
        n_nodes: usize,
        /// The line's beginning.
        found: String,
    },
    /// A row of other length, or with something that is not a finite number.
    #[error("line {line}: expected {n_columns} finite numbers")]
    Row {
        /// Line, from 1.
        line: usize,
        /// Columns by the header.
        n_columns: usize,
    },
    /// Too few rows, or times that do not increase.
    #[error("the traces need at least three rows of increasing time, but line {line} breaks this")]
    Time {
        /// Line, from 1.
        line: usize,
    },
}

/// The file's text.
#[must_use]
pub fn to_csv(time_ms: &[f64], nodes: &NodalTraces, with_calcium: bool) -> String {
    let n = nodes.n_nodes;
    let row = |k: usize| {
        let of = |values: &[f64]| values[k * n..(k + 1) * n].to_vec();
        let calcium = if with_calcium { of(&nodes.ca_um) } else { vec![] };
        Ok([of(&nodes.sa_kpa), calcium, of(&nodes.lambda)].concat())
    };
    let mut text = Vec::with_capacity((time_ms.len() + 2) * (n * columns(with_calcium).len() + 1) * 12);
    write_csv(&mut text, time_ms, [&nodes.activation_ms, &nodes.weights], with_calcium, row)
        .expect("memory takes what is written");
    String::from_utf8(text).expect("numbers are UTF-8")
}

/// Writes the file. Nine significant digits: far below every tolerance of what is made from it.
///
/// - `activation_and_weight`: one number a node each
/// - `row`: active stress, calcium where there is any and stretch of all nodes at a sample
///
/// # Errors
/// Those of `row` and of writing.
pub fn write_csv(
    out: &mut impl io::Write,
    time_ms: &[f64],
    activation_and_weight: [&[f64]; 2],
    with_calcium: bool,
    mut row: impl FnMut(usize) -> io::Result<Vec<f64>>,
) -> io::Result<()> {
    for (name, values) in ["activation_ms", "weight"].into_iter().zip(activation_and_weight) {
        let values: Vec<String> = values.iter().map(|value| number(*value)).collect();
        writeln!(out, "# {name}: {}", values.join(","))?;
    }
    writeln!(out, "{}", header(activation_and_weight[0].len(), with_calcium))?;
    for (k, time) in time_ms.iter().enumerate() {
        out.write_all(number(*time).as_bytes())?;
        for value in row(k)? {
            out.write_all(b",")?;
            out.write_all(number(value).as_bytes())?;
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

fn columns(with_calcium: bool) -> &'static [&'static str] {
    if with_calcium { &["Sa_kPa", "Ca_uM", "lambda"] } else { &["Sa_kPa", "lambda"] }
}

fn header(n_nodes: usize, with_calcium: bool) -> String {
    let mut header = "time_ms".to_owned();
    for name in columns(with_calcium) {
        for node in 1..=n_nodes {
            let _ = write!(header, ",{name}[{node}]");
        }
    }
    header
}

/// Reads what [`to_csv`] wrote.
///
/// # Errors
/// [`NodalError`] with the line that is not as it must be.
pub fn from_csv(text: &str) -> Result<NodalBeat, NodalError> {
    let mut lines = text.lines();
    let first = lines.next().unwrap_or_default();
    let activation: Option<Vec<f64>> = first.strip_prefix("# activation_ms: ").and_then(numbers);
    let activation_ms = activation.ok_or_else(|| NodalError::Activation { found: beginning(first) })?;
    let n_nodes = activation_ms.len();
    let second = lines.next().unwrap_or_default();
    let weights = second.strip_prefix("# weight: ").and_then(numbers).filter(|weights| weights.len() == n_nodes);
    let weights = weights.ok_or_else(|| NodalError::Weight { n_nodes, found: beginning(second) })?;
    let third = lines.next().unwrap_or_default();
    let with_calcium = [false, true].into_iter().find(|with_calcium| third == header(n_nodes, *with_calcium));
    let has_calcium = with_calcium.ok_or_else(|| NodalError::Header { n_nodes, found: beginning(third) })?;

    let mut nodes = NodalTraces { n_nodes, activation_ms, weights, ..NodalTraces::default() };
    let mut time_ms: Vec<f64> = Vec::new();
    let n_columns = 1 + n_nodes * columns(has_calcium).len();
    for (row, text) in lines.enumerate() {
        let line = row + 4;
        let values = numbers(text).filter(|values| values.len() == n_columns);
        let values = values.ok_or(NodalError::Row { line, n_columns })?;
        if time_ms.last().is_some_and(|last| *last >= values[0]) {
            return Err(NodalError::Time { line });
        }
        time_ms.push(values[0]);
        let mut parts = values[1..].chunks_exact(n_nodes);
        nodes.sa_kpa.extend_from_slice(parts.next().unwrap_or_default());
        if has_calcium {
            nodes.ca_um.extend_from_slice(parts.next().unwrap_or_default());
        }
        nodes.lambda.extend_from_slice(parts.next().unwrap_or_default());
    }
    if time_ms.len() < 3 {
        return Err(NodalError::Time { line: time_ms.len() + 4 });
    }
    if !has_calcium {
        nodes.ca_um = vec![0.0; nodes.sa_kpa.len()];
    }
    Ok(NodalBeat { beat: BeatTraces { time_ms, nodes: Some(nodes), ..BeatTraces::default() }, has_calcium })
}

/// A number in nine significant digits, without zeros that say nothing.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".to_owned() } else { value.to_string() };
    }
    let digits = (8 - value.abs().log10().floor() as i64).clamp(0, 17) as usize;
    let text = format!("{value:.digits$}");
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn numbers(line: &str) -> Option<Vec<f64>> {
    line.split(',').map(|text| text.parse().ok().filter(|value: &f64| value.is_finite())).collect()
}

fn beginning(line: &str) -> String {
    line.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIME_MS: [f64; 3] = [0.0, 1.0, 2.5];

    fn nodes() -> NodalTraces {
        NodalTraces {
            n_nodes: 2,
            activation_ms: vec![12.5, 15.25],
            weights: vec![0.25, 0.75],
            sa_kpa: vec![0.0, 1.234_567_89, -2.5e-6, 0.0, 100.0, 3.0],
            ca_um: vec![0.0; 6],
            lambda: vec![1.0, 0.987_654_321, 0.9, 1.0, 1.0, 1.0],
        }
    }

    fn read(text: &str) -> Result<(Vec<f64>, NodalTraces, bool), NodalError> {
        from_csv(text).map(|read| (read.beat.time_ms, read.beat.nodes.unwrap(), read.has_calcium))
    }

    #[test]
    fn traces_survive_the_file_with_and_without_calcium() {
        let mut nodes = nodes();
        assert_eq!(read(&to_csv(&TIME_MS, &nodes, false)), Ok((TIME_MS.to_vec(), nodes.clone(), false)));
        nodes.ca_um = vec![0.15, 0.15, 0.6, 0.5, 0.2, 0.3];
        let text = to_csv(&TIME_MS, &nodes, true);
        assert!(
            text.starts_with("# activation_ms: 12.5,15.25\n# weight: 0.25,0.75\ntime_ms,Sa_kPa[1],Sa_kPa[2],Ca_uM[1]")
        );
        assert_eq!(read(&text), Ok((TIME_MS.to_vec(), nodes, true)));
    }

    #[test]
    fn numbers_keep_nine_digits() {
        let cases =
            [(0.0, "0"), (1.0, "1"), (-0.15, "-0.15"), (123_456.789_012_3, "123456.789"), (1e10, "10000000000")];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
        assert_eq!(number(1.0 / 3.0), "0.333333333");
        assert_eq!(number(2e-7 / 3.0), "0.0000000666666667");
    }

    #[test]
    fn a_damaged_file_is_refused_with_its_line() {
        let text = to_csv(&TIME_MS, &nodes(), false);
        assert!(matches!(read("time_ms\n"), Err(NodalError::Activation { .. })));
        let header = text.replace("lambda[2]", "lambda[3]");
        assert!(matches!(read(&header), Err(NodalError::Header { n_nodes: 2, .. })));
        let weight = text.replace(",0.75", "");
        assert!(matches!(read(&weight), Err(NodalError::Weight { n_nodes: 2, .. })));
        let row = text.replace("\n1,", "\n1,x");
        assert_eq!(read(&row), Err(NodalError::Row { line: 5, n_columns: 5 }));
        let time = text.replace("\n2.5,", "\n0.5,");
        assert_eq!(read(&time), Err(NodalError::Time { line: 6 }));
    }
}

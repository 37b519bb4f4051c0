//! `nodal.csv`: active stress, calcium and stretch of every node of a simulated organ over its last
//! beat.
//!
//! The table is wide: one row for each time, one column for each quantity and node. Two comments
//! before the header give the nodes' activation times and their weights in medians:
//!
//! ```text
//! # activation_ms: 12.5,15.2
//! # weight: 0.5,0.5
//! time_ms,Sa_kPa[1],Sa_kPa[2],Ca_uM[1],Ca_uM[2],lambda[1],lambda[2]
//! 0,0,0,0.15,0.15,1,1
//! ```
//! The `Ca_uM` columns are absent if the contraction model has no calcium.

use std::fmt::Write as _;
use std::io;

use cardiotwin_models::beat::NodalTraces;

/// Reasons why a file is not a file of nodal traces.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NodalError {
    /// The first line does not hold the activation times.
    #[error("line 1 must be `# activation_ms: …` with one time per node, but is `{found}`")]
    Activation {
        /// Beginning of the line.
        found: String,
    },
    /// The second line does not hold one weight for each node.
    #[error("line 2 must be `# weight: …` with {n_nodes} numbers, but is `{found}`")]
    Weight {
        /// Number of nodes according to the first line.
        n_nodes: usize,
        /// Beginning of the line.
        found: String,
    },
    /// The header does not name the columns of all nodes.
    #[error("line 3 must name the columns of {n_nodes} nodes, but is `{found}`")]
    Header {
        /// Number of nodes according to the first line.
        n_nodes: usize,
        /// Beginning of the line.
        found: String,
    },
    /// A row has the wrong length, or a value that is not a finite number.
    #[error("line {line}: expected {n_columns} finite numbers")]
    Row {
        /// Number of the line, from 1.
        line: usize,
        /// Number of columns according to the header.
        n_columns: usize,
    },
    /// There are fewer than three rows, or times do not increase.
    #[error(
        "expected at least three rows of increasing time, but the time in line {line} does not increase or a row is \
         missing"
    )]
    Time {
        /// Number of the line, from 1.
        line: usize,
    },
}

/// Text of the file.
#[must_use]
pub fn to_csv(time_ms: &[f64], nodes: &NodalTraces, with_calcium: bool) -> String {
    let n = nodes.n_nodes;
    let row = |k: usize| {
        let of = |values: &[f64]| values[k * n..(k + 1) * n].to_vec();
        let calcium = if with_calcium {
            of(&nodes.ca_um)
        } else {
            vec![]
        };
        Ok([of(&nodes.sa_kpa), calcium, of(&nodes.lambda)].concat())
    };
    let mut text =
        Vec::with_capacity((time_ms.len() + 2) * (n * columns(with_calcium).len() + 1) * 12);
    write_csv(
        &mut text,
        time_ms,
        [&nodes.activation_ms, &nodes.weights],
        with_calcium,
        row,
    )
    .expect("memory takes what is written");
    String::from_utf8(text).expect("numbers are UTF-8")
}

/// Writes the file with nine significant digits, which is far more accurate than the tolerance of
/// any result computed from it.
///
/// - `activation_and_weight`: activation time \[ms\] and weight, one value for each node
/// - `row`: active stress, calcium (if the model has it) and stretch of all nodes at a sample
///
/// # Errors
/// Errors of `row` and of the output.
pub fn write_csv(
    out: &mut impl io::Write,
    time_ms: &[f64],
    activation_and_weight: [&[f64]; 2],
    with_calcium: bool,
    mut row: impl FnMut(usize) -> io::Result<Vec<f64>>,
) -> io::Result<()> {
    for (name, values) in ["activation_ms", "weight"]
        .into_iter()
        .zip(activation_and_weight)
    {
        let values: Vec<String> = values.iter().map(|value| number(*value)).collect();
        writeln!(out, "# {name}: {}", values.join(","))?;
    }
    writeln!(
        out,
        "{}",
        header(activation_and_weight[0].len(), with_calcium)
    )?;
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
    if with_calcium {
        &["Sa_kPa", "Ca_uM", "lambda"]
    } else {
        &["Sa_kPa", "lambda"]
    }
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

/// Reader for the files of [`write_csv`], one row at a time.
#[derive(Debug)]
pub struct NodalRows<R> {
    from: R,
    text: Vec<u8>,
    /// Number of lines read so far.
    line: usize,
    last_ms: Option<f64>,
    /// Activation time of each node \[ms\].
    pub activation_ms: Vec<f64>,
    /// Weight of each node.
    pub weights: Vec<f64>,
    /// Whether the rows contain calcium.
    pub has_calcium: bool,
}

/// Reasons why nodal traces cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum NodalReadError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The content of the file is invalid.
    #[error(transparent)]
    Content(#[from] NodalError),
}

impl<R: io::BufRead> NodalRows<R> {
    /// Reads the three lines before the rows.
    ///
    /// # Errors
    /// [`NodalReadError`] with the first invalid line.
    pub fn begin(from: R) -> Result<Self, NodalReadError> {
        let (text, activation_ms, weights) = (vec![], vec![], vec![]);
        let mut rows = Self {
            from,
            text,
            line: 0,
            last_ms: None,
            activation_ms,
            weights,
            has_calcium: false,
        };
        let first = rows.next_line()?.unwrap_or_default();
        let activation: Option<Vec<f64>> =
            first.strip_prefix("# activation_ms: ").and_then(numbers);
        rows.activation_ms = activation.ok_or_else(|| NodalError::Activation {
            found: beginning(&first),
        })?;
        let n_nodes = rows.activation_ms.len();
        let second = rows.next_line()?.unwrap_or_default();
        let weights = second
            .strip_prefix("# weight: ")
            .and_then(numbers)
            .filter(|weights| weights.len() == n_nodes);
        rows.weights = weights.ok_or_else(|| NodalError::Weight {
            n_nodes,
            found: beginning(&second),
        })?;
        let third = rows.next_line()?.unwrap_or_default();
        let with_calcium = [false, true]
            .into_iter()
            .find(|with_calcium| third == header(n_nodes, *with_calcium));
        rows.has_calcium = with_calcium.ok_or_else(|| NodalError::Header {
            n_nodes,
            found: beginning(&third),
        })?;
        Ok(rows)
    }

    /// Time and values of the next row, as they were passed to [`write_csv`]; `None` at the end.
    ///
    /// # Errors
    /// [`NodalReadError`] with the first invalid line, also when the file ends before its third
    /// row.
    pub fn next_row(&mut self) -> Result<Option<(f64, Vec<f64>)>, NodalReadError> {
        let n_columns = 1 + self.activation_ms.len() * columns(self.has_calcium).len();
        let text = self.next_line()?;
        let line = self.line;
        let Some(text) = text else {
            // Three lines precede the rows.
            return if line < 3 + 3 {
                Err(NodalError::Time { line: line + 1 }.into())
            } else {
                Ok(None)
            };
        };
        let values = numbers(&text).filter(|values| values.len() == n_columns);
        let mut values = values.ok_or(NodalError::Row { line, n_columns })?;
        let time_ms = values.remove(0);
        if self.last_ms.is_some_and(|last| last >= time_ms) {
            return Err(NodalError::Time { line }.into());
        }
        self.last_ms = Some(time_ms);
        Ok(Some((time_ms, values)))
    }

    /// Returns the reader, with the rest of the file unread.
    pub fn into_inner(self) -> R {
        self.from
    }

    fn next_line(&mut self) -> io::Result<Option<String>> {
        self.text.clear();
        if self.from.read_until(b'\n', &mut self.text)? == 0 {
            return Ok(None);
        }
        self.line += 1;
        Ok(Some(
            String::from_utf8_lossy(&self.text)
                .trim_end_matches(['\n', '\r'])
                .to_owned(),
        ))
    }
}

/// Formats a number with nine significant digits, without trailing zeros.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 {
            "0".to_owned()
        } else {
            value.to_string()
        };
    }
    let digits = (8 - value.abs().log10().floor() as i64).clamp(0, 17) as usize;
    let text = format!("{value:.digits$}");
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn numbers(line: &str) -> Option<Vec<f64>> {
    line.split(',')
        .map(|text| text.parse().ok().filter(|value: &f64| value.is_finite()))
        .collect()
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
        let content = |error| match error {
            NodalReadError::Content(error) => error,
            NodalReadError::Io(error) => panic!("{error}"),
        };
        let mut rows = NodalRows::begin(text.as_bytes()).map_err(content)?;
        let n_nodes = rows.activation_ms.len();
        let mut nodes = NodalTraces {
            n_nodes,
            ..NodalTraces::default()
        };
        let mut times = vec![];
        while let Some((time, values)) = rows.next_row().map_err(content)? {
            times.push(time);
            nodes.sa_kpa.extend(&values[..n_nodes]);
            nodes.lambda.extend(&values[values.len() - n_nodes..]);
            let calcium = &values[n_nodes..values.len() - n_nodes];
            if rows.has_calcium {
                nodes.ca_um.extend(calcium)
            } else {
                nodes.ca_um.extend(vec![0.0; n_nodes])
            }
        }
        (nodes.activation_ms, nodes.weights) = (rows.activation_ms, rows.weights);
        Ok((times, nodes, rows.has_calcium))
    }

    #[test]
    fn traces_survive_the_file_with_and_without_calcium() {
        let mut nodes = nodes();
        assert_eq!(
            read(&to_csv(&TIME_MS, &nodes, false)),
            Ok((TIME_MS.to_vec(), nodes.clone(), false))
        );
        nodes.ca_um = vec![0.15, 0.15, 0.6, 0.5, 0.2, 0.3];
        let text = to_csv(&TIME_MS, &nodes, true);
        assert!(text.starts_with(
            "# activation_ms: 12.5,15.25\n# weight: 0.25,0.75\ntime_ms,Sa_kPa[1],Sa_kPa[2],Ca_uM[1]"
        ));
        assert_eq!(read(&text), Ok((TIME_MS.to_vec(), nodes, true)));
    }

    #[test]
    fn numbers_keep_nine_digits() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (-0.15, "-0.15"),
            (123_456.789_012_3, "123456.789"),
            (1e10, "10000000000"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
        assert_eq!(number(1.0 / 3.0), "0.333333333");
        assert_eq!(number(2e-7 / 3.0), "0.0000000666666667");
    }

    #[test]
    fn a_damaged_file_is_refused_with_its_line() {
        let text = to_csv(&TIME_MS, &nodes(), false);
        assert!(matches!(
            read("time_ms\n"),
            Err(NodalError::Activation { .. })
        ));
        let header = text.replace("lambda[2]", "lambda[3]");
        assert!(matches!(
            read(&header),
            Err(NodalError::Header { n_nodes: 2, .. })
        ));
        let weight = text.replace(",0.75", "");
        assert!(matches!(
            read(&weight),
            Err(NodalError::Weight { n_nodes: 2, .. })
        ));
        let row = text.replace("\n1,", "\n1,x");
        assert_eq!(
            read(&row),
            Err(NodalError::Row {
                line: 5,
                n_columns: 5
            })
        );
        let time = text.replace("\n2.5,", "\n0.5,");
        assert_eq!(read(&time), Err(NodalError::Time { line: 6 }));
        let short = text.replace("\n2.5,100,3,1,1", "");
        assert_ne!(short, text);
        assert_eq!(read(&short), Err(NodalError::Time { line: 6 }));
    }
}

//! Targets of step 2: medians over nodes, aligned by activation time, and the biomarkers of these
//! medians.
//!
//! Artefacts: `median.csv` (`time_ms,Sa_kPa,Ca_uM,lambda`; the calcium column only if the
//! contraction model has calcium) and `spread.csv`, the spread of the nodes around the median:
//! values below which 5, 25, 50, 75 and 95 % of the wall lie, for each quantity.

use std::fmt::Write as _;

use cardiotwin_models::median_traces::{GrowingSpread, LEVELS, MedianTraces, NodalSpread};
use cardiotwin_schemas::outcome::{TargetsResult, TaskResult};
use cardiotwin_schemas::task::TargetsSpec;

use crate::context::Context;
use crate::error::TaskError;
use crate::inputs::{Verifying, missing};
use crate::nodal::{NodalReadError, NodalRows, number};

/// Reads nodal traces and computes the biomarkers of their medians.
///
/// # Errors
/// [`TaskError`] when the file is not the planned one, or its traces have no biomarkers.
pub fn run(spec: &TargetsSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let (spread, n_nodes, has_calcium, lambda_max) = match read(spec, context) {
        Ok(found) => found,
        Err(Unread::Stopped(error)) => return Err(error),
        Err(Unread::File(error)) => {
            // If the file was changed, report this rather than the error in its content.
            Verifying::open(&spec.nodal)?.into_inner().verify()?;
            return Err(match error {
                NodalReadError::Io(source) => missing(&spec.nodal, source),
                NodalReadError::Content(source) => TaskError::Nodal {
                    file: spec.nodal.path.clone(),
                    source,
                },
            });
        }
    };
    let spread = spread.ok_or(TaskError::NoMedian { n_nodes })?;
    let median = spread.median();
    let targets = median
        .biomarkers()
        .filter(|biomarkers| biomarkers.sa_max_kpa > 0.0)
        .ok_or(TaskError::NoMedian { n_nodes })?;
    context
        .artefacts
        .write("median", "median.csv", &median_csv(&median, has_calcium))?;
    context
        .artefacts
        .write("spread", "spread.csv", &spread_csv(&spread, has_calcium))?;
    let lambda_0 = median.lambda[0];
    Ok(TaskResult::Targets(TargetsResult {
        lambda_0,
        lambda_max,
        targets,
        n_nodes,
        has_calcium,
    }))
}

/// Reasons why nodal traces were not read.
enum Unread {
    Stopped(TaskError),
    File(NodalReadError),
}

impl From<NodalReadError> for Unread {
    fn from(error: NodalReadError) -> Self {
        Self::File(error)
    }
}

/// Reads the file row by row. Returns the spread of the nodes, the number of nodes, whether they
/// have calcium, and the largest stretch.
fn read(
    spec: &TargetsSpec,
    context: &Context,
) -> Result<(Option<NodalSpread>, u64, bool, f64), Unread> {
    let mut rows = NodalRows::begin(Verifying::open(&spec.nodal).map_err(Unread::Stopped)?)?;
    let has_calcium = rows.has_calcium;
    let mut growing = GrowingSpread::new(
        rows.activation_ms.clone(),
        rows.weights.clone(),
        has_calcium,
    );
    let n_nodes = rows.activation_ms.len();
    let mut lambda_max = f64::NEG_INFINITY;
    while let Some((time_ms, values)) = rows.next_row()? {
        // The last columns are the stretches of all nodes.
        lambda_max = values[values.len() - n_nodes..]
            .iter()
            .fold(lambda_max, |most, x| most.max(*x));
        growing.add(time_ms, values);
        context.check_stop().map_err(Unread::Stopped)?;
    }
    rows.into_inner()
        .into_inner()
        .verify()
        .map_err(Unread::Stopped)?;
    Ok((growing.finish(), n_nodes as u64, has_calcium, lambda_max))
}

fn median_csv(median: &MedianTraces, has_calcium: bool) -> String {
    let mut text = if has_calcium {
        "time_ms,Sa_kPa,Ca_uM,lambda\n"
    } else {
        "time_ms,Sa_kPa,lambda\n"
    }
    .to_owned();
    for (idx, time) in median.time_ms.iter().enumerate() {
        let _ = write!(text, "{},{}", number(*time), number(median.sa_kpa[idx]));
        if has_calcium {
            let _ = write!(text, ",{}", number(median.ca_um[idx]));
        }
        let _ = writeln!(text, ",{}", number(median.lambda[idx]));
    }
    text
}

fn spread_csv(spread: &NodalSpread, has_calcium: bool) -> String {
    let mut quantities = vec![("Sa_kPa", &spread.sa_kpa), ("lambda", &spread.lambda)];
    if has_calcium {
        quantities.insert(1, ("Ca_uM", &spread.ca_um));
    }
    let mut text = "time_ms".to_owned();
    for (name, _) in &quantities {
        LEVELS
            .iter()
            .for_each(|level| text.push_str(&format!(",{name}_p{:.0}", 100.0 * level)));
    }
    text.push('\n');
    for (row, time) in spread.time_ms.iter().enumerate() {
        text.push_str(&number(*time));
        for value in quantities.iter().flat_map(|(_, values)| values[row]) {
            // Five decimals are enough, because the file is for plots and not for a fit.
            let _ = write!(text, ",{}", number((value * 1e5).round() / 1e5));
        }
        text.push('\n');
    }
    text
}

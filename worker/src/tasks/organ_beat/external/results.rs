//! Results of an external solver: traces of the cavity and of every node.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_models::beat::{BeatTraces, NodalTraces};
use cardiotwin_schemas::external::ExternalResults;
use cardiotwin_units::MMHG_PER_KPA;

use crate::igb::{self, Igb};
use crate::nodal::{NodalReadError, NodalRows};

/// Alternative columns of the cavity pressure, with their factors to mmHg.
const PRESSURES: [(&str, f64); 2] = [("pressure_mmHg", 1.0), ("pressure_kPa", MMHG_PER_KPA)];

/// Reasons why results are not usable.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Unusable {
    /// The results are missing or have the wrong format, so that the solver or its settings are at
    /// fault.
    Form(String),
    /// The solver ended early, or its results contain values that are not finite.
    Diverged {
        /// Time of the last good sample.
        last_good_ms: f64,
        /// Problem with the next sample.
        reason: String,
        /// Traces up to the last good sample.
        traces: Box<BeatTraces>,
    },
}

fn form(file: &Path, what: impl std::fmt::Display) -> Unusable {
    Unusable::Form(format!("{}: {what}", file.display()))
}

fn text(file: &Path) -> Result<String, Unusable> {
    input_files::read_text(file, MaxBytes::TRACE)
        .map_err(|error| form(file, format!("expected results here, found none ({error})")))
}

/// Reads the traces of the cavity over one cycle of `cycle_length_ms`.
///
/// # Errors
/// [`Unusable`] with file, line and column.
pub(super) fn traces(
    folder: &Path,
    results: &ExternalResults,
    cycle_length_ms: f64,
) -> Result<BeatTraces, Unusable> {
    let file = folder.join(&results.traces);
    let text = text(&file)?;
    let mut lines = text
        .lines()
        .zip(1..)
        .filter(|(line, _)| !line.starts_with('#') && !line.trim().is_empty());
    let (header, _) = lines
        .next()
        .ok_or_else(|| form(&file, "empty, expected a header"))?;
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| names.iter().position(|found| *found == name);
    let missing = |what: &str| {
        form(
            &file,
            format!("line 1: no column {what}; found {}", names.join(", ")),
        )
    };
    let time = column("time_ms").ok_or_else(|| missing("time_ms"))?;
    let pressure = PRESSURES
        .iter()
        .find_map(|(name, factor)| Some((column(name)?, *factor)));
    let (pressure, to_mmhg) = pressure.ok_or_else(|| missing("pressure_mmHg (or pressure_kPa)"))?;
    let volume = column("volume_mL").ok_or_else(|| missing("volume_mL"))?;
    let more = [
        "aortic_pressure_mmHg",
        "aortic_flow_mL_per_s",
        "mitral_flow_mL_per_s",
    ]
    .map(column);

    let mut found = BeatTraces::default();
    for (line, number) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != names.len() {
            return Err(form(
                &file,
                format!(
                    "line {number}: {} values, expected {}",
                    cells.len(),
                    names.len()
                ),
            ));
        }
        let mut bad = None;
        let mut value = |idx: usize| match cells[idx].parse::<f64>() {
            Ok(value) if value.is_finite() => value,
            Ok(_) => {
                bad.get_or_insert(Ok(idx));
                f64::NAN
            }
            Err(_) => {
                bad = Some(Err(idx));
                f64::NAN
            }
        };
        let row = [value(time), value(pressure) * to_mmhg, value(volume)];
        let others = more.map(|idx| idx.map_or(f64::NAN, &mut value));
        let last = found.time_ms.last().copied();
        match bad {
            Some(Err(idx)) => {
                let what = format!(
                    "line {number}, {}: `{}`, expected a number",
                    names[idx], cells[idx]
                );
                return Err(form(&file, what));
            }
            Some(Ok(idx)) => {
                let reason = format!(
                    "{} is `{}` in line {number} of {}",
                    names[idx],
                    cells[idx],
                    file.display()
                );
                return Err(diverged(found, reason));
            }
            None if last.is_some_and(|last| last >= row[0]) => {
                let what = format!(
                    "line {number}: time {} ms after {} ms, expected later",
                    row[0],
                    last.unwrap_or(0.0)
                );
                return Err(form(&file, what));
            }
            None => {}
        }
        found.time_ms.push(row[0]);
        found.pressure_mmhg.push(row[1]);
        found.volume_ml.push(row[2]);
        found.aortic_pressure_mmhg.push(others[0]);
        found.aortic_flow_ml_per_s.push(others[1]);
        found.mitral_flow_ml_per_s.push(others[2]);
    }
    let n = found.time_ms.len();
    if n < 3 {
        return Err(diverged(
            found,
            format!("{} holds {n} samples", file.display()),
        ));
    }
    // The last sample may lie one step before the end of the cycle.
    let step = (found.time_ms[n - 1] - found.time_ms[0]) / (n - 1) as f64;
    if found.time_ms[n - 1] < cycle_length_ms - 1.5 * step {
        let reason = format!(
            "{} ends there, before the cycle of {cycle_length_ms} ms",
            file.display()
        );
        return Err(diverged(found, reason));
    }
    if found.time_ms[0].abs() > step || found.time_ms[n - 1] > cycle_length_ms + 1.5 * step {
        let span = format!("{} to {} ms", found.time_ms[0], found.time_ms[n - 1]);
        return Err(form(
            &file,
            format!("times {span}, expected one beat, 0 to {cycle_length_ms} ms"),
        ));
    }
    Ok(found)
}

fn diverged(traces: BeatTraces, reason: String) -> Unusable {
    let last_good_ms = traces.time_ms.last().copied().unwrap_or(0.0);
    Unusable::Diverged {
        last_good_ms,
        reason,
        traces: Box::new(traces),
    }
}

/// Reads the traces of every node. Returns the times, the traces, and whether they include calcium.
///
/// # Errors
/// [`Unusable`] with the file and the problem.
pub(super) fn nodes(
    folder: &Path,
    results: &ExternalResults,
    first_activation_ms: f64,
) -> Result<(Vec<f64>, NodalTraces, bool), Unusable> {
    if results.igb.is_empty() {
        let file = folder.join(&results.nodal);
        return nodal_csv(&file);
    }
    let mut read = BTreeMap::new();
    for (quantity, name) in &results.igb {
        let file = folder.join(name);
        let bytes = input_files::read(&file, MaxBytes::MESH).map_err(|error| {
            form(
                &file,
                format!("expected {quantity} here, found no file ({error})"),
            )
        })?;
        let igb = igb::read(&bytes).map_err(|error| form(&file, error))?;
        if let Some(at) = igb.values.iter().position(|value| !value.is_finite()) {
            let (frame, node) = (at / igb.n_nodes, at % igb.n_nodes);
            let reason = format!(
                "{quantity} of node {node} is not finite in {}",
                file.display()
            );
            let last_good_ms = igb.time_ms[frame.saturating_sub(1)];
            return Err(Unusable::Diverged {
                last_good_ms,
                reason,
                traces: Box::default(),
            });
        }
        read.insert(quantity.as_str(), (file, igb));
    }
    let of = |quantity: &str| {
        read.get(quantity)
            .ok_or_else(|| Unusable::Form(format!("solver.external.results.igb lacks {quantity}")))
    };
    let (file, stress) = of("Sa_kPa")?;
    let (other, stretch) = of("lambda")?;
    let alike = |file: &Path, other: &Path, found: &Igb, expected: &Igb| {
        if (found.n_nodes, found.time_ms.len()) == (expected.n_nodes, expected.time_ms.len()) {
            return Ok(());
        }
        let what = format!("{} nodes at {} times", found.n_nodes, found.time_ms.len());
        let expected = format!(
            "{} at {}, as in {}",
            expected.n_nodes,
            expected.time_ms.len(),
            file.display()
        );
        Err(form(other, format!("{what}, expected {expected}")))
    };
    alike(file, other, stretch, stress)?;
    let calcium = read.get("Ca_uM");
    if let Some((other, calcium)) = calcium {
        alike(file, other, calcium, stress)?;
    }
    let n_nodes = stress.n_nodes;
    let column = |name: &Option<String>, default: f64| match name {
        None => Ok(vec![default; n_nodes]),
        Some(name) => numbers(&folder.join(name), n_nodes),
    };
    let activation = column(&results.activation, first_activation_ms)?;
    let mut weights = column(&results.weights, 1.0)?;
    let sum: f64 = weights.iter().sum();
    if !(sum > 0.0 && weights.iter().all(|weight| *weight >= 0.0)) {
        return Err(Unusable::Form(
            "solver.external.results.weights: expected numbers of 0 or more, not all 0".into(),
        ));
    }
    weights.iter_mut().for_each(|weight| *weight /= sum);
    // Nodes without weight do not contract and are left out.
    let kept: Vec<usize> = (0..n_nodes).filter(|node| weights[*node] > 0.0).collect();
    let of_kept = |values: &[f64]| -> Vec<f64> {
        values
            .chunks_exact(n_nodes)
            .flat_map(|row| kept.iter().map(|node| row[*node]))
            .collect()
    };
    let nodes = NodalTraces {
        n_nodes: kept.len(),
        activation_ms: of_kept(&activation),
        weights: of_kept(&weights),
        sa_kpa: of_kept(&stress.values),
        ca_um: calcium.map_or_else(
            || vec![0.0; kept.len() * stress.time_ms.len()],
            |(_, igb)| of_kept(&igb.values),
        ),
        lambda: of_kept(&stretch.values),
    };
    Ok((stress.time_ms.clone(), nodes, calcium.is_some()))
}

/// Reads a file in the format of our own solvers.
fn nodal_csv(file: &Path) -> Result<(Vec<f64>, NodalTraces, bool), Unusable> {
    let opened = input_files::check(file, MaxBytes::MESH)
        .and_then(|()| File::open(file))
        .map_err(|error| form(file, format!("expected results here, found none ({error})")))?;
    let unusable = |error: NodalReadError| form(file, error);
    let mut rows = NodalRows::begin(BufReader::new(opened)).map_err(unusable)?;
    let n_nodes = rows.activation_ms.len();
    let mut nodes = NodalTraces {
        n_nodes,
        activation_ms: rows.activation_ms.clone(),
        weights: rows.weights.clone(),
        ..NodalTraces::default()
    };
    let mut time_ms = vec![];
    while let Some((time, values)) = rows.next_row().map_err(unusable)? {
        time_ms.push(time);
        let mut parts = values.chunks_exact(n_nodes.max(1));
        nodes
            .sa_kpa
            .extend_from_slice(parts.next().unwrap_or_default());
        if rows.has_calcium {
            nodes
                .ca_um
                .extend_from_slice(parts.next().unwrap_or_default());
        }
        nodes
            .lambda
            .extend_from_slice(parts.next().unwrap_or_default());
    }
    nodes.ca_um.resize(nodes.sa_kpa.len(), 0.0);
    Ok((time_ms, nodes, rows.has_calcium))
}

/// Reads a file with one number per line, like openCARP's `.dat` files.
fn numbers(file: &Path, expected: usize) -> Result<Vec<f64>, Unusable> {
    let text = text(file)?;
    let mut found = Vec::with_capacity(expected);
    for (line, number) in text
        .lines()
        .zip(1..)
        .filter(|(line, _)| !line.trim().is_empty())
    {
        let value = line
            .trim()
            .parse::<f64>()
            .ok()
            .filter(|value| value.is_finite());
        found
            .push(value.ok_or_else(|| {
                form(file, format!("line {number}: `{line}`, expected a number"))
            })?);
    }
    if found.len() != expected {
        return Err(form(
            file,
            format!(
                "{} numbers, expected one for each of {expected} nodes",
                found.len()
            ),
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<BeatTraces, Unusable> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("traces.csv"), text).unwrap();
        traces(folder.path(), &ExternalResults::default(), 30.0)
    }

    const WHOLE: &str = "time_ms,volume_mL,pressure_mmHg\n0,120,8\n10,110,80\n20,60,90\n30,119,8\n";

    #[test]
    fn columns_are_found_by_name_and_kilopascal_is_converted() {
        let found = read(WHOLE).unwrap();
        assert_eq!((found.volume_ml[2], found.pressure_mmhg[2]), (60.0, 90.0));
        let kpa = read(&WHOLE.replace("pressure_mmHg", "pressure_kPa")).unwrap();
        assert!((kpa.pressure_mmhg[0] - 60.0049).abs() < 1e-3);
        assert_eq!(
            read(&WHOLE.replace("30,119,8\n", ""))
                .unwrap()
                .time_ms
                .len(),
            3,
            "the sample before the end"
        );
    }

    #[test]
    fn numbers_that_are_none_and_early_ends_are_simulations_that_diverged() {
        let Err(Unusable::Diverged {
            last_good_ms,
            reason,
            traces,
        }) = read(&WHOLE.replace("20,60,90", "20,60,nan"))
        else {
            panic!()
        };
        assert_eq!((last_good_ms, traces.time_ms.len()), (10.0, 2));
        assert!(
            reason.contains("pressure_mmHg is `nan` in line 4"),
            "{reason}"
        );
        let short = read("time_ms,volume_mL,pressure_mmHg\n0,1,1\n1,1,1\n2,1,1\n");
        assert!(
            matches!(
                short,
                Err(Unusable::Diverged {
                    last_good_ms: 2.0,
                    ..
                })
            ),
            "{short:?}"
        );
    }

    #[test]
    fn other_forms_are_told_with_file_line_and_column() {
        for (text, expected) in [
            (
                WHOLE.replace("volume_mL", "volume"),
                "no column volume_mL; found time_ms, volume, pressure_mmHg",
            ),
            (
                WHOLE.replace("10,110,80", "10,110,x"),
                "line 3, pressure_mmHg: `x`, expected a number",
            ),
            (
                WHOLE.replace("10,110,80", "10,110"),
                "line 3: 2 values, expected 3",
            ),
            (
                WHOLE.replace("20,60,90", "9,60,90"),
                "line 4: time 9 ms after 10 ms",
            ),
        ] {
            let Err(Unusable::Form(message)) = read(&text) else {
                panic!("{text}")
            };
            assert!(message.contains(expected), "{message}");
        }
    }
}

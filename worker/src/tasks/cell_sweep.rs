//! A chunk of a sensitivity sweep: complete Saltelli blocks of the 0D cell, on the batched engine.
//!
//! A sample's numbers depend on its own parameters alone, so they are the same however the design is cut into chunks and
//! on however many threads a chunk is computed.
//!
//! Artefact: `samples.csv`, one line a sample in the design's order, columns as in [`SAMPLES_HEADING`].

use std::fmt::Write as _;

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::sobol::{DesignSettings, SaltelliDesign};
use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, CellStatus, EngineSettings, NegativeKwu, SimdPath, Workspace,
};
use cardiotwin_schemas::outcome::{CellSweepResult, TaskResult};
use cardiotwin_schemas::sweep::SAMPLES_HEADING;
use cardiotwin_schemas::task::CellSweepSpec;

use crate::cell_parameters::{NamedCell, position};
use crate::context::Context;
use crate::engine::settings_for;
use crate::error::TaskError;

/// Blocks after which is looked whether to stop, for each thread: some milliseconds of work.
const BLOCKS_AT_ONCE: usize = 16;
/// Cells that a thread takes at a time.
const CELLS_AT_ONCE: usize = 176;

/// Computes the chunk.
///
/// # Errors
/// [`TaskError`] when the design makes no sense, a name is unknown, or stopping was asked for. What goes wrong with a
/// sample stands in its line.
pub fn run(spec: &CellSweepSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    let blocks = spec.first_block as usize..(spec.first_block + spec.n_blocks) as usize;
    let design = design(spec, blocks.end)?;
    let cell = Cell::of(spec)?;
    let engine = CellEngine::new(EngineSettings {
        tolerance: spec.design.tolerance,
        // As the published analysis: the box reaches into it, and the equations hold there.
        negative_kwu: NegativeKwu::Keep,
        ..settings_for(context.instruction_set)
    })?;
    let threads =
        (context.threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(context.threads as usize).build());
    let pool = threads.transpose().map_err(TaskError::Threads)?;
    let rows_per_block = design.rows_per_block();
    let mut workspace = Workspace::new();
    let mut text = format!("{SAMPLES_HEADING}\n");
    let mut counts = Counts::default();
    let mut outputs = Vec::new();
    let step = BLOCKS_AT_ONCE * context.threads.max(1) as usize;
    for first in blocks.clone().step_by(step) {
        context.check_stop()?;
        let (done, total) = ((first - blocks.start) * rows_per_block, blocks.len() * rows_per_block);
        context.progress.report("samples", done as f64, Some(total as f64), || format!("{done} of {total} samples"));
        let inputs: Vec<CellInput> =
            design.rows(first..blocks.end.min(first + step)).iter().map(|row| cell.input(row)).collect();
        outputs.clear();
        outputs.resize(inputs.len(), CellOutput::default());
        match &pool {
            Some(pool) => pool.install(|| engine.evaluate_parallel(&inputs, None, CELLS_AT_ONCE, &mut outputs))?,
            None => engine.evaluate(&inputs, &mut workspace, &mut outputs)?,
        }
        for (i, output) in outputs.iter().enumerate() {
            counts.count(output);
            write_line(&mut text, first + i / rows_per_block, i % rows_per_block, output);
        }
    }
    context.artefacts.write("samples", "samples.csv", &text)?;
    Ok(TaskResult::CellSweep(counts.result(engine.path())))
}

/// The design as far as this chunk reaches: its first blocks do not depend on how many follow.
fn design(spec: &CellSweepSpec, n_blocks: usize) -> Result<SaltelliDesign, TaskError> {
    let of = &spec.design;
    let intervals: Vec<Interval> = of.parameters.iter().map(|p| Interval::new(p.lower, p.upper)).collect();
    let settings = DesignSettings { n_blocks, skip_points: of.skip_points, scramble: of.scramble_seed };
    Ok(SaltelliDesign::new(&intervals, settings)?)
}

/// The cell that every sample differs from in the swept parameters.
struct Cell {
    base: CellInput,
    swept: Vec<usize>,
}

impl Cell {
    fn of(spec: &CellSweepSpec) -> Result<Self, TaskError> {
        let of = &spec.design;
        let base = NamedCell::new(of.cycle_length_ms, of.lambda_0).with(&of.fixed)?.input();
        let swept = of.parameters.iter().map(|p| position(&p.name)).collect::<Result<_, _>>()?;
        Ok(Self { base, swept })
    }

    fn input(&self, row: &[f64]) -> CellInput {
        let mut input = self.base;
        for (at, value) in self.swept.iter().zip(row) {
            input.parameters[*at] = *value;
        }
        input
    }
}

/// The word for a status in `samples.csv`.
fn status(status: CellStatus) -> &'static str {
    match status {
        CellStatus::Periodic => "periodic",
        CellStatus::NotPeriodic => "not-periodic",
        // Without a bound of the cost nothing is given up.
        CellStatus::Hopeless | CellStatus::Stuck { .. } => "stuck",
        CellStatus::Refused(_) => "refused",
    }
}

fn write_line(text: &mut String, block: usize, row: usize, output: &CellOutput) {
    let word = status(output.status);
    // Writing to a text cannot fail. `{:?}` is the shortest form that reads back to the same number.
    let _ = match output.status {
        CellStatus::Periodic | CellStatus::NotPeriodic => {
            let b = &output.biomarkers;
            let cut = u8::from(b.std30.cut || b.std50.cut || b.std90.cut);
            writeln!(
                text,
                "{block},{row},{word},{:?},{:?},{:?},{:?},{:?},{cut},{:?},{:?},{:?},{:?},{}",
                b.sa_max_kpa,
                b.dsa_dt_max_kpa_per_ms,
                b.std30.ms,
                b.std50.ms,
                b.std90.ms,
                b.lambda_min,
                b.sa_res_kpa,
                b.sa_min_kpa,
                b.max_rise_after_peak_kpa_per_ms,
                output.beats
            )
        }
        _ => writeln!(text, "{block},{row},{word},,,,,,,,,,,{}", output.beats),
    };
}

#[derive(Debug, Default)]
struct Counts {
    periodic: u64,
    not_periodic: u64,
    stuck: u64,
    refused: u64,
}

impl Counts {
    fn count(&mut self, output: &CellOutput) {
        *match output.status {
            CellStatus::Periodic => &mut self.periodic,
            CellStatus::NotPeriodic => &mut self.not_periodic,
            CellStatus::Hopeless | CellStatus::Stuck { .. } => &mut self.stuck,
            CellStatus::Refused(_) => &mut self.refused,
        } += 1;
    }

    fn result(&self, path: SimdPath) -> CellSweepResult {
        CellSweepResult {
            n_samples: self.periodic + self.not_periodic + self.stuck + self.refused,
            n_periodic: self.periodic,
            n_not_periodic: self.not_periodic,
            n_stuck: self.stuck,
            n_refused: self.refused,
            arithmetic: match path {
                SimdPath::Portable => "portable",
                SimdPath::Avx2 => "avx2",
                SimdPath::Avx512 => "avx512",
            }
            .to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::sweep::{CellDesign, SweptParameter};
    use std::collections::BTreeMap;

    fn spec(first_block: u32, n_blocks: u32) -> CellSweepSpec {
        let swept = |name: &str, lower, upper| SweptParameter { name: name.into(), lower, upper };
        CellSweepSpec {
            design: CellDesign {
                parameters: vec![
                    swept("Ca50_ref_uM", 0.5, 2.0),
                    swept("tau_CR_ms", 64.5, 192.5),
                    swept("k_WS_per_ms", 0.004, 0.048),
                ],
                skip_points: 0,
                scramble_seed: Some(7),
                cycle_length_ms: 1000.0,
                lambda_0: 1.1,
                fixed: BTreeMap::from([("a_p_kPa".to_owned(), 42.0)]),
                tolerance: 1e-4,
            },
            first_block,
            n_blocks,
        }
    }

    fn samples(spec: &CellSweepSpec, threads: u32) -> (CellSweepResult, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let mut context = Context::plain(folder.path(), threads);
        let TaskResult::CellSweep(result) = run(spec, &mut context).unwrap() else { panic!("a sweep's result") };
        let text = std::fs::read_to_string(folder.path().join("samples.csv")).unwrap();
        assert_eq!(context.artefacts.take().len(), 1);
        (result, text.lines().map(str::to_owned).collect())
    }

    #[test]
    fn chunks_and_threads_change_no_digit() {
        let (result, whole) = samples(&spec(0, 40), 1);
        assert_eq!((result.n_samples, result.n_periodic + result.n_not_periodic), (320, 320));
        assert_eq!(samples(&spec(0, 40), 3).1, whole);
        let mut parts = samples(&spec(0, 23), 1).1;
        parts.extend(samples(&spec(23, 17), 2).1.into_iter().skip(1));
        assert_eq!(parts, whole);
    }

    #[test]
    fn a_line_holds_the_engine_s_numbers_for_the_design_s_row() {
        let spec = spec(5, 1);
        let lines = samples(&spec, 1).1;
        assert_eq!((lines[0].as_str(), lines.len()), (SAMPLES_HEADING, 9));
        let rows = design(&spec, 6).unwrap().rows(5..6);
        let mut input = CellInput::new(cardiotwin_cell_engine::DEFAULT_PARAMETERS, 1000.0, 1.1);
        // Positions as the engine's own names have them.
        let names = cardiotwin_cell_engine::PARAMETER_NAMES;
        for (name, value) in ["Ca50_ref_uM", "tau_CR_ms", "k_WS_per_ms", "a_p_kPa"]
            .iter()
            .zip([rows[3][0], rows[3][1], rows[3][2], 42.0])
        {
            input.parameters[names.iter().position(|n| n == name).unwrap()] = value;
        }
        let settings = EngineSettings { negative_kwu: NegativeKwu::Keep, ..EngineSettings::default() };
        let mut output = [CellOutput::default()];
        CellEngine::new(settings).unwrap().evaluate(&[input], &mut Workspace::new(), &mut output).unwrap();
        let fields: Vec<&str> = lines[4].split(',').collect();
        assert_eq!(&fields[..3], ["5", "3", "periodic"]);
        let number = |at: usize| fields[at].parse::<f64>().unwrap();
        assert_eq!((number(3), number(7)), (output[0].biomarkers.sa_max_kpa, output[0].biomarkers.std90.ms));
        assert_eq!(number(12), output[0].biomarkers.max_rise_after_peak_kpa_per_ms);
    }

    #[test]
    fn a_sample_without_meaning_is_a_line_and_a_design_without_meaning_an_error() {
        let mut refused = spec(0, 1);
        refused.design.fixed.insert("r_S".into(), 1.5);
        let (result, lines) = samples(&refused, 1);
        assert_eq!((result.n_refused, result.n_samples), (8, 8));
        assert_eq!(lines[1], "0,0,refused,,,,,,,,,,,0");
        let run = |spec: &CellSweepSpec| {
            let folder = tempfile::tempdir().unwrap();
            run(spec, &mut Context::plain(folder.path(), 1)).unwrap_err().to_string()
        };
        refused.design.fixed.insert("rS".into(), 0.2);
        assert!(run(&refused).contains("`rS`"));
        let mut empty = spec(0, 1);
        empty.design.parameters[0].upper = f64::NAN;
        assert!(!run(&empty).is_empty());
    }
}

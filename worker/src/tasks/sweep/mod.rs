//! A chunk of a sensitivity sweep: complete Saltelli blocks of the 0D cell, or of the organ with
//! this cell.
//!
//! A sample's results depend on its own parameters alone. They are therefore independent of the
//! division of the design into chunks and of the number of threads.
//!
//! Lines are stored as they are computed ([`SampleLog`]), and an attempt starts with the first
//! sample that earlier attempts lack.
//!
//! Artefact: `samples.csv`, one line per sample in the order of the design, with the columns of
//! [`SAMPLES_HEADING`] for the cell and of
//! [`ORGAN_SAMPLES_HEADING`](cardiotwin_schemas::sweep::ORGAN_SAMPLES_HEADING) for the organ.

mod cell;
mod model;
pub(crate) mod organ;

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::sobol::{DesignSettings, SaltelliDesign};
use cardiotwin_schemas::outcome::{CellSweepResult, TaskResult};
#[cfg(doc)]
use cardiotwin_schemas::sweep::SAMPLES_HEADING;
use cardiotwin_schemas::task::{CellSweepSpec, TaskSpec};
use rayon::ThreadPoolBuilder;

pub use self::cell::status as cell_status;
use self::model::Model;
use crate::context::Context;
use crate::error::TaskError;
use crate::sample_log::{self, SampleLog};

/// Computes the chunk.
///
/// # Errors
/// [`TaskError`] when the design is invalid, a name is unknown, or a stop is requested. The failure
/// of a sample is recorded in its line.
pub fn run(spec: &CellSweepSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    match &spec.design.organ {
        None => chunk(
            spec,
            cell::Cells::of(&spec.design, context.instruction_set)?,
            context,
        ),
        Some(organ) => chunk(spec, organ::Beats::of(&spec.design, organ)?, context),
    }
}

fn chunk<M: Model>(
    spec: &CellSweepSpec,
    mut model: M,
    context: &mut Context,
) -> Result<TaskResult, TaskError> {
    let blocks = spec.first_block as usize..(spec.first_block + spec.n_blocks) as usize;
    let design = design(spec, blocks.end)?;
    let threads = (context.threads > 1).then(|| {
        ThreadPoolBuilder::new()
            .num_threads(context.threads as usize)
            .build()
    });
    let pool = threads.transpose().map_err(TaskError::Threads)?;
    let rows_per_block = design.rows_per_block();
    let mut counts = Counts::default();
    let (mut log, mut lines) = open_log(
        spec,
        model.arithmetic(),
        rows_per_block,
        &mut counts,
        context,
    )?;
    let step = M::BLOCKS_AT_ONCE * context.threads.max(1) as usize;
    let total = blocks.len() * rows_per_block;
    for first in (blocks.start + lines.len() / rows_per_block..blocks.end).step_by(step) {
        context.check_stop()?;
        let done = lines.len();
        context
            .progress
            .report("samples", done as f64, Some(total as f64), || {
                format!("{done} of {total} samples")
            });
        // Rows of this block that an earlier attempt completed before it ended.
        let there = done - (first - blocks.start) * rows_per_block;
        let rows = design.rows(first..blocks.end.min(first + step));
        for (row, line) in (there..).zip(model.lines(&rows[there..], pool.as_ref())?) {
            let line = format!(
                "{},{},{line}",
                first + row / rows_per_block,
                row % rows_per_block
            );
            counts.count(&line);
            lines.push(line);
        }
        log.append(lines[done..].iter().map(String::as_str))
            .map_err(|source| unwritten(context, source))?;
    }
    let text = [M::HEADING]
        .into_iter()
        .chain(lines.iter().map(String::as_str));
    let text = text.fold(String::new(), |text, line| text + line + "\n");
    context.artefacts.write("samples", "samples.csv", &text)?;
    Ok(TaskResult::CellSweep(counts.result(model.arithmetic())))
}

/// Opens the log of this attempt. Also returns the first lines of the chunk, as far as earlier
/// attempts with the same arithmetic computed them.
fn open_log(
    spec: &CellSweepSpec,
    arithmetic: &str,
    rows_per_block: usize,
    counts: &mut Counts,
    context: &Context,
) -> Result<(SampleLog, Vec<String>), TaskError> {
    let key = TaskSpec::CellSweep(Box::new(spec.clone())).key();
    let about = format!("{key} {arithmetic}");
    let (log, mut lines) = SampleLog::open(&context.checkpoints, &about)
        .map_err(|source| unwritten(context, source))?;
    let (first, n) = (
        spec.first_block as usize,
        spec.n_blocks as usize * rows_per_block,
    );
    let mut expected = |(i, line): &(usize, &String)| {
        line.starts_with(&format!(
            "{},{},",
            first + i / rows_per_block,
            i % rows_per_block
        )) && counts.count(line)
    };
    lines.truncate(
        lines
            .iter()
            .take(n)
            .enumerate()
            .take_while(|found| expected(found))
            .count(),
    );
    if !lines.is_empty() {
        tracing::info!(
            samples = lines.len(),
            of = n,
            "goes on after samples of an earlier attempt"
        );
    }
    Ok((log, lines))
}

fn unwritten(context: &Context, source: std::io::Error) -> TaskError {
    TaskError::Write {
        file: context
            .checkpoints
            .own_file(sample_log::FILE)
            .unwrap_or_default(),
        source,
    }
}

/// The design up to the end of this chunk. Its first blocks do not depend on the total number of
/// blocks.
fn design(spec: &CellSweepSpec, n_blocks: usize) -> Result<SaltelliDesign, TaskError> {
    let of = &spec.design;
    let intervals: Vec<Interval> = of
        .parameters
        .iter()
        .map(|p| Interval::new(p.lower, p.upper))
        .collect();
    let settings = DesignSettings {
        n_blocks,
        skip_points: of.skip_points,
        scramble: of.scramble_seed,
    };
    Ok(SaltelliDesign::new(&intervals, settings)?)
}

#[derive(Debug, Default)]
struct Counts {
    periodic: u64,
    not_periodic: u64,
    stuck: u64,
    refused: u64,
}

impl Counts {
    /// Counts a line; returns `false` if it has no valid status.
    fn count(&mut self, line: &str) -> bool {
        *match line.split(',').nth(2).unwrap_or_default() {
            "periodic" | "finished" => &mut self.periodic,
            "not-periodic" => &mut self.not_periodic,
            "stuck" | "diverged" => &mut self.stuck,
            "refused" => &mut self.refused,
            _ => return false,
        } += 1;
        true
    }

    fn result(&self, arithmetic: &str) -> CellSweepResult {
        CellSweepResult {
            n_samples: self.periodic + self.not_periodic + self.stuck + self.refused,
            n_periodic: self.periodic,
            n_not_periodic: self.not_periodic,
            n_stuck: self.stuck,
            n_refused: self.refused,
            arithmetic: arithmetic.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_cell_engine::{
        CellEngine, CellInput, CellOutput, EngineSettings, NegativeKwu, Workspace,
    };
    use cardiotwin_schemas::sweep::{CellDesign, SAMPLES_HEADING, SweptParameter};
    use std::collections::BTreeMap;

    fn spec(first_block: u32, n_blocks: u32) -> CellSweepSpec {
        let swept = |name: &str, lower, upper| SweptParameter {
            name: name.into(),
            lower,
            upper,
        };
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
                organ: None,
            },
            first_block,
            n_blocks,
        }
    }

    fn samples(spec: &CellSweepSpec, threads: u32) -> (CellSweepResult, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let mut context = Context::plain(folder.path(), threads);
        let TaskResult::CellSweep(result) = run(spec, &mut context).unwrap() else {
            panic!("a sweep's result")
        };
        let text = std::fs::read_to_string(folder.path().join("samples.csv")).unwrap();
        assert_eq!(context.artefacts.take().len(), 1);
        (result, text.lines().map(str::to_owned).collect())
    }

    #[test]
    fn chunks_and_threads_change_no_digit() {
        let (result, whole) = samples(&spec(0, 40), 1);
        assert_eq!(
            (result.n_samples, result.n_periodic + result.n_not_periodic),
            (320, 320)
        );
        assert_eq!(samples(&spec(0, 40), 3).1, whole);
        let mut parts = samples(&spec(0, 23), 1).1;
        parts.extend(samples(&spec(23, 17), 2).1.into_iter().skip(1));
        assert_eq!(parts, whole);
    }

    #[test]
    fn an_attempt_goes_on_after_the_samples_of_an_earlier_one() {
        use crate::checkpoint::Checkpoints;
        use cardiotwin_schemas::ids::{AttemptId, TaskKey};
        let root = tempfile::tempdir().unwrap();
        let spec = spec(2, 30);
        let attempt = |generation: u32| {
            let directory = root.path().join(format!("abcd-g{generation}"));
            std::fs::create_dir_all(&directory).unwrap();
            let mut context = Context::plain(&directory, 1);
            context.checkpoints = Checkpoints::of_attempt(
                &directory,
                &AttemptId {
                    task: TaskKey("abcd".into()),
                    generation,
                },
            );
            context.progress = crate::progress::ProgressLog::in_directory(&directory, false);
            let result = run(&spec, &mut context);
            let text = std::fs::read_to_string(directory.join("samples.csv")).unwrap();
            let log = std::fs::read_to_string(directory.join("checkpoint/samples")).unwrap();
            let begun =
                std::fs::read_to_string(directory.join("progress.jsonl")).unwrap_or_default();
            (result.unwrap(), text, log, begun)
        };
        let (result, text, log, begun) = attempt(1);
        assert!(begun.contains("\"0 of 240 samples\""), "{begun}");
        assert_eq!(log.lines().count(), 1 + 240);
        // The attempt was killed within a block, while it wrote a line.
        let path = root.path().join("abcd-g1/checkpoint/samples");
        let torn: String = log.split_inclusive('\n').take(1 + 99).collect::<String>()
            + &log[log.len() - 20..log.len() - 5];
        std::fs::write(&path, torn).unwrap();
        let (again, text_again, log_again, begun) = attempt(2);
        assert!(begun.contains("\"99 of 240 samples\""), "{begun}");
        assert_eq!(
            (again, text_again, log_again),
            (result.clone(), text.clone(), log)
        );
        // All lines exist, so that nothing is computed.
        let (again, text_again, _, begun) = attempt(3);
        assert_eq!((again, text_again, begun.as_str()), (result, text, ""));
    }

    #[test]
    fn a_line_holds_the_engine_s_numbers_for_the_design_s_row() {
        let spec = spec(5, 1);
        let lines = samples(&spec, 1).1;
        assert_eq!((lines[0].as_str(), lines.len()), (SAMPLES_HEADING, 9));
        let rows = design(&spec, 6).unwrap().rows(5..6);
        let mut input = CellInput::new(cardiotwin_cell_engine::DEFAULT_PARAMETERS, 1000.0, 1.1);
        // Positions according to the engine's own names.
        let names = cardiotwin_cell_engine::PARAMETER_NAMES;
        for (name, value) in ["Ca50_ref_uM", "tau_CR_ms", "k_WS_per_ms", "a_p_kPa"]
            .iter()
            .zip([rows[3][0], rows[3][1], rows[3][2], 42.0])
        {
            input.parameters[names.iter().position(|n| n == name).unwrap()] = value;
        }
        let settings = EngineSettings {
            negative_kwu: NegativeKwu::Keep,
            ..EngineSettings::default()
        };
        let mut output = [CellOutput::default()];
        CellEngine::new(settings)
            .unwrap()
            .evaluate(&[input], &mut Workspace::new(), &mut output)
            .unwrap();
        let fields: Vec<&str> = lines[4].split(',').collect();
        assert_eq!(&fields[..3], ["5", "3", "periodic"]);
        let number = |at: usize| fields[at].parse::<f64>().unwrap();
        assert_eq!(
            (number(3), number(7)),
            (
                output[0].reading.biomarkers.sa_max_kpa,
                output[0].reading.biomarkers.std90_ms
            )
        );
        assert_eq!(number(12), output[0].reading.max_rise_after_peak_kpa_per_ms);
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
            run(spec, &mut Context::plain(folder.path(), 1))
                .unwrap_err()
                .to_string()
        };
        refused.design.fixed.insert("rS".into(), 0.2);
        assert!(run(&refused).contains("`rS`"));
        let mut empty = spec(0, 1);
        empty.design.parameters[0].upper = f64::NAN;
        assert!(!run(&empty).is_empty());
    }
}

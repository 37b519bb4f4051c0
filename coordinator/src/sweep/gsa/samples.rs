//! What the chunks computed: read back from their artefacts, checked against their hashes, judged by the exclusion rule.

use std::path::Path;

use cardiotwin_calibrate::sobol::Sample;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::outcome::{Artefact, TaskResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::TaskRecord;
use cardiotwin_schemas::sensitivity::SampleCounts;
use cardiotwin_schemas::sweep::{ExclusionRule, GsaSpec, SAMPLES_HEADING};

use super::chunks;
use crate::sweep::SweepError;

/// Biomarkers of a sample, as `samples.csv` names them: the paper's five outputs.
pub const OUTPUTS: [&str; 5] = ["Sa_max_kPa", "dSadt_max_kPa_per_ms", "STD30_ms", "STD50_ms", "STD90_ms"];

/// The samples of a design's first blocks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// Complete blocks.
    pub n_blocks: u32,
    /// Biomarkers, shape (samples, [`OUTPUTS`]); not a number where a sample failed.
    pub values: Vec<f64>,
    /// What became of each.
    pub marks: Vec<Sample>,
    /// The same, counted.
    pub counts: SampleCounts,
    /// Instruction sets that computed them.
    pub arithmetic: Vec<String>,
}

/// A line of `samples.csv`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    outputs: [f64; 5],
    cut: bool,
    resting_kpa: f64,
    smallest_kpa: f64,
    rise_kpa_per_ms: f64,
    periodic: bool,
}

/// A member of the sweep's run with its published result, if it has one.
pub type Chunk<'a> = (&'a ResolvedPatient, Option<&'a TaskRecord<TaskResult>>);

/// The samples of the first chunks without a gap, at most those of `at_most` blocks; of what comes behind a missing chunk
/// nothing is read.
///
/// # Errors
/// [`SweepError`] when an artefact cannot be read or is not what was published.
pub fn read_first<'a>(
    spec: &GsaSpec,
    at_most: u32,
    chunks: impl IntoIterator<Item = Chunk<'a>>,
) -> Result<Samples, SweepError> {
    let mut samples = Samples::default();
    let rows_per_block = 2 * spec.design.parameters.len() + 2;
    for (member, task) in chunks {
        let (Some(blocks), Some(task)) = (chunks::blocks(member), task) else { break };
        if blocks.start != samples.n_blocks || blocks.end > spec.n_blocks || blocks.start >= at_most {
            break;
        }
        let Some(artefact) = task.artefacts.iter().find(|a| a.name == "samples") else { break };
        let path = task.directory.join(&artefact.file);
        let text = verified(&path, artefact)?;
        let end = blocks.end.min(at_most);
        let n_rows = (end - blocks.start) as usize * rows_per_block;
        let broken = |problem: String| SweepError::Samples { path: path.clone(), problem };
        let mut lines = text.lines();
        if lines.next() != Some(SAMPLES_HEADING) {
            return Err(broken("its first line is not the heading of samples".into()));
        }
        let before = samples.marks.len();
        let all = end == blocks.end;
        for (i, line) in lines.enumerate().take_while(|(i, _)| all || *i < n_rows) {
            let wanted = (blocks.start as usize + i / rows_per_block, i % rows_per_block);
            let line = parse(line, wanted).map_err(|problem| broken(format!("line {}: {problem}", i + 2)))?;
            samples.push(line, &spec.analysis.exclusion);
        }
        let found = samples.marks.len() - before;
        if found != n_rows {
            return Err(broken(format!("found {found} samples, expected {n_rows}")));
        }
        if let TaskResult::CellSweep(result) = &task.result
            && !samples.arithmetic.contains(&result.arithmetic)
        {
            samples.arithmetic.push(result.arithmetic.clone());
        }
        samples.n_blocks = end;
    }
    Ok(samples)
}

fn verified(path: &Path, artefact: &Artefact) -> Result<String, SweepError> {
    let bytes =
        std::fs::read(path).map_err(|source| SweepError::File { what: "read", path: path.to_owned(), source })?;
    let found = sha256_hex(&bytes);
    if found != artefact.sha256 {
        let problem = format!("its SHA-256 is {found}, but {} was published", artefact.sha256);
        return Err(SweepError::Samples { path: path.to_owned(), problem });
    }
    String::from_utf8(bytes)
        .map_err(|_| SweepError::Samples { path: path.to_owned(), problem: "it is not text".into() })
}

/// A sample; none for one that was not computed.
fn parse(line: &str, (block, row): (usize, usize)) -> Result<Option<Line>, String> {
    let mut fields = line.split(',');
    let mut next = |name: &str| fields.next().ok_or_else(|| format!("{name} is missing"));
    for (name, wanted) in [("block", block), ("row", row)] {
        let found = next(name)?;
        if found.parse() != Ok(wanted) {
            return Err(format!("{name} is {found}, expected {wanted}"));
        }
    }
    let periodic = match next("status")? {
        "periodic" => true,
        "not-periodic" => false,
        "stuck" | "refused" => return Ok(None),
        other => return Err(format!("there is no status `{other}`")),
    };
    let mut number = |name: &str| {
        let text = next(name)?;
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| format!("{name} is `{text}`, expected a number"))
    };
    let mut outputs = [0.0; 5];
    for (output, name) in outputs.iter_mut().zip(OUTPUTS) {
        *output = number(name)?;
    }
    let cut = number("cut")? != 0.0;
    number("lambda_min")?;
    Ok(Some(Line {
        outputs,
        cut,
        resting_kpa: number("Sa_res_kPa")?,
        smallest_kpa: number("Sa_min_kPa")?,
        rise_kpa_per_ms: number("rise_after_peak_kPa_per_ms")?,
        periodic,
    }))
}

impl Line {
    /// The constraints that the sample breaks.
    fn breaks(&self, rule: &ExclusionRule) -> impl Iterator<Item = &'static str> {
        let largest = self.outputs[0];
        let broken = [
            (self.resting_kpa > rule.resting_share * largest, "resting stress"),
            (self.rise_kpa_per_ms > rule.rise_after_peak_kpa_per_ms, "stress rises after its maximum"),
            (self.smallest_kpa < -rule.negative_stress_kpa, "negative stress"),
            (self.cut, "a duration has no end"),
        ];
        broken.into_iter().filter(|(broken, _)| *broken).map(|(_, name)| name)
    }
}

impl Samples {
    fn push(&mut self, line: Option<Line>, rule: &ExclusionRule) {
        self.counts.total += 1;
        let Some(line) = line else {
            self.counts.failed += 1;
            self.values.extend([f64::NAN; OUTPUTS.len()]);
            self.marks.push(Sample::Failed);
            return;
        };
        self.values.extend(line.outputs);
        self.counts.not_periodic += u64::from(!line.periodic);
        let mut excluded = false;
        for constraint in line.breaks(rule) {
            excluded = true;
            // A name is made once for each constraint, not for each sample.
            match self.counts.excluded_by.get_mut(constraint) {
                Some(count) => *count += 1,
                None => drop(self.counts.excluded_by.insert(constraint.to_owned(), 1)),
            }
        }
        if excluded {
            self.counts.excluded += 1;
            self.marks.push(Sample::Excluded);
        } else {
            self.counts.physiological += 1;
            self.marks.push(Sample::Physiological);
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::path::PathBuf;

    use cardiotwin_schemas::ids::TaskKey;
    use cardiotwin_schemas::outcome::CellSweepResult;
    use cardiotwin_schemas::provenance::Provenance;

    use super::super::spec::{Wishes, published};
    use super::*;

    /// A sweep of two parameters (all others fixed) in chunks of two blocks.
    pub fn small(n_blocks: u32) -> GsaSpec {
        let set = super::super::spec::BOX[2..].iter().map(|(name, lower, _)| ((*name).to_owned(), *lower)).collect();
        let wishes = Wishes { samples: Some(n_blocks), chunk_blocks: Some(2), set, ..Wishes::default() };
        wishes.on(published()).unwrap()
    }

    /// A chunk's file of the lines that `line` gives for each block and row, and its record.
    pub fn publish(
        folder: &Path,
        member: &ResolvedPatient,
        rows_per_block: usize,
        line: impl Fn(u32, usize) -> String,
    ) -> TaskRecord<TaskResult> {
        let blocks = chunks::blocks(member).unwrap();
        let mut text = format!("{SAMPLES_HEADING}\n");
        for block in blocks.clone() {
            (0..rows_per_block).for_each(|row| text += &format!("{block},{row},{}\n", line(block, row)));
        }
        let directory = folder.join(member.id.as_str());
        std::fs::create_dir_all(&directory).unwrap();
        std::fs::write(directory.join("samples.csv"), &text).unwrap();
        let n_samples = (blocks.len() * rows_per_block) as u64;
        TaskRecord {
            key: TaskKey(member.id.to_string()),
            generation: 1,
            directory,
            artefacts: vec![Artefact {
                name: "samples".into(),
                file: "samples.csv".into(),
                sha256: sha256_hex(text.as_bytes()),
                bytes: text.len() as u64,
            }],
            provenance: Provenance::default(),
            result: TaskResult::CellSweep(CellSweepResult {
                n_samples,
                n_periodic: n_samples,
                n_not_periodic: 0,
                n_stuck: 0,
                n_refused: 0,
                arithmetic: "portable".into(),
            }),
        }
    }

    fn read(spec: &GsaSpec, tasks: &[Option<TaskRecord<TaskResult>>]) -> Result<Samples, SweepError> {
        let members = chunks::members(spec);
        read_first(spec, u32::MAX, members.iter().zip(tasks.iter().map(Option::as_ref)))
    }

    #[test]
    fn samples_are_judged_by_each_constraint_and_failed_ones_kept_apart() {
        let folder = tempfile::tempdir().unwrap();
        let spec = small(2);
        let lines = [
            "periodic,10.0,0.1,100.0,150.0,200.0,0,0.9,0.5,0.0,0.0,2",
            "not-periodic,10.0,0.1,100.0,150.0,200.0,0,0.9,1.0,-1e-5,3e-5,50",
            "periodic,10.0,0.1,100.0,150.0,200.0,0,0.9,1.1,0.0,0.0,2",
            "periodic,10.0,0.1,100.0,150.0,200.0,1,0.9,1.1,-0.1,0.0,2",
            "periodic,10.0,0.1,100.0,150.0,200.0,0,0.9,0.0,0.0,4e-5,2",
            "stuck,,,,,,,,,,,1",
        ];
        let task = publish(folder.path(), &chunks::members(&spec)[0], 6, |_, row| lines[row].to_owned());
        let samples = read(&spec, &[Some(task)]).unwrap();
        let counts = &samples.counts;
        assert_eq!((counts.total, counts.physiological, counts.excluded, counts.failed), (12, 4, 6, 2));
        assert_eq!(counts.not_periodic, 2);
        let by: Vec<(&str, u64)> = counts.excluded_by.iter().map(|(name, n)| (name.as_str(), *n)).collect();
        assert_eq!(
            by,
            [
                ("a duration has no end", 2),
                ("negative stress", 2),
                ("resting stress", 4),
                ("stress rises after its maximum", 2)
            ]
        );
        assert_eq!(samples.marks[5], Sample::Failed);
        assert!(samples.values[25..30].iter().all(|v| v.is_nan()));
        assert_eq!((samples.n_blocks, samples.arithmetic), (2, vec!["portable".to_owned()]));
    }

    #[test]
    fn only_the_first_chunks_without_a_gap_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let spec = small(7);
        let members = chunks::members(&spec);
        let line = |block: u32, _: usize| format!("periodic,{block}.0,0.1,100.0,150.0,200.0,0,0.9,0.0,0.0,0.0,2");
        let mut tasks: Vec<_> = members.iter().map(|m| Some(publish(folder.path(), m, 6, line))).collect();
        let whole = read(&spec, &tasks).unwrap();
        assert_eq!((whole.n_blocks, whole.marks.len(), whole.values[6 * 6 * 5]), (7, 42, 6.0));
        let chunks = members.iter().zip(tasks.iter().map(Option::as_ref));
        let three = read_first(&spec, 3, chunks).unwrap();
        assert_eq!((three.n_blocks, three.values.as_slice()), (3, &whole.values[..3 * 6 * 5]));
        tasks[2] = None;
        let first = read(&spec, &tasks).unwrap();
        assert_eq!((first.n_blocks, first.values.as_slice()), (4, &whole.values[..4 * 6 * 5]));
        tasks[0] = None;
        assert_eq!(read(&spec, &tasks).unwrap(), Samples::default());
    }

    #[test]
    fn a_file_that_is_not_the_published_one_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let spec = small(2);
        let good = "periodic,1.0,0.1,100.0,150.0,200.0,0,0.9,0.0,0.0,0.0,2";
        let member = &chunks::members(&spec)[0];
        let said = |line: &dyn Fn(u32, usize) -> String, rows| {
            let task = publish(folder.path(), member, rows, line);
            read(&spec, &[Some(task)]).unwrap_err().to_string()
        };
        let cases: [(&str, usize, &str); 3] = [
            ("odd,1", 6, "line 2: there is no status `odd`"),
            ("periodic,NaN", 6, "line 2: Sa_max_kPa is `NaN`"),
            (good, 5, "line 7: block is 1, expected 0"),
        ];
        for (line, rows, expected) in cases {
            let text = said(&|_, _| line.to_owned(), rows);
            assert!(text.contains(expected), "{text}");
        }
        let task = publish(folder.path(), member, 6, |_, _| good.to_owned());
        let path: PathBuf = task.directory.join("samples.csv");
        std::fs::write(&path, "").unwrap();
        assert!(read(&spec, &[Some(task)]).unwrap_err().to_string().contains("its SHA-256 is"));
    }
}

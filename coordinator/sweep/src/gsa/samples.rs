//! Results of the chunks: read from their artefacts, checked against their hashes, and judged by
//! the exclusion rule.

use std::path::Path;

use cardiotwin_calibrate::sobol::Sample;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::outcome::{Artefact, TaskResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::TaskRecord;
use cardiotwin_schemas::sensitivity::SampleCounts;
use cardiotwin_schemas::sweep::{ExclusionRule, GsaSpec, ORGAN_SAMPLES_HEADING, SAMPLES_HEADING};

use super::chunks;
use crate::SweepError;

/// The samples of a design's first blocks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// Number of complete blocks.
    pub n_blocks: u32,
    /// Biomarkers, shape (samples, outputs of the design), row-major; NaN for a failed sample.
    pub values: Vec<f64>,
    /// Judgement of each sample.
    pub marks: Vec<Sample>,
    /// Numbers of samples by judgement.
    pub counts: SampleCounts,
    /// Instruction sets with which the samples were computed.
    pub arithmetic: Vec<String>,
}

/// A computed sample with the verdict of the exclusion rule.
#[derive(Debug, Clone, PartialEq)]
struct Judged {
    /// Biomarkers in the order of
    /// [`CellDesign::outputs`](cardiotwin_schemas::sweep::CellDesign::outputs); NaN for an absent
    /// one.
    outputs: [f64; MOST_OUTPUTS],
    /// Constraints that the sample breaks.
    breaks: Vec<&'static str>,
    periodic: bool,
}

/// Largest number of biomarkers of a sample.
const MOST_OUTPUTS: usize = 7;

/// A member of the sweep's run with its published result, if it has one.
pub type Chunk<'a> = (&'a ResolvedPatient, Option<&'a TaskRecord<TaskResult>>);

/// Samples of the first chunks before a gap, from at most `at_most` blocks. Chunks behind a missing
/// one are not read.
///
/// # Errors
/// [`SweepError`] if an artefact cannot be read or differs from the published one.
pub fn read_first<'a>(
    spec: &GsaSpec,
    at_most: u32,
    chunks: impl IntoIterator<Item = Chunk<'a>>,
) -> Result<Samples, SweepError> {
    let mut samples = Samples::default();
    let rows_per_block = 2 * spec.design.parameters.len() + 2;
    let heading = if spec.design.organ.is_some() {
        ORGAN_SAMPLES_HEADING
    } else {
        SAMPLES_HEADING
    };
    for (member, task) in chunks {
        let (Some(blocks), Some(task)) = (chunks::blocks(member), task) else {
            break;
        };
        if blocks.start != samples.n_blocks || blocks.end > spec.n_blocks || blocks.start >= at_most
        {
            break;
        }
        let Some(artefact) = task.artefacts.iter().find(|a| a.name == "samples") else {
            break;
        };
        let path = task.directory.join(&artefact.file);
        let text = verified(&path, artefact)?;
        let end = blocks.end.min(at_most);
        let n_rows = (end - blocks.start) as usize * rows_per_block;
        let broken = |problem: String| SweepError::Samples {
            path: path.clone(),
            problem,
        };
        let mut lines = text.lines();
        if lines.next() != Some(heading) {
            return Err(broken("the first line is not the header of samples".into()));
        }
        let before = samples.marks.len();
        let all = end == blocks.end;
        for (i, line) in lines.enumerate().take_while(|(i, _)| all || *i < n_rows) {
            let wanted = (
                blocks.start as usize + i / rows_per_block,
                i % rows_per_block,
            );
            let judged = parse(line, wanted, spec)
                .map_err(|problem| broken(format!("line {}: {problem}", i + 2)))?;
            samples.push(judged, spec.design.outputs().len());
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
    let bytes = std::fs::read(path).map_err(|source| SweepError::File {
        what: "read",
        path: path.to_owned(),
        source,
    })?;
    let found = sha256_hex(&bytes);
    if found != artefact.sha256 {
        let problem = format!(
            "the SHA-256 is {found}, but {} was published",
            artefact.sha256
        );
        return Err(SweepError::Samples {
            path: path.to_owned(),
            problem,
        });
    }
    String::from_utf8(bytes).map_err(|_| SweepError::Samples {
        path: path.to_owned(),
        problem: "it is not text".into(),
    })
}

/// Parses a line of samples; `None` for a sample that was not computed.
fn parse(
    line: &str,
    (block, row): (usize, usize),
    spec: &GsaSpec,
) -> Result<Option<Judged>, String> {
    let mut fields = line.split(',');
    for (name, wanted) in [("block", block), ("row", row)] {
        let found = fields.next().ok_or_else(|| format!("{name} is missing"))?;
        if found.parse() != Ok(wanted) {
            return Err(format!("{name} is {found}, expected {wanted}"));
        }
    }
    let status = fields.next().ok_or("status is missing")?;
    let mut fields = Fields {
        fields,
        outputs: spec.design.outputs(),
    };
    match (status, spec.design.organ.is_some()) {
        ("periodic", false) => fields.cell(true, &spec.analysis.exclusion).map(Some),
        ("not-periodic", false) => fields.cell(false, &spec.analysis.exclusion).map(Some),
        ("finished", true) => fields.organ().map(Some),
        // The sample counts as not physiological, because the cell with these parameters does not
        // exist.
        ("refused", true) => {
            let breaks = vec!["the cell has no meaning"];
            Ok(Some(Judged {
                outputs: [f64::NAN; MOST_OUTPUTS],
                breaks,
                periodic: true,
            }))
        }
        ("stuck" | "refused", false) | ("diverged", true) => Ok(None),
        (other, _) => Err(format!("unknown status `{other}`")),
    }
}

/// Fields of a line after its status.
struct Fields<'a, I> {
    fields: I,
    outputs: &'a [&'static str],
}

impl<'a, I: Iterator<Item = &'a str>> Fields<'_, I> {
    fn text(&mut self, name: &str) -> Result<&'a str, String> {
        self.fields
            .next()
            .ok_or_else(|| format!("{name} is missing"))
    }

    fn number(&mut self, name: &str) -> Result<f64, String> {
        let text = self.text(name)?;
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| format!("{name} is `{text}`, expected a number"))
    }

    fn cell(&mut self, periodic: bool, rule: &ExclusionRule) -> Result<Judged, String> {
        let mut outputs = [f64::NAN; MOST_OUTPUTS];
        for (output, name) in outputs.iter_mut().zip(self.outputs) {
            *output = self.number(name)?;
        }
        let cut = self.number("cut")? != 0.0;
        self.number("lambda_min")?;
        let broken = [
            (
                self.number("Sa_res_kPa")? > rule.resting_share * outputs[0],
                "resting stress",
            ),
            (
                self.number("Sa_min_kPa")? < -rule.negative_stress_kpa,
                "negative stress",
            ),
            (
                self.number("rise_after_peak_kPa_per_ms")? > rule.rise_after_peak_kpa_per_ms,
                "stress rises after its maximum",
            ),
            (cut, "a duration has no end"),
        ];
        let breaks = broken
            .into_iter()
            .filter(|(broken, _)| *broken)
            .map(|(_, name)| name)
            .collect();
        Ok(Judged {
            outputs,
            breaks,
            periodic,
        })
    }

    fn organ(&mut self) -> Result<Judged, String> {
        let mut outputs = [f64::NAN; MOST_OUTPUTS];
        let mut absent = false;
        for (output, name) in outputs.iter_mut().zip(self.outputs) {
            match self.text(name)? {
                "" => absent = true,
                text => {
                    *output = text
                        .parse()
                        .map_err(|_| format!("{name} is `{text}`, expected a number"))?
                }
            }
        }
        let shut = self.number("shut")? != 0.0;
        let broken = [
            (shut, "a valve stays shut"),
            (absent && !shut, "a biomarker is absent"),
        ];
        let breaks = broken
            .into_iter()
            .filter(|(broken, _)| *broken)
            .map(|(_, name)| name)
            .collect();
        Ok(Judged {
            outputs,
            breaks,
            periodic: true,
        })
    }
}

impl Samples {
    fn push(&mut self, judged: Option<Judged>, n_outputs: usize) {
        self.counts.total += 1;
        let Some(judged) = judged else {
            self.counts.failed += 1;
            self.values.extend(std::iter::repeat_n(f64::NAN, n_outputs));
            self.marks.push(Sample::Failed);
            return;
        };
        self.values.extend(&judged.outputs[..n_outputs]);
        self.counts.not_periodic += u64::from(!judged.periodic);
        for constraint in &judged.breaks {
            // The name is allocated once per constraint and not once per sample.
            match self.counts.excluded_by.get_mut(*constraint) {
                Some(count) => *count += 1,
                None => drop(self.counts.excluded_by.insert((*constraint).to_owned(), 1)),
            }
        }
        if judged.breaks.is_empty() {
            self.counts.physiological += 1;
            self.marks.push(Sample::Physiological);
        } else {
            self.counts.excluded += 1;
            self.marks.push(Sample::Excluded);
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::path::PathBuf;

    use cardiotwin_schemas::ids::TaskKey;
    use cardiotwin_schemas::outcome::CellSweepResult;
    use cardiotwin_schemas::provenance::Provenance;

    use super::super::spec::tests::organ;
    use super::super::spec::{DesignOptions, of_organ, published};
    use super::*;

    /// A sweep of two parameters (all others fixed) in chunks of two blocks.
    pub fn small(n_blocks: u32) -> GsaSpec {
        let set = cardiotwin_schemas::cell::cell_intervals()
            .skip(2)
            .map(|(name, [lower, _])| (name.to_owned(), lower))
            .collect();
        let wishes = DesignOptions {
            samples: Some(n_blocks),
            chunk_blocks: Some(2),
            set,
            ..DesignOptions::default()
        };
        wishes.on(published()).unwrap()
    }

    /// Writes a chunk's file with the lines that `line` gives for each block and row, and returns
    /// its record.
    pub fn publish(
        folder: &Path,
        member: &ResolvedPatient,
        rows_per_block: usize,
        line: impl Fn(u32, usize) -> String,
    ) -> TaskRecord<TaskResult> {
        publish_as(folder, member, SAMPLES_HEADING, rows_per_block, line)
    }

    fn publish_as(
        folder: &Path,
        member: &ResolvedPatient,
        heading: &str,
        rows_per_block: usize,
        line: impl Fn(u32, usize) -> String,
    ) -> TaskRecord<TaskResult> {
        let blocks = chunks::blocks(member).unwrap();
        let mut text = format!("{heading}\n");
        for block in blocks.clone() {
            (0..rows_per_block)
                .for_each(|row| text += &format!("{block},{row},{}\n", line(block, row)));
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

    fn read(
        spec: &GsaSpec,
        tasks: &[Option<TaskRecord<TaskResult>>],
    ) -> Result<Samples, SweepError> {
        let members = chunks::members(spec);
        read_first(
            spec,
            u32::MAX,
            members.iter().zip(tasks.iter().map(Option::as_ref)),
        )
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
        let task = publish(folder.path(), &chunks::members(&spec)[0], 6, |_, row| {
            lines[row].to_owned()
        });
        let samples = read(&spec, &[Some(task)]).unwrap();
        let counts = &samples.counts;
        assert_eq!(
            (
                counts.total,
                counts.physiological,
                counts.excluded,
                counts.failed
            ),
            (12, 4, 6, 2)
        );
        assert_eq!(counts.not_periodic, 2);
        let by: Vec<(&str, u64)> = counts
            .excluded_by
            .iter()
            .map(|(name, n)| (name.as_str(), *n))
            .collect();
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
        assert_eq!(
            (samples.n_blocks, samples.arithmetic),
            (2, vec!["portable".to_owned()])
        );
    }

    #[test]
    fn samples_of_an_organ_are_excluded_where_a_valve_stays_shut_or_the_cell_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let set = cardiotwin_schemas::cell::cell_intervals()
            .skip(2)
            .map(|(name, [lower, _])| (name.to_owned(), lower))
            .collect();
        let wishes = DesignOptions {
            samples: Some(2),
            set,
            ..DesignOptions::default()
        };
        let spec = wishes.on(of_organ(organ("p1", 2.0), 1.1)).unwrap();
        let lines = [
            "finished,120.0,1.5,-1.4,300.0,80.0,40.0,60.0,0",
            "finished,20.0,0.2,-0.2,300.0,,,,1",
            "finished,120.0,1.5,-1.4,300.0,80.0,,60.0,0",
            "refused,,,,,,,,",
            "diverged,,,,,,,,",
            "finished,120.0,1.5,-1.4,300.0,80.0,40.0,60.0,0",
        ];
        let publish = |lines: &[&str]| {
            let member = &chunks::members(&spec)[0];
            publish_as(folder.path(), member, ORGAN_SAMPLES_HEADING, 6, |_, row| {
                lines[row].to_owned()
            })
        };
        let samples = read(&spec, &[Some(publish(&lines))]).unwrap();
        let counts = &samples.counts;
        assert_eq!(
            (
                counts.total,
                counts.physiological,
                counts.excluded,
                counts.failed
            ),
            (12, 4, 6, 2)
        );
        let by: Vec<(&str, u64)> = counts
            .excluded_by
            .iter()
            .map(|(name, n)| (name.as_str(), *n))
            .collect();
        assert_eq!(
            by,
            [
                ("a biomarker is absent", 2),
                ("a valve stays shut", 2),
                ("the cell has no meaning", 2)
            ]
        );
        assert_eq!((samples.values.len(), samples.values[6]), (12 * 7, 60.0));
        let said = read(&spec, &[Some(publish(&["periodic,1.0"; 6]))])
            .unwrap_err()
            .to_string();
        assert!(said.contains("unknown status `periodic`"), "{said}");
    }

    #[test]
    fn only_the_first_chunks_without_a_gap_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let spec = small(7);
        let members = chunks::members(&spec);
        let line = |block: u32, _: usize| {
            format!("periodic,{block}.0,0.1,100.0,150.0,200.0,0,0.9,0.0,0.0,0.0,2")
        };
        let mut tasks: Vec<_> = members
            .iter()
            .map(|m| Some(publish(folder.path(), m, 6, line)))
            .collect();
        let whole = read(&spec, &tasks).unwrap();
        assert_eq!(
            (whole.n_blocks, whole.marks.len(), whole.values[6 * 6 * 5]),
            (7, 42, 6.0)
        );
        let chunks = members.iter().zip(tasks.iter().map(Option::as_ref));
        let three = read_first(&spec, 3, chunks).unwrap();
        assert_eq!(
            (three.n_blocks, three.values.as_slice()),
            (3, &whole.values[..3 * 6 * 5])
        );
        tasks[2] = None;
        let first = read(&spec, &tasks).unwrap();
        assert_eq!(
            (first.n_blocks, first.values.as_slice()),
            (4, &whole.values[..4 * 6 * 5])
        );
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
            ("odd,1", 6, "line 2: unknown status `odd`"),
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
        assert!(
            read(&spec, &[Some(task)])
                .unwrap_err()
                .to_string()
                .contains("the SHA-256 is")
        );
    }
}

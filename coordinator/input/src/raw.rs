//! A folder of recordings: `prepare.toml` and the files that it names, read and checked.

use std::path::{Path, PathBuf};

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_lab_files::{Request, Table, UNREAD, Wanted, read};
use cardiotwin_recordings::cine::{Cine, CineError, cycle_of};
use cardiotwin_recordings::recording::{Channels, Recording, RecordingError};
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::preparation::RawInput;
use cardiotwin_schemas::raw::{BeatSource, FileFormat, RawFile};
use cardiotwin_signals::checks::{Facts, LARGEST_ML, VOLUME_KEY, contradictions};
use cardiotwin_signals::{Problem, Quantity, Trace};

use super::cohort::read_as;
use super::document::Document;
use super::layers::position_of;
use super::report::Report;

/// Name of the folder's settings file.
pub const PREPARE_TOML: &str = "prepare.toml";
/// Endings of files with known formats.
const ENDINGS: [&str; 11] = [
    "csv", "txt", "tsv", "xlsx", "xlsm", "xlsb", "xls", "ods", "edf", "bdf", "hea",
];
/// Factor from kPa to mmHg.
const MMHG_PER_KPA: f64 = cardiotwin_units::MMHG_PER_KPA;
/// Factor from L/min to mL/s.
const ML_PER_S_PER_L_PER_MIN: f64 = 1000.0 / 60.0;

/// A folder of recordings that was read without errors.
#[derive(Debug, Clone)]
pub struct RawFolder {
    /// Content of `prepare.toml`: columns, files and settings of the preparation.
    pub file: RawFile,
    /// Recording of the catheter.
    pub recording: Recording,
    /// The cine series, if there is one.
    pub cine: Option<Cine>,
    /// Flow of one cycle, with times in ms and flows in mL/s; `None` without a file of flow.
    pub flow: Option<(Vec<f64>, Vec<f64>)>,
    /// Files that were read, with their hashes and numbers of rows.
    pub inputs: Vec<RawInput>,
    /// Command that makes the patient, for the first line of `patient.toml`.
    pub made_by: &'static str,
}

/// Reads a folder of recordings. Every problem goes to `report`. `None` if any problem is an error.
pub fn read_raw(folder: &Path, report: &mut Report) -> Option<RawFolder> {
    let path = folder.join(PREPARE_TOML);
    let (document, given) = if path.exists() {
        let document = Document::read(&path, None, report)?;
        let file: RawFile = read_as(&document, None, report)?;
        (document, file)
    } else {
        (Document::parse(&path, "", None, report), RawFile::default())
    };
    let mut reader = Reader {
        folder,
        document: &document,
        report,
        inputs: Vec::new(),
    };
    reader.check(&given);
    let catheter = reader.catheter(&given);
    let cine = reader.cine(&given);
    let flow = reader.flow(&given);
    let inputs = std::mem::take(&mut reader.inputs);
    let recording = catheter?;
    (report.n_errors() == 0).then_some(RawFolder {
        file: given,
        recording,
        cine,
        flow,
        inputs,
        made_by: "cardiotwin prepare",
    })
}

struct Reader<'a> {
    folder: &'a Path,
    document: &'a Document,
    report: &'a mut Report,
    inputs: Vec<RawInput>,
}

impl Reader<'_> {
    fn error(
        &mut self,
        key: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        let problem = Problem::error(&self.document.file, found, expected, remedy);
        let at = position_of(self.document, key);
        self.report.add(None, problem.at_key(key).at(at));
    }

    fn range(&mut self, key: &str, value: Option<f64>, low: f64, high: f64, unit: &str) {
        if let Some(value) = value.filter(|value| !(low..=high).contains(value)) {
            let expected = format!("{low} to {high} {unit}");
            self.error(
                key,
                format!("{value} {unit}"),
                expected.trim_end(),
                "check the number and its unit",
            );
        }
    }

    fn check(&mut self, file: &RawFile) {
        if let Some(id) = &file.id {
            let sound = !id.is_empty()
                && id.len() <= 64
                && id
                    .chars()
                    .all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c));
            if !sound || id.starts_with('.') {
                self.error(
                    "id",
                    format!("{id:?}"),
                    "letters, digits, `-`, `_` and `.`",
                    "choose a pseudonym: it is the name of a folder",
                );
            }
        }
        self.range(
            "cine.cycle_length_ms",
            file.cine.cycle_length_ms,
            200.0,
            3000.0,
            "ms",
        );
        self.range("flow.sd_mL", file.flow.sd_ml, 0.0, 200.0, "mL");
        self.range(
            "anatomy.wall_volume_mL",
            file.anatomy.wall_volume_ml,
            1.0,
            1000.0,
            "mL",
        );
        if let Some(image) = &file.whole_heart {
            self.range(
                "whole_heart.volume_mL",
                Some(image.volume_ml),
                5.0,
                1000.0,
                "mL",
            );
            self.range("whole_heart.sd_mL", image.sd_ml, 0.0, 200.0, "mL");
            self.range(
                "whole_heart.time_ms",
                Some(image.time_ms),
                0.0,
                3000.0,
                "ms",
            );
        }
        if let Some(cuff) = &file.cuff {
            self.range(
                "cuff.systolic_mmHg",
                Some(cuff.systolic_mmhg),
                30.0,
                350.0,
                "mmHg",
            );
            self.range(
                "cuff.diastolic_mmHg",
                Some(cuff.diastolic_mmhg),
                10.0,
                250.0,
                "mmHg",
            );
            self.range("cuff.sd_mmHg", cuff.sd_mmhg, 0.0, 100.0, "mmHg");
            if cuff.diastolic_mmhg >= cuff.systolic_mmhg {
                let found = format!(
                    "{} mmHg at a systolic pressure of {} mmHg",
                    cuff.diastolic_mmhg, cuff.systolic_mmhg
                );
                self.error(
                    "cuff.diastolic_mmHg",
                    found,
                    "diastolic below systolic",
                    "swap the two or correct them",
                );
            }
            let between = cuff.diastolic_mmhg..=cuff.systolic_mmhg;
            if let Some(mean) = cuff.mean_mmhg.filter(|mean| !between.contains(mean)) {
                self.error(
                    "cuff.mean_mmHg",
                    format!("{mean} mmHg"),
                    "a pressure between both",
                    "correct or remove it",
                );
            }
        }
        let steps = &file.steps;
        self.range(
            "steps.average.cycle_length_ms",
            steps.average.cycle_length_ms,
            200.0,
            3000.0,
            "ms",
        );
        self.range("steps.volume.factor", steps.volume.factor, 0.1, 10.0, "");
        self.range(
            "steps.cycle.systole_factor",
            steps.cycle.systole_factor,
            0.3,
            3.0,
            "",
        );
        self.range(
            "steps.synchronise.lag_ms",
            steps.synchronise.lag_ms,
            -2000.0,
            2000.0,
            "ms",
        );
        self.range(
            "steps.noise.pressure_rms_mmHg",
            steps.noise.pressure_rms_mmhg,
            0.0,
            50.0,
            "mmHg",
        );
        self.range(
            "steps.noise.pressure_correlation_ms",
            steps.noise.pressure_correlation_ms,
            0.0,
            1000.0,
            "ms",
        );
        self.range(
            "steps.noise.volume_rms_mL",
            steps.noise.volume_rms_ml,
            0.0,
            100.0,
            "mL",
        );
        let given = steps.beats.source == Some(BeatSource::Given);
        if given == steps.beats.onsets_ms.is_empty() {
            let (found, remedy) = if given {
                (
                    "no times, and source = \"given\"",
                    "give the times, or another source",
                )
            } else {
                (
                    "times, and a source that does not use them",
                    "add source = \"given\" to [steps.beats], or remove the times",
                )
            };
            self.error("steps.beats.onsets_ms", found, "both or none", remedy);
        }
        if !steps.beats.onsets_ms.windows(2).all(|w| w[1] > w[0]) {
            self.error(
                "steps.beats.onsets_ms",
                "times that do not increase",
                "increasing times",
                "sort them",
            );
        }
        for number in steps
            .reject
            .keep
            .iter()
            .filter(|number| steps.reject.leave_out.contains(number))
        {
            let found = format!("beat {number} in both keep and leave_out");
            self.error(
                "steps.reject.keep",
                found,
                "each beat in only one of them",
                "remove it from the other",
            );
        }
    }

    /// Path and content of the named file, or of a file with the usual name and the ending of a
    /// known format. Problems are reported at `key`.
    fn bytes(
        &mut self,
        key: &str,
        named: Option<&String>,
        usual: &str,
    ) -> Option<(PathBuf, Vec<u8>)> {
        let name = match named {
            Some(name) => name.clone(),
            None => self.usual_name(key, usual)?,
        };
        let path = self.folder.join(&name);
        match input_files::read(&path, MaxBytes::TRACE) {
            Ok(bytes) => {
                self.inputs.push(input(&name, &bytes));
                Some((path, bytes))
            }
            Err(error) => {
                let found = format!(
                    "{name:?}, but no readable file {} ({error})",
                    path.display()
                );
                self.error(
                    key,
                    found,
                    "a file of a known format in the folder of the recordings",
                    "put the file there or correct its name",
                );
                None
            }
        }
    }

    fn usual_name(&mut self, key: &str, usual: &str) -> Option<String> {
        let names: Vec<String> = ENDINGS
            .iter()
            .map(|ending| format!("{usual}.{ending}"))
            .filter(|name| self.folder.join(name).exists())
            .collect();
        if names.len() > 1 {
            self.error(
                key,
                format!("the files {}", names.join(" and ")),
                "one file",
                format!(
                    "name the right one in prepare.toml: {key} = \"{}\"",
                    names[0]
                ),
            );
            return None;
        }
        names.into_iter().next()
    }

    fn table(
        &mut self,
        path: &Path,
        bytes: &[u8],
        wanted: &[Wanted],
        form: Form<'_>,
    ) -> Option<Table> {
        let request = Request {
            file: path,
            wanted,
            format: form.format,
            sheet: form.sheet,
            block: form.block,
        };
        let mut more = Vec::new();
        let folder = path.parent().unwrap_or(self.folder);
        let within = path.strip_prefix(self.folder).ok().and_then(Path::parent);
        let mut beside = |name: &str| {
            let bytes = input_files::read(&folder.join(name), MaxBytes::TRACE)
                .map_err(|error| error.to_string())?;
            let name = within.map_or_else(|| name.into(), |within| within.join(name));
            more.push(input(&name.to_string_lossy(), &bytes));
            Ok(bytes)
        };
        let reading = read(bytes, &request, &mut beside);
        reading
            .problems
            .into_iter()
            .for_each(|problem| self.report.add(None, problem));
        let table = reading.table?;
        if let Some(input) = self.inputs.last_mut() {
            input.n_rows = table.columns.values().next().map_or(0, Vec::len);
            input.read_as.clone_from(&table.said);
        }
        self.inputs.extend(more);
        Some(table)
    }

    fn catheter(&mut self, file: &RawFile) -> Option<Recording> {
        let key = "catheter.file";
        let columns = &file.catheter.columns;
        let Some((path, bytes)) = self.bytes(key, file.catheter.file.as_ref(), "catheter") else {
            if file.catheter.file.is_none() && self.report.n_errors() == 0 {
                let found = format!("no catheter.csv in {}", self.folder.display());
                let remedy = "put the recording there, or name it in [catheter] of prepare.toml; docs/prepare.md has an example";
                self.error(key, found, "a continuous recording with a pressure", remedy);
            }
            return None;
        };
        let wanted = [
            time(&columns.time_ms, &columns.time_s),
            channel(
                "lv_pressure",
                &[
                    ("lv_pressure_mmHg", &columns.lv_pressure_mmhg, 1.0),
                    ("lv_pressure_kPa", &columns.lv_pressure_kpa, MMHG_PER_KPA),
                ],
            ),
            channel(
                "aortic_pressure",
                &[
                    ("aortic_pressure_mmHg", &columns.aortic_pressure_mmhg, 1.0),
                    (
                        "aortic_pressure_kPa",
                        &columns.aortic_pressure_kpa,
                        MMHG_PER_KPA,
                    ),
                ],
            ),
            channel(
                "flow",
                &[
                    ("flow_mL_per_s", &columns.flow_ml_per_s, 1.0),
                    (
                        "flow_L_per_min",
                        &columns.flow_l_per_min,
                        ML_PER_S_PER_L_PER_MIN,
                    ),
                ],
            ),
            channel(
                "ecg",
                &[
                    ("ecg_mV", &columns.ecg_mv, 1.0),
                    ("ecg_uV", &columns.ecg_uv, 1e-3),
                ],
            ),
        ];
        let form = Form {
            format: file.catheter.format,
            sheet: file.catheter.sheet.as_deref(),
            block: file.catheter.block,
        };
        let mut table = self.table(&path, &bytes, &wanted, form)?;
        // A channel that was not connected has no samples, or one value.
        let with_samples = |quantity: &str| {
            let values = table.columns.get(quantity)?;
            let mut finite = values.iter().filter(|v| v.is_finite());
            let first = finite.next();
            Some(first.is_some_and(|first| finite.any(|v| v != first)))
        };
        let empty: Vec<&str> = ["lv_pressure", "aortic_pressure", "flow"]
            .into_iter()
            .filter(|quantity| with_samples(quantity) == Some(false))
            .collect();
        for quantity in empty {
            let name = table.names.get(quantity).cloned().unwrap_or_default();
            let values = &table.columns[quantity];
            let found = match values.iter().find(|v| v.is_finite()) {
                None => format!("column `{name}` without a single sample"),
                Some(only) => format!("column `{name}` with the value {only} alone"),
            };
            let is_named = wanted
                .iter()
                .any(|wanted| wanted.quantity == quantity && wanted.given);
            // The ventricle's pressure is what a recording is for, and what prepare.toml names is meant.
            let problem = if quantity == "lv_pressure" || is_named {
                Problem::error(
                    &path,
                    found,
                    "samples in each channel that is read",
                    "export the channel, or remove its column",
                )
            } else {
                table.columns.remove(quantity);
                Problem::warning(
                    &path,
                    found,
                    "samples in each channel that is read",
                    "export the channel if it was recorded: it is left out, as if there were no such column",
                )
            };
            self.report.add(None, problem.at_key(quantity));
        }
        let mut take = |quantity: &str| table.columns.remove(quantity);
        let time_ms = take("time")?;
        let channels = Channels {
            lv_pressure_mmhg: take("lv_pressure"),
            aortic_pressure_mmhg: take("aortic_pressure"),
            flow_ml_per_s: take("flow"),
            ecg_mv: take("ecg"),
            lv_volume_ml: None,
        };
        match Recording::new(&time_ms, channels) {
            Ok(recording) => Some(recording),
            Err(error) => {
                let remedy = match error {
                    RecordingError::NoPressure => {
                        "name a column lv_pressure_mmHg or aortic_pressure_mmHg, or name the \
                         pressure's column in [catheter.columns]"
                    }
                    RecordingError::Step { step_ms } if step_ms < 0.05 => {
                        "the values look like seconds: name the column time_s"
                    }
                    _ => "export the whole recording, every sample with its time",
                };
                let mut found = error.to_string();
                // The names tell which column the pressure is.
                let others = table.said.iter().find(|said| said.contains(UNREAD));
                if let (RecordingError::NoPressure, Some(others)) = (&error, others) {
                    found = format!("{found}; {others}");
                }
                let expected = "a continuous recording with a pressure";
                let problem = Problem::error(&path, found, expected, remedy);
                self.report.add(None, problem);
                None
            }
        }
    }

    fn cine(&mut self, file: &RawFile) -> Option<Cine> {
        let columns = &file.cine.columns;
        let (path, bytes) = self.bytes("cine.file", file.cine.file.as_ref(), "cine")?;
        let mut volume = channel("volume", &[("volume_mL", &columns.volume_ml, 1.0)]);
        volume.required = true;
        let mut table = self.table(
            &path,
            &bytes,
            &[time(&columns.time_ms, &columns.time_s), volume],
            Form {
                format: file.cine.format,
                sheet: file.cine.sheet.as_deref(),
                block: None,
            },
        )?;
        let (time_ms, volume_ml) = (
            table.columns.remove("time")?,
            table.columns.remove("volume")?,
        );
        let lines: Vec<f64> = time_ms.clone();
        let (time_ms, volume_ml) = self.segmented(&path, &table, time_ms, volume_ml);
        // Frames without a volume tell the length of the cycle all the same.
        let are_left_out = time_ms.len() < lines.len();
        let stated = file.cine.cycle_length_ms;
        let cycle_length_ms = stated.or_else(|| are_left_out.then(|| cycle_of(&lines)));
        match Cine::new(time_ms, volume_ml, cycle_length_ms) {
            Ok(cine) => self.of_a_heart(&path, cine, &file.accept),
            Err(error) => {
                let (line, remedy) = match &error {
                    CineError::Volume { time_ms, .. } => {
                        let row = lines.iter().position(|t| t == time_ms).unwrap_or(0);
                        (
                            Some(table.line(row)),
                            "give the cavity's volume in mL in every frame",
                        )
                    }
                    CineError::Beyond { .. } => {
                        (None, "give one cycle of frames, and its length in [cine]")
                    }
                    CineError::TooFew { .. } => (None, "export all frames of the cycle"),
                };
                let mut problem =
                    Problem::error(&path, error.to_string(), "the frames of one cycle", remedy);
                problem.line = line;
                self.report.add(None, problem);
                None
            }
        }
    }

    /// The frames, if their volumes are those of a heart.
    fn of_a_heart(&mut self, path: &Path, cine: Cine, accepted: &[String]) -> Option<Cine> {
        let largest = cine.volume_ml.iter().copied().fold(0.0, f64::max);
        if LARGEST_ML.contains(&largest) {
            self.lone_frames(path, &cine, accepted);
            return Some(cine);
        }
        let problem = Problem::error(
            path,
            format!("a largest volume of {largest:.4} mL"),
            format!(
                "a largest volume of {} to {} mL",
                LARGEST_ML.start, LARGEST_ML.end
            ),
            "correct the unit, or export the volumes without separators of thousands",
        );
        self.report.add(None, problem);
        None
    }

    /// Reports a frame far off its neighbours, with its time on the cine's own clock.
    fn lone_frames(&mut self, path: &Path, cine: &Cine, accepted: &[String]) {
        let frames = Trace::new(
            Quantity::Volume,
            cine.time_ms.clone(),
            cine.volume_ml.clone(),
        );
        let facts = Facts {
            cycle_ms: cine.cycle_length_ms,
            volume: frames.as_ref().ok(),
            ..Facts::default()
        };
        for problem in contradictions(&facts, accepted, path) {
            // Misspelt names are reported with what else the recordings break.
            if problem.key.as_deref() == Some(VOLUME_KEY) {
                self.report.add(
                    None,
                    Problem {
                        key: None,
                        ..problem
                    },
                );
            }
        }
    }

    /// The frames that have a volume; a warning names the others.
    fn segmented(
        &mut self,
        path: &Path,
        table: &Table,
        time_ms: Vec<f64>,
        volume_ml: Vec<f64>,
    ) -> (Vec<f64>, Vec<f64>) {
        let n = volume_ml.len();
        let bare: Vec<usize> = (0..n).filter(|i| volume_ml[*i].is_nan()).collect();
        if let Some(first) = bare.first() {
            let times: Vec<String> = bare
                .iter()
                .take(5)
                .map(|i| format!("{:.0}", time_ms[*i]))
                .collect();
            let more = if bare.len() > 5 { ", …" } else { "" };
            let mut problem = Problem::warning(
                path,
                format!(
                    "{} of {n} frames without a volume, at {}{more} ms",
                    bare.len(),
                    times.join(", ")
                ),
                "a volume in every frame",
                "draw the missing contours; until then these frames are left out",
            );
            problem.line = Some(table.line(*first));
            self.report.add(None, problem);
        }
        let both = time_ms.into_iter().zip(volume_ml);
        both.filter(|(_, volume)| !volume.is_nan()).unzip()
    }

    fn flow(&mut self, file: &RawFile) -> Option<(Vec<f64>, Vec<f64>)> {
        let columns = &file.flow.columns;
        let (path, bytes) = self.bytes("flow.file", file.flow.file.as_ref(), "flow")?;
        let mut flow = channel(
            "flow",
            &[
                ("flow_mL_per_s", &columns.flow_ml_per_s, 1.0),
                (
                    "flow_L_per_min",
                    &columns.flow_l_per_min,
                    ML_PER_S_PER_L_PER_MIN,
                ),
            ],
        );
        (flow.required, flow.may_lack) = (true, false);
        let mut table = self.table(
            &path,
            &bytes,
            &[time(&columns.time_ms, &columns.time_s), flow],
            Form {
                format: file.flow.format,
                sheet: file.flow.sheet.as_deref(),
                block: None,
            },
        )?;
        Some((table.columns.remove("time")?, table.columns.remove("flow")?))
    }
}

/// Form of a file as far as prepare.toml states it.
#[derive(Debug, Clone, Copy)]
struct Form<'a> {
    format: Option<FileFormat>,
    sheet: Option<&'a str>,
    block: Option<usize>,
}

fn input(name: &str, bytes: &[u8]) -> RawInput {
    RawInput {
        file: name.to_owned(),
        sha256: sha256_hex(bytes),
        n_rows: 0,
        read_as: Vec::new(),
    }
}

fn time(ms: &Option<String>, s: &Option<String>) -> Wanted {
    let mut wanted = channel("time", &[("time_ms", ms, 1.0), ("time_s", s, 1000.0)]);
    (wanted.required, wanted.may_lack) = (true, false);
    wanted
}

/// A quantity that may be found under the keys' own names, or, if names were given, only under
/// these.
fn channel(quantity: &'static str, names: &[(&str, &Option<String>, f64)]) -> Wanted {
    let given = names
        .iter()
        .filter_map(|(_, given, factor)| Some(((*given).clone()?, *factor)));
    let given: Vec<(String, f64)> = given.collect();
    let required = !given.is_empty();
    let own = names
        .iter()
        .map(|(name, _, factor)| ((*name).to_owned(), *factor))
        .collect();
    Wanted {
        quantity,
        names: if required { given } else { own },
        given: required,
        required,
        may_lack: true,
    }
}

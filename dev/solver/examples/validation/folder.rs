//! Writes a folder of patients: `patients/ID/patient.toml` with its traces, `cohort.toml`,
//! `labels.json`.

use crate::visibility::Visibility;
use cardiotwin_validation::{Case, Further, Measurement, PlannedCase};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

fn put(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("cannot write {}: {e}", path.display()))
}

/// Lines of a trace.
fn lines(column: &str, times_ms: impl Iterator<Item = f64>, values: &[f64]) -> String {
    let mut text = format!("time_ms,{column}\n");
    for (t, v) in times_ms.zip(values) {
        let _ = writeln!(text, "{t:.2},{v:.3}");
    }
    text
}

/// Writes the files of further measurements, and returns the tables of `patient.toml` that name
/// them.
fn write_further(own: &Path, further: &Further) -> Result<String, String> {
    let mut tables = String::new();
    for trace in &further.traces {
        let (column, rms) = match trace.kind {
            Measurement::AorticPressure | Measurement::AtrialPressure => {
                ("pressure_mmHg", "rms_mmHg")
            }
            Measurement::Strain => ("strain_percent", "rms_percent"),
            _ => ("flow_mL_per_s", "rms_mL_per_s"),
        };
        let name = trace.kind.name();
        let file = format!("{}.csv", name.replace('_', "-"));
        let times = trace.time_ms.iter().copied();
        put(&own.join(&file), &lines(column, times, &trace.value))?;
        let _ = write!(
            tables,
            "\n[measured.traces.{name}]\nfile = \"{file}\"\n{rms} = {:.3}\ncorrelation_ms = {:.2}\n",
            trace.rms, trace.correlation_ms
        );
    }
    if let Some((times, sd)) = further.valve_times_ms {
        let _ = write!(
            tables,
            "\n[measured.valve_times]\naortic_opening_ms = {:.1}\naortic_closure_ms = {:.1}\nmitral_opening_ms = {:.1}\n\
             mitral_closure_ms = {:.1}\nsd_ms = {sd:.1}\n",
            times[0], times[1], times[2], times[3]
        );
    }
    if let Some((duration, sd)) = further.qrs_ms {
        let _ = write!(
            tables,
            "\n[measured.qrs]\nduration_ms = {duration:.1}\nsd_ms = {sd:.1}\n"
        );
    }
    if let Some(beat) = &further.loaded {
        let times = (0..beat.pressure_mmhg.len()).map(|t| t as f64);
        let pressure = lines("pressure_mmHg", times, &beat.pressure_mmhg);
        let volume = lines("volume_mL", beat.frame_ms.iter().copied(), &beat.frame_ml);
        put(&own.join("loaded-pressure.csv"), &pressure)?;
        put(&own.join("loaded-volume.csv"), &volume)?;
        tables += "\n[[measured.loaded]]\npressure = \"loaded-pressure.csv\"\nvolume = \"loaded-volume.csv\"\n";
    }
    Ok(tables)
}

/// Writes the folder of one patient with its traces.
pub fn write(folder: &Path, id: &str, case: &Case, further: &Further) -> Result<(), String> {
    let own = folder.join("patients").join(id);
    std::fs::create_dir_all(&own).map_err(|e| format!("cannot make {}: {e}", own.display()))?;
    let mut pressure = "time_ms,pressure_mmHg\n".to_owned();
    for (t, p) in case.pressure_mmhg.iter().enumerate() {
        let _ = writeln!(pressure, "{t}.0,{p:.3}");
    }
    let mut volume = "time_ms,volume_mL\n".to_owned();
    for (t, v) in case.frame_ms.iter().zip(&case.frame_ml) {
        let _ = writeln!(volume, "{t:.2},{v:.2}");
    }
    let (stated, side) = (&case.stated, &case.side);
    let end_diastolic = case.pressure_mmhg[..10].iter().sum::<f64>() / 10.0;
    let patient = format!(
        "id = \"{id}\"\ncycle_length_ms = {:.1}\n\n\
         [measured]\npressure = \"pressure.csv\"\nvolume = \"volume.csv\"\n\
         end_diastolic_pressure_mmHg = {end_diastolic:.1}\n\n\
         [measured.noise]\npressure_rms_mmHg = {:.3}\npressure_correlation_ms = {:.2}\nvolume_rms_mL = {:.3}\n\n\
         [measured.aortic_pressure]\nsystolic_mmHg = {:.1}\ndiastolic_mmHg = {:.1}\nsd_mmHg = {:.1}\n\n\
         [measured.forward_stroke_volume]\nvolume_mL = {:.2}\nsd_mL = {:.2}\n\n\
         [measured.diastasis]\ntime_ms = {:.1}\nvolume_mL = {:.2}\nsd_mL = {:.2}\n\n\
         [anatomy]\nwall_volume_mL = {:.1}\n{}",
        case.cycle_ms,
        stated.pressure_rms_mmhg,
        stated.pressure_correlation_ms,
        stated.volume_rms_ml,
        side.cuff.0,
        side.cuff.1,
        side.cuff_sd,
        side.forward.0,
        side.forward.1,
        side.whole_heart_ms,
        side.whole_heart.0,
        side.whole_heart.1,
        side.wall_ml,
        write_further(&own, further)?,
    );
    put(&own.join("pressure.csv"), &pressure)?;
    put(&own.join("volume.csv"), &volume)?;
    put(&own.join("patient.toml"), &patient)
}

/// The file `labels.json`, which is rewritten with each case.
pub struct Labels {
    path: PathBuf,
    all: Value,
}

impl Labels {
    /// Reads the labels of a folder, or starts with none.
    ///
    /// - `model`: name of the model that makes the cases
    pub fn open(folder: &Path, model: &str, seed: u64) -> Result<Self, String> {
        std::fs::create_dir_all(folder)
            .map_err(|e| format!("cannot make {}: {e}", folder.display()))?;
        put(
            &folder.join("cohort.toml"),
            &format!(
                "name = \"validation\"\ndescription = \"Cases with hidden effects, made by {model}\"\npatients = \"patients\"\n"
            ),
        )?;
        let path = folder.join("labels.json");
        let fresh = json!({
            "description": format!(
                "hidden effects of each case, made by {model}, seed {seed}; strength in multiples of the smallest meaningful \
                 one; visibility.delta_chi2: fall of the misfit on noise-free data when the right effects are added to the fitted \
                 model, in units of the case's own noise; left_chi2: what they leave"
            ),
            "cases": {}
        });
        let all: Value = match std::fs::read_to_string(&path) {
            Ok(text) => {
                serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?
            }
            Err(_) => fresh.clone(),
        };
        if all["description"] != fresh["description"] {
            return Err(format!(
                "{}: made by another model or seed; take another folder",
                path.display()
            ));
        }
        Ok(Self { path, all })
    }

    /// Whether a case has been entered.
    pub fn has(&self, id: &str) -> bool {
        self.all["cases"].get(id).is_some()
    }

    /// Whether a case has been entered without its visibility.
    pub fn lacks_visibility(&self, id: &str) -> bool {
        self.has(id) && self.all["cases"][id].get("visibility").is_none()
    }

    /// Enters a case and writes the file.
    pub fn add(&mut self, planned: &PlannedCase, case: &Case, off: bool) -> Result<(), String> {
        let named: Vec<Value> = if off {
            Vec::new()
        } else {
            case.hidden.iter().map(|h| json!(h)).collect()
        };
        let mut label = json!({ "effects": named, "noise": planned.noise, "seed": planned.seed() });
        if off {
            label["off_catalogue"] = true.into();
            label["gap"] = json!(case.hidden);
        }
        if planned.hard {
            label["hard"] = true.into();
        }
        self.all["cases"][&planned.id] = label;
        self.write()
    }

    /// Enters the visibility of a case and writes the file.
    pub fn see(&mut self, id: &str, seen: &Visibility) -> Result<(), String> {
        let label = &mut self.all["cases"][id];
        let nothing = label["effects"].as_array().is_none_or(Vec::is_empty);
        label["visibility"] = json!({
            "delta_chi2": round(seen.delta_chi2),
            "left_chi2": round(seen.left_chi2),
            "band": seen.band(nothing),
        });
        self.write()
    }

    fn write(&self) -> Result<(), String> {
        let text = serde_json::to_string_pretty(&self.all).map_err(|e| e.to_string())?;
        put(&self.path, &(text + "\n"))
    }
}

fn round(x: f64) -> f64 {
    (10.0 * x).round() / 10.0
}

//! Reads cases and labels from files.

use cardiotwin_discover::further::{Further, FurtherTrace, LoadedBeat, ValveTimes};
use cardiotwin_discover::measured::{Cuff, GivenLoads, Measured, SideData, Uncertain, WholeHeart};
use cardiotwin_vocabulary::measurements::FurtherQuantity;
use cardiotwin_vocabulary::trace_noise::Noise;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Value;

/// Hidden effects of a case.
#[derive(Debug, Clone)]
pub struct Label {
    /// Names of the effects.
    pub effects: Vec<String>,
    /// `none`, `at the limit`, `weak`, `moderate`, `strong`.
    pub band: String,
    /// Whether the data can hardly resolve the effects.
    pub hard: bool,
    /// Whether the case has a gap outside the catalogue.
    pub off_catalogue: bool,
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("cannot read {}: {e}", path.display()))
}

/// Names of the cases, sorted.
pub fn cases(folder: &Path) -> Result<Vec<String>, String> {
    let patients = folder.join("patients");
    let entries = std::fs::read_dir(&patients)
        .map_err(|e| format!("cannot read {}: {e}", patients.display()))?;
    let mut ids: Vec<String> = entries
        .filter_map(|e| Some(e.ok()?.file_name().to_string_lossy().into_owned()))
        .collect();
    ids.sort();
    Ok(ids)
}

/// Numbers of the `dev-NNN` cases with which the search was developed. All other cases were set
/// aside.
const DEVELOPMENT: [u16; 24] = [
    1, 6, 7, 8, 11, 13, 15, 16, 19, 20, 21, 25, 26, 27, 29, 30, 31, 33, 34, 39, 40, 43, 45, 46,
];

/// Selects one of the two parts of the cases.
pub fn part(ids: &[String], part: &str) -> Result<Vec<String>, String> {
    let wanted = match part {
        "development" => true,
        "aside" => false,
        other => return Err(format!("--part is {other}, expected development or aside")),
    };
    let used = |id: &str| {
        id.strip_prefix("dev-")
            .and_then(|n| n.parse().ok())
            .is_some_and(|n: u16| DEVELOPMENT.contains(&n))
    };
    Ok(ids
        .iter()
        .filter(|id| used(id) == wanted)
        .cloned()
        .collect())
}

fn number(table: &Value, keys: &[&str]) -> Option<f64> {
    let mut value = table;
    for key in keys {
        value = value.get(key)?;
    }
    value
        .as_float()
        .or_else(|| value.as_integer().map(|i| i as f64))
}

fn trace(path: &Path) -> Result<(Vec<f64>, Vec<f64>), String> {
    let text = read(path)?;
    let mut columns = (Vec::new(), Vec::new());
    for (idx, line) in text.lines().enumerate().skip(1) {
        let bad = || {
            format!(
                "{}:{}: expected two numbers, found {line:?}",
                path.display(),
                idx + 1
            )
        };
        let (t, v) = line.split_once(',').ok_or_else(bad)?;
        columns.0.push(t.trim().parse().map_err(|_| bad())?);
        columns.1.push(v.trim().parse().map_err(|_| bad())?);
    }
    Ok(columns)
}

/// Reads the further traces and the beats under changed load that the file names.
fn further(folder: &Path, patient: &Value, cycle_ms: f64) -> Result<Further, String> {
    let measured = &patient["measured"];
    let mut further = Further::default();
    for quantity in FurtherQuantity::ALL {
        let table = measured.get("traces").and_then(|t| t.get(quantity.name()));
        let Some(table) = table else { continue };
        let file = |key: &str| table.get(key).and_then(Value::as_str);
        let value = |key: &str| number(table, &[key]);
        let (time_ms, values) = trace(&folder.join(file("file").unwrap_or_default()))?;
        let rms = ["rms_mmHg", "rms_mL_per_s", "rms_percent"].into_iter();
        let sd = value("delay_sd_ms").unwrap_or(0.0);
        further.traces.push(FurtherTrace {
            quantity,
            time_ms,
            value: values,
            rms: rms.filter_map(value).next().ok_or("no rms of a trace")?,
            correlation_ms: value("correlation_ms").ok_or("no correlation_ms of a trace")?,
            delay: Uncertain {
                value: value("delay_ms").unwrap_or(0.0),
                sd,
            },
        });
    }
    let loaded = measured.get("loaded").and_then(Value::as_array);
    for beat in loaded.into_iter().flatten() {
        let file = |key: &str| folder.join(beat.get(key).and_then(Value::as_str).unwrap_or(""));
        let (pressure_time_ms, pressure_mmhg) = trace(&file("pressure"))?;
        let (frame_time_ms, frame_volume_ml) = trace(&file("volume"))?;
        further.loaded.push(LoadedBeat {
            cycle_ms: number(beat, &["cycle_length_ms"]).unwrap_or(cycle_ms),
            pressure_time_ms,
            pressure_mmhg,
            frame_time_ms,
            frame_volume_ml,
        });
    }
    Ok(further)
}

/// Leaves out all further measurements but some: quantities of traces, `valve_times`, `qrs`, `loaded`.
pub fn keep(measured: &mut Measured, names: &[String]) {
    let kept = |name: &str| names.iter().any(|n| n == name);
    (measured.further.traces).retain(|trace| kept(trace.quantity.name()));
    if !kept("valve_times") {
        measured.side.valve_times = ValveTimes::default();
    }
    if !kept("qrs") {
        measured.side.qrs_ms = None;
    }
    if !kept("loaded") {
        measured.further.loaded.clear();
    }
}

/// Reads one patient's folder. If the file states the number of frames from which the volume was
/// interpolated, the same number of samples is taken.
pub fn measured(folder: &Path) -> Result<Measured, String> {
    let file = folder.join("patient.toml");
    let patient: Value =
        toml::from_str(&read(&file)?).map_err(|e| format!("{}: {e}", file.display()))?;
    let get = |keys: &[&str]| number(&patient, keys);
    let need = |keys: &[&str]| {
        get(keys).ok_or(format!("{}: {} is missing", file.display(), keys.join(".")))
    };
    let (pressure_time_ms, pressure_mmhg) = trace(&folder.join("pressure.csv"))?;
    let (mut frame_time_ms, mut frame_volume_ml) = trace(&folder.join("volume.csv"))?;
    if let Some(frames) = get(&["measured", "noise", "volume_frames"]) {
        let n = frame_time_ms.len();
        let frames = (frames as usize).min(n);
        let keep: Vec<usize> = (0..frames).map(|k| k * n / frames).collect();
        frame_time_ms = keep.iter().map(|i| frame_time_ms[*i]).collect();
        frame_volume_ml = keep.iter().map(|i| frame_volume_ml[*i]).collect();
    }
    let uncertain = |value: Option<f64>, sd: Option<f64>| {
        Some(Uncertain {
            value: value?,
            sd: sd?,
        })
    };
    let cuff = |key: &str| {
        uncertain(
            get(&["measured", "aortic_pressure", key]),
            get(&["measured", "aortic_pressure", "sd_mmHg"]),
        )
    };
    let volume = |key: &str| {
        uncertain(
            get(&["measured", key, "volume_mL"]),
            get(&["measured", key, "sd_mL"]),
        )
    };
    let valve = |key: &str| {
        uncertain(
            get(&["measured", "valve_times", key]),
            get(&["measured", "valve_times", "sd_ms"]),
        )
    };
    let wall = need(&["anatomy", "wall_volume_mL"])?;
    let cycle_ms = need(&["cycle_length_ms"])?;
    // Uncertainties as in the command line program.
    let given = |keys: &[&str], share: f64| {
        get(keys).map(|value| Uncertain {
            value,
            sd: share * value,
        })
    };
    Ok(Measured {
        cycle_ms,
        pressure_time_ms,
        pressure_mmhg,
        frame_time_ms,
        frame_volume_ml,
        noise: Noise {
            pressure_rms_mmhg: get(&["measured", "noise", "pressure_rms_mmHg"]),
            pressure_correlation_ms: get(&["measured", "noise", "pressure_correlation_ms"]),
            volume_rms_ml: get(&["measured", "noise", "volume_rms_mL"]),
            ..Noise::default()
        },
        side: SideData {
            cuff: cuff("systolic_mmHg")
                .zip(cuff("diastolic_mmHg"))
                .map(|(systolic, diastolic)| Cuff {
                    systolic,
                    diastolic,
                }),
            forward_stroke_volume: volume("forward_stroke_volume"),
            whole_heart: get(&["measured", "diastasis", "time_ms"])
                .zip(volume("diastasis"))
                .map(|(time_ms, volume)| WholeHeart { time_ms, volume }),
            valve_times: ValveTimes {
                aortic_opening: valve("aortic_opening_ms"),
                aortic_closure: valve("aortic_closure_ms"),
                mitral_opening: valve("mitral_opening_ms"),
                mitral_closure: valve("mitral_closure_ms"),
            },
            qrs_ms: uncertain(
                get(&["measured", "qrs", "duration_ms"]),
                get(&["measured", "qrs", "sd_ms"]),
            ),
        },
        wall_volume: Uncertain {
            value: wall,
            sd: 0.05 * wall,
        },
        given: GivenLoads {
            left_atrial_pressure: given(&["preload", "left_atrial_pressure_mmHg"], 0.25),
            characteristic_resistance: given(
                &["afterload", "characteristic_resistance_mmHg_s_per_mL"],
                0.3,
            ),
            peripheral_resistance: given(
                &["afterload", "peripheral_resistance_mmHg_s_per_mL"],
                0.1,
            ),
            compliance: given(&["afterload", "compliance_mL_per_mmHg"], 0.15),
        },
        further: further(folder, &patient, cycle_ms)?,
    })
}

/// Labels by case; empty if the folder has none.
pub fn labels(folder: &Path) -> Result<BTreeMap<String, Label>, String> {
    let path = folder.join("labels.json");
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let all: serde_json::Value =
        serde_json::from_str(&read(&path)?).map_err(|e| format!("{}: {e}", path.display()))?;
    let cases = all["cases"].as_object().ok_or("labels.json has no cases")?;
    let flag = |case: &serde_json::Value, key: &str| case[key].as_bool().unwrap_or(false);
    Ok(cases
        .iter()
        .map(|(id, case)| {
            let effects = case["effects"].as_array().into_iter().flatten();
            let label = Label {
                effects: effects
                    .filter_map(|e| Some(e["effect"].as_str()?.to_owned()))
                    .collect(),
                band: case["visibility"]["band"]
                    .as_str()
                    .unwrap_or("none")
                    .to_owned(),
                hard: flag(case, "hard"),
                off_catalogue: flag(case, "off_catalogue"),
            };
            (id.clone(), label)
        })
        .collect())
}

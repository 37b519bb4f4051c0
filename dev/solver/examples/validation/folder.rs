//! Writes folders of patients: `patients/ID/patient.toml` with its traces, and `cohort.toml`.

use cardiotwin_validation::{Case, Further, Measurement};
use std::fmt::Write;
use std::path::Path;

/// Writes a file.
pub fn put(path: &Path, text: &str) -> Result<(), String> {
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

/// Makes a cohort's folder with its `cohort.toml`.
pub fn open(folder: &Path, description: &str) -> Result<(), String> {
    std::fs::create_dir_all(folder)
        .map_err(|e| format!("cannot make {}: {e}", folder.display()))?;
    let cohort = format!(
        "name = \"validation\"\ndescription = \"{description}\"\npatients = \"patients\"\n"
    );
    put(&folder.join("cohort.toml"), &cohort)
}

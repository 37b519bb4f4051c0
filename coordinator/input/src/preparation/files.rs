//! Tables in the patient's folder: traces that the patient's file names, and results of the steps.

use std::fmt::Write as _;

use cardiotwin_recordings::average::MeanTrace;
use cardiotwin_recordings::prepare::Prepared;

use crate::RawFolder;

/// Folder next to `patient.toml` that holds the results of the steps.
pub const PREPARED: &str = "prepared";

/// Name and content of each table.
pub fn tables(folder: &RawFolder, prepared: &Prepared) -> Vec<(String, String)> {
    let average = &prepared.average;
    let mut files = Vec::new();
    let trace = |header: &str, trace: &MeanTrace| {
        let mut text = format!("time_ms,{header}\n");
        for (i, value) in trace.mean.iter().enumerate() {
            let _ = writeln!(text, "{},{:.3}", time(i as f64 * average.step_ms), value);
        }
        text
    };
    if let Some(lv) = &average.lv_pressure {
        files.push(("pressure.csv".to_owned(), trace("pressure_mmHg", lv)));
    }
    if let Some(aorta) = &average.aortic_pressure {
        files.push((
            "aortic_pressure.csv".to_owned(),
            trace("pressure_mmHg", aorta),
        ));
    }
    if let Some(flow) = &average.flow {
        files.push(("aortic_flow.csv".to_owned(), trace("flow_mL_per_s", flow)));
    }
    if let Some(volume) = &prepared.volume {
        let mut text = "time_ms,volume_mL\n".to_owned();
        for (t, v) in volume
            .synchronised
            .time_ms
            .iter()
            .zip(&volume.synchronised.volume_ml)
        {
            let _ = writeln!(text, "{},{v:.3}", time(*t));
        }
        files.push(("volume.csv".to_owned(), text));
        files.push((format!("{PREPARED}/frames.csv"), frames(prepared)));
    }
    files.push((format!("{PREPARED}/beats.csv"), beats(folder, prepared)));
    files.push((format!("{PREPARED}/mean.csv"), mean(prepared)));
    files
}

/// A time in ms with up to three decimals, without trailing zeros.
fn time(ms: f64) -> String {
    let text = format!("{ms:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Table of all beats: onset, length, whether the beat is part of the mean, and why not.
fn beats(folder: &RawFolder, prepared: &Prepared) -> String {
    let mut text = "beat,onset_ms,length_ms,kept,kind,reasons\n".to_owned();
    for (number, beat, reasons) in prepared.judged() {
        let why: Vec<String> = reasons.iter().map(ToString::to_string).collect();
        let _ = writeln!(
            text,
            "{},{:.2},{:.2},{},{},\"{}\"",
            number,
            folder.recording.begin_ms + folder.recording.elapsed_ms(beat.onset_ms),
            beat.length_ms,
            if reasons.is_empty() { "yes" } else { "no" },
            reasons.first().map_or("", |reason| reason.kind()),
            why.join("; ")
        );
    }
    text
}

/// Table of the mean beat with the standard deviation between beats.
fn mean(prepared: &Prepared) -> String {
    let average = &prepared.average;
    let channels = [
        ("lv_pressure", "mmHg", &average.lv_pressure),
        ("aortic_pressure", "mmHg", &average.aortic_pressure),
        ("flow", "mL_per_s", &average.flow),
    ];
    let channels: Vec<(&str, &str, &MeanTrace)> = channels
        .iter()
        .filter_map(|(name, unit, trace)| Some((*name, *unit, trace.as_ref()?)))
        .collect();
    let mut text = "time_ms".to_owned();
    for (name, unit, _) in &channels {
        let _ = write!(text, ",{name}_{unit},{name}_sd_{unit}");
    }
    text.push('\n');
    let n = channels.first().map_or(0, |c| c.2.mean.len());
    for i in 0..n {
        text.push_str(&time(i as f64 * average.step_ms));
        for (_, _, trace) in &channels {
            let _ = write!(text, ",{:.3},{:.3}", trace.mean[i], trace.sd[i]);
        }
        text.push('\n');
    }
    text
}

/// Table of all frames as measured and after each step.
fn frames(prepared: &Prepared) -> String {
    let mut text =
        "time_ms,volume_mL,adjusted_volume_mL,reconciled_time_ms,synchronised_time_ms\n".to_owned();
    let Some(volume) = &prepared.volume else {
        return text;
    };
    let cycle = prepared.average.cycle_length_ms;
    let adjusted = volume
        .original
        .volume_ml
        .iter()
        .zip(&volume.adjusted.cine.volume_ml);
    for (t, (before, after)) in volume.original.time_ms.iter().zip(adjusted) {
        let reconciled = volume.reconciled.map(*t);
        let synchronised = (reconciled - volume.lag.taken_ms()).rem_euclid(cycle);
        let _ = writeln!(
            text,
            "{},{before:.3},{after:.3},{},{}",
            time(*t),
            time(reconciled),
            time(synchronised)
        );
    }
    text
}

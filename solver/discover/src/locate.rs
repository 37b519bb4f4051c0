//! Location of the disagreement between model and data: residuals by signal and phase of the beat.

use crate::channel::{QRS_MODEL_SD_MS, VALVE_MODEL_SD_MS};
use crate::forward::Prediction;
use crate::further::ValveTimes;
use crate::noise::slopes;
use crate::phases::{PHASES, Phases};
use crate::problem::{Data, Problem};
use crate::valves::cyclic;
use cardiotwin_vocabulary::biomarkers::Biomarker;
use cardiotwin_vocabulary::findings::{Place, Side};

/// One row of the table: a signal in a phase, or a scalar, whose phase is `beat`.
///
/// - `size`: mean of data minus model, in mmHg, mmHg/s or mL; `sd`: its standard deviation by noise and model discrepancy
/// - `share`: of the sum of squared white residuals; zero for derived rows
fn place(
    (signal, phase): (&str, &str),
    (size, sd, share): (f64, f64, f64),
    biomarkers: &[Biomarker],
) -> Place {
    let unit = match signal {
        "pressure_rate" => "mmHg/s",
        "aortic_flow" | "mitral_flow" => "mL/s",
        "strain" => "%",
        "qrs" => "ms",
        _ if ValveTimes::NAMES.contains(&signal) => "ms",
        _ if signal.ends_with("volume") => "mL",
        _ => "mmHg",
    };
    Place {
        signal: signal.to_owned(),
        phase: phase.to_owned(),
        sign: if size < 0.0 { Side::Below } else { Side::Above },
        size,
        unit: unit.to_owned(),
        z: size / sd,
        share,
        biomarkers: biomarkers.iter().map(|b| b.name().to_owned()).collect(),
    }
}

/// Biomarkers that a signal in a phase affects.
fn biomarkers(signal: &str, phase: usize) -> &'static [Biomarker] {
    use Biomarker::{DpdtMax, DpdtMin, Edp, Edv, PMax, Ptd90, Sv, TauVd, TauVr};

    match (signal, phase) {
        ("pressure", 0) => &[DpdtMax, Ptd90],
        ("pressure", 1 | 2) => &[PMax],
        ("pressure", 3) => &[DpdtMin, Ptd90],
        ("pressure", 6) => &[Edp],
        ("volume", 0) => &[Edv, Sv, TauVd],
        ("volume", 1) => &[TauVd],
        ("volume", 2) => &[TauVd, Sv],
        ("volume", 3) => &[Sv],
        ("volume", 4 | 5) => &[TauVr],
        ("volume", 6) => &[Edv, Sv],
        _ => &[],
    }
}

/// Compares a beat with the data, by signal and phase.
#[must_use]
pub fn locate(problem: &Problem<'_>, beat: &Prediction) -> Vec<Place> {
    let data = problem.data;
    let phases = Phases::of(&data.pressure, &data.volume, data.measured.cycle_ms);
    let cycle = data.measured.cycle_ms;
    let mut places = Vec::new();
    let mut traces = vec![
        ("pressure", &data.pressure, &beat.pressure_mmhg[..]),
        ("volume", &data.volume, &beat.volume_ml),
    ];
    traces.extend((data.further.channels.iter()).map(|channel| {
        let quantity = channel.quantity;
        (quantity.name(), &channel.signal, beat.further(quantity))
    }));
    for (name, signal, trace) in traces {
        let model = beat.sampled(trace, &signal.time_ms);
        let residual = signal.residual(&model);
        let white = signal.whitener(&model).whiten(&residual);
        for (phase, phase_name) in PHASES.iter().enumerate() {
            let inside: Vec<usize> = (0..signal.len())
                .filter(|i| phases.at(signal.time_ms[*i], cycle) == phase)
                .collect();
            if inside.is_empty() {
                continue;
            }
            let n = inside.len() as f64;
            let size = inside.iter().map(|i| residual[*i]).sum::<f64>() / n;
            let share = inside.iter().map(|i| white[*i] * white[*i]).sum();
            places.push(place(
                (name, phase_name),
                (size, signal.mean_sd(&inside, &model), share),
                biomarkers(name, phase),
            ));
        }
    }
    let side = &data.measured.side;
    let mut scalar = |name: &str, measured: f64, model: f64, sd: f64, biomarkers: &[Biomarker]| {
        let size = measured - model;
        let share = (size / sd).powi(2);
        places.push(place((name, "beat"), (size, sd, share), biomarkers));
    };
    if let Some(cuff) = side.cuff {
        scalar(
            "cuff_systolic",
            cuff.systolic.value,
            beat.systolic_mmhg,
            cuff.systolic.sd,
            &[Biomarker::PMax],
        );
        scalar(
            "cuff_diastolic",
            cuff.diastolic.value,
            beat.diastolic_mmhg,
            cuff.diastolic.sd,
            &[],
        );
    }
    if let Some(v) = side.forward_stroke_volume {
        scalar(
            "forward_stroke_volume",
            v.value,
            beat.forward_stroke_volume_ml,
            v.sd,
            &[Biomarker::Sv],
        );
    }
    if let Some(w) = side.whole_heart {
        scalar(
            "whole_heart_volume",
            w.volume.value,
            beat.at(&beat.true_volume_ml, w.time_ms),
            w.volume.sd,
            &[Biomarker::Edv],
        );
    }
    for (which, time) in side.valve_times.all().into_iter().enumerate() {
        if let (Some(time), Some(model)) = (time, beat.valve_times_ms) {
            let difference = cyclic(time.value - model[which], cycle);
            let sd = time.sd.hypot(VALVE_MODEL_SD_MS[which]);
            scalar(ValveTimes::NAMES[which], difference, 0.0, sd, &[]);
        }
    }
    if let Some(qrs) = side.qrs_ms {
        scalar(
            "qrs",
            qrs.value,
            beat.qrs_ms,
            qrs.sd.hypot(QRS_MODEL_SD_MS),
            &[],
        );
    }
    for (idx, (loaded, model)) in data.further.loaded.iter().zip(&beat.loaded).enumerate() {
        let models = loaded.models(model);
        for (of, signal, model) in [
            ("pressure", &loaded.pressure, &models[0]),
            ("volume", &loaded.volume, &models[1]),
        ] {
            let residual = signal.residual(model);
            let white = signal.whitener(model).whiten(&residual);
            let all: Vec<usize> = (0..signal.len()).collect();
            let size = residual.iter().sum::<f64>() / all.len().max(1) as f64;
            let share = white.iter().map(|w| w * w).sum();
            let name = format!("load_{}_{of}", idx + 1);
            let sd = signal.mean_sd(&all, model);
            places.push(place((&name, "beat"), (size, sd, share), &[]));
        }
    }
    let total: f64 = places.iter().map(|p| p.share).sum();
    places
        .iter_mut()
        .for_each(|p| p.share /= total.max(f64::MIN_POSITIVE));
    places.extend(derived(data, beat, &phases));
    places
}

/// Rows that restate others in clinical terms: end-diastolic pressure and volume, and extremes of
/// dP/dt.
fn derived(data: &Data, beat: &Prediction, phases: &Phases) -> Vec<Place> {
    let cycle = data.measured.cycle_ms;
    let end = phases.isovolumic_contraction_ms;
    let near = |t: f64| {
        let d = (t - end).rem_euclid(cycle);
        d.min(cycle - d)
    };
    let mut rows = Vec::new();
    let mut row = |signal: &str, phase: &str, size: f64, sd: f64, biomarker: Biomarker| {
        rows.push(place((signal, phase), (size, sd, 0.0), &[biomarker]));
    };
    for (name, signal, trace, width, biomarker) in [
        (
            "end_diastolic_pressure",
            &data.pressure,
            &beat.pressure_mmhg,
            12.0,
            Biomarker::Edp,
        ),
        (
            "end_diastolic_volume",
            &data.volume,
            &beat.volume_ml,
            35.0,
            Biomarker::Edv,
        ),
    ] {
        let inside: Vec<usize> = (0..signal.len())
            .filter(|i| near(signal.time_ms[*i]) <= width)
            .collect();
        if !inside.is_empty() {
            let model = beat.sampled(trace, &signal.time_ms);
            let difference = |i: &usize| signal.value[*i] - model[*i];
            let size = inside.iter().map(difference).sum::<f64>() / inside.len() as f64;
            row(
                name,
                "beat",
                size,
                signal.mean_sd(&inside, &model),
                biomarker,
            );
        }
    }
    let model: Vec<f64> = data
        .pressure
        .time_ms
        .iter()
        .map(|t| beat.at(&beat.pressure_mmhg, *t))
        .collect();
    let (of_data, of_model) = (
        slopes(&data.pressure.time_ms, &data.pressure.value, 8.0),
        slopes(&data.pressure.time_ms, &model, 8.0),
    );
    // Noise of a slope over 16 ms, from two ends of coloured noise.
    let tau = data.levels.pressure_correlation_ms;
    let sd = data.levels.pressure_rms_mmhg * (2.0 * (1.0 - (-16.0 / tau).exp())).sqrt() / 16.0;
    for (phase, sign, biomarker) in [
        ("isovolumic_contraction", 1.0, Biomarker::DpdtMax),
        ("isovolumic_relaxation", -1.0, Biomarker::DpdtMin),
    ] {
        let largest = |v: &[f64]| v.iter().fold(f64::MIN, |m, x| m.max(sign * x));
        row(
            "pressure_rate",
            phase,
            1e3 * sign * (largest(&of_data) - largest(&of_model)),
            1e3 * sd,
            biomarker,
        );
    }
    rows
}

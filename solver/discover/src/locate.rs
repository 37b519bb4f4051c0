//! Location of the disagreement between model and data: residuals by signal and phase of the beat.
//! The phases are found from the data.

use crate::forward::Prediction;
use crate::noise::slopes;
use crate::problem::{Data, Problem};
use cardiotwin_vocabulary::biomarkers::Biomarker;
use cardiotwin_vocabulary::findings::{Place, Side};
use serde::{Deserialize, Serialize};

/// Start times of the phases within the cycle \[ms\], in order. The last phase ends where the first
/// starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// Foot of the upstroke, where isovolumic contraction starts.
    pub isovolumic_contraction_ms: f64,
    /// Time after the largest dP/dt at which dP/dt has fallen to half of it; about the opening of
    /// the aortic valve.
    pub early_ejection_ms: f64,
    /// Middle of the ejection.
    pub late_ejection_ms: f64,
    /// Time before the smallest dP/dt at which dP/dt reaches half of it; about the closure of the
    /// aortic valve.
    pub isovolumic_relaxation_ms: f64,
    /// Foot of the fall, where the mitral valve opens.
    pub rapid_filling_ms: f64,
    /// End of rapid filling: 70 % of the stroke volume has returned.
    pub diastasis_ms: f64,
    /// Latest start of atrial systole.
    pub atrial_systole_ms: f64,
}

/// Names of the phases, in order.
pub const PHASES: [&str; 7] = [
    "isovolumic_contraction",
    "early_ejection",
    "late_ejection",
    "isovolumic_relaxation",
    "rapid_filling",
    "diastasis",
    "atrial_systole",
];

/// Longest time from the start of atrial systole to the foot of the upstroke \[ms\]: a P-R interval
/// and the electromechanical delay.
const ATRIAL_LEAD_MS: f64 = 150.0;

impl Phases {
    /// Finds the phases in pressure and volume as measured, from extremes of dP/dt and levels of
    /// pressure and volume.
    #[must_use]
    pub fn of(data: &Data) -> Self {
        let (t, p) = (&data.pressure.time_ms, &data.pressure.value);
        let cycle = data.measured.cycle_ms;
        let rate = slopes(t, p, 8.0);
        let extreme = |sign: f64| {
            (0..t.len())
                .max_by(|a, b| (sign * rate[*a]).total_cmp(&(sign * rate[*b])))
                .unwrap_or(0)
        };
        let (up, down) = (extreme(1.0), extreme(-1.0));
        let (low, high) = p
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
        let level = |share: f64| low + share * (high - low);
        // Walks from an index backwards or forwards around the cycle until the condition holds.
        let walk = |from: usize, step: isize, stop: &dyn Fn(usize) -> bool| -> f64 {
            let n = t.len() as isize;
            let mut i = from as isize;
            for _ in 0..n {
                if stop(i as usize) {
                    break;
                }
                i = (i + step).rem_euclid(n);
            }
            t[i as usize]
        };
        let foot = walk(up, -1, &|i| rate[i] < 0.1 * rate[up]);
        let opening = walk(up, 1, &|i| rate[i] < 0.5 * rate[up]);
        let closing = walk(down, -1, &|i| rate[i] > 0.5 * rate[down]);
        let filling = walk(down, 1, &|i| {
            p[i] < level(0.12) || rate[i] > 0.1 * rate[down]
        });
        let after = |a: f64, b: f64| (b - a).rem_euclid(cycle);
        let half = (opening + 0.5 * after(opening, closing)).rem_euclid(cycle);
        let atrial = (foot - ATRIAL_LEAD_MS).rem_euclid(cycle);
        // Rapid filling lasts until 70 % of the stroke volume has returned, but at most for two
        // thirds of the time to atrial systole.
        let (vt, v) = (&data.volume.time_ms, &data.volume.value);
        let (v_low, v_high) = v
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
        let way = after(filling, atrial);
        let back = (vt.iter().zip(v))
            .filter(|(t, v)| after(filling, **t) < way && **v > v_low + 0.7 * (v_high - v_low))
            .map(|(t, _)| after(filling, *t))
            .fold(way, f64::min);
        let rapid = if way > 0.0 {
            back.clamp(way.min(60.0), 0.67 * way.max(90.0)).min(way)
        } else {
            0.0
        };
        Self {
            isovolumic_contraction_ms: foot,
            early_ejection_ms: opening,
            late_ejection_ms: half,
            isovolumic_relaxation_ms: closing,
            rapid_filling_ms: filling,
            diastasis_ms: (filling + rapid).rem_euclid(cycle),
            atrial_systole_ms: atrial,
        }
    }

    /// Start times in order.
    #[must_use]
    pub fn beginnings(&self) -> [f64; 7] {
        [
            self.isovolumic_contraction_ms,
            self.early_ejection_ms,
            self.late_ejection_ms,
            self.isovolumic_relaxation_ms,
            self.rapid_filling_ms,
            self.diastasis_ms,
            self.atrial_systole_ms,
        ]
    }

    /// Index in [`PHASES`] of a time in the cycle.
    #[must_use]
    pub fn at(&self, time_ms: f64, cycle_ms: f64) -> usize {
        let begin = self.beginnings();
        let since = |i: usize| (time_ms - begin[i]).rem_euclid(cycle_ms);
        (0..7)
            .min_by(|a, b| since(*a).total_cmp(&since(*b)))
            .unwrap_or(0)
    }
}

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
        "volume" | "end_diastolic_volume" | "forward_stroke_volume" | "whole_heart_volume" => "mL",
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
    let phases = Phases::of(data);
    let cycle = data.measured.cycle_ms;
    let mut places = Vec::new();
    for (name, signal, trace) in [
        ("pressure", &data.pressure, &beat.pressure_mmhg),
        ("volume", &data.volume, &beat.volume_ml),
    ] {
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

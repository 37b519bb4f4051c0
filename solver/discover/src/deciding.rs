//! Measurement that would decide between an effect and its rivals.
//!
//! The model with the effect predicts what each measurement would show, and a rival's parameters are
//! moved to follow it as far as its present data allow, to first order. What is left is the misfit by
//! which the measurement is expected to separate the two. With white residuals d of the rival, their
//! derivatives J and the curvature H of the rival's fit it is dᵀ d − dᵀ J (H + Jᵀ J)⁻¹ Jᵀ d.

use crate::channel::{Channel, Loaded, QRS_MODEL_SD_MS, VALVE_MODEL_SD_MS};
use crate::fit::Fit;
use crate::forward::{LoadedPrediction, Prediction};
use crate::further::{FurtherTrace, LoadedBeat};
use crate::measured::Uncertain;
use crate::problem::Problem;
use crate::stage::{BARE_MENTION, Search, SearchStage};
use crate::usual;
use crate::valves::cyclic;
use cardiotwin_vocabulary::findings::Confusable;
use cardiotwin_vocabulary::measurements::FurtherQuantity;
use cardiotwin_vocabulary::measurements::Measurement;
use nalgebra::{DMatrix, DVector};

/// Misfit below which a rival cannot be distinguished: the odds are less than about 30 to 1 for
/// noise of average magnitude.
pub const SEPARABLE: f64 = 7.0;

/// A rival of an accepted effect.
#[derive(Debug, Clone)]
pub struct Rival {
    /// Misfit that it leaves on the effect's noise-free output.
    pub confusable: Confusable,
    /// Misfit by which each further measurement is expected to separate it from the effect; empty for
    /// a rival that can be distinguished.
    pub separations: Vec<Separation>,
}

/// Step of the differences in z.
const STEP: f64 = 0.02;
/// Filling pressure under the lower load, as a share of that at rest.
const LOWER: f64 = 0.6;
/// Frames of an image series over a cycle.
const FRAMES: usize = 33;

/// Base parameters that differ under another load, with the priors' standard deviations of the
/// logarithms of their factors.
const LOADS: [(&str, f64); 3] = [
    ("left_atrial_pressure_mmHg", 0.7),
    ("peripheral_resistance_mmHg_s_per_mL", 0.2),
    ("Smax_ref_kPa", 0.1),
];

/// Number of further candidates that a suspect is to be separated from.
const N_SUSPECTS: usize = 2;

/// Misfit by which a measurement is expected to separate an effect from a rival.
pub type Separation = (Measurement, f64);

/// Beats of one set of parameters: at rest and under the lower load.
struct Beats {
    rest: Prediction,
    lower: Option<Prediction>,
}

/// Predicts the beats of a structure at these values.
fn beats(problem: &Problem<'_>, fit: &Fit, values: &[f64], load: [f64; 3]) -> Option<Beats> {
    let rest = problem.predict(&fit.structure, values, Some(&fit.minimum.warm))?;
    let mut under_load = values.to_vec();
    let base = problem.forward.base();
    let mut is_known = true;
    for ((name, _), factor) in LOADS.iter().zip(load) {
        match base.iter().position(|p| p.name == *name) {
            Some(at) => under_load[at] *= factor,
            None => is_known = false,
        }
    }
    let lower = if is_known {
        problem.predict(&fit.structure, &under_load, Some(&rest.warm))
    } else {
        None
    };
    Some(Beats { rest, lower })
}

/// White residuals of beats against what one measurement shows of the true ones.
type White<'a> = Box<dyn Fn(&Beats) -> Option<Vec<f64>> + 'a>;

fn trace(quantity: FurtherQuantity, truth: &Prediction, cycle_ms: f64) -> White<'static> {
    let n = match quantity {
        FurtherQuantity::AorticPressure | FurtherQuantity::AtrialPressure => cycle_ms as usize,
        FurtherQuantity::AorticFlow | FurtherQuantity::MitralFlow | FurtherQuantity::Strain => {
            FRAMES
        }
    };
    let time_ms: Vec<f64> = (0..n).map(|k| k as f64 * cycle_ms / n as f64).collect();
    let measured = FurtherTrace {
        quantity,
        value: truth.sampled(truth.further(quantity), &time_ms),
        time_ms,
        rms: usual::trace_rms(quantity),
        correlation_ms: usual::CORRELATION_MS,
        delay: Uncertain {
            value: 0.0,
            sd: 0.0,
        },
    };
    let channel = Channel::new(&measured, cycle_ms, 1.0);
    Box::new(move |beats| Some(channel.signal.white(&channel.model(&beats.rest))))
}

fn loaded<'a>(problem: &Problem<'_>, truth: &Prediction) -> White<'a> {
    let measured = &problem.data.measured;
    let beat = LoadedBeat {
        cycle_ms: measured.cycle_ms,
        pressure_mmhg: truth.sampled(&truth.pressure_mmhg, &measured.pressure_time_ms),
        pressure_time_ms: measured.pressure_time_ms.clone(),
        frame_volume_ml: truth.sampled(&truth.volume_ml, &measured.frame_time_ms),
        frame_time_ms: measured.frame_time_ms.clone(),
    };
    let data = problem.data;
    let loaded = Loaded::new(&beat, measured, &data.levels, &data.error_model);
    Box::new(move |beats| {
        let lower = beats.lower.as_ref()?;
        let prediction = LoadedPrediction {
            step_ms: lower.step_ms,
            pressure_mmhg: lower.pressure_mmhg.clone(),
            volume_ml: lower.volume_ml.clone(),
        };
        let [pressure, volume] = loaded.models(&prediction);
        let white = [
            loaded.pressure.white(&pressure),
            loaded.volume.white(&volume),
        ];
        Some(white.concat())
    })
}

/// What each measurement that was not made would show of the true beats.
fn measurements<'a>(problem: &'a Problem<'_>, truth: &'a Beats) -> Vec<(Measurement, White<'a>)> {
    let measured = &problem.data.measured;
    let (side, cycle) = (&measured.side, measured.cycle_ms);
    let mut list: Vec<(Measurement, White<'a>)> = Vec::new();
    for quantity in FurtherQuantity::ALL {
        if !measured.further.has(quantity) {
            list.push((quantity.measurement(), trace(quantity, &truth.rest, cycle)));
        }
    }
    let rest = &truth.rest;
    if let Some(times) = rest.valve_times_ms
        && side.valve_times.all().iter().all(Option::is_none)
    {
        let white = move |beats: &Beats| {
            let model = beats.rest.valve_times_ms?;
            let residual = |k: usize| {
                cyclic(times[k] - model[k], cycle) / usual::VALVE_SD_MS.hypot(VALVE_MODEL_SD_MS[k])
            };
            Some((0..4).map(residual).collect())
        };
        list.push((Measurement::ValveTimes, Box::new(white)));
    }
    let mut scalar = |what: Measurement, sd: f64, of: fn(&Prediction) -> f64| {
        let white = move |beats: &Beats| Some(vec![(of(rest) - of(&beats.rest)) / sd]);
        list.push((what, Box::new(white)));
    };
    if side.qrs_ms.is_none() {
        let sd = usual::QRS_SD_MS.hypot(QRS_MODEL_SD_MS);
        scalar(Measurement::Qrs, sd, |beat| beat.qrs_ms);
    }
    if side.forward_stroke_volume.is_none() {
        let sd = usual::STROKE_VOLUME_SD * rest.forward_stroke_volume_ml.abs().max(1.0);
        scalar(Measurement::ForwardStrokeVolume, sd, |beat| {
            beat.forward_stroke_volume_ml
        });
    }
    if side.cuff.is_none() {
        let white = move |beats: &Beats| {
            let model = &beats.rest;
            Some(vec![
                (rest.systolic_mmhg - model.systolic_mmhg) / usual::CUFF_SD_MMHG,
                (rest.diastolic_mmhg - model.diastolic_mmhg) / usual::CUFF_SD_MMHG,
            ])
        };
        list.push((Measurement::Cuff, Box::new(white)));
    }
    if side.whole_heart.is_none() {
        // In diastasis, at three quarters of the cycle.
        let at = move |beat: &Prediction| beat.at(&beat.true_volume_ml, 0.75 * cycle);
        let white = move |beats: &Beats| {
            let truth = at(rest);
            Some(vec![(truth - at(&beats.rest)) / (usual::IMAGE_SD * truth)])
        };
        list.push((Measurement::WholeHeartVolume, Box::new(white)));
    }
    if measured.further.loaded.is_empty()
        && let Some(lower) = &truth.lower
    {
        list.push((Measurement::Loaded, loaded(problem, lower)));
    }
    list
}

/// Expected misfit of a rival for each measurement that was not made; empty if a beat is missing.
///
/// - `problem`: with the data to which the rival was fitted
/// - `truth`: fit with the effect
#[must_use]
pub fn separations(problem: &Problem<'_>, truth: &Fit, rival: &Fit) -> Vec<Separation> {
    let at_rest = [LOWER, 1.0, 1.0];
    let Some(true_beats) = beats(problem, truth, &truth.values(), at_rest) else {
        return Vec::new();
    };
    let Some(here) = beats(problem, rival, &rival.values(), at_rest) else {
        return Vec::new();
    };
    let n = rival.z.len();
    // Moved in each parameter, then in what is free under another load.
    let moved: Vec<Option<(Beats, f64)>> = (0..n)
        .map(|k| {
            let (_, upper) = rival.parameters[k].z_bounds();
            let step = if rival.z[k] + STEP > upper {
                -STEP
            } else {
                STEP
            };
            let mut values = rival.values();
            values[k] = rival.parameters[k].value(rival.z[k] + step);
            Some((beats(problem, rival, &values, at_rest)?, step))
        })
        .collect();
    let under_loads: Vec<Option<(Beats, f64)>> = (0..LOADS.len())
        .map(|k| {
            let mut load = at_rest;
            load[k] *= (STEP * LOADS[k].1).exp();
            Some((beats(problem, rival, &rival.values(), load)?, STEP))
        })
        .collect();
    let curvature = rival.curvature();
    let expected = |what: Measurement, white: &White<'_>| -> Option<f64> {
        let d = DVector::from_vec(white(&here)?);
        let free = if what == Measurement::Loaded {
            &under_loads[..]
        } else {
            &[]
        };
        let n_all = n + free.len();
        let mut normal = DMatrix::identity(n_all, n_all);
        normal.view_mut((0, 0), (n, n)).copy_from(&curvature);
        let mut jacobian = DMatrix::zeros(d.len(), n_all);
        for (k, moved) in moved.iter().chain(free).enumerate() {
            // A parameter without a beat next to it cannot follow.
            if let Some((beats, step)) = moved
                && let Some(there) = white(beats)
            {
                jacobian.set_column(k, &((DVector::from_vec(there) - &d) / *step));
            }
        }
        normal += jacobian.tr_mul(&jacobian);
        let along = jacobian.tr_mul(&d);
        let solved = normal.cholesky()?.solve(&along);
        Some((d.norm_squared() - along.dot(&solved)).max(0.0))
    };
    measurements(problem, &true_beats)
        .iter()
        .filter_map(|(what, white)| Some((*what, expected(*what, white)?)))
        .collect()
}

/// Measurements in the order in which they are suggested: by the smallest misfit that they are
/// expected to leave to any rival. Those below `least` for all rivals are left out; where that leaves
/// none, the best one is kept if it is worth more than a mention.
#[must_use]
pub fn suggested(rivals: &[Vec<Separation>], least: f64) -> Vec<Measurement> {
    let of = |what: Measurement| -> Vec<f64> {
        (rivals.iter().flatten())
            .filter(|(other, _)| *other == what)
            .map(|(_, misfit)| *misfit)
            .collect()
    };
    let mut list: Vec<(Measurement, f64, f64)> = (Measurement::ALL.into_iter())
        .map(|what| {
            let misfits = of(what);
            let extreme = |start: f64, better: fn(f64, f64) -> f64| {
                misfits.iter().copied().fold(start, better)
            };
            (what, extreme(f64::MAX, f64::min), extreme(0.0, f64::max))
        })
        .filter(|(.., largest)| *largest >= BARE_MENTION)
        .collect();
    list.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let best = list.first().map(|(what, ..)| *what);
    list.retain(|(.., largest)| *largest >= least);
    if list.is_empty() {
        return best.into_iter().collect();
    }
    list.into_iter().map(|(what, ..)| what).collect()
}

impl Search<'_> {
    /// Measurements that would decide between the accepted effects and their rivals, the best first;
    /// then those of the catalogue. If no effect was accepted, between the first candidates of the
    /// ranking that the data prefer, and nothing.
    ///
    /// - `rivals`: those of the accepted effects; `None` if none was accepted
    pub(crate) fn deciding(&self, stage: &SearchStage, rivals: Option<&[Rival]>) -> Vec<String> {
        let separations: Vec<Vec<Separation>> = if rivals.is_none() {
            self.suspects(stage)
        } else {
            (rivals.iter().copied().flatten())
                .map(|r| r.separations.clone())
                .collect()
        };
        let words = suggested(&separations, SEPARABLE);
        let mut list: Vec<String> = words.iter().map(|what| what.words().to_owned()).collect();
        let of_catalogue = (self.forward.candidates().iter())
            .filter(|c| {
                let is = |name: &String| *name == c.name;
                (rivals.iter().copied().flatten())
                    .any(|r| is(&r.confusable.effect) || is(&r.confusable.rival))
            })
            .flat_map(|c| &c.separated_by);
        for words in of_catalogue {
            // What the program reads was computed above.
            if Measurement::of_words(words).is_none() && !list.contains(words) {
                list.push(words.clone());
            }
        }
        list
    }

    /// What separates the most likely candidate from nothing and from the next ones, if the data prefer
    /// it.
    fn suspects(&self, stage: &SearchStage) -> Vec<Vec<Separation>> {
        let mut likely = (self.ranking(stage).into_iter())
            .filter(|(_, gain)| *gain > BARE_MENTION)
            .filter_map(|(term, _)| Some((term, stage.with[term].as_ref()?.plain())))
            .filter(|(term, fit)| self.plausible(fit, *term))
            .map(|(_, fit)| fit);
        let Some(first) = likely.next() else {
            return Vec::new();
        };
        let problem = self.plain();
        std::iter::once(stage.own.plain())
            .chain(likely.take(N_SUSPECTS))
            .map(|rival| separations(&problem, first, rival))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_measurement_that_separates_all_rivals_comes_first() {
        let rivals = [
            vec![
                (Measurement::Qrs, 90.0),
                (Measurement::AorticFlow, 20.0),
                (Measurement::Strain, 1.0),
            ],
            vec![
                (Measurement::Qrs, 2.0),
                (Measurement::AorticFlow, 15.0),
                (Measurement::Strain, 3.0),
            ],
        ];
        assert_eq!(
            suggested(&rivals, 7.0),
            [Measurement::AorticFlow, Measurement::Qrs]
        );
        // Nothing separates well: the best is suggested, if it is of any use.
        let weak = [vec![(Measurement::Strain, 3.0), (Measurement::Cuff, 1.0)]];
        assert_eq!(suggested(&weak, 7.0), [Measurement::Strain]);
        assert!(suggested(&[vec![(Measurement::Cuff, 1.0)]], 7.0).is_empty());
        assert!(suggested(&[], 7.0).is_empty());
    }
}

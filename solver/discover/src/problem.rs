//! Fit problem of the search: a structure (base, named terms, bumps) and its residuals against the
//! data.

use crate::channel::{FurtherData, QRS_MODEL_SD_MS, VALVE_MODEL_SD_MS};
use crate::forward::{Forward, Orbits, Prediction, Request};
use crate::joint::SharedErrors;
use crate::learnt::Formulation;
use crate::measured::Measured;
use crate::noise::{ErrorModel, NoiseLevels, Signal, pressure_signal, volume_signal};
use crate::parameter::Parameter;
use crate::valves::cyclic;
use nalgebra::{DMatrix, DVector};

/// Number of factors of the activation in the nameless competitor.
pub const N_BUMPS: usize = 6;

/// Data prepared for fits.
#[derive(Debug, Clone)]
pub struct Data {
    /// Traces and scalars as they were measured.
    pub measured: Measured,
    /// Noise levels of the fits.
    pub levels: NoiseLevels,
    /// Discrepancy that the model may show although no effect is missing.
    pub error_model: ErrorModel,
    /// Pressure samples, averaged in bins.
    pub pressure: Signal,
    /// Volume of the frames.
    pub volume: Signal,
    /// Further traces, and beats under changed load.
    pub further: FurtherData,
    /// Errors that both share.
    shared: SharedErrors,
}

impl Data {
    /// Computes bins, covariances and noise levels of measured data.
    ///
    /// - `formulation`: how the base may miss a healthy heart, besides
    #[must_use]
    pub fn new(
        measured: Measured,
        error_model: &ErrorModel,
        formulation: Option<&Formulation>,
    ) -> Self {
        let levels = NoiseLevels::of(&measured);
        let pressure = pressure_signal(&measured, &levels, error_model);
        let volume = volume_signal(&measured, &levels, error_model);
        let signals = [&pressure, &volume];
        let errors = match formulation {
            Some(formulation) => formulation.errors(signals, measured.cycle_ms),
            None => DMatrix::zeros(pressure.len() + volume.len(), 0),
        };
        Self {
            shared: SharedErrors::new(signals, errors),
            further: FurtherData::new(&measured, &levels, error_model),
            measured,
            levels,
            error_model: *error_model,
            pressure,
            volume,
        }
    }

    /// The trace data at selected times, with all side data.
    #[must_use]
    pub fn part(&self, wanted: &dyn Fn(f64) -> bool) -> Self {
        let keep = |signal: &Signal| {
            (0..signal.len())
                .filter(|i| wanted(signal.time_ms[*i]))
                .collect::<Vec<usize>>()
        };
        let (mut rows, of_volume) = (keep(&self.pressure), keep(&self.volume));
        let (pressure, volume) = (self.pressure.subset(&rows), self.volume.subset(&of_volume));
        rows.extend(of_volume.iter().map(|i| self.pressure.len() + i));
        Self {
            shared: self.shared.part([&pressure, &volume], &rows),
            pressure,
            volume,
            further: self.further.clone(),
            measured: self.measured.clone(),
            ..*self
        }
    }

    /// Logarithm of the determinant of the noise's covariance.
    #[must_use]
    pub fn noise_log_determinant(&self) -> f64 {
        let traces = self.pressure.log_determinant + self.volume.log_determinant;
        if self.further.is_empty() {
            traces
        } else {
            traces + self.further.log_determinant()
        }
    }

    /// Number of data besides pressure and volume of the steady beat.
    #[must_use]
    pub fn n_side(&self) -> usize {
        self.measured.side.len() + self.further.len()
    }

    /// Number of independent data: frames, samples of other traces two correlation times apart, and
    /// scalars.
    #[must_use]
    pub fn n_effective(&self) -> f64 {
        let span = self.measured.cycle_ms * self.pressure.len() as f64 * crate::noise::BIN_MS
            / self.measured.cycle_ms;
        self.volume.len() as f64
            + span / (2.0 * self.levels.pressure_correlation_ms)
            + self.measured.side.len() as f64
            + self.n_effective_further()
    }

    fn n_effective_further(&self) -> f64 {
        let of = |samples: usize, correlation_ms: f64, cycle_ms: f64| {
            (samples as f64).min(cycle_ms / (2.0 * correlation_ms))
        };
        let further = &self.measured.further;
        let traces = (further.traces.iter())
            .map(|t| of(t.time_ms.len(), t.correlation_ms, self.measured.cycle_ms));
        let tau = self.levels.pressure_correlation_ms;
        let loaded = (further.loaded.iter())
            .map(|b| b.frame_time_ms.len() as f64 + of(b.pressure_time_ms.len(), tau, b.cycle_ms));
        traces.chain(loaded).sum()
    }
}

/// Terms of a model besides the base.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Structure {
    /// Indices of the candidates.
    pub terms: Vec<usize>,
    /// Whether the activation has nameless bumps.
    pub bumps: bool,
}

/// Weights of the squared residuals of pressure and volume: the inverse squares of their profiled
/// noise scales.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Weight of the squared pressure residuals.
    pub pressure: f64,
    /// Weight of the squared volume residuals.
    pub volume: f64,
}

/// Model and data of a fit.
pub struct Problem<'a> {
    /// Model with its catalogue.
    pub forward: &'a dyn Forward,
    /// Measured data with their noise levels.
    pub data: &'a Data,
}

/// Sums of squared white residuals by origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// Sum over the pressure bins.
    pub pressure: f64,
    /// Sum over the volume frames.
    pub volume: f64,
    /// Sum over the side data: scalars, further traces, beats under changed load.
    pub side: f64,
    /// Logarithm of the determinant that shared errors and the common factor of the volumes add to
    /// the covariance of the noise.
    pub log_determinant: f64,
    /// Sum over the priors.
    pub prior: f64,
}

impl Problem<'_> {
    /// Parameters of a structure: base, terms in order, bumps.
    #[must_use]
    pub fn parameters(&self, structure: &Structure) -> Vec<Parameter> {
        let mut all = self.forward.base().to_vec();
        for term in &structure.terms {
            all.extend(self.forward.candidates()[*term].parameters.iter().cloned());
        }
        if structure.bumps {
            all.extend((0..N_BUMPS).map(|i| Parameter {
                name: format!("bump_{}", i + 1),
                lower: -1.0,
                upper: 1.0,
                mean: 0.0,
                sd: self.data.error_model.competitors.activation,
                log: false,
            }));
        }
        all
    }

    /// Predicts the beat for these values.
    #[must_use]
    pub fn predict(
        &self,
        structure: &Structure,
        values: &[f64],
        warm: Option<&Orbits>,
    ) -> Option<Prediction> {
        let n_base = self.forward.base().len();
        let (base, mut rest) = values.split_at(n_base);
        let mut terms = Vec::with_capacity(structure.terms.len());
        for term in &structure.terms {
            let (own, others) = rest.split_at(self.forward.candidates()[*term].parameters.len());
            terms.push((*term, own));
            rest = others;
        }
        self.forward.predict(
            &Request {
                base,
                terms: &terms,
                bumps: rest,
            },
            warm,
        )
    }

    /// White residuals of a beat, data minus model, in the order pressure, volume, scalars, further
    /// traces, beats under changed load. The
    /// last element is the root of the logarithm of the determinant added by shared errors and the
    /// volumes' common factor, since that varies with the model. The weights multiply the squares of the first two
    /// groups.
    #[must_use]
    pub fn white(&self, beat: &Prediction, weights: Weights) -> Vec<f64> {
        let data = self.data;
        let mut out = Vec::with_capacity(data.pressure.len() + data.volume.len() + 32);
        let models = [
            beat.sampled(&beat.pressure_mmhg, &data.pressure.time_ms),
            beat.sampled(&beat.volume_ml, &data.volume.time_ms),
        ];
        let residuals = [
            data.pressure.residual(&models[0]),
            data.volume.residual(&models[1]),
        ];
        let white = data.shared.whiten(
            [&data.pressure, &data.volume],
            [&residuals[0], &residuals[1]],
            &models[1],
        );
        out.extend(white.residuals);
        let (p, v) = (weights.pressure.sqrt(), weights.volume.sqrt());
        let n_p = data.pressure.len();
        out[..n_p].iter_mut().for_each(|r| *r *= p);
        out[n_p..].iter_mut().for_each(|r| *r *= v);
        out.extend(self.side(beat));
        let mut log_determinant = white.log_determinant;
        if !data.further.is_empty() {
            let further = data.further.white(beat);
            out.extend(further.residuals);
            log_determinant += further.log_determinant;
        }
        out.push(log_determinant.sqrt());
        out
    }

    /// Standardised residuals of the scalars: cuff (systolic, diastolic), forward stroke volume,
    /// whole-heart volume, times of valves, duration of QRS.
    #[must_use]
    pub fn side(&self, beat: &Prediction) -> Vec<f64> {
        let side = &self.data.measured.side;
        let mut out = Vec::with_capacity(4);
        if let Some(cuff) = side.cuff {
            out.push((cuff.systolic.value - beat.systolic_mmhg) / cuff.systolic.sd);
            out.push((cuff.diastolic.value - beat.diastolic_mmhg) / cuff.diastolic.sd);
        }
        if let Some(v) = side.forward_stroke_volume {
            out.push((v.value - beat.forward_stroke_volume_ml) / v.sd);
        }
        if let Some(w) = side.whole_heart {
            out.push((w.volume.value - beat.at(&beat.true_volume_ml, w.time_ms)) / w.volume.sd);
        }
        for (which, time) in side.valve_times.all().into_iter().enumerate() {
            if let Some(time) = time {
                // A beat without this event has no finite residual, and is no solution.
                let model = beat.valve_times_ms.map_or(f64::NAN, |times| times[which]);
                let difference = cyclic(time.value - model, self.data.measured.cycle_ms);
                out.push(difference / time.sd.hypot(VALVE_MODEL_SD_MS[which]));
            }
        }
        if let Some(qrs) = side.qrs_ms {
            out.push((qrs.value - beat.qrs_ms) / qrs.sd.hypot(QRS_MODEL_SD_MS));
        }
        out
    }

    /// Residuals for z: white residuals, then priors; with the state for a warm start.
    #[must_use]
    pub fn residuals(
        &self,
        structure: &Structure,
        parameters: &[Parameter],
        z: &[f64],
        weights: Weights,
        warm: Option<&Orbits>,
    ) -> Option<(DVector<f64>, Orbits)> {
        let values: Vec<f64> = parameters.iter().zip(z).map(|(p, z)| p.value(*z)).collect();
        let beat = self.predict(structure, &values, warm)?;
        let mut out = self.white(&beat, weights);
        if out.iter().any(|r| !r.is_finite()) {
            return None;
        }
        out.extend_from_slice(z);
        Some((DVector::from_vec(out), beat.warm))
    }

    /// Unweighted sums of squares by origin, from residuals that include these weights.
    #[must_use]
    pub fn misfit(&self, residuals: &DVector<f64>, weights: Weights) -> Misfit {
        let (n_p, n_v, n_s) = (
            self.data.pressure.len(),
            self.data.volume.len(),
            self.data.n_side(),
        );
        let sum = |from: usize, n: usize| residuals.rows(from, n).norm_squared();
        Misfit {
            pressure: sum(0, n_p) / weights.pressure,
            volume: sum(n_p, n_v) / weights.volume,
            side: sum(n_p + n_v, n_s),
            log_determinant: sum(n_p + n_v + n_s, 1),
            prior: sum(n_p + n_v + n_s + 1, residuals.len() - n_p - n_v - n_s - 1),
        }
    }
}

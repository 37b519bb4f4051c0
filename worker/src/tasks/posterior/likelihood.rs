//! Likelihood of measured traces, given a beat.
//!
//! The errors of each trace are Gaussian. Noise has the level stated in the patient's file; it has
//! an exponential correlation in the pressure, and is independent between frames in the volume. The
//! deviation of the twin's beat beyond the noise, as a function of time in the beat, counts as an
//! error of the model with a longer correlation time (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B
//! 63:425). A beat of the law takes the place of the twin's where the law has no beat with the twin's
//! parameters. Parameters are therefore not bent to explain, for example, an atrial kick that the
//! model lacks. One factor enlarges all standard deviations, because draws spread too little in a
//! nonlinear ventricle (a tempered likelihood; `posterior.error_factor`). The measured biomarkers
//! replace a trace that was not measured. The rates of pressure count in either case, because they
//! change faster than the samples resolve.

use cardiotwin_calibrate::posterior::TraceErrors;
use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::posterior::{Deviations, PosteriorSpec, TraceNoise};
use cardiotwin_schemas::samples::{BeatSamples, N_SAMPLES};

use super::summary::Seen;

/// The data with their errors, and the correction that makes the one-fibre ventricle exact at the
/// twin.
#[derive(Clone)]
pub(super) struct Likelihood {
    pressure: Option<TraceErrors>,
    volume: Option<TraceErrors>,
    /// Measured biomarkers that count, with their relative standard deviations.
    biomarkers: Vec<(Biomarker, f64, f64)>,
    /// Factor of all standard deviations.
    error_factor: f64,
    /// Beats of the organ and of the one-fibre ventricle whose difference corrects other beats; `None`
    /// without a correction.
    correction: Option<[Seen; 2]>,
    pub(super) deviations: Deviations,
}

/// Deviation of the twin's trace beyond its noise, by sample.
struct Discrepancy {
    /// Standard deviation of each sample.
    of_samples: Vec<f64>,
}

impl Discrepancy {
    /// - `noise_variance`: variance of the data's noise, in their unit squared
    /// - `correlation`: correlation time of the model error, in samples; squares are averaged over
    ///   twice this time
    fn of(simulated: &[f64], measured: &[f64], noise_variance: f64, correlation: f64) -> Self {
        let squares: Vec<f64> = simulated
            .iter()
            .zip(measured)
            .map(|(a, b)| (a - b).powi(2))
            .collect();
        let n = squares.len();
        let reach = (correlation.round() as usize).min(n.saturating_sub(1) / 2);
        let of_sample = |k: usize| {
            // The beat is periodic, so that the last sample's neighbour is the first one.
            let around = (0..=2 * reach).map(|step| squares[(k + n + step - reach) % n]);
            let mean = around.sum::<f64>() / (2 * reach + 1) as f64;
            (mean - noise_variance).max(0.0).sqrt()
        };
        Self {
            of_samples: (0..n).map(of_sample).collect(),
        }
    }

    fn root_mean_square(&self) -> f64 {
        let square: f64 = self.of_samples.iter().map(|s| s * s).sum();
        (square / self.of_samples.len().max(1) as f64).sqrt()
    }
}

impl Likelihood {
    /// The likelihood of beats that are corrected to the twin's.
    ///
    /// - `cheap`: the one-fibre ventricle's beat with the twin's parameters
    pub(super) fn of(spec: &PosteriorSpec, cheap: &OrganBeatResult) -> Self {
        let twin = Seen {
            biomarkers: spec.twin.biomarkers,
            samples: spec.twin.samples.clone(),
        };
        let cheap = Seen {
            biomarkers: cheap.biomarkers,
            samples: cheap.samples.clone(),
        };
        Self {
            correction: Some([twin, cheap]),
            ..Self::uncorrected(spec, &spec.twin.samples)
        }
    }

    /// The likelihood of beats without a correction.
    ///
    /// - `twin`: samples whose deviation from the data is the error of the model
    pub(super) fn uncorrected(spec: &PosteriorSpec, twin: &BeatSamples) -> Self {
        let noise = TraceNoise::of(&spec.noise);
        let measured = &spec.samples;
        let spacing_ms = spec.beat.cycle_length_ms / N_SAMPLES as f64;
        let lasting_ms = spec.settings.discrepancy_correlation_ms;
        let beyond = |twin: &[f64], measured: &[f64], noise_rms: f64| {
            Discrepancy::of(twin, measured, noise_rms.powi(2), lasting_ms / spacing_ms)
        };
        let of_pressure = beyond(
            &twin.pressure_mmhg,
            &measured.pressure_mmhg,
            noise.pressure_rms_mmhg,
        );
        let of_volume = beyond(&twin.volume_ml, &measured.volume_ml, noise.volume_rms_ml);
        let deviations = Deviations {
            noise,
            pressure_discrepancy_mmhg: of_pressure.root_mean_square(),
            volume_discrepancy_ml: of_volume.root_mean_square(),
        };
        let decayed =
            |i: usize, j: usize, ms: f64| (-(i.abs_diff(j) as f64) * spacing_ms / ms).exp();
        let of_model = |found: &Discrepancy, i: usize, j: usize| {
            found.of_samples[i] * found.of_samples[j] * decayed(i, j, lasting_ms)
        };
        let pressure = TraceErrors::new(&measured.pressure_mmhg, |i, j| {
            let own =
                noise.pressure_rms_mmhg.powi(2) * decayed(i, j, noise.pressure_correlation_ms);
            own + of_model(&of_pressure, i, j)
        });
        let volume = TraceErrors::new(&measured.volume_ml, |i, j| {
            let own = if i == j { noise.volume_variance() } else { 0.0 };
            own + of_model(&of_volume, i, j)
        });
        // Samples at a fortieth of a cycle do not resolve the steepest rates, which last some
        // milliseconds.
        let is_rate = |b: Biomarker| matches!(b, Biomarker::DpdtMax | Biomarker::DpdtMin);
        let counts = |biomarker: Biomarker| match biomarker.is_of_volume() {
            true => volume.is_none(),
            false => pressure.is_none() || is_rate(biomarker),
        };
        let biomarkers = spec
            .measured
            .of_organ()
            .into_iter()
            .filter_map(|(biomarker, value)| {
                let percent = spec.uncertainty_percent.get(biomarker.key())?;
                counts(biomarker).then_some((biomarker, value?, percent / 100.0))
            });
        let biomarkers = biomarkers.collect();
        Self {
            pressure,
            volume,
            biomarkers,
            error_factor: spec.settings.error_factor,
            correction: None,
            deviations,
        }
    }

    /// Whether beats are corrected to the twin's.
    pub(super) fn is_corrected(&self) -> bool {
        self.correction.is_some()
    }

    /// Samples and biomarkers of a one-fibre beat, corrected to those of the organ.
    pub(super) fn corrected(&self, beat: OrganBeatResult) -> Seen {
        let beat = Seen {
            biomarkers: beat.biomarkers,
            samples: beat.samples,
        };
        let Some([twin, cheap]) = &self.correction else {
            return beat;
        };
        let moved = |own: &[f64], cheap: &[f64], twin: &[f64]| {
            own.iter()
                .zip(cheap)
                .zip(twin)
                .map(|((own, cheap), twin)| twin + (own - cheap))
                .collect()
        };
        let samples = BeatSamples {
            pressure_mmhg: moved(
                &beat.samples.pressure_mmhg,
                &cheap.samples.pressure_mmhg,
                &twin.samples.pressure_mmhg,
            ),
            volume_ml: moved(
                &beat.samples.volume_ml,
                &cheap.samples.volume_ml,
                &twin.samples.volume_ml,
            ),
        };
        let (cheap, twin) = (&cheap.biomarkers, &twin.biomarkers);
        let moved = |b: Biomarker| Some(twin.get(b)? * beat.biomarkers.get(b)? / cheap.get(b)?);
        let biomarkers = Biomarker::OF_ORGAN
            .map(|b| (b, moved(b)))
            .into_iter()
            .collect();
        Seen {
            biomarkers,
            samples,
        }
    }

    /// Differences from the data divided by their standard deviations, decorrelated.
    pub(super) fn residuals(&self, samples: &BeatSamples, biomarkers: &Biomarkers) -> Vec<f64> {
        let mut all = Vec::new();
        for (errors, simulated) in [
            (&self.pressure, &samples.pressure_mmhg),
            (&self.volume, &samples.volume_ml),
        ] {
            all.extend(errors.iter().flat_map(|errors| errors.residuals(simulated)));
        }
        all.extend(self.biomarkers.iter().map(|(biomarker, measured, sd)| {
            let simulated = biomarkers.get(*biomarker);
            simulated.map_or(f64::NAN, |simulated| (simulated / measured - 1.0) / sd)
        }));
        all.iter_mut()
            .for_each(|residual| *residual /= self.error_factor);
        all
    }
}

//! How probable measured traces are, given a beat.
//!
//! The errors of each trace are Gaussian. Its noise is what the patient's file states: of the pressure with an exponential
//! correlation, of the volume independent in each frame. What the twin's beat misses beyond that is an error of the model, of
//! a longer correlation time (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425). A trace that was not measured is replaced
//! by its measured biomarkers. The rates of pressure, which last shorter than samples lie apart, count in either case.

use cardiotwin_calibrate::posterior::TraceErrors;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::posterior::{Deviations, PosteriorSpec, TraceNoise};
use cardiotwin_schemas::samples::{BeatSamples, N_SAMPLES};

/// The data with their errors, and what makes the one-fibre ventricle exact at the twin.
pub(super) struct Likelihood {
    pressure: Option<TraceErrors>,
    volume: Option<TraceErrors>,
    /// Measured biomarkers that count with their relative standard deviations.
    biomarkers: Vec<(&'static str, f64, f64)>,
    twin: BeatSamples,
    twin_biomarkers: Biomarkers,
    cheap: BeatSamples,
    cheap_biomarkers: Biomarkers,
    pub(super) deviations: Deviations,
}

/// Root mean square of the differences that is not explained by noise of this variance.
fn beyond(simulated: &[f64], measured: &[f64], noise_variance: f64) -> f64 {
    let n = simulated.len().min(measured.len());
    if n == 0 {
        return 0.0;
    }
    let square: f64 = simulated.iter().zip(measured).map(|(a, b)| (a - b).powi(2)).sum();
    (square / n as f64 - noise_variance).max(0.0).sqrt()
}

impl Likelihood {
    /// - `cheap`: the one-fibre ventricle's beat with the twin's parameters
    pub(super) fn of(spec: &PosteriorSpec, cheap: &OrganBeatResult) -> Self {
        let noise = TraceNoise::of(&spec.noise);
        let (measured, twin) = (&spec.samples, &spec.twin.samples);
        let deviations = Deviations {
            noise,
            pressure_discrepancy_mmhg: beyond(
                &twin.pressure_mmhg,
                &measured.pressure_mmhg,
                noise.pressure_rms_mmhg.powi(2),
            ),
            volume_discrepancy_ml: beyond(&twin.volume_ml, &measured.volume_ml, noise.volume_rms_ml.powi(2)),
        };
        let spacing_ms = spec.beat.cycle_length_ms / N_SAMPLES as f64;
        let decayed = |apart: usize, correlation_ms: f64| (-(apart as f64) * spacing_ms / correlation_ms).exp();
        let of_model = |rms: f64, apart: usize| rms.powi(2) * decayed(apart, spec.settings.discrepancy_correlation_ms);
        let pressure = TraceErrors::new(&measured.pressure_mmhg, |apart| {
            noise.pressure_rms_mmhg.powi(2) * decayed(apart, noise.pressure_correlation_ms)
                + of_model(deviations.pressure_discrepancy_mmhg, apart)
        });
        let volume = TraceErrors::new(&measured.volume_ml, |apart| {
            let own = if apart == 0 { noise.volume_variance() } else { 0.0 };
            own + of_model(deviations.volume_discrepancy_ml, apart)
        });
        let is_of_volume = |name: &str| ["SV_mL", "tau_VD_ms", "tau_VR_ms"].contains(&name);
        // A fortieth of a cycle says nothing of the steepest rates, which last some milliseconds.
        let is_rate = |name: &str| name.starts_with("dPdt");
        let counts = |name: &str| match is_of_volume(name) {
            true => volume.is_none(),
            false => pressure.is_none() || is_rate(name),
        };
        let biomarkers = spec.measured.of_organ().into_iter().filter_map(|(name, value)| {
            let percent = spec.uncertainty_percent.get(name)?;
            counts(name).then_some((name, value?, percent / 100.0))
        });
        let biomarkers = biomarkers.collect();
        Self {
            pressure,
            volume,
            biomarkers,
            twin: twin.clone(),
            twin_biomarkers: spec.twin.biomarkers,
            cheap: cheap.samples.clone(),
            cheap_biomarkers: cheap.biomarkers,
            deviations,
        }
    }

    /// Samples and biomarkers of a beat of the one-fibre ventricle as the organ would have them.
    pub(super) fn corrected(&self, beat: &OrganBeatResult) -> (BeatSamples, Biomarkers) {
        let moved = |own: &[f64], cheap: &[f64], twin: &[f64]| {
            own.iter().zip(cheap).zip(twin).map(|((own, cheap), twin)| twin + (own - cheap)).collect()
        };
        let samples = BeatSamples {
            pressure_mmhg: moved(&beat.samples.pressure_mmhg, &self.cheap.pressure_mmhg, &self.twin.pressure_mmhg),
            volume_ml: moved(&beat.samples.volume_ml, &self.cheap.volume_ml, &self.twin.volume_ml),
        };
        let [own, cheap, twin] =
            [&beat.biomarkers, &self.cheap_biomarkers, &self.twin_biomarkers].map(|b| b.of_organ());
        let ratio = |k: usize| Some(twin[k].1? * own[k].1? / cheap[k].1?);
        let biomarkers = Biomarkers::with_organ(std::array::from_fn(ratio));
        (samples, biomarkers)
    }

    /// Differences to the data over their standard deviations, independent of each other.
    pub(super) fn residuals(&self, samples: &BeatSamples, biomarkers: &Biomarkers) -> Vec<f64> {
        let mut all = Vec::new();
        for (errors, simulated) in [(&self.pressure, &samples.pressure_mmhg), (&self.volume, &samples.volume_ml)] {
            all.extend(errors.iter().flat_map(|errors| errors.residuals(simulated)));
        }
        let found = biomarkers.of_organ();
        all.extend(self.biomarkers.iter().map(|(name, measured, sd)| {
            let simulated = found.iter().find(|(other, _)| other == name).and_then(|(_, value)| *value);
            simulated.map_or(f64::NAN, |simulated| (simulated / measured - 1.0) / sd)
        }));
        all
    }
}

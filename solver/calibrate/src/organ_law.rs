//! Fit of the organ's law to beats: Bayesian linear regression, so that a law is defined by one
//! beat, by many, or by a prior alone.
//!
//! Coefficients have a Gaussian prior. Samples of the beats add independent Gaussian errors. The
//! law is the mean of the posterior.

use cardiotwin_models::ventricle::organ_law::{N_DEVIATION, N_PRESSURE, N_STRETCH};
use cardiotwin_models::ventricle::{OneFibrePassive, OrganLaw};
pub use cardiotwin_vocabulary::organ_law::{Gaussian, LawPrior};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// Weight of the prior next to beats of the organ. The spread between the twelve organs of the prior
/// is too small for organs of another kind; errors on these twelve are the same for 1 to 1/9.
const PRIOR_WEIGHT: f64 = 0.25;
/// Largest number of times that the prior's weight is multiplied by ten until the law can be used.
const STIFFENINGS: i32 = 6;
/// Samples of a beat of the organ. All lists have one value for each time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawBeat<'a> {
    /// Cavity volume \[mL\].
    pub volume_ml: &'a [f64],
    /// Cavity pressure \[mmHg\].
    pub pressure_mmhg: &'a [f64],
    /// Mean active stress of the wall, weighted by volume \[kPa\].
    pub stress_kpa: &'a [f64],
    /// Mean stretch of the cells, weighted by volume; the first sample is end-diastole.
    pub stretch: &'a [f64],
    /// Standard deviation of the cells' stretch over the wall along its pattern, signed.
    pub stretch_deviation: &'a [f64],
    /// Active stress along the same pattern \[kPa\].
    pub stress_deviation_kpa: &'a [f64],
    /// Slack stretch of the cells over that of the unloaded wall; `None` if their stretch is counted
    /// from end-diastole.
    pub slack: Option<f64>,
}

/// Features of an organ on which the prior depends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrganFeatures {
    /// Logarithm of the passive law's exponents over the published ones.
    pub log_exponent_factor: f64,
    /// Logarithm of the volume of the image over the end-diastolic volume.
    pub log_image_volume: f64,
    /// Duration of the contraction at the epicardium over that at the endocardium.
    pub duration_share: f64,
}

impl Default for OrganFeatures {
    fn default() -> Self {
        Self {
            log_exponent_factor: 0.0,
            log_image_volume: 0.0,
            duration_share: 1.0,
        }
    }
}

/// Unusable input of a fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OrganLawError {
    /// Lists of a beat differ in length or are empty, or a value is not finite.
    #[error(
        "beat {number} of the organ's law must have as many pressures, stresses, stretches and deviations as volumes, all \
         finite and the stretches positive"
    )]
    Samples {
        /// Number of the beat, from 1.
        number: usize,
    },
    /// The prior has another number of coefficients, or a covariance that is not positive definite.
    #[error(
        "the prior of the {what} must have {expected} coefficients with a positive definite covariance"
    )]
    Prior {
        /// Quantity of the law.
        what: &'static str,
        /// Number of coefficients.
        expected: usize,
    },
}

/// The prior that is shipped.
#[must_use]
pub fn shipped_prior() -> LawPrior {
    serde_json::from_str(include_str!("organ_law_prior.json")).expect("the shipped prior is JSON")
}

/// Normal equations of a regression.
pub(crate) struct Regression<const N: usize> {
    pub(crate) mean: SVector<f64, N>,
    precision: SMatrix<f64, N, N>,
    /// XᵀX/σ² and Xᵀ(y − X μ)/σ².
    pub(crate) information: SMatrix<f64, N, N>,
    pub(crate) gradient: SVector<f64, N>,
}

impl<const N: usize> Regression<N> {
    fn new(
        prior: &LawPrior,
        of: &Gaussian,
        features: &OrganFeatures,
        what: &'static str,
    ) -> Result<Self, OrganLawError> {
        let refused = OrganLawError::Prior { what, expected: N };
        let lists = [
            &of.mean,
            &of.per_log_exponent_factor,
            &of.per_log_image_volume,
        ];
        let is_square = of.covariance.len() == N && of.covariance.iter().all(|row| row.len() == N);
        if lists.iter().any(|list| list.len() != N) || !is_square {
            return Err(refused);
        }
        let covariance = DMatrix::from_fn(N, N, |i, j| of.covariance[i][j]);
        let factor = covariance.cholesky().ok_or(refused)?;
        let inverse = factor.inverse();
        let [low, high] = prior.log_exponent_factor_range;
        let of_exponent = features.log_exponent_factor.clamp(low, high);
        let of_image = features.log_image_volume - prior.typical_log_image_volume;
        let mean = |i: usize| {
            of.mean[i]
                + of.per_log_exponent_factor[i] * of_exponent
                + of.per_log_image_volume[i] * of_image
        };
        Ok(Self {
            mean: SVector::from_fn(|i, _| mean(i)),
            precision: SMatrix::from_fn(|i, j| 0.5 * (inverse[(i, j)] + inverse[(j, i)])),
            information: SMatrix::zeros(),
            gradient: SVector::zeros(),
        })
    }

    /// Adds a sample whose value without coefficients is `own`.
    fn add(&mut self, row: [f64; N], own: f64, value: f64, sd: f64) {
        let row = SVector::from(row) / sd;
        self.information += row * row.transpose();
        self.gradient += row * ((value - own) / sd - row.dot(&self.mean));
    }

    /// Coefficients with a prior of `weight` times its precision.
    fn solve(&self, weight: f64) -> [f64; N] {
        let matrix = self.precision * weight + self.information;
        let matrix = DMatrix::from_fn(N, N, |i, j| matrix[(i, j)]);
        let right = DVector::from_column_slice(self.gradient.as_slice());
        let change = matrix.cholesky().map(|factor| factor.solve(&right));
        std::array::from_fn(|i| self.mean[i] + change.as_ref().map_or(0.0, |change| change[i]))
    }
}

fn check(beats: &[LawBeat<'_>]) -> Result<(), OrganLawError> {
    for (beat, number) in beats.iter().zip(1..) {
        let n = beat.volume_ml.len();
        let lists = [
            beat.volume_ml,
            beat.pressure_mmhg,
            beat.stress_kpa,
            beat.stretch,
            beat.stretch_deviation,
            beat.stress_deviation_kpa,
        ];
        let is_usable = n > 0
            && lists
                .iter()
                .all(|list| list.len() == n && list.iter().all(|x| x.is_finite()))
            && beat.stretch.iter().all(|x| *x > 0.0);
        if !is_usable {
            return Err(OrganLawError::Samples { number });
        }
    }
    Ok(())
}

/// Normal equations of the law's coefficients with samples of beats.
pub(crate) struct Regressions {
    pub(crate) pressure: Regression<N_PRESSURE>,
    pub(crate) stretch: Regression<N_STRETCH>,
    pub(crate) deviation: Regression<N_DEVIATION>,
}

/// Normal equations with the samples of all beats.
pub(crate) fn regressions(
    passive: &OneFibrePassive,
    features: &OrganFeatures,
    beats: &[LawBeat<'_>],
    prior: &LawPrior,
) -> Result<Regressions, OrganLawError> {
    check(beats)?;
    let mut pressure = Regression::<N_PRESSURE>::new(prior, &prior.pressure, features, "pressure")?;
    let mut stretch = Regression::<N_STRETCH>::new(prior, &prior.stretch, features, "stretch")?;
    let mut deviation =
        Regression::<N_DEVIATION>::new(prior, &prior.deviation, features, "deviation")?;
    let end_diastole = OrganLaw::stretch_row(passive, passive.end_diastolic_volume_ml, 0.0, 0.0);
    let expected_stretch = end_diastole.0 + SVector::from(end_diastole.1).dot(&stretch.mean);
    for beat in beats {
        // The deviation is small, so that the prior's stretch at end-diastole is exact enough for it.
        let scale = beat.slack.unwrap_or(expected_stretch / beat.stretch[0]);
        for (k, volume_ml) in beat.volume_ml.iter().enumerate() {
            let stress_kpa = beat.stress_kpa[k];
            let (own, row) = OrganLaw::pressure_row(passive, *volume_ml, stress_kpa);
            pressure.add(row, own, beat.pressure_mmhg[k], prior.pressure_sd_mmhg);
            let row = OrganLaw::deviation_row(
                passive,
                *volume_ml,
                stress_kpa,
                beat.stress_deviation_kpa[k],
            );
            let found = scale * beat.stretch_deviation[k];
            deviation.add(row, 0.0, found, prior.deviation_sd);
            let (own, mut row) = OrganLaw::stretch_row(
                passive,
                *volume_ml,
                stress_kpa,
                beat.stress_deviation_kpa[k],
            );
            match beat.slack {
                Some(slack) => stretch.add(row, own, beat.stretch[k] * slack, prior.stretch_sd),
                None => {
                    // Λ = r Λ_ED, where both sides are linear in the coefficients.
                    let ratio = beat.stretch[k] / beat.stretch[0];
                    row.iter_mut()
                        .zip(end_diastole.1)
                        .for_each(|(term, of_ed)| *term -= ratio * of_ed);
                    stretch.add(row, own, ratio * end_diastole.0, prior.stretch_sd);
                }
            }
        }
    }
    Ok(Regressions {
        pressure,
        stretch,
        deviation,
    })
}

/// Law of an organ from its beats, or from the prior alone.
///
/// Where the law would lose pressure with stress or with volume, or stiff cells would find no stress,
/// the prior counts ten times as much, and so on; the prior's mean is the last resort.
///
/// # Errors
/// [`OrganLawError`] for samples or a prior that cannot be used.
pub fn fit_law(
    passive: &OneFibrePassive,
    features: &OrganFeatures,
    beats: &[LawBeat<'_>],
    prior: &LawPrior,
) -> Result<OrganLaw, OrganLawError> {
    let Regressions {
        pressure,
        stretch,
        deviation,
    } = regressions(passive, features, beats, prior)?;
    let law = |of_pressure: Option<f64>, of_stretch: Option<f64>| OrganLaw {
        pressure: of_pressure.map_or_else(|| pressure.mean.into(), |weight| pressure.solve(weight)),
        stretch: of_stretch.map_or_else(|| stretch.mean.into(), |weight| stretch.solve(weight)),
        deviation: of_stretch
            .map_or_else(|| deviation.mean.into(), |weight| deviation.solve(weight)),
        compliance: prior.compliance,
        duration_share: features.duration_share,
    };
    let weights = || (0..STIFFENINGS).map(|k| PRIOR_WEIGHT * 10f64.powi(k));
    let of_pressure = weights().find(|weight| law(Some(*weight), None).is_monotone(passive));
    let of_stretch = weights().find(|weight| law(None, Some(*weight)).is_settled(passive));
    Ok(law(of_pressure, of_stretch))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passive() -> OneFibrePassive {
        OneFibrePassive {
            wall_volume_ml: 100.0,
            unloaded_volume_ml: 70.0,
            end_diastolic_volume_ml: 130.0,
            end_diastolic_pressure_mmhg: 9.0,
            stiffness_kpa: 1.5,
            exponent: 9.24,
        }
    }

    fn vague() -> LawPrior {
        let gaussian = |n: usize| Gaussian {
            mean: vec![0.0; n],
            per_log_exponent_factor: vec![0.0; n],
            per_log_image_volume: vec![0.0; n],
            covariance: (0..n)
                .map(|i| (0..n).map(|j| if i == j { 100.0 } else { 0.0 }).collect())
                .collect(),
        };
        LawPrior {
            pressure: gaussian(N_PRESSURE),
            stretch: gaussian(N_STRETCH),
            deviation: gaussian(N_DEVIATION),
            deviation_sd: 1e-5,
            pressure_sd_mmhg: 0.01,
            stretch_sd: 1e-5,
            compliance: 0.0,
            typical_log_image_volume: -0.1,
            log_exponent_factor_range: [-1.0, 1.0],
            n_organs: 12.0,
        }
    }

    /// A law that is known, and samples of it over a loop in volume and stress.
    fn known() -> (OrganLaw, [Vec<f64>; 6]) {
        let law = OrganLaw {
            pressure: [-0.5, -6.0, 1.22, 0.46, -0.08, -0.1, -0.5, 0.2],
            stretch: [-0.02, -0.005, -0.19, -0.01, 0.08, 0.27],
            deviation: [0.04, -0.02, 0.26, -0.03, 0.04, 0.6],
            compliance: 0.0,
            duration_share: 1.0,
        };
        let points = (0..100).map(|k| {
            let phase = std::f64::consts::TAU * f64::from(k) / 100.0;
            let volume = 98.0 + 32.0 * phase.cos();
            let stress = 45.0 * (1.0 - (phase - 0.9).cos()) * (0.7 + 0.3 * (3.0 * phase).cos());
            (volume, if k == 0 { 0.0 } else { stress })
        });
        let mut samples: [Vec<f64>; 6] = Default::default();
        for (volume, stress) in points {
            let difference = 0.3 * stress * (volume / 50.0).sin();
            let deviation = law.deviation(&passive(), volume, stress).value
                - law.response_per_kpa(stress) * difference;
            samples[4].push(deviation / 1.08);
            samples[5].push(difference);
            samples[0].push(volume);
            samples[1].push(law.pressure(&passive(), volume, stress).value);
            samples[2].push(stress);
            let stretch = law.stretch(&passive(), volume, stress).value
                + law.stretch_per_difference(stress) * difference;
            samples[3].push(stretch / 1.08);
        }
        (law, samples)
    }

    fn beat(samples: &[Vec<f64>; 6]) -> LawBeat<'_> {
        let [
            volume_ml,
            pressure_mmhg,
            stress_kpa,
            stretch,
            stretch_deviation,
            stress_deviation_kpa,
        ] = samples;
        LawBeat {
            volume_ml,
            pressure_mmhg,
            stress_kpa,
            stretch,
            stretch_deviation,
            stress_deviation_kpa,
            slack: Some(1.08),
        }
    }

    #[test]
    fn a_known_law_is_found_from_its_samples() {
        let (law, samples) = known();
        let found = fit_law(
            &passive(),
            &OrganFeatures::default(),
            &[beat(&samples)],
            &vague(),
        )
        .unwrap();
        for (k, volume) in samples[0].iter().enumerate() {
            let stress = samples[2][k];
            let (a, b) = (
                law.pressure(&passive(), *volume, stress).value,
                found.pressure(&passive(), *volume, stress).value,
            );
            assert!((a - b).abs() < 0.02, "{a} {b}");
            let (a, b) = (
                law.stretch(&passive(), *volume, stress).value,
                found.stretch(&passive(), *volume, stress).value,
            );
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
        for (a, b) in law.deviation.iter().zip(&found.deviation) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }

    #[test]
    fn a_law_counted_from_end_diastole_is_found_up_to_that_stretch() {
        let (law, samples) = known();
        let own = LawBeat {
            slack: None,
            ..beat(&samples)
        };
        let found = fit_law(&passive(), &OrganFeatures::default(), &[own], &vague()).unwrap();
        let ratio = |law: &OrganLaw, volume: f64, stress: f64| {
            law.stretch(&passive(), volume, stress).value / law.end_diastolic_stretch(&passive())
        };
        for (volume, stress) in samples[0].iter().zip(&samples[2]) {
            let (a, b) = (
                ratio(&law, *volume, *stress),
                ratio(&found, *volume, *stress),
            );
            assert!((a - b).abs() < 2e-4, "{a} {b}");
        }
    }

    #[test]
    fn the_prior_follows_the_organs_features() {
        let mut prior = vague();
        prior.pressure.mean[2] = 1.0;
        prior.pressure.per_log_exponent_factor[2] = 0.1;
        prior.pressure.per_log_image_volume[2] = -1.0;
        let features = OrganFeatures {
            log_exponent_factor: 3.0,
            log_image_volume: -0.3,
            ..OrganFeatures::default()
        };
        let law = fit_law(&passive(), &features, &[], &prior).unwrap();
        assert!((law.pressure[2] - 1.3).abs() < 1e-12, "{:?}", law.pressure);
    }

    #[test]
    fn without_beats_the_law_is_the_priors_mean() {
        let mut prior = vague();
        prior.pressure.mean[2..4].copy_from_slice(&[1.0, 0.2]);
        let law = fit_law(&passive(), &OrganFeatures::default(), &[], &prior).unwrap();
        assert_eq!(law.pressure[3], 0.2);
    }

    #[test]
    fn samples_that_would_make_a_falling_law_leave_it_monotone() {
        let (_, mut samples) = known();
        let (stress, pressure) = (samples[2].clone(), &mut samples[1]);
        pressure
            .iter_mut()
            .zip(&stress)
            .for_each(|(p, t)| *p -= 3.0 * t);
        let mut prior = vague();
        prior.pressure.mean[2] = 1.0;
        let features = OrganFeatures::default();
        let law = fit_law(&passive(), &features, &[beat(&samples)], &prior).unwrap();
        assert!(law.is_monotone(&passive()));
    }

    #[test]
    fn the_shipped_prior_is_a_monotone_law() {
        let law = fit_law(&passive(), &OrganFeatures::default(), &[], &shipped_prior()).unwrap();
        assert!(law.is_monotone(&passive()) && law.is_settled(&passive()));
    }

    #[test]
    fn unusable_input_is_refused() {
        let (_, mut samples) = known();
        samples[1].pop();
        let refused = fit_law(
            &passive(),
            &OrganFeatures::default(),
            &[beat(&samples)],
            &vague(),
        );
        assert_eq!(refused, Err(OrganLawError::Samples { number: 1 }));
        let mut prior = vague();
        prior.stretch.covariance[0][0] = -1.0;
        assert!(fit_law(&passive(), &OrganFeatures::default(), &[], &prior).is_err());
    }
}

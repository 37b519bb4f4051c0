//! A prior of the organ's law that further organs have taught.
//!
//! Coefficients of the organs are draws from one Gaussian distribution. Its mean and covariance
//! maximise the likelihood of all organs' samples together with the earlier organs, which count as
//! observed coefficients (expectation maximisation of a linear mixed model: Laird and Ware 1982,
//! Biometrics 38:963, equations 3.1 to 3.4). Slopes over features and errors of samples stay.

use crate::organ_law::{LawBeat, OrganFeatures, OrganLawError, Regression, regressions};
use cardiotwin_models::ventricle::OneFibrePassive;
use cardiotwin_vocabulary::organ_law::{Gaussian, LawPrior};
use nalgebra::{SMatrix, SVector};

/// Number of iterations. Coefficients are nearly determined by an organ's own samples, so that a few
/// are enough: further ones move the mean by less than a thousandth of its deviation.
const ITERATIONS: usize = 20;

/// An organ that teaches.
#[derive(Debug, Clone, PartialEq)]
pub struct LawOrgan<'a> {
    /// Passive one-fibre wall of the organ.
    pub passive: OneFibrePassive,
    /// Features of the organ.
    pub features: OrganFeatures,
    /// Beats of the organ.
    pub beats: Vec<LawBeat<'a>>,
}

/// The prior with what further organs teach. Organs without a beat teach nothing.
///
/// The result depends on the order of the organs by rounding alone; callers sort them.
///
/// # Errors
/// [`OrganLawError`] for samples or a prior that cannot be used.
pub fn learn(prior: &LawPrior, organs: &[LawOrgan<'_>]) -> Result<LawPrior, OrganLawError> {
    let (mut of_pressure, mut of_stretch, mut of_deviation) = (Vec::new(), Vec::new(), Vec::new());
    for organ in organs.iter().filter(|organ| !organ.beats.is_empty()) {
        let of_organ = regressions(&organ.passive, &organ.features, &organ.beats, prior)?;
        of_pressure.push(of_organ.pressure);
        of_stretch.push(of_organ.stretch);
        of_deviation.push(of_organ.deviation);
    }
    Ok(LawPrior {
        pressure: updated(&prior.pressure, prior.n_organs, &of_pressure),
        stretch: updated(&prior.stretch, prior.n_organs, &of_stretch),
        deviation: updated(&prior.deviation, prior.n_organs, &of_deviation),
        n_organs: prior.n_organs + of_pressure.len() as f64,
        ..prior.clone()
    })
}

/// Checks the number of coefficients and the covariances of a prior.
///
/// # Errors
/// [`OrganLawError::Prior`] for a prior that no law can start from.
pub fn check_prior(prior: &LawPrior) -> Result<(), OrganLawError> {
    let wall = OneFibrePassive {
        wall_volume_ml: 100.0,
        unloaded_volume_ml: 70.0,
        end_diastolic_volume_ml: 130.0,
        end_diastolic_pressure_mmhg: 9.0,
        stiffness_kpa: 1.5,
        exponent: 9.24,
    };
    regressions(&wall, &OrganFeatures::default(), &[], prior).map(|_| ())
}

/// Distribution of the coefficients after the organs; `n_before` organs made the present one.
fn updated<const N: usize>(before: &Gaussian, n_before: f64, organs: &[Regression<N>]) -> Gaussian {
    let of_before = SMatrix::<f64, N, N>::from_fn(|i, j| before.covariance[i][j]);
    let n_all = n_before + organs.len() as f64;
    // Shift of the mean of all organs, and the covariance around it.
    let mut shift = SVector::<f64, N>::zeros();
    let mut covariance = of_before;
    for _ in 0..ITERATIONS {
        let Some(precision) = covariance.try_inverse() else {
            break;
        };
        // Coefficients of each organ, less its mean by features, given its samples.
        let expected: Vec<(SVector<f64, N>, SMatrix<f64, N, N>)> = organs
            .iter()
            .filter_map(|organ| {
                let uncertainty = (precision + organ.information).try_inverse()?;
                Some((
                    uncertainty * (organ.gradient + precision * shift),
                    uncertainty,
                ))
            })
            .collect();
        let sum = expected
            .iter()
            .fold(SVector::zeros(), |sum: SVector<f64, N>, (mean, _)| {
                sum + mean
            });
        shift = sum / n_all;
        let scatter = expected.iter().fold(
            (of_before + shift * shift.transpose()) * n_before,
            |sum: SMatrix<f64, N, N>, (mean, uncertainty)| {
                let residual = mean - shift;
                sum + residual * residual.transpose() + uncertainty
            },
        );
        covariance = scatter / n_all;
    }
    let row = |i: usize| {
        (0..N)
            .map(|j| 0.5 * (covariance[(i, j)] + covariance[(j, i)]))
            .collect()
    };
    Gaussian {
        mean: before
            .mean
            .iter()
            .zip(shift.iter())
            .map(|(m, s)| m + s)
            .collect(),
        covariance: (0..N).map(row).collect(),
        ..before.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::organ_law::{fit_law, shipped_prior};
    use cardiotwin_models::ventricle::OrganLaw;

    fn wall(volume_ml: f64) -> OneFibrePassive {
        OneFibrePassive {
            wall_volume_ml: 0.75 * volume_ml,
            unloaded_volume_ml: 0.54 * volume_ml,
            end_diastolic_volume_ml: volume_ml,
            end_diastolic_pressure_mmhg: 9.0,
            stiffness_kpa: 1.5,
            exponent: 9.24,
        }
    }

    /// A beat in a law: volumes, pressures, stresses, stretches.
    fn samples(law: &OrganLaw, wall: &OneFibrePassive) -> [Vec<f64>; 6] {
        let mut samples: [Vec<f64>; 6] = Default::default();
        for k in 0..80 {
            let phase = std::f64::consts::TAU * f64::from(k) / 80.0;
            let volume = wall.end_diastolic_volume_ml * (0.78 + 0.22 * phase.cos());
            let stress = 40.0 * (1.0 - (phase - 0.9).cos());
            samples[0].push(volume);
            samples[1].push(law.pressure(wall, volume, stress).value);
            samples[2].push(stress);
            samples[3].push(law.stretch(wall, volume, stress).value / 1.08);
            samples[4].push(law.deviation(wall, volume, stress).value / 1.08);
            samples[5].push(0.0);
        }
        samples
    }

    fn organ<'a>(wall: OneFibrePassive, samples: &'a [Vec<f64>; 6]) -> LawOrgan<'a> {
        LawOrgan {
            passive: wall,
            features: OrganFeatures::default(),
            beats: vec![LawBeat {
                volume_ml: &samples[0],
                pressure_mmhg: &samples[1],
                stress_kpa: &samples[2],
                stretch: &samples[3],
                stretch_deviation: &samples[4],
                stress_deviation_kpa: &samples[5],
                slack: Some(1.08),
            }],
        }
    }

    /// Hearts of another kind: a tenth more pressure per stress than the shipped law says.
    fn others(n: u32) -> Vec<(OneFibrePassive, [Vec<f64>; 6])> {
        (0..n)
            .map(|k| {
                let wall = wall(110.0 + 8.0 * f64::from(k));
                let prior = shipped_prior();
                let features = OrganFeatures::default();
                let mut law = fit_law(&wall, &features, &[], &prior).unwrap();
                law.pressure[2] *= 1.1 + 0.005 * f64::from(k % 3);
                (wall, samples(&law, &wall))
            })
            .collect()
    }

    fn pressure_error(prior: &LawPrior, (wall, samples): &(OneFibrePassive, [Vec<f64>; 6])) -> f64 {
        let law = fit_law(wall, &OrganFeatures::default(), &[], prior).unwrap();
        let errors = samples[0].iter().zip(&samples[2]).zip(&samples[1]);
        errors
            .map(|((v, t), p)| (law.pressure(wall, *v, *t).value - p).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn organs_of_another_kind_teach_the_law_of_the_next_one() {
        let all = others(9);
        let (next, teachers) = all.split_last().unwrap();
        let before = shipped_prior();
        let lessons: Vec<LawOrgan> = teachers.iter().map(|(w, s)| organ(*w, s)).collect();
        let after = learn(&before, &lessons).unwrap();
        assert_eq!(after.n_organs, before.n_organs + 8.0);
        let (wrong, right) = (pressure_error(&before, next), pressure_error(&after, next));
        assert!(wrong > 5.0 && right < 0.7 * wrong, "{wrong} {right} mmHg");
        check_prior(&after).unwrap();
    }

    #[test]
    fn the_order_of_the_organs_does_not_matter() {
        let all = others(4);
        let lessons: Vec<LawOrgan> = all.iter().map(|(w, s)| organ(*w, s)).collect();
        let reversed: Vec<LawOrgan> = lessons.iter().rev().cloned().collect();
        let [a, b] = [lessons, reversed].map(|organs| learn(&shipped_prior(), &organs).unwrap());
        for (x, y) in a.pressure.mean.iter().zip(&b.pressure.mean) {
            assert!((x - y).abs() < 1e-9, "{x} {y}");
        }
    }

    #[test]
    fn without_organs_the_law_stays() {
        let before = shipped_prior();
        let after = learn(&before, &[]).unwrap();
        for (x, y) in before.pressure.mean.iter().zip(&after.pressure.mean) {
            assert_eq!(x, y);
        }
        assert_eq!(before.n_organs, after.n_organs);
    }

    #[test]
    fn a_prior_without_its_coefficients_is_refused() {
        let mut prior = shipped_prior();
        prior.stretch.mean.pop();
        assert!(check_prior(&prior).is_err());
    }
}

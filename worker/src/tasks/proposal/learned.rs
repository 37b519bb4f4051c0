//! The organ's law of a task for drawing: curves of its pressure, and its error at the beats that
//! taught.

use cardiotwin_calibrate::organ_law::{LawBeat, fit_law};
use cardiotwin_models::ventricle::{OneFibrePassive, OrganLaw};
use cardiotwin_schemas::organ_law::{LawBeatFit, LawCurve, LawError, LawSamples, LearnedLaw};
use cardiotwin_schemas::task::{InputFile, OrganBeatSpec};

use crate::error::TaskError;
use crate::tasks::surrogate::{law_organ, learnable_beats, prior_of};

/// Mean active stresses of the curves \[kPa\].
const CURVES_KPA: [f64; 7] = [0.0, 10.0, 20.0, 40.0, 60.0, 80.0, 120.0];
/// Number of volumes of a curve.
const N_VOLUMES: usize = 49;

/// The law of a surrogate; `None` for the one-fibre ventricle.
///
/// - `beats`: beats of the organ, oldest first; empty for the law of the prior
/// - `prior`: file of the law before the first beat; `None` for the law of the program
///
/// # Errors
/// [`TaskError`] when the organ's figures are outside the range of the model, or samples or the
/// prior cannot be used.
pub(crate) fn learned_law(
    beat: &OrganBeatSpec,
    beats: Option<&[LawSamples]>,
    prior: Option<&InputFile>,
) -> Result<Option<LearnedLaw>, TaskError> {
    let Some(beats) = beats else {
        return Ok(None);
    };
    let before_any = prior_of(prior)?;
    let (wall, features) = law_organ(&beat.organ, &before_any)?;
    let beats = learnable_beats(&beat.cell_stretch, beats.iter());
    // The law of the first 0, 1, … beats.
    let laws: Vec<OrganLaw> = (0..=beats.len())
        .map(|n| fit_law(&wall, &features, &beats[..n], &before_any))
        .collect::<Result<_, _>>()?;
    let law = &laws[beats.len()];
    let fits = beats.iter().zip(&laws).map(|(beat, earlier)| {
        let law_pressure_mmhg = pressures(law, &wall, beat);
        LawBeatFit {
            volume_ml: beat.volume_ml.to_vec(),
            pressure_mmhg: beat.pressure_mmhg.to_vec(),
            before: LawError::of(&pressures(earlier, &wall, beat), beat.pressure_mmhg),
            after: LawError::of(&law_pressure_mmhg, beat.pressure_mmhg),
            law_pressure_mmhg,
        }
    });
    let [low, high] = OrganLaw::domain_ml(&wall);
    let volume_ml: Vec<f64> = (0..N_VOLUMES)
        .map(|k| low + (high - low) * k as f64 / (N_VOLUMES - 1) as f64)
        .collect();
    let curve = |active_stress_kpa: f64| LawCurve {
        active_stress_kpa,
        pressure_mmhg: volume_ml
            .iter()
            .map(|volume| law.pressure(&wall, *volume, active_stress_kpa).value)
            .collect(),
    };
    Ok(Some(LearnedLaw {
        prior_organs: before_any.n_organs.round() as u32,
        learned_from: prior.map(|file| file.sha256.clone()),
        curves: CURVES_KPA.map(curve).to_vec(),
        beats: fits.collect(),
        volume_ml,
    }))
}

/// Pressure of a law \[mmHg\] at the volumes and stresses of a beat.
fn pressures(law: &OrganLaw, wall: &OneFibrePassive, beat: &LawBeat<'_>) -> Vec<f64> {
    let samples = beat.volume_ml.iter().zip(beat.stress_kpa);
    samples
        .map(|(volume, stress)| law.pressure(wall, *volume, *stress).value)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::surrogate::{features, law_wall};
    use crate::tasks::sweep::organ::tests::beat;
    use cardiotwin_calibrate::organ_law::shipped_prior;
    use cardiotwin_schemas::finite_element::{FiniteElementOrgan, VentricleFigures};
    use cardiotwin_schemas::organ::OrganSpec;
    use cardiotwin_schemas::organ_law::N_LAW_SAMPLES;

    fn organ() -> OrganBeatSpec {
        let ventricle = InputFile {
            name: "ventricle".into(),
            path: "ventricle.bin".into(),
            sha256: "0".into(),
        };
        let figures = VentricleFigures {
            nodes: 498,
            elements: 1878,
            degrees_of_freedom: 1494,
            mean_edge_mm: 10.1,
            wall_volume_ml: 120.0,
            image_volume_ml: 138.5,
            image_pressure_mmhg: 5.0,
            unloaded_volume_ml: 81.0,
            end_diastolic_volume_ml: 150.0,
            end_diastolic_pressure_mmhg: 7.0,
            stiffness_kpa: 0.42,
            exponent_factor: 0.8,
            onset_ms: 30.0,
            spread_ms: 50.0,
            epicardial_duration_share: 0.9,
        };
        OrganBeatSpec {
            organ: OrganSpec::FiniteElement(Box::new(FiniteElementOrgan { ventricle, figures })),
            ..beat()
        }
    }

    /// A beat whose pressure is above that of the program's law by 5 mmHg at most, with the stress.
    fn samples(organ: &OrganBeatSpec, peak_kpa: f64) -> LawSamples {
        let OrganSpec::FiniteElement(fe) = &organ.organ else {
            unreachable!("made of finite elements")
        };
        let (wall, features) = (law_wall(&fe.figures).unwrap(), features(&fe.figures));
        let law = fit_law(&wall, &features, &[], &shipped_prior()).unwrap();
        let mut samples = LawSamples::default();
        for k in 0..N_LAW_SAMPLES {
            let phase = std::f64::consts::TAU * k as f64 / N_LAW_SAMPLES as f64;
            let volume = 110.0 + 40.0 * phase.cos();
            let stress = 0.5 * peak_kpa * (1.0 - phase.cos());
            samples.volume_ml.push(volume);
            samples.active_stress_kpa.push(stress);
            let pressure = law.pressure(&wall, volume, stress).value + 0.05 * stress;
            samples.pressure_mmhg.push(pressure);
            samples
                .stretch
                .push(law.stretch(&wall, volume, stress).value / 1.08);
            let deviation = law.deviation(&wall, volume, stress).value;
            samples.stretch_deviation.push(deviation / 1.08);
            samples.stress_deviation_kpa.push(0.0);
        }
        samples
    }

    #[test]
    fn errors_are_those_of_the_laws_before_and_after_each_beat() {
        let organ = organ();
        let beats = [samples(&organ, 100.0), samples(&organ, 60.0)];
        let found = learned_law(&organ, Some(&beats), None).unwrap().unwrap();
        assert_eq!(
            (found.prior_organs, found.learned_from.as_ref()),
            (12, None)
        );
        // By construction the first beat is off the program's law by 0.05 mmHg per kPa.
        let first = &found.beats[0];
        assert!((first.before.worst_mmhg - 5.0).abs() < 1e-9, "{first:?}");
        let squares = beats[0]
            .active_stress_kpa
            .iter()
            .map(|t| (0.05 * t).powi(2));
        let rms = (squares.sum::<f64>() / N_LAW_SAMPLES as f64).sqrt();
        assert!((first.before.rms_mmhg - rms).abs() < 1e-9, "{first:?}");
        // One beat teaches nearly all about the next one.
        assert!(first.after.rms_mmhg < 0.1 * rms, "{first:?}");
        assert!(
            found.beats[1].before.rms_mmhg < 0.2 * rms,
            "{:?}",
            found.beats[1]
        );
        let alone = learned_law(&organ, Some(&beats[..1]), None)
            .unwrap()
            .unwrap();
        assert_eq!(alone.beats[0].before, first.before);
        assert_ne!(alone.beats[0].after, first.after);
        for (fit, beat) in found.beats.iter().zip(&beats) {
            assert_eq!(fit.pressure_mmhg, beat.pressure_mmhg);
            assert_eq!(
                fit.after,
                LawError::of(&fit.law_pressure_mmhg, &beat.pressure_mmhg)
            );
        }
    }

    #[test]
    fn curves_rise_with_stress_over_the_domain_and_a_spring_has_none() {
        let organ = organ();
        let rises = |law: &LearnedLaw| {
            law.curves.windows(2).all(|pair| {
                let [low, high] = [&pair[0].pressure_mmhg, &pair[1].pressure_mmhg];
                low.len() == N_VOLUMES && low.iter().zip(high).all(|(low, high)| low < high)
            })
        };
        let found = learned_law(&organ, Some(&[]), None).unwrap().unwrap();
        assert!(found.beats.is_empty() && found.error().is_none());
        assert!(found.volume_ml[0] < 81.0 && found.volume_ml[N_VOLUMES - 1] > 150.0);
        assert!(rises(&found), "{found:?}");
        assert_eq!(learned_law(&organ, None, None).unwrap(), None);
        // Step 0 of an external solver is a one-fibre ventricle.
        let external = learned_law(&beat(), Some(&[]), None).unwrap().unwrap();
        assert!(
            external.beats.is_empty() && rises(&external),
            "{external:?}"
        );
        assert_ne!(external.curves, found.curves);
    }
}

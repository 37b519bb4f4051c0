//! Cross-fibre stress: active stress perpendicular to the fibres.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::contraction::{
    ActiveStress, Contraction, ContractionError, EachStep, NodeStep, UniformStep,
};

/// Catalogue entry of the cross-fibre stress.
pub const EFFECT: Effect = Effect {
    name: "cross_fibre_stress",
    kind: Kind::Physiology,
    meaning: "The muscle pulls across its fibres too.",
    equation: "σ_cross = ν σ_fibre; in the one-fibre model, whose strain is the same in both directions, Sa → (1 + ν) Sa",
    source: "Our values. The abstract of Walker et al. 2005, Am J Physiol 289:H692, has 0.4. The abstract of Genet et al. 2014, J Appl Physiol 117:142, has no share. Lin and Yin 1998, J Biomech Eng 120:504, was not read",
    parameters: &[Parameter {
        name: "cross_fibre_share",
        unit: "1",
        meaning: "active stress across over that along the fibre, ν",
        range: (0.0, 0.5),
        off: Some(0.0),
        smallest: 0.1,
        typical: 0.25,
        prior_scale: 0.15,
        role: Role::Strength,
    }],
    signature: "none in pressure and volume: it is a change of the peak stress; in three dimensions wall thickening, torsion and shape",
    marks: &[
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::LateEjection,
            signal: Signal::Volume,
            sign: Sign::Down,
        },
    ],
    confused_with: &[],
    separated_by: &[
        "strain imaging (thickening)",
        "torsion by tagging MRI",
        "the shape of the cavity over the beat",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::MaterialTerm {
        how: "active stress `cross_fibre_share` · Sa along the sheet normal, across the fibre in the plane of the wall",
    },
    hidden_because: Some(
        "in a one-fibre ventricle it is exactly a change of the peak active stress; strain or torsion would show it",
    ),
    remedy: None,
    action: Action::Wall(add),
};

/// A contraction model with scaled stress.
#[derive(Debug)]
struct Scaled {
    inner: Box<dyn Contraction>,
    factor: f64,
}

impl Scaled {
    fn scale(&self, stress: ActiveStress) -> ActiveStress {
        ActiveStress {
            sa_kpa: self.factor * stress.sa_kpa,
            dsa_dlambda_kpa: self.factor * stress.dsa_dlambda_kpa,
        }
    }
}

impl Contraction for Scaled {
    fn n_states(&self) -> usize {
        self.inner.n_states()
    }

    fn needs_calcium(&self) -> bool {
        self.inner.needs_calcium()
    }

    fn rest(&self, state: &mut [f64]) {
        self.inner.rest(state);
    }

    fn length_factor(&self, lambda: f64) -> (f64, f64) {
        self.inner.length_factor(lambda)
    }

    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        self.inner
            .try_step(step, state, trial)
            .map(|stress| self.scale(stress))
    }

    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        self.inner.try_step_uniform(step, states, trials, stress)?;
        stress.iter_mut().for_each(|out| *out = self.scale(*out));
        Ok(())
    }

    fn try_step_each(
        &self,
        step: &EachStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        self.inner.try_step_each(step, states, trials, stress)?;
        stress.iter_mut().for_each(|out| *out = self.scale(*out));
        Ok(())
    }
}

fn add(
    values: &[f64],
    _around: &Surroundings,
    mut parts: OneFibreParts,
) -> Result<OneFibreParts, EffectError> {
    let factor = 1.0 + values[0];
    parts.contraction = parts
        .contraction
        .wrapped(&[], |inner| Box::new(Scaled { inner, factor }));
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contraction::{Tanh, TanhParameters};

    #[test]
    fn equals_a_larger_peak_stress() {
        let base = TanhParameters::default();
        let cell = Scaled {
            inner: Box::new(Tanh::new(base).unwrap()),
            factor: 1.25,
        };
        let stronger = Tanh::new(TanhParameters {
            smax_ref_kpa: 125.0,
            ..base
        })
        .unwrap();
        let step = NodeStep {
            since_activation_ms: 200.0,
            dt_ms: 1.0,
            ca_start_um: 0.0,
            ca_end_um: 0.0,
            lambda_prev: 1.0,
            lambda: 0.95,
        };
        let (a, b) = (
            cell.try_step(&step, &[], &mut []).unwrap(),
            stronger.try_step(&step, &[], &mut []).unwrap(),
        );
        assert!(
            (a.sa_kpa - b.sa_kpa).abs() < 1e-12
                && (a.dsa_dlambda_kpa - b.dsa_dlambda_kpa).abs() < 1e-10
        );
    }
}

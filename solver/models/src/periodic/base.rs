//! The base model in the fourteen parameters of a fit to pressure and volume.

use crate::circulation::{LeftHeart, StartPressure};
use crate::contraction::{Tanh, TanhParameters};
use crate::effects::{Assembled, BaseModel, EffectError, EffectSetting, assemble};
use crate::ventricle::passive_state::DEFAULT_EXPONENT;
use crate::ventricle::{ActivationSpread, GroupContraction, OneFibrePassive, PassiveLaw as _};
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};
use cardiotwin_vocabulary::circulation::WindkesselParameters;
use serde::Serialize;

/// A parameter of the base model as a fit sees it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BaseParameter {
    /// Name of the parameter, with its unit.
    pub name: &'static str,
    /// Unit, `1` for a pure number.
    pub unit: &'static str,
    /// Meaning of the parameter in a few words.
    pub meaning: &'static str,
    /// Smallest and largest physiological value.
    pub range: (f64, f64),
    /// Value for an average adult; starts of a fit are better taken from the data.
    pub typical: f64,
    /// Whether it varies by factors rather than by amounts.
    pub logarithmic: bool,
}

const fn parameter(
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
    range: (f64, f64),
    typical: f64,
    logarithmic: bool,
) -> BaseParameter {
    BaseParameter {
        name,
        unit,
        meaning,
        range,
        typical,
        logarithmic,
    }
}

/// The fourteen, in the order of all value lists. The aortic valve's resistance is bounded so that it cannot take the
/// place of a stenosis.
pub const BASE_PARAMETERS: [BaseParameter; 14] = [
    parameter(
        "left_atrial_pressure_mmHg",
        "mmHg",
        "filling pressure, constant",
        (1.0, 35.0),
        8.0,
        true,
    ),
    parameter(
        "reference_volume_mL",
        "mL",
        "volume at which the active stretch is one, near end-diastole",
        (30.0, 400.0),
        130.0,
        true,
    ),
    parameter(
        "unloaded_share",
        "1",
        "unloaded over reference volume",
        (0.2, 0.85),
        0.55,
        false,
    ),
    parameter(
        "passive_pressure_mmHg",
        "mmHg",
        "passive pressure at the reference volume",
        (1.0, 50.0),
        9.0,
        true,
    ),
    parameter(
        "characteristic_resistance_mmHg_s_per_mL",
        "mmHg s/mL",
        "R1 of the Windkessel",
        (0.005, 0.2),
        0.05,
        true,
    ),
    parameter(
        "peripheral_resistance_mmHg_s_per_mL",
        "mmHg s/mL",
        "R2 of the Windkessel",
        (0.2, 4.0),
        0.9,
        true,
    ),
    parameter(
        "compliance_mL_per_mmHg",
        "mL/mmHg",
        "C of the Windkessel",
        (0.2, 6.0),
        1.5,
        true,
    ),
    parameter(
        "R_AV_f_mmHg_s_per_mL",
        "mmHg s/mL",
        "aortic valve, forward",
        (0.001, 0.015),
        0.006,
        true,
    ),
    parameter(
        "R_MV_f_mmHg_s_per_mL",
        "mmHg s/mL",
        "mitral valve, forward",
        (0.001, 0.06),
        0.01,
        true,
    ),
    parameter(
        "Smax_ref_kPa",
        "kPa",
        "peak isometric stress",
        (20.0, 600.0),
        110.0,
        true,
    ),
    parameter(
        "tau_SR_ref_ms",
        "ms",
        "time constant of the stress rise",
        (0.5, 120.0),
        20.0,
        true,
    ),
    parameter(
        "tau_SD_ms",
        "ms",
        "time constant of the stress decay",
        (3.0, 250.0),
        60.0,
        true,
    ),
    parameter(
        "t_CR_ms",
        "ms",
        "duration of the stress transient",
        (150.0, 700.0),
        380.0,
        true,
    ),
    parameter(
        "onset_ms",
        "ms",
        "first activation after the beat's start",
        (0.0, 120.0),
        10.0,
        false,
    ),
];

/// Properties of a patient that are given and not fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitSubject {
    /// Length of the patient's cardiac cycle.
    pub cycle_length: Ms,
    /// Volume of the left ventricle's wall.
    pub wall_volume: Ml,
    /// Exponent of the passive law.
    pub exponent: f64,
    /// Time from the first to the last activation.
    pub spread: Ms,
    /// Number of groups that are activated one after another.
    pub n_groups: usize,
    /// Tanh parameters that are not fitted.
    pub tanh: TanhParameters,
}

impl FitSubject {
    /// The default law and activation in eight groups, which is where traces stop to depend on their number.
    #[must_use]
    pub fn new(cycle_length: Ms, wall_volume: Ml) -> Self {
        Self {
            cycle_length,
            wall_volume,
            exponent: DEFAULT_EXPONENT,
            spread: Ms(40.0),
            n_groups: 8,
            tanh: TanhParameters::default(),
        }
    }

    /// The base model at values of [`BASE_PARAMETERS`].
    ///
    /// # Errors
    /// [`EffectError`] for values that the models refuse.
    ///
    /// # Panics
    /// When there are not fourteen values.
    pub fn base(&self, values: &[f64]) -> Result<BaseModel, EffectError> {
        let [
            left_atrial_pressure,
            reference,
            unloaded_share,
            passive_pressure,
            r1,
            r2,
            compliance,
            aortic_forward,
            mitral_forward,
            smax_ref_kpa,
            tau_sr_ref_ms,
            tau_sd_ms,
            t_cr_ms,
            onset,
        ] = *values.first_chunk().expect("fourteen values");
        let passive = OneFibrePassive::through(
            Ml(unloaded_share * reference),
            Ml(reference),
            Mmhg(passive_pressure),
            self.wall_volume,
            self.exponent,
        )?;
        let tanh = TanhParameters {
            smax_ref_kpa,
            tau_sr_ref_ms,
            tau_sd_ms,
            t_cr_ms,
            ..self.tanh
        };
        let heart = LeftHeart {
            left_atrial_pressure: Mmhg(left_atrial_pressure),
            mitral_forward: MmhgSPerMl(mitral_forward),
            mitral_backward: LeftHeart::BACKWARD,
            aortic_forward: MmhgSPerMl(aortic_forward),
            aortic_backward: LeftHeart::BACKWARD,
            windkessel: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: r1,
                peripheral_resistance_mmhg_s_per_ml: r2,
                compliance_ml_per_mmhg: compliance,
            },
            start: StartPressure::DiastolicCuff(Mmhg(75.0)),
            cycle_length: self.cycle_length,
        };
        Ok(BaseModel {
            heart,
            passive,
            activation: ActivationSpread {
                onset: Ms(onset),
                spread: self.spread,
                n_groups: self.n_groups,
            },
            contraction: GroupContraction::tanh(Tanh::new(tanh)?),
            inertances: [0.0; 2],
            closed: None,
            law: None,
        })
    }

    /// Base model and effects put together.
    ///
    /// # Errors
    /// As [`Self::base`], and for effects outside their ranges.
    ///
    /// # Panics
    /// When there are not fourteen values.
    pub fn model(
        &self,
        values: &[f64],
        effects: &[EffectSetting],
    ) -> Result<Assembled, EffectError> {
        assemble(self.base(values)?, effects)
    }

    /// Typical values of the fourteen.
    #[must_use]
    pub fn typical() -> [f64; 14] {
        BASE_PARAMETERS.map(|p| p.typical)
    }
}

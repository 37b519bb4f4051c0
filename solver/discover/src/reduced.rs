//! The model of the search: the one-fibre ventricle with its circulation and the catalogue of
//! effects.

use crate::activation::{ActivationCurve, CurveParameters};
use crate::forward::{Candidate, Forward, LoadedPrediction, Orbits, Prediction, Request};
use crate::measured::{Measured, Uncertain};
use crate::parameter::Parameter;
use crate::valves::{Traces, reservoir, valve_times};
use cardiotwin_models::circulation::windkessel::WindkesselParameters;
use cardiotwin_models::circulation::{LeftHeart, StartPressure};
use cardiotwin_models::effects::{
    self, Assembled, BaseModel, CATALOGUE, Effect, EffectSetting, Kind, Role, assemble,
};
use cardiotwin_models::periodic::{Orbit, PeriodicBeat, PeriodicSettings, find};
use cardiotwin_models::ventricle::passive_state::DEFAULT_EXPONENT;
use cardiotwin_models::ventricle::{
    ActivationSpread, GroupContraction, OneFibrePassive, PassiveLaw as _,
};
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};
use cardiotwin_vocabulary::findings::InThreeDimensions;
use cardiotwin_vocabulary::measurements::FurtherQuantity;

/// Time step of a simulated beat \[ms\].
const STEP: Ms = Ms(2.0);
/// Largest change of a state over a beat that counts as periodic.
const TOLERANCE: f64 = 2e-4;
/// Number of beats after which a model that is not periodic counts as without a result.
const BEATS: usize = 25;

/// Bounds of the inertances of the blood in the valves \[mmHg·s²/mL\]: ρ l/A for a column of 0.25 cm
/// in 10 cm² to one of 10 cm in 5 cm². The priors' medians belong to about 1 cm in 4 cm². All are our
/// values (Mynard et al. 2012, Int J Numer Meth Biomed Eng 28:626, was not read).
const INERTANCES: (f64, f64) = (2e-5, 1.5e-3);

/// Compliance of the left atrium with the lung veins where no atrial pressure was measured
/// \[mL/mmHg\]: some 45 mL that collect in systole raise its pressure by 3 mmHg.
const ATRIAL_COMPLIANCE: f64 = 15.0;
/// Duration of a normal QRS \[ms\], our value. A summary of Surawicz et al. 2009, J Am Coll Cardiol
/// 53:976, has up to 110 ms, and 95 ms as the mean of men.
/// The spread of the base's activation is no part of it: in fits to healthy hearts it is 20 to 80 ms,
/// as their formulation asks (`examples/tolerances`).
const NORMAL_QRS_MS: f64 = 90.0;
/// Effect whose delay makes QRS wider.
const LATE_ACTIVATION: &str = "dyssynchrony";

/// Names of the base parameters, in the order of all value lists. Compliance of the atrium and loads
/// of further beats follow where these were measured.
pub const BASE: [&str; 22] = [
    "left_atrial_pressure_mmHg",
    "reference_volume_mL",
    "unloaded_share",
    "passive_pressure_mmHg",
    "passive_exponent",
    "wall_volume_mL",
    "characteristic_resistance_mmHg_s_per_mL",
    "peripheral_resistance_mmHg_s_per_mL",
    "compliance_mL_per_mmHg",
    "R_AV_f_mmHg_s_per_mL",
    "R_MV_f_mmHg_s_per_mL",
    "Smax_ref_kPa",
    "tau_SR_ref_ms",
    "rise_exponent",
    "tau_SD_ms",
    "t_CR_ms",
    "onset_ms",
    "spread_ms",
    "least_stretch",
    "mitral_inertance_mmHg_s2_per_mL",
    "aortic_inertance_mmHg_s2_per_mL",
    "rate_loss_s",
];

/// Reduced model of one patient.
#[derive(Debug, Clone)]
pub struct Reduced {
    cycle: Ms,
    base: Vec<Parameter>,
    candidates: Vec<Candidate>,
    effects: Vec<&'static Effect>,
    /// Whether the compliance of the atrium is a parameter.
    atrium: bool,
    /// Cycle lengths of the beats under changed load.
    loads: Vec<Ms>,
}

fn log(name: &str, (lower, upper): (f64, f64), mean: f64, sd: f64) -> Parameter {
    Parameter {
        name: name.to_owned(),
        lower,
        upper,
        mean: mean.clamp(lower, upper),
        sd,
        log: true,
    }
}

fn plain(name: &str, (lower, upper): (f64, f64), mean: f64, sd: f64) -> Parameter {
    Parameter {
        name: name.to_owned(),
        lower,
        upper,
        mean: mean.clamp(lower, upper),
        sd,
        log: false,
    }
}

/// Narrows a prior to the stated value of the parameter, if there is one.
fn given(prior: Parameter, value: Option<Uncertain>) -> Parameter {
    match value {
        Some(given) if given.value > 0.0 => Parameter {
            lower: prior.lower.min(0.8 * given.value),
            upper: prior.upper.max(1.25 * given.value),
            mean: given.value,
            sd: prior.sd.min(given.sd / given.value),
            ..prior
        },
        _ => prior,
    }
}

/// Priors of the base parameters: weak, centred on extremes of the data and textbook values, and
/// narrower for stated values.
fn base_priors(m: &Measured) -> Vec<Parameter> {
    let range = |v: &[f64]| {
        v.iter()
            .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)))
    };
    let (v_min, v_max) = range(&m.frame_volume_ml);
    let p_max = range(&m.pressure_mmhg).1;
    let (systolic, diastolic) = m.side.cuff.map_or((p_max, 0.65 * p_max), |cuff| {
        (cuff.systolic.value, cuff.diastolic.value)
    });
    let stroke = m
        .side
        .forward_stroke_volume
        .map_or(v_max - v_min, |v: Uncertain| v.value);
    let resistance = (diastolic + 0.4 * (systolic - diastolic)) / (stroke / m.cycle_ms * 1e3);
    let wall = m.wall_volume;
    let wall_sd = wall.sd / wall.value;
    vec![
        given(
            log(BASE[0], (3.0, 40.0), 11.0, 0.4),
            m.given.left_atrial_pressure,
        ),
        log(BASE[1], (0.7 * v_max, 1.4 * v_max), v_max, 0.1),
        plain(BASE[2], (0.08, 0.65), 0.38, 0.13),
        log(BASE[3], (1.0, 60.0), 12.0, 0.5),
        log(BASE[4], (3.0, 18.0), DEFAULT_EXPONENT, 0.18),
        log(
            BASE[5],
            (0.6 * wall.value, 1.6 * wall.value),
            wall.value,
            wall_sd,
        ),
        given(
            log(BASE[6], (0.005, 0.2), 0.045, 0.5),
            m.given.characteristic_resistance,
        ),
        given(
            log(
                BASE[7],
                (0.3 * resistance, 3.0 * resistance),
                resistance,
                0.3,
            ),
            m.given.peripheral_resistance,
        ),
        given(log(BASE[8], (0.2, 6.0), 1.4, 0.5), m.given.compliance),
        log(BASE[9], (0.001, 0.015), 0.006, 0.4),
        log(BASE[10], (0.003, 0.12), 0.03, 0.5),
        log(BASE[11], (20.0, 500.0), 80.0, 0.5),
        log(BASE[12], (5.0, 250.0), 35.0, 0.6),
        log(BASE[13], (1.0, 5.0), 2.0, 0.25),
        log(BASE[14], (8.0, 300.0), 45.0, 0.6),
        log(
            BASE[15],
            (150.0, 0.95 * m.cycle_ms),
            0.3 * m.cycle_ms + 90.0,
            0.2,
        ),
        plain(BASE[16], (0.0, 140.0), 15.0, 15.0),
        plain(BASE[17], (10.0, 100.0), 40.0, 13.0),
        plain(BASE[18], (0.3, 0.85), 0.67, 0.1),
        log(BASE[19], INERTANCES, 2e-4, 0.7),
        log(BASE[20], INERTANCES, 2.2e-4, 0.7),
        plain(BASE[21], (0.0, 0.6), 0.15, 0.1),
    ]
}

/// Priors of what only further measurements need: the compliance of the atrium, and filling pressure,
/// peripheral resistance and peak stress of each beat under changed load, as factors of those of the
/// steady beat.
///
/// The filling pressure is free within a factor of some four. Reflexes change resistance and
/// contractility within some beats: by a fifth and by a tenth here (our values; Burkhoff, Mirsky and
/// Suga 2005, Am J Physiol 289:H501, was not read).
fn further_priors(m: &Measured) -> Vec<Parameter> {
    let mut list = Vec::new();
    if m.further.has(FurtherQuantity::AtrialPressure) {
        let name = "atrial_compliance_mL_per_mmHg";
        list.push(log(name, (2.0, 80.0), ATRIAL_COMPLIANCE, 0.6));
    }
    for k in 1..=m.further.loaded.len() {
        let filling = format!("load_{k}_filling_pressure_factor");
        let resistance = format!("load_{k}_peripheral_resistance_factor");
        list.push(log(&filling, (0.1, 5.0), 1.0, 0.7));
        list.push(log(&resistance, (0.4, 2.5), 1.0, 0.2));
        let stress = format!("load_{k}_peak_stress_factor");
        list.push(log(&stress, (0.6, 1.7), 1.0, 0.1));
    }
    list
}

/// A catalogue entry with its fitted parameters, strength and shape. The other parameters keep
/// their typical values.
fn candidate(effect: &'static Effect) -> Candidate {
    let strength = effect.strength();
    let off = strength.off.unwrap_or(strength.range.0);
    let fitted: Vec<_> = effect
        .parameters
        .iter()
        .filter(|p| p.role != Role::Held)
        .collect();
    let parameters = fitted
        .iter()
        .map(|p| {
            let mean = if p.role == Role::Strength {
                off
            } else {
                p.typical
            };
            plain(p.name, p.accepted(), mean, p.prior_scale)
        })
        .collect();
    let typical: Vec<f64> = fitted.iter().map(|p| p.typical).collect();
    let mut starts = vec![typical.clone()];
    let (low, high) = strength.range;
    if low < off && off < high {
        let mut other = typical.clone();
        other[0] = (2.0 * off - typical[0]).max(low);
        starts.push(other);
    }
    // A shape whose typical value is far from the middle of its range also gets a start there.
    for (i, p) in fitted.iter().enumerate().skip(1) {
        let middle = 0.5 * (p.range.0 + p.range.1);
        if (middle - p.typical).abs() > 0.3 * (p.range.1 - p.range.0) {
            let mut other = typical.clone();
            other[i] = middle;
            starts.push(other);
        }
    }
    Candidate {
        name: effect.name.to_owned(),
        meaning: effect.meaning.to_owned(),
        in_3d: in_3d(effect.in_3d),
        remedy: effect.remedy.map(str::to_owned),
        artefact: effect.kind == Kind::Artefact,
        parameters,
        off,
        smallest: strength.smallest,
        starts,
        confused_with: effect
            .confused_with
            .iter()
            .map(|s| (*s).to_owned())
            .collect(),
        separated_by: effect
            .separated_by
            .iter()
            .map(|s| (*s).to_owned())
            .collect(),
        log_prior: 2.0 * effect.prior_odds.ln(),
        hidden_because: effect.hidden_because.map(str::to_owned),
    }
}

fn in_3d(declared: effects::InThreeDimensions) -> InThreeDimensions {
    use effects::InThreeDimensions as Declared;
    let (way, how) = match declared {
        Declared::AsItIs => ("as-it-is", None),
        Declared::ActivationMap { how } => ("activation-map", Some(how.to_owned())),
        Declared::PassiveExponents { factor } => {
            let how =
                format!("all exponents of Guccione's law times {factor}; its scale is fitted anew");
            ("passive-exponents", Some(how))
        }
        Declared::MaterialTerm { how } => ("material-term", Some(how.to_owned())),
        Declared::Cannot { why } => ("cannot", Some(why.to_owned())),
    };
    InThreeDimensions {
        way: way.to_owned(),
        how,
    }
}

impl Reduced {
    /// The model of a patient, with the whole catalogue.
    #[must_use]
    pub fn new(measured: &Measured) -> Self {
        Self {
            cycle: Ms(measured.cycle_ms),
            base: [base_priors(measured), further_priors(measured)].concat(),
            candidates: CATALOGUE.into_iter().map(candidate).collect(),
            effects: CATALOGUE.to_vec(),
            atrium: measured.further.has(FurtherQuantity::AtrialPressure),
            loads: (measured.further.loaded.iter())
                .map(|beat| Ms(beat.cycle_ms))
                .collect(),
        }
    }

    /// Multiplies the prior standard deviation of a base parameter, to show what the prior decides.
    ///
    /// # Panics
    /// If the model has no parameter of this name.
    pub fn scale_prior(&mut self, name: &str, factor: f64) {
        let parameter = self.base.iter_mut().find(|p| p.name == name);
        parameter.expect("a base parameter").sd *= factor;
    }

    /// The candidates, to show what their priors and smallest sizes decide.
    pub fn candidates_mut(&mut self) -> &mut [Candidate] {
        &mut self.candidates
    }

    /// Catalogue settings of candidates with fitted values.
    #[must_use]
    pub fn settings(&self, terms: &[(usize, &[f64])]) -> Vec<EffectSetting> {
        terms
            .iter()
            .map(|(term, fitted)| {
                let effect = self.effects[*term];
                let mut fitted = fitted.iter();
                let value = |p: &effects::Parameter| {
                    if p.role == Role::Held {
                        p.typical
                    } else {
                        fitted.next().copied().unwrap_or(p.typical)
                    }
                };
                EffectSetting {
                    effect,
                    values: effect.parameters.iter().map(value).collect(),
                }
            })
            .collect()
    }

    fn base_model(&self, x: &[f64], bumps: &[f64], cycle: Ms) -> Option<BaseModel> {
        let passive =
            OneFibrePassive::through(Ml(x[2] * x[1]), Ml(x[1]), Mmhg(x[3]), Ml(x[5]), x[4]).ok()?;
        let heart = LeftHeart {
            left_atrial_pressure: Mmhg(x[0]),
            mitral_forward: MmhgSPerMl(x[10]),
            mitral_backward: LeftHeart::BACKWARD,
            aortic_forward: MmhgSPerMl(x[9]),
            aortic_backward: LeftHeart::BACKWARD,
            windkessel: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: x[6],
                peripheral_resistance_mmhg_s_per_ml: x[7],
                compliance_ml_per_mmhg: x[8],
            },
            start: StartPressure::DiastolicCuff(Mmhg(75.0)),
            cycle_length: cycle,
        };
        let curve = CurveParameters {
            smax_kpa: x[11],
            rise_ms: x[12],
            rise_exponent: x[13],
            fall_ms: x[14],
            duration_ms: x[15],
            least_stretch: x[18],
            spread_ms: x[17],
            rate_loss_s: x[21],
        };
        Some(BaseModel {
            heart,
            passive,
            activation: ActivationSpread {
                onset: Ms(x[16]),
                spread: Ms(0.0),
                n_groups: 1,
            },
            contraction: GroupContraction::new(
                Box::new(ActivationCurve::new(&curve, bumps)),
                None,
                Vec::new(),
            )
            .ok()?,
            inertances: [x[19], x[20]],
            closed: None,
            law: None,
        })
    }
}

impl Forward for Reduced {
    fn base(&self) -> &[Parameter] {
        &self.base
    }

    fn base_starts(&self) -> Vec<Vec<f64>> {
        let start = |changes: &[(usize, f64)]| {
            let mut z = vec![0.0; self.base.len()];
            changes.iter().for_each(|(i, value)| z[*i] = *value);
            z
        };
        vec![
            start(&[(11, 0.7), (12, -0.5), (14, 0.7), (2, -0.7)]),
            start(&[(12, -0.7), (15, -0.5), (14, -0.5), (0, 0.7), (18, 0.7)]),
        ]
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn predict(&self, request: &Request<'_>, warm: Option<&Orbits>) -> Option<Prediction> {
        let (beat, model) = self.beat(
            request,
            request.base,
            self.cycle,
            warm.map(|orbits| &orbits.steady),
        )?;
        let mut prediction = self.steady(request, beat, &model);
        for (k, cycle) in self.loads.iter().enumerate() {
            // A request with the parameters of the steady beat alone asks for no other.
            let Some(base) = self.under_load(request.base, k) else {
                break;
            };
            let warm = warm.and_then(|orbits| orbits.loaded.get(k));
            let (beat, model) = self.beat(request, &base, *cycle, warm)?;
            let measured = beat.measured(&model);
            prediction.loaded.push(LoadedPrediction {
                step_ms: measured.spacing_ms(),
                pressure_mmhg: measured.pressure_mmhg,
                volume_ml: measured.volume_ml,
            });
            prediction.warm.loaded.push(beat.orbit);
        }
        Some(prediction)
    }
}

impl Reduced {
    /// The periodic beat, sought from an orbit and, where that fails, from the model's start: secants
    /// of another orbit may lead astray.
    fn beat(
        &self,
        request: &Request<'_>,
        base: &[f64],
        cycle: Ms,
        warm: Option<&Orbit>,
    ) -> Option<(PeriodicBeat, Assembled)> {
        let settings = PeriodicSettings {
            tolerance: TOLERANCE,
            limit: BEATS,
            ..PeriodicSettings::with_step(cycle, STEP)
        };
        let from = |start: Option<&Orbit>| {
            let base = self.base_model(base, request.bumps, cycle)?;
            let mut model = assemble(base, &self.settings(request.terms)).ok()?;
            let beat = find(&mut model, cycle, &settings, start).ok()?;
            beat.periodic.then_some((beat, model))
        };
        let near = warm.and_then(|orbit| from(Some(orbit)));
        near.or_else(|| from(None))
    }

    /// Base values with the filling pressure and the peripheral resistance of a beat under changed
    /// load; `None` without its factors.
    fn under_load(&self, base: &[f64], k: usize) -> Option<Vec<f64>> {
        let first = BASE.len() + usize::from(self.atrium) + 3 * k;
        let [filling, resistance, stress] = *base.get(first..)?.first_chunk()?;
        let mut base = base[..BASE.len()].to_vec();
        base[0] *= filling;
        base[7] *= resistance;
        base[11] *= stress;
        Some(base)
    }

    /// What is measured of a steady beat.
    fn steady(&self, request: &Request<'_>, beat: PeriodicBeat, model: &Assembled) -> Prediction {
        let x = request.base;
        let measured = beat.measured(model);
        let step_ms = measured.spacing_ms();
        let aorta = beat
            .aortic_pressure_mmhg
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        let compliance = (self.atrium.then(|| x.get(BASE.len())).flatten())
            .copied()
            .unwrap_or(ATRIAL_COMPLIANCE);
        let stored = reservoir(&beat.mitral_flow_ml_per_s, step_ms, compliance);
        let filled = (beat.atrial_pressure_mmhg.iter().zip(stored)).map(|(p, stored)| p + stored);
        // λ³ is in proportion to the volume inside the fibre's shell, V + V_w/3.
        let shell = |volume: &f64| (volume + x[5] / 3.0).cbrt();
        let at_start = beat.heart.volume_ml.first().map_or(1.0, shell);
        let strain = (beat.heart.volume_ml.iter()).map(|v| 100.0 * (shell(v) / at_start - 1.0));
        let valves = Traces {
            aortic: &beat.aortic_flow_ml_per_s,
            mitral: &beat.mitral_flow_ml_per_s,
            ventricle: &beat.heart.pressure_mmhg,
            atrium: &beat.atrial_pressure_mmhg,
        };
        Prediction {
            step_ms,
            pressure_mmhg: measured.pressure_mmhg,
            volume_ml: measured.volume_ml,
            atrial_pressure_mmhg: filled.collect(),
            strain_percent: strain.collect(),
            valve_times_ms: valve_times(valves, step_ms),
            qrs_ms: NORMAL_QRS_MS + self.late_ms(request),
            loaded: Vec::new(),
            true_volume_ml: beat.heart.volume_ml,
            true_pressure_mmhg: beat.heart.pressure_mmhg,
            aortic_flow_ml_per_s: beat.aortic_flow_ml_per_s,
            mitral_flow_ml_per_s: beat.mitral_flow_ml_per_s,
            aortic_pressure_mmhg: beat.aortic_pressure_mmhg,
            systolic_mmhg: aorta.1,
            diastolic_mmhg: aorta.0,
            forward_stroke_volume_ml: beat.forward_volume_ml,
            warm: Orbits {
                steady: beat.orbit,
                loaded: Vec::new(),
            },
        }
    }

    /// Delay of the late part of the wall \[ms\].
    fn late_ms(&self, request: &Request<'_>) -> f64 {
        let is_late = |term: &usize| self.effects[*term].name == LATE_ACTIVATION;
        (request.terms.iter())
            .find(|(term, _)| is_late(term))
            .map_or(0.0, |(_, values)| values[0])
    }
}

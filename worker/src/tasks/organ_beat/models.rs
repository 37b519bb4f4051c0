//! Models and solver settings of a beat, made from its specification.

use std::collections::BTreeMap;
use std::sync::Arc;

use cardiotwin_models::beat::{BeatSettings, Beats};
use cardiotwin_models::calcium::{Calcium, Rice2008, Rice2008Parameters, SampledCalcium};
use cardiotwin_models::cell0d::{CalciumInput, CellError, CellParameters, CellSolverSettings};
use cardiotwin_models::circulation::{ClosedLoop, LeftHeart, StartPressure};
use cardiotwin_models::contraction::{OwnCell, StretchReference, Tanh, catalogue};
use cardiotwin_models::effects::{Assembled, BaseModel, EffectSetting, assemble};
use cardiotwin_models::step_control::StepControl;
use cardiotwin_models::ventricle::{
    ActivationSpread, GroupContraction, OrganLaw, end_diastolic_stretch,
};
use cardiotwin_schemas::finite_element::EquationSettings;
use cardiotwin_schemas::organ::{
    ActivationSpec, BeatCount, CellStretch, ContractionSpec, EffectSpec, OneFibrePassive,
    StretchOrigin,
};
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};

use crate::calcium;
use crate::cell_parameters::NamedCell;
use crate::error::TaskError;

/// The reduced ventricle of an organ: the one-fibre ventricle, or the one with the organ's law.
#[derive(Debug, Clone)]
pub struct ReducedOrgan {
    /// Passive law and reference volumes.
    pub passive: OneFibrePassive,
    /// Activation of the groups.
    pub activation: ActivationSpec,
    /// The organ's law; `None` for the one-fibre ventricle.
    pub law: Option<Arc<OrganLaw>>,
    /// Accuracy of the periodic cell from which the groups start.
    pub cell_solver: CellSolverSettings,
}

impl ReducedOrgan {
    /// The one-fibre ventricle.
    #[must_use]
    pub fn one_fibre(passive: OneFibrePassive, activation: ActivationSpec) -> Self {
        Self {
            passive,
            activation,
            law: None,
            cell_solver: CellSolverSettings::default(),
        }
    }
}

/// Reduced ventricle and circulation of a specification with its effects, at the beginning of the
/// beat.
///
/// # Errors
/// [`TaskError`] when parameters are outside the range of the models, or an effect is unknown or an
/// artefact of the measurement.
pub fn reduced(spec: &OrganBeatSpec, organ: &ReducedOrgan) -> Result<Assembled, TaskError> {
    let activation = &organ.activation;
    let effects = effects(&spec.circulation.effects)?;
    let base = BaseModel {
        heart: heart(spec),
        passive: organ.passive,
        activation: ActivationSpread {
            onset: Ms(activation.onset_ms),
            spread: Ms(activation.spread_ms),
            n_groups: activation.groups as usize,
        },
        contraction: contraction(
            spec,
            &organ.cell_solver,
            end_diastolic_stretch(&organ.passive, organ.law.as_deref()),
        )?,
        inertances: [0.0; 2],
        closed: closed_loop(spec, activation.onset_ms),
        law: organ.law.clone(),
    };
    let mut assembled = assemble(base, &effects)?;
    assembled
        .ventricle
        .limit_iterations(spec.newton_iterations as usize);
    Ok(assembled)
}

pub(super) fn settings(spec: &OrganBeatSpec) -> BeatSettings {
    BeatSettings {
        cycle_length: Ms(spec.cycle_length_ms),
        beats: match spec.beats {
            BeatCount::Fixed { n } => Beats::Exactly(n as usize),
            BeatCount::Periodic { max, tolerance } => Beats::UntilPeriodic {
                limit: max as usize,
                volume: Ml(tolerance),
                pressure: Mmhg(tolerance),
            },
        },
        step: Ms(spec.time_step_ms),
        diastolic_step: Ms(spec
            .finite_element
            .map_or(0.0, |equations| equations.diastolic_step_ms)),
        control: spec
            .finite_element
            .and_then(|equations| control(spec, &equations)),
        shortest_step: Ms(spec.shortest_step_ms),
        record_nodes: true,
    }
}

/// Control of the steps, if the settings allow steps longer than the output interval.
fn control(spec: &OrganBeatSpec, equations: &EquationSettings) -> Option<StepControl> {
    (equations.longest_step_ms > spec.time_step_ms).then_some(StepControl {
        longest: Ms(equations.longest_step_ms),
        tolerance_per_s: equations.step_tolerance,
    })
}

pub(super) fn heart(spec: &OrganBeatSpec) -> LeftHeart {
    LeftHeart {
        left_atrial_pressure: Mmhg(spec.circulation.left_atrial_pressure_mmhg),
        mitral_forward: MmhgSPerMl(spec.valves.r_mv_f_mmhg_s_per_ml),
        mitral_backward: MmhgSPerMl(spec.valves.r_b_mmhg_s_per_ml),
        aortic_forward: MmhgSPerMl(spec.valves.r_av_f_mmhg_s_per_ml),
        aortic_backward: MmhgSPerMl(spec.valves.r_b_mmhg_s_per_ml),
        windkessel: spec.circulation.afterload,
        start: StartPressure::DiastolicCuff(Mmhg(
            spec.circulation.initial_windkessel_pressure_mmhg,
        )),
        cycle_length: Ms(spec.cycle_length_ms),
    }
}

/// The loop that closes the circulation behind the ventricle, if the specification has one.
pub(super) fn closed_loop(spec: &OrganBeatSpec, onset_ms: f64) -> Option<ClosedLoop> {
    let closed = spec.circulation.closed.as_ref()?;
    let left = heart(spec);
    let stroke_volume = Ml(closed.stroke_volume_ml);
    let mut around = ClosedLoop::around(left, Ms(onset_ms), stroke_volume);
    if let Some(share) = closed.venous_share {
        around.table = around.table.with_venous_share(share);
    }
    let Some(at) = closed.rest else {
        return Some(around);
    };
    let mut rest = left;
    rest.cycle_length = Ms(at.cycle_length_ms);
    rest.left_atrial_pressure = Mmhg(at.left_atrial_pressure_mmhg);
    rest.windkessel.peripheral_resistance_mmhg_s_per_ml = at.peripheral_resistance_mmhg_s_per_ml;
    Some(ClosedLoop { rest, ..around })
}

/// Catalogue entries of the accepted effects. Effects of the measurement are rejected, because a
/// simulation measures nothing.
pub(super) fn effects(specs: &[EffectSpec]) -> Result<Vec<EffectSetting>, TaskError> {
    let setting = |spec: &EffectSpec| {
        let setting = EffectSetting::named(&spec.name, &spec.parameters)?;
        setting.require_physiology()?;
        Ok(setting)
    };
    specs.iter().map(setting).collect()
}

/// Contraction of a beat.
///
/// - `accuracy`: that of the periodic cell from which the groups start
/// - `end_diastolic_stretch`: from the unloaded wall, at which a model's own cell is held
pub(super) fn contraction(
    spec: &OrganBeatSpec,
    accuracy: &CellSolverSettings,
    end_diastolic_stretch: f64,
) -> Result<GroupContraction, TaskError> {
    let cycle_length_ms = spec.cycle_length_ms;
    let reference = stretch_reference(spec.cell_stretch);
    let contraction = match &spec.contraction {
        ContractionSpec::Tanh { parameters } => Tanh::new(*parameters)
            .map(GroupContraction::tanh)
            .map_err(TaskError::Contraction)?,
        ContractionSpec::Land2017Rice {
            parameters,
            lambda_0,
        } => land(
            NamedCell::new(cycle_length_ms, *lambda_0)
                .with(parameters)?
                .parameters(),
            accuracy,
        )?,
        ContractionSpec::Land2017Trace {
            parameters,
            lambda_0,
            calcium,
        } => {
            let cell = NamedCell::new(cycle_length_ms, *lambda_0)
                .with(parameters)?
                .parameters();
            let samples = calcium::samples(calcium, cycle_length_ms)?;
            let sampled =
                SampledCalcium::new(Ms(calcium::INTERVAL_MS), samples).map_err(CellError::from)?;
            let cell = CellParameters {
                calcium: CalciumInput::Sampled(Arc::new(sampled)),
                ..cell
            };
            land(cell, accuracy)?
        }
        ContractionSpec::Catalogue { name, parameters } => {
            let held = reference.at_end_diastole(end_diastolic_stretch);
            of_catalogue(name, parameters, cycle_length_ms, held)?
        }
    };
    Ok(contraction.with_stretch(reference))
}

/// Whether the contraction model has calcium.
pub(super) fn has_calcium(spec: &OrganBeatSpec) -> bool {
    match &spec.contraction {
        ContractionSpec::Tanh { .. } => false,
        ContractionSpec::Land2017Rice { .. } | ContractionSpec::Land2017Trace { .. } => true,
        ContractionSpec::Catalogue { name, parameters } => catalogue::find(name)
            .and_then(|model| model.with(parameters))
            .is_ok_and(|model| model.needs_calcium()),
    }
}

/// A model of the catalogue: at activation of its own cell, or at rest. A model that needs calcium and brings none gets Rice's
/// transient with its defaults.
fn of_catalogue(
    name: &str,
    parameters: &BTreeMap<String, f64>,
    cycle_length_ms: f64,
    end_diastolic_stretch: f64,
) -> Result<GroupContraction, TaskError> {
    let model = catalogue::find(name)
        .and_then(|model| model.with(parameters))
        .map_err(TaskError::Contraction)?;
    let own = model
        .own_cell(cycle_length_ms, end_diastolic_stretch)
        .map_err(TaskError::Contraction)?;
    if let Some(OwnCell { calcium, start }) = own {
        return GroupContraction::new(model, Some(calcium), start).map_err(TaskError::Organ);
    }
    let calcium: Option<Arc<dyn Calcium>> = if model.needs_calcium() {
        let rice = Rice2008::new(Rice2008Parameters::default()).map_err(CellError::Calcium)?;
        Some(Arc::new(rice))
    } else {
        None
    };
    let mut rest = vec![0.0; model.n_states()];
    model.rest(&mut rest);
    GroupContraction::new(model, calcium, rest).map_err(TaskError::Organ)
}

fn stretch_reference(stretch: CellStretch) -> StretchReference {
    match stretch.origin {
        StretchOrigin::EndDiastole => StretchReference::EndDiastole,
        StretchOrigin::Unloaded => StretchReference::Unloaded {
            slack: stretch.slack_stretch,
        },
    }
}

/// Land's model, started from the periodic state of the cell.
fn land(
    cell: CellParameters,
    accuracy: &CellSolverSettings,
) -> Result<GroupContraction, TaskError> {
    let cell = cell.build()?;
    let start = cell.periodic_start(accuracy)?;
    Ok(GroupContraction::land_from(&cell, &start))
}

//! The cost of a parameter vector: one periodic beat of the 0D cell against the targets.

use std::collections::BTreeMap;

use cardiotwin_calibrate::Interval;
use cardiotwin_models::cell0d::{
    ActiveStressBiomarkers, CellBeat, CellCost, CellError, CellPenalty, CellSolverSettings, CellTargets, CellWeights,
};
use cardiotwin_schemas::biomarkers::CellBiomarkers;
use cardiotwin_schemas::task::CellFitSpec;

use crate::cell_parameters::{NamedCell, position};
use crate::error::TaskError;

/// Cost of a cell that cannot be computed: finite, and worse than any that can.
pub const WORST: f64 = 1e9;

/// A cell to be fitted: what is fixed, what is free, what is aimed at.
#[derive(Debug, Clone)]
pub struct Objective {
    base: NamedCell,
    names: Vec<String>,
    bounds: Vec<Interval>,
    targets: CellTargets,
    weights: CellWeights,
    solver: CellSolverSettings,
}

/// One computed cell.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// Its biomarkers.
    pub biomarkers: ActiveStressBiomarkers,
    /// Terms of the misfit.
    pub cost: CellCost,
    /// Terms of the penalty.
    pub penalty: CellPenalty,
}

impl Evaluation {
    /// Misfit and penalty.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.cost.total() + self.penalty.total()
    }

    /// All terms by name.
    #[must_use]
    pub fn terms(&self) -> BTreeMap<String, f64> {
        let (cost, penalty) = (&self.cost, &self.penalty);
        [
            ("Sa_max_kPa", cost.sa_max),
            ("dSadt_max_kPa_per_ms", cost.dsadt_max),
            ("STD30_ms", cost.std30),
            ("STD50_ms", cost.std50),
            ("STD90_ms", cost.std90),
            ("lambda_min", cost.lambda_min),
            ("penalty_resting_stress", penalty.sa_res),
            ("penalty_negative_stress", penalty.negative_stress),
            ("penalty_rise_after_maximum", penalty.rise_after_max),
            ("penalty_CTD50", penalty.ctd50),
            ("penalty_CTD90", penalty.ctd90),
        ]
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
    }
}

impl Objective {
    /// The objective of a specification.
    ///
    /// # Errors
    /// [`TaskError`] for a parameter without a name in the cell or without bounds, or a target that is no number.
    pub fn new(spec: &CellFitSpec) -> Result<Self, TaskError> {
        let settings = &spec.settings;
        let base = NamedCell::new(spec.cycle_length_ms, spec.lambda_0).with(&spec.fixed)?.with(&settings.frozen)?;
        let mut bounds = Vec::new();
        for name in &settings.fitted() {
            position(name)?;
            let [lower, upper] =
                *settings.bounds.get(name).ok_or_else(|| TaskError::NoBounds { name: name.clone() })?;
            bounds.push(Interval::new(lower, upper));
        }
        Ok(Self {
            base,
            names: settings.fitted(),
            bounds,
            targets: targets(&spec.targets)?,
            weights: weights(&settings.weights)?,
            solver: CellSolverSettings::default(),
        })
    }

    /// The box of the free parameters, in the order of the settings.
    #[must_use]
    pub fn bounds(&self) -> &[Interval] {
        &self.bounds
    }

    /// Names of the free parameters.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The guess that the settings give, if any: parameters that it leaves out are at their default.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn guesses(&self, spec: &CellFitSpec) -> Result<Vec<Vec<f64>>, TaskError> {
        if spec.settings.initial.is_empty() {
            return Ok(Vec::new());
        }
        let guess = NamedCell::new(spec.cycle_length_ms, spec.lambda_0).with(&spec.settings.initial)?;
        Ok(vec![self.names.iter().map(|name| guess.value(name)).collect::<Result<_, _>>()?])
    }

    /// Value of a parameter that is not free.
    pub fn fixed_value(&self, name: &str) -> Result<f64, TaskError> {
        self.base.value(name)
    }

    /// The cost alone; [`WORST`] where the cell cannot be computed.
    #[must_use]
    pub fn cost(&self, values: &[f64], beat: &mut CellBeat) -> f64 {
        match self.evaluate(values, beat) {
            Ok(evaluation) => Some(evaluation.total()).filter(|cost| cost.is_finite()).unwrap_or(WORST).min(WORST),
            Err(_) => WORST,
        }
    }

    /// Computes the cell of a parameter vector; `beat` holds its traces afterwards.
    ///
    /// # Errors
    /// [`CellError`] when the cell refuses the parameters or finds no periodic beat.
    pub fn evaluate(&self, values: &[f64], beat: &mut CellBeat) -> Result<Evaluation, CellError> {
        let values: BTreeMap<String, f64> = self.names.iter().cloned().zip(values.iter().copied()).collect();
        let cell = self.base.clone().with(&values).unwrap_or_else(|_| self.base.clone()).parameters().build()?;
        cell.solve_periodic_into(&self.solver, beat)?;
        let biomarkers = beat.biomarkers().ok_or(CellError::NotPeriodic { beats: 0, change: f64::NAN })?;
        let penalty = CellPenalty::new(&beat.time_ms, &beat.sa_kpa, &cell.calcium_biomarkers()?);
        Ok(Evaluation { biomarkers, cost: CellCost::new(&self.targets, &biomarkers, &self.weights), penalty })
    }
}

fn targets(targets: &CellBiomarkers) -> Result<CellTargets, TaskError> {
    for (name, value) in by_name(targets) {
        if !(value > 0.0 && value.is_finite()) {
            return Err(TaskError::Target { name, value });
        }
    }
    Ok(CellTargets {
        sa_max_kpa: targets.sa_max_kpa,
        dsadt_max_kpa_per_ms: targets.dsadt_max_kpa_per_ms,
        std30_ms: targets.std30_ms,
        std50_ms: targets.std50_ms,
        std90_ms: targets.std90_ms,
        lambda_min: targets.lambda_min,
    })
}

/// Biomarkers with their names in files.
#[must_use]
pub fn by_name(biomarkers: &CellBiomarkers) -> [(&'static str, f64); 6] {
    [
        ("Sa_max_kPa", biomarkers.sa_max_kpa),
        ("dSadt_max_kPa_per_ms", biomarkers.dsadt_max_kpa_per_ms),
        ("STD30_ms", biomarkers.std30_ms),
        ("STD50_ms", biomarkers.std50_ms),
        ("STD90_ms", biomarkers.std90_ms),
        ("lambda_min", biomarkers.lambda_min),
    ]
}

/// Weights by name: the paper's where a name is absent.
fn weights(given: &BTreeMap<String, f64>) -> Result<CellWeights, TaskError> {
    let mut weights = CellWeights::default();
    for (name, value) in given {
        let weight = match name.as_str() {
            "Sa_max_kPa" => &mut weights.sa_max,
            "dSadt_max_kPa_per_ms" => &mut weights.dsadt_max,
            "STD30_ms" => &mut weights.std30,
            "STD50_ms" => &mut weights.std50,
            "STD90_ms" => &mut weights.std90,
            "lambda_min" => &mut weights.lambda_min,
            _ => return Err(TaskError::UnknownWeight { name: name.clone() }),
        };
        *weight = *value;
    }
    Ok(weights)
}

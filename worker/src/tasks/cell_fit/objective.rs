//! Cost of parameter vectors: periodic beats of many 0D cells at once, compared with the targets.

use std::collections::BTreeMap;

use cardiotwin_calibrate::Interval;
use cardiotwin_cell_engine::{
    self as engine, CellEngine, CellInput, CellOutput, CellStatus, CellTrace, Penalty,
    SampledCalcium, Workspace,
};
use cardiotwin_models::contraction::LAMBDA_CAP;
use cardiotwin_schemas::biomarkers::{CELL_BIOMARKERS, CellBiomarkers};
use cardiotwin_schemas::settings::InstructionSet;
use cardiotwin_schemas::task::CellFitSpec;

use crate::calcium;
use crate::cell_parameters::{NamedCell, position};
use crate::engine::settings_for;
use crate::error::TaskError;

/// Cost of a cell that cannot be computed. It is finite, and larger than the cost of any cell that
/// can.
pub const WORST: f64 = 1e9;

/// Weight of the squared relative shortage of Ca50 in the cost.
const SHORTAGE_WEIGHT: f64 = 100.0;

/// Objective of a fit: fixed parameters, free parameters and targets.
#[derive(Debug, Clone)]
pub struct Objective {
    base: NamedCell,
    names: Vec<String>,
    positions: Vec<usize>,
    bounds: Vec<Interval>,
    objective: engine::Objective,
    engine: CellEngine,
    /// Positions of Ca50_ref, beta_1 and Ca_res in the engine's input.
    sensitivity: [usize; 3],
    lambda_max: f64,
}

/// A cell with its cost.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// Biomarkers of the cell.
    pub biomarkers: CellBiomarkers,
    /// Misfit of the biomarkers plus the penalties.
    pub cost: f64,
    /// Terms of the cost, by name.
    pub terms: BTreeMap<String, f64>,
    /// Beat of the cell.
    pub trace: CellTrace,
}

impl Objective {
    /// Objective of a specification.
    ///
    /// # Errors
    /// [`TaskError`] for an unknown parameter or one without bounds, a target that is not positive
    /// and finite, an unusable calcium file, or instructions that the processor lacks.
    pub fn new(spec: &CellFitSpec, instruction_set: InstructionSet) -> Result<Self, TaskError> {
        let settings = &spec.settings;
        let base = NamedCell::new(spec.cycle_length_ms, spec.lambda_0)
            .with(&spec.fixed)?
            .with(&settings.frozen)?;
        let names = settings.fitted();
        let positions = names
            .iter()
            .map(|name| position(name))
            .collect::<Result<_, _>>()?;
        let interval = |name: &String| {
            let [lower, upper] = *settings
                .bounds
                .get(name)
                .ok_or_else(|| TaskError::NoBounds { name: name.clone() })?;
            Ok(Interval::new(lower, upper))
        };
        let bounds = names
            .iter()
            .map(interval)
            .collect::<Result<_, TaskError>>()?;
        let mut engine = CellEngine::new(settings_for(instruction_set))?;
        if let Some(file) = &spec.calcium {
            let samples = calcium::samples(file, spec.cycle_length_ms)?;
            engine = engine.with_calcium(SampledCalcium::new(calcium::INTERVAL_MS, samples)?);
        }
        let mut objective = engine::Objective::new(checked(spec.targets)?);
        for (name, value) in &settings.weights {
            let position = CELL_BIOMARKERS.iter().position(|label| label.key == name);
            let unknown = || TaskError::UnknownWeight { name: name.clone() };
            objective.weights[position.ok_or_else(unknown)?] = *value;
        }
        let sensitivity = [
            position("Ca50_ref_uM")?,
            position("beta_1_uM")?,
            position("Ca_res_uM")?,
        ];
        let lambda_max = spec.lambda_max.min(LAMBDA_CAP);
        Ok(Self {
            base,
            names,
            positions,
            bounds,
            objective,
            engine,
            sensitivity,
            lambda_max,
        })
    }

    /// Bounds of the free parameters, in the order of the settings.
    #[must_use]
    pub fn bounds(&self) -> &[Interval] {
        &self.bounds
    }

    /// Names of the free parameters.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Targets of the fit.
    #[must_use]
    pub fn targets(&self) -> &CellBiomarkers {
        &self.objective.targets
    }

    /// Value of a parameter that is not free.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn fixed_value(&self, name: &str) -> Result<f64, TaskError> {
        self.base.value(name)
    }

    /// Initial guess of the settings as a vector of free parameters; parameters that it leaves out
    /// have their default. Empty without a guess.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn guesses(&self, initial: &BTreeMap<String, f64>) -> Result<Vec<Vec<f64>>, TaskError> {
        if initial.is_empty() {
            return Ok(Vec::new());
        }
        let guess = self.base.clone().with(initial)?;
        Ok(vec![
            self.names
                .iter()
                .map(|name| guess.value(name))
                .collect::<Result<_, _>>()?,
        ])
    }

    /// Engine that computes the cells.
    #[must_use]
    pub fn engine(&self) -> &CellEngine {
        &self.engine
    }

    /// The cell of a vector of free parameters.
    #[must_use]
    pub fn input(&self, values: &[f64]) -> CellInput {
        let mut input = self.base.input();
        self.positions
            .iter()
            .zip(values)
            .for_each(|(position, value)| input.parameters[*position] = *value);
        input
    }

    /// Relative shortage of Ca50: (resting calcium − Ca50) / resting calcium at the largest stretch
    /// of the organ's beat, or 0 if Ca50 is larger.
    ///
    /// A cell whose Ca50 falls to the resting calcium contracts at rest in the most stretched parts
    /// of the wall. If Ca50 falls to zero, the stress is undefined.
    fn sensitivity_shortage(&self, input: &CellInput) -> f64 {
        let [ca50_ref, beta_1, ca_res] =
            self.sensitivity.map(|position| input.parameters[position]);
        ((ca_res - ca50_ref - beta_1 * (self.lambda_max - 1.0)) / ca_res).max(0.0)
    }

    /// Cost of a computed cell; [`WORST`] if it has no periodic beat, or if its Ca50 is not
    /// positive at a stretch that the organ reaches.
    #[must_use]
    pub fn cost(&self, input: &CellInput, output: &CellOutput) -> f64 {
        let shortage = self.sensitivity_shortage(input);
        if output.status != CellStatus::Periodic || shortage >= 1.0 {
            return WORST;
        }
        let cost = self
            .objective
            .cost(&output.reading.biomarkers, &output.penalty)
            + SHORTAGE_WEIGHT * shortage.powi(2);
        if cost.is_finite() {
            cost.min(WORST)
        } else {
            WORST
        }
    }

    /// Computes one cell and its beat.
    ///
    /// # Errors
    /// [`TaskError::NoBeat`] when the cell has no periodic beat.
    pub fn evaluate(&self, values: &[f64]) -> Result<Evaluation, TaskError> {
        let mut outputs = [CellOutput::default()];
        let mut traces = [CellTrace::default()];
        let input = self.input(values);
        self.engine.evaluate_with_traces(
            std::slice::from_ref(&input),
            &mut Workspace::new(),
            &mut outputs,
            &mut traces,
        )?;
        let [output] = outputs;
        let [trace] = traces;
        if output.status != CellStatus::Periodic {
            return Err(TaskError::NoBeat {
                status: format!("{:?}", output.status),
            });
        }
        let biomarkers = output.reading.biomarkers;
        let mut terms = self.terms(&biomarkers, &output.penalty);
        let shortage = SHORTAGE_WEIGHT * self.sensitivity_shortage(&input).powi(2);
        if shortage > 0.0 {
            terms.insert("penalty_Ca50".to_owned(), shortage);
        }
        Ok(Evaluation {
            biomarkers,
            cost: self.cost(&input, &output),
            terms,
            trace,
        })
    }

    fn terms(&self, biomarkers: &CellBiomarkers, penalty: &Penalty) -> BTreeMap<String, f64> {
        let rows = self.objective.targets.by_name().into_iter();
        let rows = rows.zip(biomarkers.values()).zip(self.objective.weights);
        let misfit = rows.map(|(((name, target), value), weight)| {
            (name, weight * ((target - value) / target).powi(2))
        });
        let penalty = [
            ("penalty_resting_stress", penalty.sa_res),
            ("penalty_negative_stress", penalty.negative_stress),
            ("penalty_rise_after_maximum", penalty.rise_after_peak),
            ("penalty_CTD50", penalty.ctd50_low + penalty.ctd50_high),
            ("penalty_CTD90", penalty.ctd90_low + penalty.ctd90_high),
        ];
        misfit
            .chain(penalty)
            .map(|(name, value)| (name.to_owned(), value))
            .collect()
    }
}

/// Checks that each target is positive and finite.
fn checked(targets: CellBiomarkers) -> Result<CellBiomarkers, TaskError> {
    for (name, value) in targets.by_name() {
        if !(value > 0.0 && value.is_finite()) {
            return Err(TaskError::Target { name, value });
        }
    }
    Ok(targets)
}

//! Names of the cell's parameters in files (`organ::CELL_PARAMETERS`), and their places in the
//! solvers' types.

use std::collections::BTreeMap;

use cardiotwin_cell_engine::{CellInput, DEFAULT_PARAMETERS, N_PARAMETERS};
use cardiotwin_models::calcium::Rice2008Parameters;
use cardiotwin_models::cell0d::{CalciumInput, CellParameters, LandPassiveParameters};
use cardiotwin_models::contraction::Land2017Parameters;
use cardiotwin_schemas::organ::CELL_PARAMETERS;

use crate::error::TaskError;

/// A cell whose parameters are accessed by name: contraction (Land), passive stress and calcium.
/// All have their default values until they are set.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCell {
    /// Values in the order of [`CELL_PARAMETERS`], which is also the engine's.
    values: [f64; N_PARAMETERS],
    cycle_length_ms: f64,
    lambda_0: f64,
}

/// Position of a parameter in [`CELL_PARAMETERS`] and in [`CellInput::parameters`].
///
/// # Errors
/// [`TaskError::UnknownParameter`] for a name that the cell does not have.
pub fn position(name: &str) -> Result<usize, TaskError> {
    let position = CELL_PARAMETERS.iter().position(|known| *known == name);
    position.ok_or_else(|| TaskError::UnknownParameter {
        name: name.to_owned(),
    })
}

impl NamedCell {
    /// A cell with the default parameters (Tables A2 to A4, and the passive scale of the
    /// sensitivity analysis), at a cycle length \[ms\] and an initial stretch.
    #[must_use]
    pub fn new(cycle_length_ms: f64, lambda_0: f64) -> Self {
        Self {
            values: DEFAULT_PARAMETERS,
            cycle_length_ms,
            lambda_0,
        }
    }

    /// Sets all parameters of a map.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn with(mut self, parameters: &BTreeMap<String, f64>) -> Result<Self, TaskError> {
        for (name, value) in parameters {
            self.values[position(name)?] = *value;
        }
        Ok(self)
    }

    /// The value of a parameter.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn value(&self, name: &str) -> Result<f64, TaskError> {
        Ok(self.values[position(name)?])
    }

    /// Input of the batched engine; [`position`] gives a parameter's place in it.
    #[must_use]
    pub fn input(&self) -> CellInput {
        CellInput::new(self.values, self.cycle_length_ms, self.lambda_0)
    }

    /// Input of the scalar cell, from which the organ's contraction is also made.
    #[must_use]
    pub fn parameters(&self) -> CellParameters {
        let [active @ .., ca_res, ca_max, tau_cr, tau_cd, a_p_kpa] = self.values;
        let calcium = Rice2008Parameters::from_values([ca_res, ca_max, tau_cr, tau_cd]);
        CellParameters {
            land: Land2017Parameters::from_values(active),
            passive: LandPassiveParameters {
                a_p_kpa,
                ..LandPassiveParameters::default()
            },
            calcium: CalciumInput::Rice(calcium),
            cycle_length_ms: self.cycle_length_ms,
            lambda0: self.lambda_0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_the_scalar_cells() {
        let cell = NamedCell::new(1000.0, 1.0).parameters();
        let models = CellParameters::default();
        assert_eq!(
            (cell.land, cell.passive, cell.calcium),
            (models.land, models.passive, models.calcium)
        );
    }

    #[test]
    fn every_name_has_a_place_of_its_own() {
        let values: BTreeMap<String, f64> = CELL_PARAMETERS
            .iter()
            .enumerate()
            .map(|(idx, name)| ((*name).to_owned(), 100.0 + idx as f64))
            .collect();
        let cell = NamedCell::new(800.0, 0.99).with(&values).unwrap();
        let input = cell.input();
        for (name, value) in &values {
            assert_eq!(cell.value(name).unwrap(), *value, "{name}");
            assert_eq!(input.parameters[position(name).unwrap()], *value, "{name}");
        }
        assert_eq!((input.cycle_length_ms, input.lambda_0), (800.0, 0.99));
        let parameters = cell.parameters();
        assert_eq!(
            (parameters.cycle_length_ms, parameters.lambda0),
            (800.0, 0.99)
        );
        assert_eq!(parameters.land.beta1_um, values["beta_1_uM"]);
        assert_eq!(parameters.passive.a_p_kpa, values["a_p_kPa"]);
        let CalciumInput::Rice(rice) = parameters.calcium else {
            panic!("Rice's calcium is what was set")
        };
        assert_eq!(rice.tau_cd_ms, values["tau_CD_ms"]);
    }

    #[test]
    fn an_unknown_name_is_refused() {
        let unknown = BTreeMap::from([("Ca50".to_owned(), 0.8)]);
        let error = NamedCell::new(800.0, 1.0)
            .with(&unknown)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("`Ca50`") && error.contains("Ca50_ref_uM"),
            "{error}"
        );
    }
}

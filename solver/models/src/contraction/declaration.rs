//! Declaration of a contraction model in the catalogue.

use std::collections::BTreeMap;

use super::{Contraction, ContractionError};
use crate::parameter::Domain;

/// Makes a model from one value for each of its parameters.
pub type Build = fn(&[f64]) -> Result<Box<dyn Contraction>, ContractionError>;

/// An entry of the catalogue.
#[derive(Debug, Clone, Copy)]
pub struct ContractionModel {
    /// Name in files and on the command line.
    pub name: &'static str,
    /// Meaning, in one sentence.
    pub meaning: &'static str,
    /// Equation in the form in which it is computed.
    pub equation: &'static str,
    /// Publication from which the model is taken.
    pub source: &'static str,
    /// Parameters, in the order in which `build` takes their values.
    pub parameters: &'static [ModelParameter],
    /// Makes the model from one value for each parameter, or says which values do not go together.
    pub build: Build,
}

/// One parameter of a model in the catalogue.
#[derive(Debug, Clone, Copy)]
pub struct ModelParameter {
    /// Key in files, which ends with the unit where there is one.
    pub name: &'static str,
    /// Meaning of the parameter.
    pub meaning: &'static str,
    /// Value if a specification gives none.
    pub default: f64,
    /// Values that the equations admit.
    pub domain: Domain,
}

impl ContractionModel {
    /// The model with parameters by name; absent parameters have their default.
    ///
    /// # Errors
    /// [`ContractionError::UnknownParameter`] for a name that the model lacks, [`ContractionError::Parameter`] and others for
    /// values that its equations do not admit.
    pub fn with(
        &self,
        parameters: &BTreeMap<String, f64>,
    ) -> Result<Box<dyn Contraction>, ContractionError> {
        let is_known = |key: &String| self.parameters.iter().any(|p| p.name == key);
        if let Some(found) = parameters.keys().find(|key| !is_known(key)) {
            let names: Vec<_> = self.parameters.iter().map(|p| p.name).collect();
            return Err(ContractionError::UnknownParameter {
                model: self.name,
                found: found.clone(),
                expected: names.join(", "),
            });
        }
        let mut values = Vec::with_capacity(self.parameters.len());
        for parameter in self.parameters {
            let value = parameters
                .get(parameter.name)
                .copied()
                .unwrap_or(parameter.default);
            if !parameter.domain.contains(value) {
                return Err(ContractionError::Parameter {
                    name: parameter.name,
                    value,
                    expected: parameter.domain.expected(),
                });
            }
            values.push(value);
        }
        (self.build)(&values)
    }
}

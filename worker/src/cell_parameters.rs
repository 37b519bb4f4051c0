//! Names of the cell's parameters in files (`organ::CELL_PARAMETERS`) and where they go in the solver's types.

use std::collections::BTreeMap;

use cardiotwin_models::calcium::Rice2008Parameters;
use cardiotwin_models::cell0d::{CalciumInput, CellParameters};

use crate::error::TaskError;

/// A cell's parameters by name: Land, passive and calcium, all at their defaults before anything is set.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCell {
    cell: CellParameters,
    rice: Rice2008Parameters,
}

impl NamedCell {
    /// Defaults (Tables A2 to A4) at a cycle length and initial stretch.
    #[must_use]
    pub fn new(cycle_length_ms: f64, lambda_0: f64) -> Self {
        let cell = CellParameters { cycle_length_ms, lambda0: lambda_0, ..CellParameters::default() };
        Self { cell, rice: Rice2008Parameters::default() }
    }

    /// Sets every parameter of a map.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn with(mut self, parameters: &BTreeMap<String, f64>) -> Result<Self, TaskError> {
        for (name, value) in parameters {
            *self.field(name)? = *value;
        }
        Ok(self)
    }

    /// The place of a parameter.
    ///
    /// # Errors
    /// [`TaskError::UnknownParameter`] for a name that the cell does not have.
    pub fn field(&mut self, name: &str) -> Result<&mut f64, TaskError> {
        let land = &mut self.cell.land;
        Ok(match name {
            "k_TRPN_per_ms" => &mut land.k_trpn_per_ms,
            "n_TRPN" => &mut land.n_trpn,
            "Ca50_ref_uM" => &mut land.ca50_ref_um,
            "k_U_per_ms" => &mut land.k_u_per_ms,
            "n_Tm" => &mut land.n_tm,
            "TRPN50" => &mut land.trpn50,
            "k_UW_per_ms" => &mut land.k_uw_per_ms,
            "k_WS_per_ms" => &mut land.k_ws_per_ms,
            "r_W" => &mut land.r_w,
            "r_S" => &mut land.r_s,
            "gamma_S_per_ms" => &mut land.gamma_s_per_ms,
            "gamma_W_per_ms" => &mut land.gamma_w_per_ms,
            "phi" => &mut land.phi,
            "A_eff" => &mut land.a_eff,
            "beta_0" => &mut land.beta0,
            "beta_1_uM" => &mut land.beta1_um,
            "Smax_ref_kPa" => &mut land.smax_ref_kpa,
            "Ca_res_uM" => &mut self.rice.ca_res_um,
            "Ca_max_uM" => &mut self.rice.ca_max_um,
            "tau_CR_ms" => &mut self.rice.tau_cr_ms,
            "tau_CD_ms" => &mut self.rice.tau_cd_ms,
            "a_p_kPa" => &mut self.cell.passive.a_p_kpa,
            _ => return Err(TaskError::UnknownParameter { name: name.to_owned() }),
        })
    }

    /// What the solver takes.
    #[must_use]
    pub fn parameters(&self) -> CellParameters {
        CellParameters { calcium: CalciumInput::Rice(self.rice), ..self.cell.clone() }
    }

    /// The calcium transient's part.
    #[must_use]
    pub fn rice(&self) -> Rice2008Parameters {
        self.rice
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::organ::CELL_PARAMETERS;

    #[test]
    fn every_name_has_a_place_of_its_own() {
        let values: BTreeMap<String, f64> =
            CELL_PARAMETERS.iter().enumerate().map(|(idx, name)| ((*name).to_owned(), 100.0 + idx as f64)).collect();
        let mut cell = NamedCell::new(800.0, 0.99).with(&values).unwrap();
        for (name, value) in &values {
            assert_eq!(*cell.field(name).unwrap(), *value, "{name}");
        }
        let parameters = cell.parameters();
        assert_eq!((parameters.cycle_length_ms, parameters.lambda0), (800.0, 0.99));
        let CalciumInput::Rice(rice) = parameters.calcium else { panic!("Rice's calcium is what was set") };
        assert_eq!(rice.ca_res_um, values["Ca_res_uM"]);
    }

    #[test]
    fn an_unknown_name_is_refused() {
        let unknown = BTreeMap::from([("Ca50".to_owned(), 0.8)]);
        let error = NamedCell::new(800.0, 1.0).with(&unknown).unwrap_err().to_string();
        assert!(error.contains("`Ca50`") && error.contains("Ca50_ref_uM"), "{error}");
    }
}

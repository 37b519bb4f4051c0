//! Angles of the fibres \[degrees\].
//!
//! α turns the fibre from the circumferential direction, counter-clockwise as seen from the base,
//! towards the base. β then turns the sheet around the fibre, starting from the transmural
//! direction.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Angles of the Laplace-Dirichlet fibre rule (Bayer et al. 2012).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FibreAngles {
    /// Fibre angle at the endocardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub alpha_endo_deg: f64,
    /// Fibre angle at the epicardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub alpha_epi_deg: f64,
    /// Sheet angle at the endocardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub beta_endo_deg: f64,
    /// Sheet angle at the epicardium.
    #[schemars(extend("minimum" = -90.0, "maximum" = 90.0))]
    pub beta_epi_deg: f64,
}

impl Default for FibreAngles {
    /// α from +60 to −60, β from −65 to +25 (β as in Bayer et al. 2012).
    fn default() -> Self {
        Self {
            alpha_endo_deg: 60.0,
            alpha_epi_deg: -60.0,
            beta_endo_deg: -65.0,
            beta_epi_deg: 25.0,
        }
    }
}

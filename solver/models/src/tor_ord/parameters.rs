//! What can differ between two cells: their place in the wall, factors of currents and fluxes, and the bath.

/// Place of a cell in the ventricle's wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellType {
    /// Below the inner surface.
    Endocardial,
    /// Below the outer surface.
    Epicardial,
    /// Between the two.
    MidMyocardial,
}

/// Declares [`Factors`] with its table.
macro_rules! factors {
    ($($field:ident: $key:literal, $meaning:literal;)*) => {
        /// Factors of maximum conductances, permeabilities and fluxes, dimensionless.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Factors {
            $(#[doc = concat!("Factor of the ", $meaning, ".")] pub $field: f64,)*
        }

        impl Factors {
            /// Key in files and meaning of each factor, in the order of [`Self::from_values`].
            pub const TABLE: [(&'static str, &'static str); [$($key),*].len()] = [$(($key, concat!("factor of the ", $meaning))),*];

            /// From numbers in the order of [`Self::TABLE`].
            #[must_use]
            pub fn from_values(values: [f64; Self::TABLE.len()]) -> Self {
                let [$($field),*] = values;
                Self { $($field),* }
            }
        }
    };
}

factors! {
    i_cal: "ICaL_factor", "L-type calcium current";
    i_na: "INa_factor", "fast sodium current";
    i_to: "Ito_factor", "transient outward current";
    i_nal: "INaL_factor", "late sodium current";
    i_kr: "IKr_factor", "rapid delayed rectifier";
    i_ks: "IKs_factor", "slow delayed rectifier";
    i_k1: "IK1_factor", "inward rectifier";
    i_kb: "IKb_factor", "background potassium current";
    i_naca: "INaCa_factor", "sodium-calcium exchanger";
    i_nak: "INaK_factor", "sodium-potassium pump";
    i_nab: "INab_factor", "background sodium current";
    i_cab: "ICab_factor", "background calcium current";
    i_pca: "IpCa_factor", "calcium pump of the membrane";
    i_clca: "IClCa_factor", "calcium-activated chloride current";
    i_clb: "IClb_factor", "background chloride current";
    j_rel: "Jrel_factor", "release by ryanodine receptors";
    j_up: "Jup_factor", "uptake by SERCA, with the leak";
}

/// Concentrations in the bath.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outside {
    /// Sodium \[mM\].
    pub na_mm: f64,
    /// Calcium \[mM\].
    pub ca_mm: f64,
    /// Potassium \[mM\].
    pub k_mm: f64,
}

impl Outside {
    /// The paper's bath.
    pub const PAPER: Self = Self {
        na_mm: 140.0,
        ca_mm: 1.8,
        k_mm: 5.0,
    };
}

/// How troponin C buffers calcium in the cytosol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Troponin {
    /// At once, as in the cell without contraction (Tomek 2019); Land's states only follow.
    Instantaneous,
    /// As bound by Land's CaTRPN, so that contraction acts on calcium (Margara 2021).
    Land,
}

//! Printed forms of the quantities that files name by keys: symbol, unit and meaning.

/// Symbol, unit and meaning of a parameter or biomarker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label {
    /// Key in files, for example `tau_SR_ref_ms`.
    pub key: &'static str,
    /// Symbol, for example `τ`.
    pub symbol: &'static str,
    /// Subscript of the symbol, for example `SR,ref`; may be empty.
    pub subscript: &'static str,
    /// Unit, for example `ms`; empty for a dimensionless quantity.
    pub unit: &'static str,
    /// Meaning in a few words, in lower case, for tables and messages.
    pub meaning: &'static str,
}

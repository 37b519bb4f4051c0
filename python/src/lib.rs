//! `cardiotwin._native`: the 0D cell and the one-fibre ventricle in the process of Python, without
//! a coordinator. Inputs are names with units and NumPy arrays; the conversions, defaults and
//! readings are those of the worker.

mod cell;
mod error;
mod labels;
mod threads;
mod ventricle;

use pyo3::prelude::*;

/// Functions behind `cardiotwin.cells` and `cardiotwin.ventricles`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::cell::{cell_batch, cell_beat};
    #[pymodule_export]
    use super::error::{Error, ModelError};
    #[pymodule_export]
    use super::labels::{cell_biomarkers, cell_parameters, organ_biomarkers};
    #[pymodule_export]
    use super::ventricle::Ventricle;
}

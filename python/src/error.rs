//! Exceptions.

use std::error::Error as StdError;

use cardiotwin_worker::error::chain;
use pyo3::exceptions::PyException;
use pyo3::{PyErr, create_exception};

create_exception!(
    cardiotwin._native,
    Error,
    PyException,
    "An error of cardiotwin, in the words of the programs."
);
create_exception!(
    cardiotwin._native,
    ModelError,
    Error,
    "A model rejects its parameters, or has no solution with them."
);

/// The exception of an error of the solvers, with its causes in one line.
pub fn model(error: &dyn StdError) -> PyErr {
    ModelError::new_err(chain(error))
}

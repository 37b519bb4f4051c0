//! Figure and page of a sensitivity analysis, made from its record.

mod figure;
mod page;

pub use figure::figure;
pub use page::page;

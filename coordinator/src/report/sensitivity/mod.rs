//! A sensitivity analysis as figure and page. Record in, text out.

mod figure;
mod page;

pub use figure::figure;
pub use page::page;

//! The dashboard's web server: one page, its access by a token, and updates as they come.
//!
//! The server knows nothing of databases or files: a [`Source`] answers its questions. It only
//! reads, and it listens on the loopback address alone. The JSON between server and page is private
//! to both and changes with them; programs read `cardiotwin status --json` instead.

mod access;
mod assets;
mod connection;
mod live;
mod routes;
mod server;
mod source;

pub use access::Token;
pub use server::{Server, ServerError};
pub use source::{
    AttemptRow, CohortState, Drawing, Estimate, LogText, PatientPage, PatientRow, Source,
    SourceError,
};

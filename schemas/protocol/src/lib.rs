//! Protocol between coordinator and worker: one directory per attempt with files that are written
//! once.
//!
//! ```text
//! spec.json ──► started.json (exclusive) ──► work ──► artefacts, synced ──► outcome.json (exclusive)
//!                                                                              ▲
//!                       coordinator revokes the attempt ───────────────────────┘
//! ```
//! The worker's outcome and the coordinator's revocation contend for the name `outcome.json`, which
//! only one of them can create. A revoked attempt therefore has no outcome, and an attempt with an
//! outcome can no longer be revoked.
//!
//! | module | subject |
//! |---|---|
//! | [`names`] | names of the files |
//! | [`claim`] | who works on an attempt |
//! | [`closing`] | how an attempt is closed: published or revoked |
//! | [`exit_code`] | exit codes of a worker that published nothing |
//! | [`files`] | files that appear whole or not at all |
//! | [`process`] | identity of processes |

pub mod claim;
pub mod closing;
pub mod exit_code;
pub mod files;
pub mod names;
pub mod process;
pub mod seal;

//! The dashboard of the built program: who may look, and a run that is followed to its end in
//! headless Chromium.

#[path = "../built.rs"]
mod built;
#[path = "../e2e/support.rs"]
#[allow(
    dead_code,
    reason = "the cohorts are those of the end-to-end tests, which call them in more ways"
)]
mod support;

mod access;
mod pages;
mod server;

//! The real binaries on a cohort of two patients: whole runs, changes, requests, stops, damage.
//! Each test takes seconds and nothing is mocked. `make test` builds the binaries first; by hand:
//! `cargo build --release --workspace --bins`.

mod access;
mod afterload;
#[path = "../built.rs"]
mod built;
mod damage;
mod discover;
mod early_end;
mod export;
mod external;
mod finite_element;
mod fits;
mod housekeeping;
mod kept;
mod launcher;
mod laws;
mod mesh;
mod notices;
mod old_run;
mod output;
mod own_traces;
#[path = "../pictures.rs"]
mod pictures;
mod pilots;
mod prepare;
mod prepare_formats;
mod printed;
mod refused;
mod requests;
mod robustness;
mod runs;
mod schema;
mod sites;
mod slurm_answers;
mod slurm_environment;
mod status_page;
mod stops;
mod support;
mod sweeps;

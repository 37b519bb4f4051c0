//! Provenance of a patient's numbers.

use std::collections::BTreeMap;

use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::Update;
use maud::{Markup, html};

use super::format::{duration, moment, significant};
use super::tables::scrolling;
use crate::results::PatientView;

/// First digits of a hash; all of them on hover.
fn hash(text: &str) -> Markup {
    let short: String = text.chars().take(12).collect();
    html! { code title=(text) { (short) } }
}

/// Table of the finished tasks with key, times and seed; hashes of the inputs; settings that
/// determine the result.
#[must_use]
pub fn details(patient: &PatientRecord) -> Markup {
    let tasks = PatientView(patient).tasks();
    let mut inputs: BTreeMap<&str, &str> = BTreeMap::new();
    for input in [&patient.plan.step0.pressure, &patient.plan.step0.volume]
        .into_iter()
        .flatten()
    {
        inputs.insert(&input.name, &input.sha256);
    }
    for (_, _, _, provenance) in &tasks {
        inputs.extend(
            provenance
                .inputs
                .iter()
                .map(|(name, sha256)| (name.as_str(), sha256.as_str())),
        );
    }
    let settings = &patient.plan.settings;
    html! {
        details.provenance {
            summary { "Provenance" }
            @if tasks.is_empty() { p.absent { "No task of this patient has finished." } }
            @else {
                (scrolling(&html! {
                    table {
                        thead { tr {
                            @for head in ["task", "key", "try", "started", "wall time", "processor time", "memory", "seed", "threads", "ranks", "version", "commit", "arithmetic", "host"] {
                                th scope="col" { (head) }
                            }
                        } }
                        tbody {
                            @for (name, key, generation, p) in &tasks {
                                tr {
                                    th scope="row" { (name) } td { (hash(key)) } td.num { (generation) } td { (moment(&p.started)) }
                                    td.num data-value=(p.wall_s) { (duration(p.wall_s)) } td.num data-value=(p.cpu_s) { (duration(p.cpu_s)) }
                                    td.num { (significant(p.peak_memory_mb, 3)) " MB" }
                                    td.num { @if let Some(seed) = p.seed { (seed) } }
                                    td.num { (p.threads) } td.num { (p.ranks) } td { (p.version) }
                                    td { @if let Some(commit) = &p.commit { (hash(commit)) } }
                                    td { (p.arithmetic) } td { (p.host) }
                                }
                            }
                        }
                    }
                }))
            }
            @if !inputs.is_empty() {
                p { "Inputs, SHA-256:" @for (name, sha256) in &inputs { " " (name) " " (hash(sha256)) } }
            }
            p {
                "Settings: step 1 tolerance " (significant(settings.step1.tolerance, 2)) ", damping " (significant(settings.step1.damping, 2))
                @if settings.step1_update() == Update::SpaceMapping { ", space mapping" }
                ", at most " (settings.step1.max_iterations) " iterations; step 2 seed " (settings.step2.seed)
                ", population " (settings.step2.popsize as usize * settings.step2.parameters.len())
                ", tolerance " (significant(settings.step2.tol, 2)) "; time step " (significant(settings.solver.time_step_ms, 2))
                " ms, " (settings.solver.beats) (if settings.solver.beats == 1 { " beat" } else { " beats" }) "."
            }
        }
    }
}

//! Tables of the mesh's figures and of the cost of each simulation.

use std::collections::BTreeMap;

use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::record::{PatientRecord, TaskRecord};
use maud::{Markup, html};

use crate::html::format::{duration, fixed, raw, significant};
use crate::html::tables::scrolling;

type Counters = BTreeMap<String, f64>;

/// Table of mesh and step 0; `None` before step 0 is done, or if the organ is not a finite-element
/// ventricle.
pub fn mesh(patient: &PatientRecord) -> Option<Markup> {
    let step0 = patient.step0.as_ref()?;
    let OrganSpec::FiniteElement(organ) = &step0.result.organ else {
        return None;
    };
    let (figures, counters) = (&organ.figures, &step0.result.counters);
    let of = |name: &str| counters.get(name).copied();
    let three = |values: [Option<f64>; 3], decimals| values.map(|v| fixed(v, decimals)).join(" / ");
    let edges = [
        of("mesh_edge_shortest_mm"),
        Some(figures.mean_edge_mm),
        of("mesh_edge_longest_mm"),
    ];
    let rows = [
        ("nodes", figures.nodes.to_string(), ""),
        ("tetrahedra", figures.elements.to_string(), ""),
        (
            "degrees of freedom",
            figures.degrees_of_freedom.to_string(),
            "",
        ),
        ("edge: shortest / mean / longest", three(edges, 2), "mm"),
        (
            "mean ratio (1: regular): smallest",
            fixed(of("mesh_mean_ratio_least"), 2),
            "",
        ),
        ("mean ratio: mean", fixed(of("mesh_mean_ratio_mean"), 2), ""),
        (
            "largest angle between faces",
            fixed(of("mesh_dihedral_largest_deg"), 0),
            "°",
        ),
    ];
    let phases = [
        ("mesh", "seconds_mesh"),
        ("fibres", "seconds_fibres"),
        ("activation", "seconds_activation"),
        ("unloading and stiffness", "seconds_unloading"),
    ];
    Some(scrolling(&html! {
        table {
            caption { "Mesh and step 0" }
            tbody {
                @for (name, value, unit) in rows {
                    tr { th scope="row" { (name) } td.num { (value) } td.unit { (unit) } }
                }
                @for (name, key) in phases {
                    @if let Some(seconds) = of(key) { tr { th scope="row" { "time: " (name) } td.num { (duration(seconds)) } td {} } }
                }
                @if let (Some(n), Some(passes)) = (of("newton_iterations"), of("unloading_passes")) {
                    tr { th scope="row" { "Newton iterations, passes of step 0" } td.num { (n) ", " (passes) } td {} }
                }
            }
        }
    }))
}

/// Table with a row for each simulation; `None` without any.
pub fn simulations(patient: &PatientRecord) -> Option<Markup> {
    fn row<T>(
        name: String,
        record: &TaskRecord<T>,
        counters: impl Fn(&T) -> &Counters,
    ) -> (String, &Counters, f64) {
        (name, counters(&record.result), record.provenance.wall_s)
    }
    let beats = patient
        .iterations
        .iter()
        .filter_map(|i| Some((format!("step 1, iteration {}", i.number), i.run.as_ref()?)));
    let beats = beats.chain(
        patient
            .verification
            .as_ref()
            .map(|run| ("verification".to_owned(), run)),
    );
    let rows: Vec<_> = beats
        .map(|(name, run)| row(name, run, |beat| &beat.counters))
        .collect();
    if rows.is_empty() {
        return None;
    }
    let ratio = |counters: &Counters, of: &str, by: &str| {
        Some(counters.get(of)? / counters.get(by).filter(|n| **n > 0.0)?)
    };
    let seconds = |counters: &Counters, name: &str| {
        counters
            .get(name)
            .map_or_else(|| "\u{2013}".to_owned(), |s| duration(*s))
    };
    Some(scrolling(&html! {
        table {
            caption { "Simulations" }
            thead.long { tr {
                @for head in ["simulation", "time steps", "cut steps", "Newton iterations a step", "Krylov iterations a Newton iteration", "set-up", "beat", "wall time"] { th scope="col" { (head) } }
            } }
            tbody {
                @for (name, counters, wall_s) in &rows {
                    tr {
                        th scope="row" { (name) }
                        td.num { (fixed(counters.get("time_steps").copied(), 0)) }
                        td.num { (fixed(counters.get("cut_steps").copied(), 0)) }
                        td.num { (fixed(ratio(counters, "newton_iterations", "time_steps"), 2)) }
                        td.num { (ratio(counters, "krylov_iterations", "newton_iterations_tried").map_or_else(|| "\u{2013}".to_owned(), |r| significant(r, 3))) }
                        td.num data-value=(raw(counters.get("seconds_setup").copied())) { (seconds(counters, "seconds_setup")) }
                        td.num data-value=(raw(counters.get("seconds_beat").copied())) { (seconds(counters, "seconds_beat")) }
                        td.num data-value=(wall_s) { (duration(*wall_s)) }
                    }
                }
            }
        }
    }))
}

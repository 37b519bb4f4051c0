//! Announcement of the size of a VTU series before it is written.

use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::Fidelity;

use super::talk::count;

/// Bytes per node in a compressed frame. Measured: 66 on 500 nodes, 72 on 2,000.
const BYTES_PER_NODE: f64 = 70.0;

/// Description of the series and its size; `None` if no series is written.
#[must_use]
pub fn announcement(plan: &ResolvedPatient, every_ms: f64) -> Option<String> {
    let solver = &plan.settings.solver;
    if every_ms <= 0.0 {
        return None;
    }
    if solver.fidelity != Fidelity::FiniteElement {
        return Some(
            "no VTU series: it needs the finite-element ventricle (--fidelity finite-element)"
                .to_owned(),
        );
    }
    let every_ms = every_ms.max(solver.time_step_ms);
    let frames = (plan.step0.cycle_length_ms / every_ms + 1e-6).floor() + 1.0;
    let nodes = solver.finite_element.mesh_nodes;
    let megabytes = 1e-6 * frames * f64::from(nodes) * BYTES_PER_NODE;
    let size = if megabytes < 1000.0 {
        format!("{megabytes:.0} MB")
    } else {
        format!("{:.1} GB", megabytes / 1000.0)
    };
    let frames = count(frames as usize, "frame");
    Some(format!(
        "VTU series: {frames} of about {nodes} nodes, about {size} per simulation; open \
         vtu/beat.pvd in ParaView"
    ))
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::plan::Workflow;

    use super::*;

    #[test]
    fn the_size_is_told_and_a_reduced_ventricle_is_told_apart() {
        let mut plan = ResolvedPatient::without_data("P1".into(), Workflow::Personalise);
        plan.settings.solver.fidelity = Fidelity::Reduced;
        assert_eq!(announcement(&plan, 0.0), None);
        assert!(announcement(&plan, 10.0).unwrap().contains("no VTU series"));
        plan.settings.solver.fidelity = Fidelity::FiniteElement;
        plan.settings.solver.finite_element.mesh_nodes = 64_000;
        let said = announcement(&plan, 10.0).unwrap();
        assert!(
            said.contains("101 frames of about 64000 nodes") && said.contains("MB"),
            "{said}"
        );
        // A series cannot be finer than the time step.
        assert!(announcement(&plan, 0.1).unwrap().contains("1001 frames"));
    }
}

//! Simulations in 3D on sites that give whole nodes: several nodes in one job, each of them filled.

use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::Fidelity;
use cardiotwin_slurm_model::Settings;

use super::lab::Lab;
use crate::tests::personalised;

/// Patients in 3D. Their chains in sequence on one node exceed its walltime.
fn in_3d(n: usize) -> Vec<ResolvedPatient> {
    let patient = |i: usize| {
        let mut patient = personalised(&format!("P{i}"), 8.0 + i as f64);
        patient.settings.solver.fidelity = Fidelity::FiniteElement;
        patient
    };
    (1..=n).map(patient).collect()
}

fn demand(lab: &Lab) -> Vec<String> {
    let folders = std::fs::read_dir(lab.run_dir().join("slurm"))
        .unwrap()
        .flatten();
    let scripts =
        folders.map(|folder| std::fs::read_to_string(folder.path().join("job.sh")).unwrap());
    let line = |script: String| {
        script
            .lines()
            .find_map(|line| line.strip_prefix("#SBATCH --nodes=").map(str::to_owned))
    };
    scripts.filter_map(line).collect()
}

/// Nodes of four cores, one core per patient: five patients take two nodes, not five.
#[tokio::test]
async fn a_node_is_filled_before_another_is_taken() {
    let mut lab = Lab::new(in_3d(5), Settings::default()).with_whole_nodes();
    lab.settings.simulation_s = 60.0;
    lab.tick().await;
    assert_eq!(demand(&lab), ["2"]);
    assert_eq!(lab.finish().await.done, 5);
    lab.assert_published_once().await;
    let (claimed, ended) = lab.attempts();
    assert_eq!(claimed, ended, "nothing was begun twice");
    assert_eq!(
        lab.slurm.model.lock().unwrap().runs().len(),
        1,
        "one job of several nodes, one wait in the queue"
    );
}

/// A job loses one of its nodes: the patients that the driver there had not finished continue in
/// another job.
#[tokio::test]
async fn a_bundle_that_loses_a_node_is_continued() {
    let mut lab = Lab::new(in_3d(9), Settings::default()).with_whole_nodes();
    lab.settings.simulation_s = 60.0;
    lab.tick().await;
    assert_eq!(demand(&lab), ["3"]);
    lab.pass(5);
    // The driver of each node dies at its fourth simulation, after claiming it.
    lab.drive(|| Some((3, true))).await;
    lab.slurm.model.lock().unwrap().lose_node(2);
    assert_eq!(lab.finish().await.done, 9);
    lab.assert_published_once().await;
    assert!(lab.slurm.model.lock().unwrap().runs().len() > 1);
}

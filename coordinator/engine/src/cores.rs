//! Number of threads of a task, and number of tasks that run side by side.

use cardiotwin_schemas::finite_element::{ElementKind, FiniteElementSettings};
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings, Fidelity, SolverSettings};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_slurm::plan::ranks_for;

use super::books::TaskEntry;
use super::mesh_size;

/// Number of nodes of a mesh from which step 0 and a beat in 3D are shared among all cores. On
/// smaller meshes threads wait for each other more than they save, and other patients make better
/// use of the cores.
const LARGE_MESH_NODES: u64 = 8000;

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// Number of workers at once: as set, or one per core.
#[must_use]
pub fn workers(settings: &ExecutorSettings) -> usize {
    match settings.workers {
        0 => cores() / settings.threads.max(1) as usize,
        n => n as usize,
    }
    .max(1)
}

/// Nodes of a mesh per thread of a beat in a job. With fewer, threads wait for each other.
const NODES_PER_THREAD: u32 = 4000;

/// Nodes of a cluster on which a simulation may run.
#[derive(Debug, Clone, Copy)]
pub struct ClusterNodes {
    /// Threads or MPI ranks that a node takes.
    pub cores: u32,
    /// Largest number of nodes of a simulation on MPI ranks.
    pub most: u32,
}

/// Number of threads or MPI ranks of a patient's workers in a job: as set, or as many as a beat on
/// a mesh of `mesh_nodes` nodes can use.
#[must_use]
pub fn threads_in_job(
    settings: &ExecutorSettings,
    solver: &SolverSettings,
    mesh_nodes: u32,
    nodes: ClusterNodes,
) -> u32 {
    let is_large =
        solver.fidelity == Fidelity::FiniteElement && u64::from(mesh_nodes) >= LARGE_MESH_NODES;
    let is_shared = is_large && solver.finite_element.linear_solver.is_parallel();
    match settings.threads {
        0 if is_shared && settings.launcher.is_empty() => {
            (mesh_nodes / NODES_PER_THREAD).clamp(1, nodes.cores.max(1))
        }
        0 if is_shared => dividing(
            solver.finite_element.subdomains,
            ranks_for(mesh_nodes, nodes.cores, nodes.most),
        ),
        0 => 1,
        n => n,
    }
}

/// The largest number of ranks, `most` at most, that shares so many parts of a mesh equally; `most` itself for no parts.
fn dividing(parts: u32, most: u32) -> u32 {
    if parts == 0 {
        return most;
    }
    (1..=most.min(parts))
        .rev()
        .find(|ranks| parts.is_multiple_of(*ranks))
        .unwrap_or(1)
}

/// Number of threads of a task: as set, or all cores for step 0 and a beat on a large mesh, and one
/// for any other task.
#[must_use]
pub fn threads(settings: &ExecutorSettings, task: &TaskSpec) -> u32 {
    match settings.threads {
        // In a job, [`threads_in_job`] decides.
        0 if settings.kind == ExecutorKind::Local && is_large(task) => {
            if settings.launcher.is_empty() {
                cores() as u32
            } else {
                dividing(task.subdomains(), cores() as u32)
            }
        }
        0 => 1,
        n => n,
    }
}

/// Whether a task takes all cores, so that nothing runs next to it.
pub(super) fn takes_all(settings: &ExecutorSettings, task: &TaskEntry) -> bool {
    settings.threads == 0
        && settings.kind == ExecutorKind::Local
        && cores() > 1
        && ["organ-beat", "passive-state"].contains(&&*task.kind)
        // A specification that cannot be read fails when its attempt begins, with its own message.
        && serde_json::from_str(&task.spec).is_ok_and(|spec| is_large(&spec))
}

/// Whether the task is step 0 or a beat on a large mesh, with elements and a solver that several
/// threads can share.
fn is_large(task: &TaskSpec) -> bool {
    let beat = match task {
        TaskSpec::OrganBeat(beat) => beat,
        TaskSpec::PassiveState(spec) => {
            return spec.finite_element.as_ref().is_some_and(|anatomy| {
                let requested = anatomy.mesh_nodes;
                anatomy.element == ElementKind::LinearNodal
                    && u64::from(mesh_size::of_step0(spec).unwrap_or(requested)) >= LARGE_MESH_NODES
            });
        }
        _ => return false,
    };
    let OrganSpec::FiniteElement(organ) = &beat.organ else {
        return false;
    };
    let equations = beat
        .finite_element
        .unwrap_or_else(|| FiniteElementSettings::default().equations());
    let figures = &organ.figures;
    figures.nodes >= LARGE_MESH_NODES
        && figures.degrees_of_freedom == 3 * figures.nodes
        && equations.linear_solver.is_parallel()
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::finite_element::{MeshFibres, OwnMesh};
    use cardiotwin_schemas::plan::ResolvedPatient;
    use cardiotwin_schemas::task::InputFile;

    use super::*;

    /// Step 0 on the patient's own mesh, whose file states `nodes` nodes; 1000 are requested.
    fn step0_on_own_mesh(folder: &std::path::Path, nodes: u64, element: ElementKind) -> TaskSpec {
        let path = folder.join("heart.pts");
        std::fs::write(&path, format!("{nodes}\n0 0 0\n")).unwrap();
        let settings = FiniteElementSettings {
            element,
            ..FiniteElementSettings::default()
        };
        let mut spec = ResolvedPatient::noop("P1", 0).step0;
        spec.finite_element = Some(settings.anatomy(&[]));
        spec.own_mesh = Some(OwnMesh {
            files: vec![InputFile {
                name: "mesh".to_owned(),
                path,
                sha256: String::new(),
            }],
            unit: "um".to_owned(),
            left_ventricle: vec![1],
            fibres: MeshFibres::Auto,
            activation_times: None,
            activation_sites_mm: vec![],
            right_ventricle: None,
        });
        TaskSpec::PassiveState(Box::new(spec))
    }

    #[test]
    fn step_0_of_a_large_mesh_of_ones_own_takes_all_cores() {
        let folder = tempfile::tempdir().unwrap();
        let of = |nodes, element| {
            let task = step0_on_own_mesh(folder.path(), nodes, element);
            threads(&ExecutorSettings::default(), &task) as usize
        };
        assert_eq!(of(12_831, ElementKind::LinearNodal), cores());
        assert_eq!(of(7_999, ElementKind::LinearNodal), 1);
        assert_eq!(of(12_831, ElementKind::LinearPointwise), 1);
    }

    #[test]
    fn ranks_share_the_parts_of_a_mesh_equally() {
        assert_eq!([dividing(0, 6), dividing(8, 6), dividing(8, 8)], [6, 4, 8]);
        assert_eq!(
            [dividing(7, 6), dividing(8, 100), dividing(63, 10)],
            [1, 8, 9]
        );
    }
}

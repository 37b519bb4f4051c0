//! Fibres and activation times on several ranks are those on one.

use cardiotwin_linalg::parallel::{Communicator as _, ThreadSettings, on_threads};
use cardiotwin_mechanics::tissue::{FEWEST_NODES, Tissue, TissueError, TissueJob, serve};
use cardiotwin_mesh::eikonal::{Conduction, EikonalError, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, Longitudinal, fields, frames_at_centroids, rule};
use cardiotwin_mesh::{TetMesh, tags};
use cardiotwin_units::Ml;

const MUSCLE: [i32; 1] = [tags::LEFT_VENTRICLE];

fn ventricle() -> (TetMesh, TissueJob) {
    let made = generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), 4000)).expect("a mesh");
    assert!(made.mesh.n_nodes() >= FEWEST_NODES);
    let conduction = Conduction::of_left_ventricle(&made.shape.fascicles());
    (
        made.mesh,
        TissueJob {
            muscle: MUSCLE.to_vec(),
            fibres: Some(FibreAngles::default()),
            conduction: Some(conduction),
        },
    )
}

/// By ranks of which only the first has the mesh.
fn on_ranks(mesh: &TetMesh, job: &TissueJob, n_ranks: usize) -> Result<Tissue, TissueError> {
    let found = on_threads(n_ranks, ThreadSettings::default(), |comm| {
        if comm.rank() == 0 {
            return Some(job.lead(mesh, &comm, || {}, &|| {}));
        }
        serve(&comm);
        None
    });
    found
        .expect("no rank fails")
        .into_iter()
        .flatten()
        .next()
        .expect("rank 0")
}

#[test]
fn fibres_are_the_same_to_the_bit_and_times_to_round_off_on_any_number_of_ranks() {
    let (mut mesh, job) = ventricle();
    // The code for a whole mesh.
    let found = fields(&mesh, &MUSCLE, Longitudinal::FromBase).expect("fields");
    let want = rule(&mesh, &MUSCLE, &found, &FibreAngles::default());
    let bare = mesh.clone();
    mesh.fibres.clone_from(&want);
    mesh.frames = frames_at_centroids(&mesh, &MUSCLE);
    let times = activation_ms(&mesh, job.conduction.as_ref().expect("conduction")).expect("times");
    for n_ranks in [1, 2, 3, 4, 7] {
        let threads = job
            .on_threads(&bare, n_ranks, ThreadSettings::default(), &|| {})
            .expect("tissue");
        assert!(threads.fibres == want, "{n_ranks} ranks have other fibres");
        let apart = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() };
        let most = threads
            .activation_ms
            .iter()
            .zip(&times)
            .map(apart)
            .fold(0.0, f64::max);
        println!("{n_ranks} ranks: times differ by {most:.1e} ms");
        assert!(
            threads.activation_ms.len() == times.len() && most < 1e-10,
            "{n_ranks} ranks: {most} ms"
        );
        if n_ranks > 1 {
            assert!(
                on_ranks(&bare, &job, n_ranks).expect("tissue") == threads,
                "{n_ranks} ranks that are sent their parts"
            );
        }
    }
}

#[test]
fn what_the_mesh_brings_is_kept_and_what_is_not_wanted_is_not_made() {
    let (mut mesh, job) = ventricle();
    let both = job
        .on_threads(&mesh, 1, ThreadSettings::default(), &|| {})
        .expect("tissue");
    mesh.fibres.clone_from(&both.fibres);
    mesh.frames = frames_at_centroids(&mesh, &MUSCLE);
    let times = on_ranks(
        &mesh,
        &TissueJob {
            fibres: None,
            ..job.clone()
        },
        3,
    )
    .expect("times");
    assert!(!times.fibres.at_nodes() && times.activation_ms.len() == mesh.n_nodes());
    let fibres = on_ranks(
        &mesh,
        &TissueJob {
            conduction: None,
            ..job
        },
        3,
    )
    .expect("fibres");
    assert!(fibres.fibres == both.fibres && fibres.activation_ms.is_empty());
}

#[test]
fn errors_are_those_of_one_rank_and_end_all() {
    let (mesh, job) = ventricle();
    let refused = |mesh: &TetMesh, change: &dyn Fn(&mut TissueJob)| {
        let mut job = job.clone();
        change(&mut job);
        let [alone, several] =
            [1, 4].map(|n| job.on_threads(mesh, n, ThreadSettings::default(), &|| {}));
        assert_eq!(alone, several);
        assert_eq!(alone, on_ranks(mesh, &job, 3));
        alone.expect_err("an error")
    };
    let conduction = |job: &mut TissueJob, change: &dyn Fn(&mut Conduction)| {
        change(job.conduction.as_mut().expect("conduction"));
    };
    let bare = refused(&mesh, &|job| job.fibres = None);
    assert!(
        matches!(bare, TissueError::Activation(EikonalError::NoFibre { .. })),
        "{bare}"
    );
    let nothing = refused(&mesh, &|job| conduction(job, &|c| c.tags = vec![9]));
    assert!(
        matches!(
            nothing,
            TissueError::Activation(EikonalError::NoTissue { .. })
        ),
        "{nothing}"
    );
    let held_by_nothing = TetMesh {
        surfaces: vec![],
        ..mesh.clone()
    };
    assert!(matches!(
        refused(&held_by_nothing, &|_| {}),
        TissueError::Fibres(_)
    ));
    // A piece of muscle that nothing joins to the rest.
    let mut island = mesh.clone();
    let away = island.nodes_mm.len() as u32;
    let lone: Vec<_> = island
        .corners(0)
        .iter()
        .map(|x| x.map(|c| c + 200.0))
        .collect();
    island.nodes_mm.extend(lone);
    island.tets.push([away, away + 1, away + 2, away + 3]);
    island.tags.push(tags::LEFT_VENTRICLE);
    let fibres = job
        .on_threads(&mesh, 1, ThreadSettings::default(), &|| {})
        .expect("tissue")
        .fibres;
    island.frames = frames_at_centroids(
        &TetMesh {
            fibres,
            ..mesh.clone()
        },
        &MUSCLE,
    );
    island.frames.push(island.frames[0]);
    let unreached = refused(&island, &|job| job.fibres = None);
    let expected = EikonalError::Unreached {
        n: 4,
        node: away as usize,
    };
    assert_eq!(unreached, TissueError::Activation(expected));
}

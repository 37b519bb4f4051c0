//! Cuts of a ventricle's mesh, its parts, and multigrid on them.

use std::sync::Arc;

use cardiotwin_linalg::parallel::{
    Communicator as _, MessageReader, MessageWriter, Part, ThreadSettings, VectorLayout,
    cut_figures, on_threads, owners,
};
use cardiotwin_linalg::{
    BlockCsr, CondensedMatrix, KrylovEnding, KrylovSettings, Multigrid, NO_SLOT, Pattern,
    Preconditioner as _, conjugate_gradients,
};
use cardiotwin_mesh::TetMesh;
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::partition::{CoordinateBisection, Partitioner as _, node_owners};
use cardiotwin_units::Ml;

fn ventricle(n_nodes: usize) -> TetMesh {
    generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), n_nodes))
        .expect("a mesh")
        .mesh
}

#[test]
fn parts_are_balanced_and_cut_few_edges() {
    for (size, most_cut) in [
        (2000, [0.06, 0.08, 0.11, 0.16]),
        (8000, [0.03, 0.05, 0.06, 0.09]),
    ] {
        let mesh = ventricle(size);
        let n = mesh.n_nodes();
        for (n_ranks, most_cut) in [2, 3, 4, 8].into_iter().zip(most_cut) {
            let found = owners(n, &mesh.tets, n_ranks).expect("a cut");
            let cut = cut_figures(n, &mesh.tets, &found, n_ranks);
            // What is computed twice at the cut is about two elements for each edge that is cut.
            assert!(
                cut.elements < 1.02 + 2.2 * cut.cut_edges,
                "{size} nodes, {n_ranks} ranks: {cut:?}"
            );
            assert!(
                cut.nodes < 1.08 && cut.cut_edges < most_cut,
                "{size} nodes, {n_ranks} ranks: {cut:?}"
            );
            let parts = CoordinateBisection.parts(&mesh, &vec![1.0; mesh.n_tets()], n_ranks);
            let simple = cut_figures(n, &mesh.tets, &node_owners(&mesh, &parts), n_ranks);
            assert!(
                cut.elements < simple.elements,
                "{size} nodes, {n_ranks} ranks: {cut:?} {simple:?}"
            );
        }
    }
}

#[test]
fn the_same_mesh_gives_the_same_cut_whoever_else_cuts() {
    let mesh = ventricle(500);
    let cut = || owners(mesh.n_nodes(), &mesh.tets, 4).expect("a cut");
    let want = cut();
    std::thread::scope(|scope| {
        let others: Vec<_> = (0..4)
            .map(|_| scope.spawn(|| (0..5).map(|_| cut()).collect::<Vec<_>>()))
            .collect();
        for other in others {
            assert!(
                other
                    .join()
                    .expect("no panic")
                    .iter()
                    .all(|got| *got == want)
            );
        }
    });
}

#[test]
fn parts_make_up_the_mesh_and_know_each_other() {
    let mesh = ventricle(700);
    let n = mesh.n_nodes();
    for n_ranks in [1, 2, 5] {
        let owners = owners(n, &mesh.tets, n_ranks).expect("a cut");
        let parts: Vec<Part> = (0..n_ranks)
            .map(|rank| Part::of(rank, &owners, &mesh.tets))
            .collect();
        let mut seen = vec![0; n];
        parts
            .iter()
            .flat_map(Part::owned_nodes)
            .for_each(|node| seen[*node as usize] += 1);
        assert_eq!(seen, vec![1; n]);
        let mut spoken = vec![0; mesh.n_tets()];
        for part in &parts {
            let own = part
                .elements
                .iter()
                .zip(&part.speaks_for)
                .filter(|(_, speaks)| **speaks);
            own.for_each(|(e, _)| spoken[*e as usize] += 1);
            assert!(part.elements.is_sorted() && part.owned_nodes().is_sorted());
            let mut message = MessageWriter::default();
            part.pack(&mut message);
            assert_eq!(
                &Part::unpack(&mut MessageReader::new(&message.numbers)),
                part
            );
            let held = |node: u32| {
                part.nodes
                    .iter()
                    .position(|own| *own == node)
                    .map(|at| at as u32)
            };
            assert!(
                (0..n as u32)
                    .step_by(7)
                    .all(|node| part.local(node) == held(node))
            );
            // Every row of an owned node is complete.
            for (e, tet) in mesh.tets.iter().enumerate() {
                let touches = tet.iter().any(|node| part.owned(*node).is_some());
                assert_eq!(touches, part.elements.binary_search(&(e as u32)).is_ok());
                assert!(!touches || tet.iter().all(|node| part.local(*node).is_some()));
            }
        }
        assert_eq!(spoken, vec![1; mesh.n_tets()]);
        // Every ghost becomes what its owner has.
        let arrived = on_threads(n_ranks, ThreadSettings::default(), |comm| {
            let part = &parts[comm.rank()];
            let mut values = part.take(1, &(0..n).map(|k| k as f64).collect::<Vec<_>>());
            values[part.layout.n_owned..].fill(-1.0);
            comm.update_ghosts(&part.layout, 1, &mut values);
            values
                .iter()
                .zip(&part.nodes)
                .all(|(value, node)| *value == f64::from(*node))
        });
        assert_eq!(arrived, Ok(vec![true; n_ranks]));
    }
    let owners = vec![0; n];
    assert_eq!(
        Part::of(0, &owners, &mesh.tets),
        Part::whole(n, mesh.n_tets())
    );
}

#[test]
fn multigrid_on_ranks_is_that_on_one_but_for_groups_at_borders() {
    let mesh = ventricle(7000);
    let (n, tets) = (mesh.n_nodes(), &mesh.tets);
    // Springs along the elements' edges, a little of them to the ground.
    let stiffness = |part: &Part| {
        let local = |e: &u32| tets[*e as usize].map(|node| part.local(node).expect("held"));
        let held: Vec<[u32; 4]> = part.elements.iter().map(local).collect();
        let pattern = Arc::new(Pattern::of_elements(
            part.layout.n_owned,
            held.iter().map(|t| (&t[..], &t[..])),
        ));
        let mut stiffness = BlockCsr::zeros(pattern.clone());
        let mut add = |row: u32, column: u32, block: [f64; 9]| {
            let slot = pattern.slot(row, column);
            if slot != NO_SLOT {
                stiffness.blocks[slot as usize]
                    .iter_mut()
                    .zip(block)
                    .for_each(|(to, from)| *to += from);
            }
        };
        for t in &held {
            for (a, b) in
                [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(a, b)| (t[a], t[b]))
            {
                let [x, y] = [a, b].map(|node| mesh.nodes_mm[part.nodes[node as usize] as usize]);
                let d: [f64; 3] = std::array::from_fn(|i| x[i] - y[i]);
                let size = d.iter().map(|x| x * x).sum::<f64>();
                let spring: [f64; 9] = std::array::from_fn(|k| {
                    d[k / 3] * d[k % 3] / size + if k % 4 == 0 { 0.05 } else { 0.0 }
                });
                for (row, column, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                    add(row, column, spring.map(|x| sign * x));
                }
            }
            t.iter().for_each(|a| {
                add(
                    *a,
                    *a,
                    std::array::from_fn(|k| if k % 4 == 0 { 1e-4 } else { 0.0 }),
                )
            });
        }
        CondensedMatrix {
            stiffness,
            coupling: None,
            bulk: vec![],
        }
    };
    let b = (0..3 * n)
        .map(|k| (k as f64 * 0.7).sin())
        .collect::<Vec<f64>>();
    let settings = KrylovSettings {
        relative_tolerance: 1e-8,
        ..KrylovSettings::default()
    };
    let solved = |n_ranks: usize| {
        let owners = owners(n, tets, n_ranks).expect("a cut");
        let of_ranks = on_threads(n_ranks, ThreadSettings::default(), |comm| {
            let part = Part::of(comm.rank(), &owners, tets);
            let space = VectorLayout {
                comm: &comm,
                layout: &part.layout,
            };
            let a = stiffness(&part);
            let multigrid = Multigrid::new(
                space,
                &a.stiffness.pattern,
                &|slot| a.stiffness_block(slot),
                &part.take(3, mesh.nodes_mm.as_flattened()),
            );
            let (b, mut x) = (part.take(3, &b), vec![0.0; 3 * part.nodes.len()]);
            let report = conjugate_gradients(space, &a, &multigrid, &b, &mut x, &settings);
            assert_eq!(report.ending, KrylovEnding::Converged, "{report:?}");
            // Symmetric, or conjugate gradients would not be.
            let (mut ma, mut mb) = (vec![0.0; b.len()], vec![0.0; b.len()]);
            let other: Vec<f64> = part.take(
                3,
                &(0..3 * n)
                    .map(|k| (k as f64 * 1.3).cos())
                    .collect::<Vec<_>>(),
            );
            multigrid.apply(space, &b, &mut mb);
            multigrid.apply(space, &other, &mut ma);
            let [left, right, size] = space.dots([(&other, &mb), (&b, &ma), (&b, &mb)]);
            assert!(
                (left - right).abs() < 1e-4 * size,
                "{left} {right} of {size}"
            );
            x.truncate(space.n_owned());
            (
                report.iterations,
                multigrid.sizes().len(),
                part.owned_nodes().to_vec(),
                x,
            )
        })
        .expect("no rank fails");
        let mut all = vec![0.0; 3 * n];
        for (_, _, nodes, x) in &of_ranks {
            for (node, x) in nodes.iter().zip(x.as_chunks::<3>().0) {
                all[3 * *node as usize..][..3].copy_from_slice(x);
            }
        }
        (of_ranks[0].0, of_ranks[0].1, all)
    };
    let (alone, levels, want) = solved(1);
    assert_eq!(
        levels, 3,
        "a level of groups, too, before the factorisation"
    );
    let largest = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    for n_ranks in [2, 3, 5] {
        let (iterations, _, x) = solved(n_ranks);
        assert!(
            iterations <= alone + alone / 4 + 2,
            "{n_ranks} ranks: {iterations} iterations, {alone} on one"
        );
        let apart = x
            .iter()
            .zip(&want)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(
            apart < 1e-4 * largest,
            "{n_ranks} ranks: {apart} of {largest}"
        );
    }
}

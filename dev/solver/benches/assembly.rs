//! Nanoseconds a tetrahedron of the assembly, on one core: `cargo bench --manifest-path dev/Cargo.toml --bench assembly`.
//!
//! Criterion prints "thrpt" in elements a second; 2.5 Melem/s are 400 ns a tetrahedron.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_linalg::Operator as _;
use cardiotwin_linalg::parallel::{Layout, SingleProcess, VectorLayout};
use cardiotwin_mechanics::body::{Body, BodyInput, Deformation};
use cardiotwin_mechanics::element::kernel::{ActivePoint, VolumeChange};
use cardiotwin_mechanics::element::quadratic::QuadraticMesh;
use cardiotwin_mechanics::material::{ActiveLaw, Guccione, Law, Tissue, Volumetric, VolumetricLaw};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

fn tissue() -> Tissue {
    Tissue {
        law: Law::Guccione(Guccione::guccione1995(2.0)),
        volumetric: Volumetric {
            law: VolumetricLaw::LnSquared,
            kappa_kpa: 650.0,
        },
        active: Some(ActiveLaw::PAPER),
        density: 1.06,
    }
}

const NODAL: VolumeChange = VolumeChange::Nodal {
    pointwise_share: 0.05,
};

fn bodies(n: usize) -> Vec<(&'static str, usize, Body)> {
    let mesh = verification::meshes::cuboid([n; 3], |p| p.map(|x| 10.0 * x));
    let second = QuadraticMesh::new(&mesh.nodes, &mesh.tets, |_, _| None);
    let frame = |_: usize, _: [f64; 3]| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let tissue_of = vec![0; mesh.tets.len()];
    let mut out = vec![];
    for (name, volume) in [
        ("linear pointwise", VolumeChange::Pointwise),
        ("linear nodal", NODAL),
    ] {
        let input = BodyInput {
            nodes: &mesh.nodes,
            n_vertices: mesh.nodes.len(),
            tets: &mesh.tets,
            tissues: vec![tissue()],
            tissue_of: &tissue_of,
            frame: &frame,
            volume,
            layout: Layout::whole(mesh.nodes.len()),
            elements: &[],
        };
        out.push((
            name,
            mesh.tets.len(),
            Body::linear(&input, &SingleProcess).expect("a proper mesh"),
        ));
    }
    let input = BodyInput {
        nodes: &second.nodes,
        n_vertices: second.n_vertices,
        tets: &second.tets,
        tissues: vec![tissue()],
        tissue_of: &tissue_of,
        frame: &frame,
        volume: NODAL,
        layout: Layout::whole(second.nodes.len()),
        elements: &[],
    };
    out.push((
        "quadratic nodal",
        second.tets.len(),
        Body::quadratic(&input, &SingleProcess).expect("a proper mesh"),
    ));
    out
}

fn assembly(criterion: &mut Criterion) {
    for n in [11, 22] {
        for (name, n_tets, body) in bodies(n) {
            let u: Vec<f64> = body
                .reference()
                .iter()
                .map(|x| 0.01 * (2.0 * x).sin())
                .collect();
            let mut deformation = Deformation::default();
            body.deform(&u, &SingleProcess, &mut deformation);
            let active = vec![
                ActivePoint {
                    sa_kpa: [40.0; 8],
                    slope_kpa: [20.0; 8]
                };
                body.n_point_batches()
            ];
            let (mut force, mut tangent) = (vec![0.0; u.len()], body.new_tangent());
            let mut group = criterion
                .benchmark_group(format!("{name}, {n_tets} tets, {} nodes", body.n_nodes()));
            group
                .sample_size(20)
                .throughput(Throughput::Elements(n_tets as u64));
            group.bench_function("volumes", |b| {
                b.iter(|| body.deform(&u, &SingleProcess, &mut deformation))
            });
            group.bench_function("forces", |b| {
                b.iter(|| body.add_forces(&u, &active, &deformation, &mut force))
            });
            group.bench_function("volumes + forces + tangent + scatter", |b| {
                b.iter(|| {
                    body.deform(&u, &SingleProcess, &mut deformation);
                    body.tangent(&u, &active, &deformation, &mut force, &mut tangent);
                });
            });
            if let Some(mut packed) = body.new_packed_tangent() {
                group.bench_function(
                    "volumes + forces + tangent + scatter in single precision",
                    |b| {
                        b.iter(|| {
                            body.deform(&u, &SingleProcess, &mut deformation);
                            body.tangent(&u, &active, &deformation, &mut force, &mut packed);
                        });
                    },
                );
                let (mut x, mut y) = (u.clone(), vec![0.0; u.len()]);
                let space = VectorLayout {
                    comm: &SingleProcess,
                    layout: body.layout(),
                };
                let product = "product with the tangent in single precision";
                group.bench_function(product, |b| {
                    b.iter(|| packed.multiply(space, &mut x, &mut y))
                });
            }
            let mut x = u.clone();
            let mut y = vec![0.0; u.len()];
            let space = VectorLayout {
                comm: &SingleProcess,
                layout: body.layout(),
            };
            group.bench_function("product with the tangent", |b| {
                b.iter(|| tangent.multiply(space, &mut x, &mut y))
            });
        }
    }
}

criterion_group!(benches, assembly);
criterion_main!(benches);

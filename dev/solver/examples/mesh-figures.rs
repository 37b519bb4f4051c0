//! Figures of `docs/mesh.md`: `cargo run --release --manifest-path dev/Cargo.toml --example mesh-figures`.

use cardiotwin_mesh::eikonal::{Conduction, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::order::{Renumbering, bandwidth};
use cardiotwin_mesh::partition::{CoordinateBisection, Partitioner, figures};
use cardiotwin_mesh::quality::Quality;
use cardiotwin_mesh::tags;
use cardiotwin_units::Ml;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "  asked    nodes     tets  layers  edge/mm  min q  mean q  max deg  make/s  fibres/s  eikonal/s  last/ms  \
         bandwidth made/RCM  shared by 8"
    );
    let muscle = &[tags::LEFT_VENTRICLE];
    for n_nodes in [500, 1000, 2000, 4000, 8000, 16_000, 64_000, 200_000] {
        let begun = Instant::now();
        let made = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), n_nodes))?;
        let making = begun.elapsed().as_secs_f64();
        let mut mesh = made.mesh;
        let q = Quality::of(&mesh);
        let begun = Instant::now();
        make(&mut mesh, muscle, &FibreAngles::default())?;
        let ruling = begun.elapsed().as_secs_f64();
        let conduction = Conduction::of_left_ventricle(&made.shape.fascicles());
        let begun = Instant::now();
        let times = activation_ms(&mesh, &conduction)?;
        let waving = begun.elapsed().as_secs_f64();
        let last = times
            .into_iter()
            .filter(|t| t.is_finite())
            .fold(0.0, f64::max);
        let ordered = Renumbering::reverse_cuthill_mckee(&mesh).apply(&mesh);
        let work = vec![1.0; mesh.n_tets()];
        let cut = figures(&mesh, &work, &CoordinateBisection.parts(&mesh, &work, 8), 8);
        println!(
            "{n_nodes:>7} {:>8} {:>8} {:>7} {:>8.2} {:>6.3} {:>7.3} {:>8.1} {making:>7.2} {ruling:>9.2} {waving:>10.2} \
             {last:>8.1} {:>9}/{:<8} {:>11.3}",
            mesh.n_nodes(),
            mesh.n_tets(),
            made.n_layers,
            q.mean_edge_mm,
            q.min,
            q.mean,
            q.max_dihedral_deg,
            bandwidth(&mesh),
            bandwidth(&ordered),
            cut.shared_share,
        );
    }
    Ok(())
}

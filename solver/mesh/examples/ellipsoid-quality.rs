//! Prints how well shaped generated ellipsoids are: `cargo run --release -p cardiotwin-mesh --example ellipsoid-quality`.

use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::quality::Quality;
use cardiotwin_units::Ml;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("asked     nodes     tets  layers  edge/mm  min q  mean q  poor %  min deg  max deg   seconds");
    for n_nodes in [500, 1000, 2000, 4000, 8000, 16_000, 64_000, 200_000] {
        let begun = std::time::Instant::now();
        let made = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), n_nodes))?;
        let seconds = begun.elapsed().as_secs_f64();
        let q = Quality::of(&made.mesh);
        println!(
            "{n_nodes:>6} {:>8} {:>8} {:>7} {:>8.2} {:>6.3} {:>7.3} {:>7.2} {:>8.1} {:>8.1} {seconds:>9.2}",
            made.mesh.n_nodes(),
            made.mesh.n_tets(),
            made.n_layers,
            q.mean_edge_mm,
            q.min,
            q.mean,
            100.0 * q.poor_share,
            q.min_dihedral_deg,
            q.max_dihedral_deg,
        );
    }
    Ok(())
}

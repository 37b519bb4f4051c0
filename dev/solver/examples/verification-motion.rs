//! Tables of `docs/verification.md` about bodies in motion, as CSV: `cargo run --release --manifest-path dev/Cargo.toml --example
//! verification-motion order|energy|cube`.

#[path = "../verification/mod.rs"]
mod verification;

use verification::beat::beat;
use verification::land_cube::{Coupling, Load, contract};
use verification::motion::errors_in_time;

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    match wanted.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["order"] => order(),
        ["energy"] => energy(),
        ["cube"] => cube(),
        _ => {
            eprintln!("name one table: order, energy, cube");
            std::process::exit(2);
        }
    }
}

/// Distance from the motion in 512 steps, by the length of the step and the spectral radius.
fn order() {
    println!("rho,dt_ms,error_mm");
    let steps = [8, 16, 32, 64, 128];
    for rho in [0.0, 0.5, 1.0] {
        for (n, error) in steps.iter().zip(errors_in_time(rho, &steps)) {
            println!("{rho},{},{error:.6e}", 8.0 / *n as f64);
        }
    }
}

fn energy() {
    println!("t_ms,pressure_uJ,muscle_uJ,lost_uJ,stored_uJ,turned_over_uJ,gap_uJ");
    for b in beat() {
        let gap = b.gap();
        println!(
            "{},{:.6},{:.6},{:.6},{:.6},{:.6},{gap:.6}",
            b.t_ms, b.pressure, b.muscle, b.lost, b.stored, b.turned_over
        );
    }
}

/// Mean stretch of half of the cube; a run whose step fails ends there.
fn cube() {
    println!("load,coupling,dt_ms,t_ms,stretch");
    for load in [Load::Isometric, Load::Shortening] {
        for dt_ms in [1.0, 0.1] {
            for coupling in [
                Coupling::Implicit,
                Coupling::Stabilised,
                Coupling::Staggered,
            ] {
                for (k, stretch) in contract(load, coupling, dt_ms, 30.0)
                    .into_iter()
                    .enumerate()
                {
                    println!(
                        "{load:?},{coupling:?},{dt_ms},{:.1},{stretch:.6}",
                        k as f64 * dt_ms
                    );
                }
            }
        }
    }
}

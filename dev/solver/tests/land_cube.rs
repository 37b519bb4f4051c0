//! The contraction model of Land 2017 in a cube, with and without the term of Regazzoni and Quarteroni 2021.

#[path = "../verification/mod.rs"]
mod verification;

use verification::land_cube::{Coupling, Load, contract, roughness};

#[test]
fn land_2017_is_stable_at_1_and_at_a_tenth_of_a_millisecond_and_not_without_its_stiffness_in_the_equations()
 {
    for load in [Load::Isometric, Load::Shortening] {
        let mut ends = vec![];
        for (dt_ms, end_ms) in [(1.0, 30.0), (0.1, 20.0)] {
            let n = (end_ms / dt_ms) as usize + 1;
            let smooth = contract(load, Coupling::Implicit, dt_ms, end_ms);
            let stabilised = contract(load, Coupling::Stabilised, dt_ms, end_ms);
            let staggered = contract(load, Coupling::Staggered, dt_ms, end_ms);
            assert_eq!((smooth.len(), stabilised.len()), (n, n), "{load:?} {dt_ms}");
            let (a, b, c) = (
                roughness(&smooth),
                roughness(&stabilised),
                roughness(&staggered),
            );
            println!(
                "{load:?} {dt_ms}: {a:.2e} {b:.2e} {c:.2e}, {} of {n} steps, ends {:?} {:?}",
                staggered.len(),
                smooth.last(),
                stabilised.last()
            );
            assert!(b < 5.0 * a, "{load:?} {dt_ms}: {a} {b}");
            assert!(
                staggered.len() < n || c > 20.0 * a,
                "{load:?} {dt_ms}: {a} {c}"
            );
            ends.push(smooth[(20.0 / dt_ms).round() as usize]);
        }
        assert!((ends[0] - ends[1]).abs() < 0.02, "{load:?}: {ends:?}");
    }
}

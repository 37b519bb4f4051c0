//! A synthetic calcium transient, Rice's curve with independent normal noise, as a CSV file on
//! stdout.
//!
//! ```sh
//! cargo run --release --manifest-path dev/Cargo.toml --example calcium-trace \
//!     > examples/calcium/transient.csv
//! ```

use cardiotwin_calibrate::calcium_fit::Rice2008Parameters;
use cardiotwin_calibrate::normal;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Standard deviation of the noise, µM.
const NOISE_UM: f64 = 0.01;
const SEED: u64 = 20;

fn main() {
    let rice = Rice2008Parameters {
        ca_res_um: 0.12,
        ca_max_um: 0.7,
        tau_cr_ms: 170.0,
        tau_cd_ms: 60.0,
    };
    let times: Vec<f64> = (0..160).map(|i| 5.0 * f64::from(i)).collect();
    let mut random = Pcg64::seed_from_u64(SEED);
    println!(
        "# Made, not measured: Rice's transient (Jung et al. 2022, eq. A16) with Ca_res 0.12 uM, Ca_max 0.7 uM,"
    );
    println!(
        "# time constants 170 and 60 ms, and independent normal noise of {NOISE_UM} uM (seed {SEED})."
    );
    println!("time_ms,calcium_uM");
    for (time_ms, calcium_um) in times.iter().zip(rice.transient_um(&times)) {
        let noise = NOISE_UM * normal::quantile(random.random_range(1e-12..1.0 - 1e-12));
        println!("{time_ms},{:.4}", calcium_um + noise);
    }
}

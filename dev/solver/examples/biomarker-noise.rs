//! Effect of measurement noise on each biomarker of step 1: `cargo run --release --manifest-path
//! dev/Cargo.toml --example biomarker-noise -- [hearts=200] [first=900000]`.
//!
//! `tests/validation` draws the hearts, without hidden effects. Each is measured with the
//! generator's usual noise: 1 to 1.5 mmHg on the pressure, 2 to 3 mL on each frame of the volume.
//! The table shows the root mean square and the mean of (noisy − clean) / clean over the hearts in
//! percent, with both traces read over the same windows.

use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{
    BeatBiomarkers, Continuation, NoiseWindows, Quantity, Trace, noise_windows, resample,
};
use cardiotwin_units::Ms;
use cardiotwin_validation::{Case, Hearts};

const NAMES: [&str; 7] = [
    "P_max", "dPdt_max", "dPdt_min", "PTD90", "SV", "tau_VD", "tau_VR",
];

fn biomarkers(
    pressure: &Trace,
    volume: &Trace,
    periodic: Continuation,
    windows: NoiseWindows,
) -> Result<[Option<f64>; 7], Box<dyn std::error::Error>> {
    let set = BeatBiomarkers::over(Some(pressure), Some(volume), periodic, windows)?;
    Ok([
        set.values.p_max_mmhg,
        set.values.dpdt_max_mmhg_per_ms,
        set.values.dpdt_min_mmhg_per_ms,
        set.values.ptd90_ms,
        set.values.sv_ml,
        set.values.tau_vd_ms,
        set.values.tau_vr_ms,
    ])
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |name: &str, default: u64| -> Result<u64, std::num::ParseIntError> {
        let given = std::env::args()
            .find_map(|a| Some(a.strip_prefix(name)?.strip_prefix('=')?.to_owned()));
        given.map_or(Ok(default), |text| text.parse())
    };
    let (hearts, first) = (argument("hearts", 200)?, argument("first", 900_000)?);
    let mut errors: [Vec<f64>; 7] = Default::default();
    for seed in first..first + hearts {
        let Some(case) = Case::draw(Hearts::Elastance, seed, &[], 1.0) else {
            continue;
        };
        let periodic = Continuation::periodic(Ms(case.cycle_ms));
        let pressure = |values: &[f64]| Trace::uniform(Quantity::Pressure, 1.0, values.to_vec());
        let volume =
            |values: &[f64]| Trace::new(Quantity::Volume, case.frame_ms.clone(), values.to_vec());
        let (noisy, clean) = (
            pressure(&case.pressure_mmhg)?,
            pressure(&case.clean_pressure_mmhg)?,
        );
        let (frames, clean_frames) = (volume(&case.frame_ml)?, volume(&case.clean_frame_ml)?);
        let windows = noise_windows::of(
            Some(&resample(&noisy, periodic, STEP)?),
            Some(&frames),
            periodic,
        );
        let measured = biomarkers(&noisy, &frames, periodic, windows)?;
        let known = biomarkers(&clean, &clean_frames, periodic, windows)?;
        for (errors, (measured, known)) in errors.iter_mut().zip(measured.into_iter().zip(known)) {
            errors.extend(
                measured
                    .zip(known)
                    .map(|(measured, known)| 100.0 * (measured / known - 1.0)),
            );
        }
    }
    println!(
        "{:10} {:>6} {:>8} {:>8} {:>10}",
        "biomarker", "hearts", "rms, %", "mean, %", "median, %"
    );
    for (name, errors) in NAMES.iter().zip(&mut errors) {
        let n = errors.len() as f64;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        let mean = errors.iter().sum::<f64>() / n;
        errors.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        // For a normal deviate z, the median of |z| is 0.6745.
        let robust = errors
            .get(errors.len() / 2)
            .map_or(f64::NAN, |e| e.abs() / 0.6745);
        println!("{name:10} {n:>6} {rms:>8.2} {mean:>8.2} {robust:>10.2}");
    }
    Ok(())
}

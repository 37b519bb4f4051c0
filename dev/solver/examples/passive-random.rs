//! Step 0 of random ventricles on coarse meshes, and how many of them fail: `cargo run --release --manifest-path dev/Cargo.toml
//! --example passive-random -- [n=100] [first=0] [nodes=500] [hold=0.3] [fit=0] [verbose=1]`. Walls of 40 to 400 mL, pressures
//! to 4 kPa; the beat's springs are 0.01 to 10 kPa/mm on the rim and 0.01 to 5 kPa/mm on the epicardium, and step 0 does not
//! see them. The springs on the rim that step 0 hangs on are `hold` (a cohort's are 0.3), or 0.01 to 10 kPa/mm. Each heart is
//! unloaded and inflated under its law; without `fit=0` the law is then found again from the volumes.

use std::time::Instant;

use cardiotwin_mechanics::organ::passive_fit::fit;
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, PassiveFit, Piece, Search, UnloadingSettings, WallParameters,
};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::tags;
use cardiotwin_units::{MMHG_PER_KPA, Ml};

fn argument<T: std::str::FromStr>(name: &str, default: T) -> T {
    let found =
        std::env::args().find_map(|a| a.strip_prefix(name)?.strip_prefix('=')?.parse().ok());
    found.unwrap_or(default)
}

/// Uniform numbers of a seed (SplitMix64).
struct Draw(u64);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (first, n) = (argument("first", 0), argument("n", 100));
    let mut failed = 0;
    let begun = Instant::now();
    for seed in first..first + n {
        let mut draw = Draw(1000 + seed);
        let wall_ml = (40f64.ln() + draw.between(0.0, 1.0) * 10f64.ln()).exp();
        let image_ml = wall_ml * draw.between(0.5, 1.4);
        let edp_mmhg = draw.between(4.0, 30.0);
        let image_mmhg = edp_mmhg * draw.between(0.4, 0.9);
        let mut spec = EllipsoidSpec::new(Ml(image_ml), Ml(wall_ml), argument("nodes", 500));
        spec.long_to_short = draw.between(1.6, 2.6);
        let mut mesh = generate(&spec)?.mesh;
        let turn = draw.between(40.0, 80.0);
        make(
            &mut mesh,
            &[tags::LEFT_VENTRICLE],
            &FibreAngles {
                alpha_endo_deg: turn,
                alpha_epi_deg: -turn,
                ..FibreAngles::default()
            },
        )?;
        let anatomy = Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], ElementKind::LINEAR_NODAL)?;
        let [image_pressure_kpa, end_diastolic_pressure_kpa] =
            [image_mmhg, edp_mmhg].map(|p| p / MMHG_PER_KPA);
        let factor = draw.between(0.3, 1.2);
        let mut known = WallParameters::default();
        let stiffness_kpa = 0.42 * (draw.between(-1.0, 1.5)).exp() / factor.powi(2);
        known.muscle = known
            .muscle
            .with_stiffness(stiffness_kpa)
            .scaled(1.0, factor);
        let [hold, rim, epicardium] = [(0.01, 10.0), (0.01, 10.0), (0.01, 5.0)]
            .map(|(least, most): (f64, f64)| draw.between(least.ln(), most.ln()).exp());
        let hold = argument("hold", hold);
        (
            known.static_spring,
            known.rim.stiffness,
            known.pericardium.stiffness,
        ) = (hold, rim, epicardium);
        let given = PassiveFit::Given {
            image_pressure_kpa,
            end_diastolic_pressure_kpa,
        };
        let mut wall = WallParameters {
            muscle: WallParameters::default().muscle,
            ..known.clone()
        };
        wall.muscle = wall.muscle.with_stiffness(0.42);
        let mut search = Search::new(UnloadingSettings::for_anatomy(&anatomy));
        let case = format!(
            "{seed}: wall {wall_ml:.0} mL, image {image_ml:.0} mL at {image_mmhg:.1} mmHg, end-diastole at {edp_mmhg:.1} mmHg, C {:.2}, factor {factor:.2}, long {:.2}, fibres {turn:.0} deg, rim {hold:.3} kPa/mm in step 0",
            stiffness_kpa, spec.long_to_short
        );
        let one = Instant::now();
        let made = match fit(&Piece::whole(&anatomy), &known, &given, None, &mut search) {
            Ok(made) => made,
            Err(error) => {
                failed += 1;
                let cause = std::error::Error::source(&error)
                    .map(|s| format!(": {s}"))
                    .unwrap_or_default();
                println!(
                    "{case}: FORWARD {error}{cause} ({:.1} s)",
                    one.elapsed().as_secs_f64()
                );
                continue;
            }
        };
        if argument("fit", 1) == 0 {
            if argument("verbose", 0) > 0 {
                println!(
                    "{case}: {} Newton, {:.1} s",
                    made.state.newton_iterations,
                    one.elapsed().as_secs_f64()
                );
            }
            continue;
        }
        let target = PassiveFit::ThreePoints {
            image_pressure_kpa,
            end_diastolic_pressure_kpa,
            end_diastolic_volume_mm3: made.state.volume_mm3(),
            unloaded_volume_mm3: made.state.unloaded_volume_mm3(),
        };
        let case = format!(
            "{case}: V0 {:.1} EDV {:.1} ({} Newton, {:.1} s)",
            1e-3 * made.state.unloaded_volume_mm3(),
            1e-3 * made.state.volume_mm3(),
            made.state.newton_iterations,
            one.elapsed().as_secs_f64()
        );
        let one = Instant::now();
        match fit(&Piece::whole(&anatomy), &wall, &target, None, &mut search) {
            Ok(found) if argument("verbose", 0) > 0 => println!(
                "{case}: C {:.3}, {} Newton, {:.1} s",
                found.wall.muscle.stiffness_kpa(),
                found.state.newton_iterations,
                one.elapsed().as_secs_f64()
            ),
            Ok(_) => {}
            Err(error) => {
                failed += 1;
                let cause = std::error::Error::source(&error)
                    .map(|s| format!(": {s}"))
                    .unwrap_or_default();
                println!(
                    "{case}: {error}{cause} ({:.1} s)",
                    one.elapsed().as_secs_f64()
                );
            }
        }
    }
    println!(
        "{failed} of {n} failed, {:.0} s",
        begun.elapsed().as_secs_f64()
    );
    Ok(())
}

//! Error of the estimated filling pressure on hearts whose atrial pressure is known: `cargo run
//! --release --manifest-path dev/Cargo.toml --example filling-pressure -- [hearts=40] [seed=20261201]
//! [kick=2]`.
//!
//! `tests/validation` draws the hearts of two formulations, each without and with an atrial kick of
//! a level, and measures them with its usual noise. The known value is the mean pressure of the left
//! atrium over the cycle. The table shows mean, standard deviation and root mean square of the errors
//! in mmHg: of the share of the end-diastolic pressure that counted before, not below the pressure of
//! the whole-heart image and not above end-diastole; of the pressure that closes the volume; and of
//! that one over its own standard deviation. Below are the errors at other resistances of the valve.

use cardiotwin_models::circulation::filling::{
    FilledVolume, MITRAL_RESISTANCE, SHARE_OF_EDP, closing_pressure, from_beat,
};
use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Quantity, Trace, noise_windows, resample};
use cardiotwin_units::{Ml, MmhgSPerMl, Ms};
use cardiotwin_validation::hidden::{self, Instruments};
use cardiotwin_validation::measure::instruments_on;
use cardiotwin_validation::random::Random;
use cardiotwin_validation::{Case, Hearts};

/// Relative standard deviation of a stroke volume from cine frames, as in step 0.
const STROKE_SD: f64 = 0.08;
const RESISTANCES: [f64; 7] = [0.006, 0.008, 0.01, 0.013, 0.016, 0.02, 0.025];

/// Errors of one heart.
struct Errors {
    before_mmhg: f64,
    now_mmhg: f64,
    over_sd: f64,
    at: [f64; RESISTANCES.len()],
}

fn errors(
    hearts: Hearts,
    seed: u64,
    kick: Option<usize>,
) -> Result<Option<Errors>, Box<dyn std::error::Error>> {
    let mut random = Random::new(seed, 0);
    let mut heart = hearts.draw(&mut random);
    let mut instruments = Instruments::default();
    if let Some(level) = kick {
        hidden::draw("atrial_kick", level, &mut random).add(&mut heart, &mut instruments);
    }
    let Some(beat) = heart.beat().filter(|beat| hearts.refused(beat).is_none()) else {
        return Ok(None);
    };
    let traces = instruments_on(&beat, &instruments);
    let case = Case::observe(&beat, traces, 100.0, 1.0, &mut Random::new(seed, 1));
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let known = mean(&beat.atrial_pressure);

    let periodic = Continuation::periodic(Ms(case.cycle_ms));
    let frames = Trace::new(
        Quantity::Volume,
        case.frame_ms.clone(),
        case.frame_ml.clone(),
    )?;
    let pressure = resample(
        &Trace::uniform(Quantity::Pressure, 1.0, case.pressure_mmhg.clone())?,
        periodic,
        STEP,
    )?;
    let volume = resample(&frames, periodic, STEP)?;
    let windows = noise_windows::of(Some(&pressure), Some(&frames), periodic);
    let read = BeatBiomarkers::over(Some(&pressure), Some(&volume), periodic, windows)?;
    let Some(stroke) = read.values.sv_ml else {
        return Ok(None);
    };
    let edp = mean(&case.pressure_mmhg[..10]);
    let diastasis = pressure.at(case.side.whole_heart_ms);
    let before = (SHARE_OF_EDP * edp).max(diastasis.min(edp));
    let filled = FilledVolume {
        volume: Ml(stroke),
        sd: Ml(STROKE_SD * stroke),
        origin: "the stroke volume",
    };
    let found = from_beat(pressure.values(), STEP, filled)?;
    let mut at = [0.0; RESISTANCES.len()];
    for (error, resistance) in at.iter_mut().zip(RESISTANCES) {
        let closing =
            closing_pressure(pressure.values(), STEP, Ml(stroke), MmhgSPerMl(resistance))?;
        *error = closing.0.0 - known;
    }
    let now_mmhg = found.value.0 - known;
    Ok(Some(Errors {
        before_mmhg: before - known,
        now_mmhg,
        over_sd: now_mmhg / found.sd.0,
        at,
    }))
}

fn said(values: impl Iterator<Item = f64>) -> String {
    let values: Vec<f64> = values.collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| v * v).sum::<f64>() / n;
    let sd = (square - mean * mean).max(0.0).sqrt();
    format!("{mean:6.2} {sd:5.2} {:5.2}", square.sqrt())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |name: &str, default: u64| -> Result<u64, std::num::ParseIntError> {
        let given = std::env::args()
            .find_map(|a| Some(a.strip_prefix(name)?.strip_prefix('=')?.to_owned()));
        given.map_or(Ok(default), |text| text.parse())
    };
    let wanted = argument("hearts", 40)?;
    let first = argument("seed", 20_261_201)?.wrapping_mul(1_000_003);
    let level = argument("kick", 2)? as usize;
    println!("errors in mmHg: mean, standard deviation, root mean square");
    println!(
        "hearts                    n  before               now                  now over its sd"
    );
    let mut all = Vec::new();
    for (name, hearts, stream) in [
        ("elastance", Hearts::Elastance, 0),
        ("sarcomeres", Hearts::Sarcomeres, 500_000),
    ] {
        for (with, kick) in [("", None), (", kick", Some(level))] {
            let mut found = Vec::new();
            for i in 0..wanted {
                found.extend(errors(hearts, first.wrapping_add(stream + i), kick)?);
            }
            println!(
                "{:22} {:4}  {}  {}  {}",
                format!("{name}{with}"),
                found.len(),
                said(found.iter().map(|e| e.before_mmhg)),
                said(found.iter().map(|e| e.now_mmhg)),
                said(found.iter().map(|e| e.over_sd)),
            );
            all.extend(found);
        }
    }
    println!(
        "{:22} {:4}  {}  {}  {}",
        "all",
        all.len(),
        said(all.iter().map(|e| e.before_mmhg)),
        said(all.iter().map(|e| e.now_mmhg)),
        said(all.iter().map(|e| e.over_sd)),
    );
    println!(
        "\nresistance of the valve in mmHg s/mL, {} now",
        MITRAL_RESISTANCE.0
    );
    for (i, resistance) in RESISTANCES.iter().enumerate() {
        println!("{resistance:6.3}  {}", said(all.iter().map(|e| e.at[i])));
    }
    Ok(())
}

//! Hearts, their measured data and their true answers.

use crate::changes::{CHANGES, CYCLE_MS};
use crate::folder;
use cardiotwin_signals::pressure_volume_loop::stroke_work_mj;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Quantity, Trace};
use cardiotwin_units::Ms;
use cardiotwin_validation::circulation::{Beat, Rest};
use cardiotwin_validation::measure::instruments_on;
use cardiotwin_validation::random::Random;
use cardiotwin_validation::{Case, Further, Hearts, hidden::Instruments};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Hearts that are drawn before one is given up.
const TRIES: u64 = 60;

/// Indices of a beat, by the names of `cardiotwin predict`. The end-diastolic volume is the largest one.
fn indices(beat: &Beat) -> Option<Vec<(&'static str, f64)>> {
    let largest = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
    let smallest = |values: &[f64]| values.iter().copied().fold(f64::MAX, f64::min);
    let n = beat.pressure.len();
    let time_ms: Vec<f64> = (0..n).map(|k| k as f64).collect();
    let pressure = Trace::new(Quantity::Pressure, time_ms, beat.pressure.clone()).ok()?;
    let periodic = Continuation::Periodic {
        cycle_length_ms: Ms(n as f64),
    };
    let of_pressure = BeatBiomarkers::of_samples(Some(&pressure), None, periodic);
    let of_pressure = of_pressure.ok()?.values;
    let (filled, emptied) = (largest(&beat.volume), smallest(&beat.volume));
    let stroke = filled - emptied;
    let aorta = &beat.aortic_pressure;
    Some(vec![
        ("P_max_mmHg", of_pressure.p_max_mmhg?),
        ("EDP_mmHg", of_pressure.edp_mmhg?),
        ("dPdt_max_mmHg_per_ms", of_pressure.dpdt_max_mmhg_per_ms?),
        ("dPdt_min_mmHg_per_ms", of_pressure.dpdt_min_mmhg_per_ms?),
        ("PTD90_ms", of_pressure.ptd90_ms?),
        ("EDV_mL", filled),
        ("ESV_mL", emptied),
        ("SV_mL", stroke),
        ("ejection_fraction", stroke / filled),
        ("cardiac_output_L_per_min", 60.0 * stroke / n as f64),
        (
            "stroke_work_mJ",
            stroke_work_mj(&beat.volume, &beat.pressure)?,
        ),
        ("aortic_systolic_mmHg", largest(aorta)),
        ("aortic_diastolic_mmHg", smallest(aorta)),
        (
            "aortic_mean_mmHg",
            aorta.iter().sum::<f64>() / aorta.len() as f64,
        ),
    ])
}

/// Relative changes of the indices by change; `None` if one of the changed hearts is not steady.
fn truth(rest: &Rest) -> Option<Value> {
    let before = indices(&rest.changed(|_| {})?)?;
    let mut all = Map::new();
    for change in CHANGES {
        let after = indices(&(change.of_heart)(rest)?)?;
        let shares = (after.iter().zip(&before))
            .map(|((name, after), (_, before))| ((*name).to_owned(), json!(after / before - 1.0)));
        all.insert(change.name.to_owned(), Value::Object(shares.collect()));
    }
    Some(Value::Object(all))
}

/// A heart of a kind at rest with its measured data and true answers.
fn drawn(hearts: Hearts, seed: u64) -> Option<(Case, Value)> {
    for attempt in 0..TRIES {
        let mut heart = hearts.draw(&mut Random::new(seed, 2 * attempt));
        heart.pace(CYCLE_MS);
        let Some(rest) = heart.rest().filter(|r| hearts.refused(&r.beat).is_none()) else {
            continue;
        };
        let Some(truth) = truth(&rest) else {
            continue;
        };
        let mut random = Random::new(seed, 2 * attempt + 1);
        let drawn_ml = heart.left.reference_ml * random.between(0.7, 1.0);
        let wall_ml = heart.left.sarcomeres.map_or(drawn_ml, |wall| wall.wall_ml);
        let traces = instruments_on(&rest.beat, &Instruments::default());
        let case = Case::observe(&rest.beat, traces, wall_ml, 1.0, &mut random);
        return Some((case, truth));
    }
    None
}

/// Writes a cohort of hearts, and their true answers to `truth.json`.
pub fn make(into: &Path, n_hearts: usize, seed: u64) -> Result<(), String> {
    folder::open(into, "Hearts whose answers to changed loads are known")?;
    let mut all = Map::new();
    for k in 0..n_hearts {
        let (kind, hearts) = match k % 5 {
            0 | 2 => ("elastance", Hearts::Elastance),
            1 | 3 => ("sarcomeres", Hearts::Sarcomeres),
            _ => ("extreme", Hearts::Extreme),
        };
        let id = format!("{kind}-{:03}", k + 1);
        let of_heart = seed.wrapping_mul(1_000_003).wrapping_add(k as u64);
        let Some((case, truth)) = drawn(hearts, of_heart) else {
            eprintln!("{id}: no heart of {TRIES} is plausible and steady; left out");
            continue;
        };
        folder::write(into, &id, &case, &Further::default())?;
        all.insert(id, truth);
    }
    println!("{} hearts of {n_hearts}", all.len());
    let text = serde_json::to_string_pretty(&json!({ "seed": seed, "hearts": all }))
        .map_err(|e| e.to_string())?;
    folder::put(&into.join("truth.json"), &(text + "\n"))
}

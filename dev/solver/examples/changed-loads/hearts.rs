//! Hearts, their measured data and their true answers.

use crate::{CHANGES, INDICES, folder};
use cardiotwin_validation::circulation::{Beat, Rest};
use cardiotwin_validation::measure::instruments_on;
use cardiotwin_validation::random::Random;
use cardiotwin_validation::{Case, Further, Hearts, hidden::Instruments};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Cycle at rest, and after the change of rate \[ms\]: 70 and 100 beats a minute.
const CYCLES_MS: [usize; 2] = [857, 600];
/// Hearts that are drawn before one is given up.
const TRIES: u64 = 60;

/// Values of [`INDICES`].
fn indices(beat: &Beat) -> [f64; 5] {
    let largest = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
    let filled = largest(&beat.volume);
    let emptied = beat.volume.iter().copied().fold(f64::MAX, f64::min);
    let upstroke = beat.pressure.windows(2).map(|w| w[1] - w[0]);
    [
        largest(&beat.pressure),
        upstroke.fold(f64::MIN, f64::max),
        filled,
        filled - emptied,
        1.0 - emptied / filled,
    ]
}

/// The heart's steady beat after a change with its name.
fn changed(rest: &Rest, change: &str) -> Option<Beat> {
    match change {
        "periphery" => rest.changed(|heart| heart.peripheral_resistance *= 0.75),
        "compliance" => rest.changed(|heart| {
            heart.arterial_compliance.0 *= 0.75;
            heart.arterial_compliance.1 *= 0.75;
        }),
        "filling" => rest.filled(1.2),
        "contractility" => rest.changed(|heart| heart.strengthen(1.2)),
        "rate" => rest.changed(|heart| heart.pace(CYCLES_MS[1])),
        "rate-alone" => rest.changed(|heart| heart.cycle_ms = CYCLES_MS[1]),
        _ => rest.changed(|heart| heart.aortic.resistance *= 3.0),
    }
}

/// Relative changes of the indices by change; `None` if one of the changed hearts is not steady.
fn truth(rest: &Rest) -> Option<Value> {
    let before = indices(&rest.changed(|_| {})?);
    let mut all = Map::new();
    for (change, _) in CHANGES {
        let after = indices(&changed(rest, change)?);
        let shares = (INDICES.iter().zip(after).zip(before))
            .map(|((name, after), before)| ((*name).to_owned(), json!(after / before - 1.0)));
        all.insert(change.to_owned(), Value::Object(shares.collect()));
    }
    Some(Value::Object(all))
}

/// A heart of a kind at rest with its measured data and true answers.
fn drawn(hearts: Hearts, seed: u64) -> Option<(Case, Value)> {
    for attempt in 0..TRIES {
        let mut heart = hearts.draw(&mut Random::new(seed, 2 * attempt));
        heart.pace(CYCLES_MS[0]);
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
    let text = serde_json::to_string_pretty(&json!({ "seed": seed, "hearts": all }))
        .map_err(|e| e.to_string())?;
    folder::put(&into.join("truth.json"), &(text + "\n"))?;
    for (change, _) in CHANGES {
        let mean = |index: &str| {
            let values: Vec<f64> = (all.values())
                .filter_map(|heart| heart[change][index].as_f64())
                .collect();
            format!(
                "{:+6.1}",
                100.0 * values.iter().sum::<f64>() / values.len() as f64
            )
        };
        println!("{change:14} {}", INDICES.map(mean).join(" "));
    }
    println!("mean true change in percent: {}", INDICES.join(", "));
    Ok(())
}

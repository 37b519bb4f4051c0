//! Measures how the base model misses further measurements of healthy hearts of other formulations:
//! the source of the errors in `src/channel.rs`.
//!
//! ```text
//! tolerances [--hearts N] [--seed N] [--jobs N]
//! ```
//!
//! The base is fitted to pressure, volume, scalars and all further traces of N hearts that lack
//! nothing, all without noise. The table has, for each quantity, the standard deviation of the error
//! of whole traces (offset) and of what is left (smooth), its correlation time, and the mean and the
//! standard deviation of the times of the valves and of the width of QRS.

#[path = "../command/arguments.rs"]
mod arguments;
#[path = "../validation/self_consistent.rs"]
mod self_consistent;
#[path = "../validation/source.rs"]
#[allow(dead_code)]
mod source;
#[path = "../../../../solver/discover/tests/support/visibility.rs"]
#[allow(dead_code)]
mod visibility;

use cardiotwin_discover::Reduced;
use cardiotwin_discover::further::{FurtherTrace, LoadedBeat, ValveTimes};
use cardiotwin_discover::least_squares::Settings;
use cardiotwin_discover::measured::Uncertain;
use cardiotwin_discover::noise::ErrorModel;
use cardiotwin_discover::problem::{Data, Problem};
use cardiotwin_discover::search::fit_base;
use cardiotwin_discover::usual;
use cardiotwin_discover::valves::cyclic;
use cardiotwin_validation::further::valve_times;
use cardiotwin_validation::{Hearts, Measurement, Plan, PlannedCase};
use cardiotwin_vocabulary::measurements::FurtherQuantity;
use rayon::prelude::*;

/// Errors of one heart: residuals of each quantity every 4 ms, of the times of the valves, and the
/// spread of activation.
struct Missed {
    traces: Vec<Vec<f64>>,
    valves: [f64; 4],
    spread_ms: f64,
    /// Residuals of pressure and volume under a lower load.
    loaded: [Vec<f64>; 2],
}

fn missed(planned: &PlannedCase) -> Option<Missed> {
    let case = planned.make()?;
    let beats = planned.beats(&case, &[Measurement::Loaded])?;
    let (beat, lower) = (beats.steady, beats.lower?);
    let mut measured = visibility::noise_free(&case);
    let cycle = measured.cycle_ms;
    let true_times = valve_times(&beat)?;
    for quantity in FurtherQuantity::ALL {
        let kind = Measurement::named(quantity.name())?;
        measured.further.traces.push(FurtherTrace {
            quantity,
            time_ms: measured.pressure_time_ms.clone(),
            value: beat.of(kind, case.clean_side.wall_ml),
            rms: usual::trace_rms(quantity),
            correlation_ms: 10.0,
            delay: Uncertain {
                value: 0.0,
                sd: 0.0,
            },
        });
    }
    let time = |which: usize| {
        Some(Uncertain {
            value: true_times[which],
            sd: 10.0,
        })
    };
    measured.side.valve_times = ValveTimes {
        aortic_opening: time(0),
        aortic_closure: time(1),
        mitral_opening: time(2),
        mitral_closure: time(3),
    };
    let of_frame = |t: &f64| lower.volume[(*t as usize).min(lower.volume.len() - 1)];
    measured.further.loaded.push(LoadedBeat {
        cycle_ms: cycle,
        pressure_time_ms: measured.pressure_time_ms.clone(),
        pressure_mmhg: lower.pressure.clone(),
        frame_time_ms: measured.frame_time_ms.clone(),
        frame_volume_ml: measured.frame_time_ms.iter().map(of_frame).collect(),
    });
    let forward = Reduced::new(&measured);
    let data = Data::new(measured, &ErrorModel::default(), None);
    let problem = Problem {
        forward: &forward,
        data: &data,
    };
    let fit = fit_base(&problem, &Settings::default())?;
    let values = fit.values();
    let fitted = problem.predict(&fit.structure, &values, Some(&fit.minimum.warm))?;
    let model_times = fitted.valve_times_ms?;
    let mut valves = [0.0; 4];
    for which in 0..4 {
        valves[which] = cyclic(true_times[which] - model_times[which], cycle);
    }
    Some(Missed {
        traces: (data.further.channels.iter())
            .map(|channel| channel.signal.residual(&channel.model(&fitted)))
            .collect(),
        valves,
        spread_ms: values[17],
        loaded: {
            let loaded = &data.further.loaded[0];
            let [pressure, volume] = loaded.models(&fitted.loaded[0]);
            [
                loaded.pressure.residual(&pressure),
                loaded.volume.residual(&volume),
            ]
        },
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn sd(values: &[f64]) -> f64 {
    let m = mean(values);
    mean(&values.iter().map(|v| (v - m).powi(2)).collect::<Vec<f64>>()).sqrt()
}

/// Time after which the mean correlation of the residuals has fallen to e^(-1/2) \[ms\], as of a bell
/// curve of this width.
fn correlation_ms(traces: &[Vec<f64>]) -> f64 {
    let power = |lag: usize| {
        let of = |r: &Vec<f64>| {
            let m = mean(r);
            let n = r.len();
            (0..n)
                .map(|i| (r[i] - m) * (r[(i + lag) % n] - m))
                .sum::<f64>()
        };
        traces.iter().map(of).sum::<f64>()
    };
    let at_once = power(0);
    let lag = (1..100).find(|lag| power(*lag) < (-0.5f64).exp() * at_once);
    4.0 * lag.unwrap_or(100) as f64
}

fn main() -> Result<(), String> {
    let (mut n_hearts, mut seed, mut jobs) = (30usize, 900u64, 2usize);
    for pair in arguments::pairs(std::env::args().skip(1)) {
        let (flag, value) = pair?;
        let number = arguments::number(&flag, &value)?;
        match flag.as_str() {
            "--hearts" => n_hearts = number,
            "--seed" => seed = number as u64,
            "--jobs" => jobs = number,
            _ => return Err("usage: tolerances [--hearts N] [--seed N] [--jobs N]".to_owned()),
        }
    }
    arguments::limit_threads(jobs)?;
    for (name, hearts) in [
        ("elastance", Hearts::Elastance),
        ("sarcomeres", Hearts::Sarcomeres),
    ] {
        let planned = Plan::Nulls.cases(n_hearts, seed, hearts);
        let found: Vec<Missed> = planned.par_iter().filter_map(missed).collect();
        println!("{name}: {} of {n_hearts} hearts", found.len());
        for (which, quantity) in FurtherQuantity::ALL.into_iter().enumerate() {
            let traces: Vec<Vec<f64>> = found.iter().map(|f| f.traces[which].clone()).collect();
            let offsets: Vec<f64> = traces.iter().map(|r| mean(r)).collect();
            let squares: Vec<f64> = traces.iter().map(|r| sd(r).powi(2)).collect();
            println!(
                "  {:16} offset {:+.2} ± {:.2}, smooth {:.2} {} over {:.0} ms",
                quantity.name(),
                mean(&offsets),
                sd(&offsets),
                mean(&squares).sqrt(),
                quantity.unit(),
                correlation_ms(&traces)
            );
        }
        for (which, valve) in ValveTimes::NAMES.iter().enumerate() {
            let errors: Vec<f64> = found.iter().map(|f| f.valves[which]).collect();
            println!("  {valve:16} {:+.1} ± {:.1} ms", mean(&errors), sd(&errors));
        }
        for (which, signal) in ["pressure, mmHg", "volume, mL"].iter().enumerate() {
            let rms =
                |f: &Missed| mean(&f.loaded[which].iter().map(|r| r * r).collect::<Vec<f64>>());
            let squares: Vec<f64> = found.iter().map(rms).collect();
            println!("  lower load, {signal}: rms {:.2}", mean(&squares).sqrt());
        }
        let spreads: Vec<f64> = found.iter().map(|f| f.spread_ms).collect();
        println!(
            "  spread           {:.1} ± {:.1} ms",
            mean(&spreads),
            sd(&spreads)
        );
    }
    Ok(())
}

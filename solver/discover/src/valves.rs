//! Times at which the valves of a predicted beat open and close.

use crate::forward::trace_at;

/// Flow above which a valve is open \[mL/s\]: far below any flow of a beat, and above what a closed
/// valve of the model lets through.
const OPEN_ML_PER_S: f64 = 1.0;
/// Pressure of the ventricle above the atrium that closes the mitral valve \[mmHg\]: above what
/// remains between both in diastasis, and passed within some ms when the ventricle contracts.
const CLOSING_MMHG: f64 = 1.0;

/// Time at which a trace crosses the threshold between two neighbouring samples \[ms\].
fn crossing(trace: &[f64], threshold: f64, step_ms: f64, before: usize) -> f64 {
    let n = trace.len();
    let (a, b) = (trace[before % n], trace[(before + 1) % n]);
    let share = if a == b {
        0.5
    } else {
        (threshold - a) / (b - a)
    };
    (before as f64 + share) * step_ms
}

/// Traces of a beat by which its valves move.
#[derive(Debug, Clone, Copy)]
pub struct Traces<'a> {
    /// Flow through the aortic valve \[mL/s\].
    pub aortic: &'a [f64],
    /// Flow through the mitral valve \[mL/s\].
    pub mitral: &'a [f64],
    /// Pressure of the ventricle \[mmHg\].
    pub ventricle: &'a [f64],
    /// Pressure of the atrium \[mmHg\].
    pub atrium: &'a [f64],
}

/// Times of opening and closure of the aortic, then of the mitral valve \[ms\], within the cycle;
/// `None` where a valve never opens or never closes.
///
/// The mitral valve closes where the ventricle's pressure rises above the atrium's: with equal
/// pressures in diastasis, its flow may end long before.
#[must_use]
pub fn valve_times(of: Traces<'_>, step_ms: f64) -> Option<[f64; 4]> {
    let (aortic, mitral) = (of.aortic, of.mitral);
    let n = aortic.len();
    let excess: Vec<f64> = std::iter::zip(of.ventricle, of.atrium)
        .map(|(ventricle, atrium)| ventricle - atrium)
        .collect();
    let cycle = n as f64 * step_ms;
    let is_open = |trace: &[f64], i: usize| trace[i % n] > OPEN_ML_PER_S;
    let peak = (0..n).max_by(|a, b| aortic[*a].total_cmp(&aortic[*b]))?;
    if !is_open(aortic, peak) {
        return None;
    }
    let opened = (1..n).find(|k| !is_open(aortic, peak + n - k))?;
    let closed = (1..n).find(|k| !is_open(aortic, peak + k))?;
    let (opening, closure) = (peak + n - opened, peak + closed - 1);
    // The mitral valve opens first after the aortic closure, and closes last before its opening.
    let filling = (1..n).find(|k| is_open(mitral, closure + k))?;
    let filled = (0..n).find(|k| excess[(opening + n - k) % n] < CLOSING_MMHG)?;
    let times = [
        crossing(aortic, OPEN_ML_PER_S, step_ms, opening),
        crossing(aortic, OPEN_ML_PER_S, step_ms, closure),
        crossing(mitral, OPEN_ML_PER_S, step_ms, closure + filling - 1),
        crossing(&excess, CLOSING_MMHG, step_ms, opening + n - filled),
    ];
    Some(times.map(|t| t.rem_euclid(cycle)))
}

/// Distance of two times of a cycle \[ms\], at most half of it.
#[must_use]
pub fn cyclic(difference_ms: f64, cycle_ms: f64) -> f64 {
    (difference_ms + 0.5 * cycle_ms).rem_euclid(cycle_ms) - 0.5 * cycle_ms
}

/// Pressure that the left atrium gains by filling from the lungs at a constant rate, and loses to
/// the ventricle \[mmHg\]; its mean is zero.
///
/// - `mitral`: flow through the mitral valve \[mL/s\]
#[must_use]
pub fn reservoir(mitral: &[f64], step_ms: f64, compliance: f64) -> Vec<f64> {
    let n = mitral.len() as f64;
    let mean = mitral.iter().sum::<f64>() / n;
    let mut volume = 0.0;
    let mut trace: Vec<f64> = (0..mitral.len())
        .map(|i| {
            let now = volume / compliance;
            let next = trace_at(mitral, 1.0, i as f64 + 1.0);
            volume += (mean - 0.5 * (mitral[i] + next)) * step_ms * 1e-3;
            now
        })
        .collect();
    let level = trace.iter().sum::<f64>() / n;
    trace.iter_mut().for_each(|p| *p -= level);
    trace
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(of: &[Vec<f64>; 4]) -> Option<[f64; 4]> {
        let [aortic, mitral, ventricle, atrium] = of;
        let traces = Traces {
            aortic,
            mitral,
            ventricle,
            atrium,
        };
        valve_times(traces, 2.0)
    }

    /// A beat of 800 ms: ejection from 60 to 300 ms, filling from 380 to 700 ms, contraction from 780
    /// ms.
    fn flows() -> [Vec<f64>; 4] {
        let hump = |t: f64, from: f64, to: f64| {
            let x = (t - from) / (to - from);
            if (0.0..=1.0).contains(&x) {
                400.0 * (std::f64::consts::PI * x).sin()
            } else {
                -0.1
            }
        };
        let times: Vec<f64> = (0..400).map(|i| 2.0 * f64::from(i)).collect();
        let pressure = |t: &f64| if *t < 340.0 || *t > 779.0 { 20.0 } else { 8.0 };
        [
            times.iter().map(|t| hump(*t, 60.0, 300.0)).collect(),
            times.iter().map(|t| hump(*t, 380.0, 700.0)).collect(),
            times.iter().map(pressure).collect(),
            vec![8.0; times.len()],
        ]
    }

    #[test]
    fn valves_open_and_close_where_their_flow_begins_and_ends() {
        let beat = flows();
        let found = times(&beat).unwrap();
        for (time, expected) in found.iter().zip([60.0, 300.0, 380.0, 779.0]) {
            assert!((time - expected).abs() < 2.0, "{found:?}");
        }
        // The same beat with its zero in the middle of ejection.
        let later = times(&beat.map(|v| [&v[100..], &v[..100]].concat())).unwrap();
        for (time, turned) in found.iter().zip(later) {
            assert!(cyclic(time - 200.0 - turned, 800.0).abs() < 1e-9);
        }
        assert_eq!(times(&[(); 4].map(|()| vec![0.0; 9])), None);
    }

    #[test]
    fn the_atrium_fills_in_systole_by_its_share_of_the_stroke() {
        let [_, mitral, ..] = flows();
        let p = reservoir(&mitral, 2.0, 20.0);
        // Without inflow from 700 to 380 ms of the next beat, 0.6 of the stroke volume collects.
        let stroke = mitral.iter().sum::<f64>() * 2e-3;
        assert!((p[190] - p[350] - 0.6 * stroke / 20.0).abs() < 0.05 * stroke / 20.0);
        assert!(p.iter().sum::<f64>().abs() < 1e-9);
    }
}

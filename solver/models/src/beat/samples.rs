//! Samples of a beat's traces inside a long step.

use super::BeatTraces;

impl BeatTraces {
    /// Samples between the last two, at these times, with the valves of the sample before.
    ///
    /// Where the step before began `before` samples ahead of this one, pressures and nodes follow the parabola through both
    /// ends of this step and the beginning of that one, as long as no valve moved in between; otherwise they are linear. Flows
    /// are linear, and the volume is their integral.
    pub(super) fn fill_in(&mut self, times_ms: &[f64], before: Option<usize>) {
        let Some(at) = self
            .time_ms
            .len()
            .checked_sub(2)
            .filter(|_| !times_ms.is_empty())
        else {
            return;
        };
        let (begin, end) = (self.time_ms[at], self.time_ms[at + 1]);
        let shares: Vec<f64> = times_ms
            .iter()
            .map(|t| (t - begin) / (end - begin))
            .collect();
        let valves = |k: usize| (self.aortic_open[k], self.mitral_open[k]);
        let earlier = before
            .and_then(|before| at.checked_sub(before).filter(|_| before > 0))
            .filter(|k| valves(*k) == valves(at) && valves(at) == valves(at + 1))
            .map(|k| (at - k, (begin - self.time_ms[k]) / (end - begin)));
        let flows = &self.net_inflow_ml_per_s;
        let bend_ml = 0.5e-3 * (end - begin) * (flows[at + 1] - flows[at]);
        fill_in(&mut self.volume_ml, 1, &shares, |_, _| bend_ml);
        for trace in [
            &mut self.aortic_flow_ml_per_s,
            &mut self.mitral_flow_ml_per_s,
            &mut self.net_inflow_ml_per_s,
        ] {
            fill_in(trace, 1, &shares, |_, _| 0.0);
        }
        let parabola = |width: usize| {
            move |rows: &[f64], last: f64| {
                let (Some((back, ratio)), Some(n)) = (earlier, rows.len().checked_sub(1)) else {
                    return 0.0;
                };
                let (from, of_before) = (rows[n], rows[n - back * width]);
                ((last - from) - (from - of_before) / ratio) / (1.0 + ratio)
            }
        };
        for trace in [
            &mut self.pressure_mmhg,
            &mut self.aortic_pressure_mmhg,
            &mut self.left_atrial_pressure_mmhg,
        ] {
            fill_in(trace, 1, &shares, parabola(1));
        }
        for valve in [&mut self.aortic_open, &mut self.mitral_open] {
            let (before, last) = (valve[at], valve.pop());
            valve.extend(std::iter::repeat_n(before, times_ms.len()).chain(last));
        }
        if let Some(nodes) = &mut self.nodes {
            for trace in [&mut nodes.sa_kpa, &mut nodes.ca_um, &mut nodes.lambda] {
                fill_in(trace, nodes.n_nodes, &shares, parabola(nodes.n_nodes));
            }
        }
        self.time_ms.truncate(at + 1);
        self.time_ms.extend(times_ms.iter().copied().chain([end]));
    }
}

/// Puts rows between the last two of a trace, at these shares of the way.
///
/// - `bend`: factor of `s (s − 1)` that is added to the straight line at share `s`, from the rows up to the number at the
///   step's beginning, and the number at its end
fn fill_in(trace: &mut Vec<f64>, width: usize, shares: &[f64], bend: impl Fn(&[f64], f64) -> f64) {
    let last = trace.split_off(trace.len() - width);
    let before = trace.len() - width;
    let bends: Vec<f64> = (last.iter().enumerate())
        .map(|(k, last)| bend(&trace[..=before + k], *last))
        .collect();
    for share in shares {
        for (k, (last, bend)) in last.iter().zip(&bends).enumerate() {
            let from = trace[before + k];
            trace.push(from + share * (last - from) + bend * share * (share - 1.0));
        }
    }
    trace.extend(last);
}

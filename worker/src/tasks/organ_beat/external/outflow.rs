//! Flows and aortic pressure for plots, if an external solver does not provide them. They are
//! computed from the volume and the patient's Windkessel.

use cardiotwin_models::beat::BeatTraces;
use cardiotwin_schemas::organ::CirculationSpec;

/// Fills missing values and describes them in words.
///
/// Flows are −dV/dt and dV/dt, as if valves had no leakage. The aortic pressure follows from the
/// outflow by the three-element Windkessel, with implicit steps between samples.
pub(super) fn fill(traces: &mut BeatTraces, circulation: &CirculationSpec) -> Option<String> {
    let lacks = |trace: &[f64]| trace.iter().any(|value| value.is_nan());
    let mut named = Vec::new();
    let rate = rates(&traces.time_ms, &traces.volume_ml);
    if lacks(&traces.aortic_flow_ml_per_s) {
        traces.aortic_flow_ml_per_s = rate.iter().map(|rate| (-rate).max(0.0)).collect();
        named.push("aortic flow");
    }
    if lacks(&traces.mitral_flow_ml_per_s) {
        traces.mitral_flow_ml_per_s = rate.iter().map(|rate| rate.max(0.0)).collect();
        named.push("mitral flow");
    }
    if lacks(&traces.aortic_pressure_mmhg) {
        let load = &circulation.afterload;
        let mut stored = circulation.initial_windkessel_pressure_mmhg;
        let mut before = traces.time_ms.first().copied().unwrap_or(0.0);
        let samples = traces.time_ms.iter().zip(&traces.aortic_flow_ml_per_s);
        traces.aortic_pressure_mmhg = samples
            .map(|(time, flow)| {
                let share = 1e-3 * (time - before) / load.compliance_ml_per_mmhg;
                before = *time;
                stored = (stored + share * flow)
                    / (1.0 + share / load.peripheral_resistance_mmhg_s_per_ml);
                stored + load.characteristic_resistance_mmhg_s_per_ml * flow
            })
            .collect();
        named.push("aortic pressure");
    }
    (!named.is_empty()).then(|| {
        format!(
            "{}: not the external solver's, but from its volume and the patient's Windkessel",
            named.join(", ")
        )
    })
}

/// dV/dt at the samples \[mL/s\], by central differences.
fn rates(time_ms: &[f64], volume_ml: &[f64]) -> Vec<f64> {
    let last = time_ms.len().saturating_sub(1);
    let at = |k: usize| (k.saturating_sub(1), (k + 1).min(last));
    let rate =
        |(a, b): (usize, usize)| 1e3 * (volume_ml[b] - volume_ml[a]) / (time_ms[b] - time_ms[a]);
    (0..time_ms.len()).map(|k| rate(at(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::organ::WindkesselParameters;

    #[test]
    fn a_constant_outflow_brings_the_aorta_to_flow_times_resistance() {
        let circulation = CirculationSpec {
            afterload: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.1,
                peripheral_resistance_mmhg_s_per_ml: 0.9,
                compliance_ml_per_mmhg: 0.1,
            },
            initial_windkessel_pressure_mmhg: 70.0,
            left_atrial_pressure_mmhg: 8.0,
            effects: vec![],
            closed: None,
        };
        let time_ms: Vec<f64> = (0..=1000).map(f64::from).collect();
        let volume_ml = time_ms.iter().map(|t| 150.0 - 0.1 * t).collect();
        let none = vec![f64::NAN; time_ms.len()];
        let mut traces = BeatTraces {
            time_ms,
            volume_ml,
            aortic_pressure_mmhg: none.clone(),
            aortic_flow_ml_per_s: none.clone(),
            mitral_flow_ml_per_s: none,
            ..BeatTraces::default()
        };
        let said = fill(&mut traces, &circulation).unwrap();
        assert!(
            said.starts_with("aortic flow, mitral flow, aortic pressure: not the external"),
            "{said}"
        );
        assert!(
            traces
                .aortic_flow_ml_per_s
                .iter()
                .all(|q| (q - 100.0).abs() < 1e-9)
        );
        assert!(
            (traces.aortic_pressure_mmhg[1000] - 100.0).abs() < 0.01,
            "{}",
            traces.aortic_pressure_mmhg[1000]
        );
        assert_eq!(fill(&mut traces, &circulation), None, "what is there stays");
    }
}

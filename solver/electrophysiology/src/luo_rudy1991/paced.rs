//! Initial states of tissue: a single cell at rest, or in the periodic state at a heart rate.

use super::cells::{Cells, Membrane};
use super::{Parameters, State, gates};

/// A rectangular stimulus current.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stimulus {
    /// Current \[µA/cm²\]; a positive one depolarises.
    pub current_ua_cm2: f64,
    /// Start of the current \[ms\].
    pub start_ms: f64,
    /// Duration of the current \[ms\].
    pub length_ms: f64,
}

impl Default for Stimulus {
    /// 25.5 µA/cm² for 2 ms from time zero, as stored with the model in the CellML repository.
    fn default() -> Self {
        Self {
            current_ua_cm2: 25.5,
            start_ms: 0.0,
            length_ms: 2.0,
        }
    }
}

impl Stimulus {
    /// Charge within a step from `t_ms` \[µA ms/cm²\]. With 1 µF/cm², the number is a potential in
    /// mV. The value is exact for any step.
    #[must_use]
    pub fn charge(&self, t_ms: f64, step_ms: f64) -> f64 {
        let from = t_ms.max(self.start_ms);
        let to = (t_ms + step_ms).min(self.start_ms + self.length_ms);
        self.current_ua_cm2 * (to - from).max(0.0)
    }
}

/// State of a cell at rest, in which all derivatives vanish.
#[must_use]
pub fn rest(parameters: &Parameters) -> State {
    let at = |v: f64| {
        let [m, h, j, d, f, x] = gates(v).map(|gate| gate.steady);
        // Calcium balances the slow inward current. The fixed-point iteration is a contraction,
        // because the current is tiny at rest.
        let mut ca_mm = 2e-4;
        for _ in 0..100 {
            ca_mm = 1e-4 - 1e-4 / 0.07 * parameters.slow_inward(v, d, f, ca_mm);
        }
        State {
            v_mv: v,
            m,
            h,
            j,
            d,
            f,
            x,
            ca_mm,
        }
    };
    // The membrane current has a zero between these potentials.
    let (mut low, mut high) = (-95.0, -75.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if parameters.slope(&at(middle), 0.0).v_mv > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    at(0.5 * (low + high))
}

/// State of a cell just before a stimulus, after `n_beats` of `cycle_ms` that start from `state`.
#[must_use]
pub fn paced(
    membrane: &Membrane,
    state: &State,
    stimulus: &Stimulus,
    cycle_ms: f64,
    n_beats: usize,
) -> State {
    let step_ms = membrane.step_ms();
    let n_steps = (cycle_ms / step_ms).round() as usize;
    let mut cell = Cells::new(1, state);
    for _ in 0..n_beats {
        for step in 0..n_steps {
            cell.v_mv[0] +=
                stimulus.charge(step as f64 * step_ms, step_ms) / membrane.capacitance_uf_cm2();
            cell.step(membrane);
        }
    }
    cell.state(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_changes_at_rest() {
        let p = Parameters::default();
        let state = rest(&p);
        let slope = p.slope(&state, 0.0);
        assert!((-85.0..-84.0).contains(&state.v_mv), "{}", state.v_mv);
        assert!(
            slope.v_mv.abs() < 1e-9 && slope.ca_mm.abs() < 1e-12,
            "{slope:?}"
        );
        // The state is also stable: a perturbation decays.
        let membrane = Membrane::new(p, 0.025);
        let mut cell = Cells::new(
            1,
            &State {
                v_mv: state.v_mv + 5.0,
                ..state
            },
        );
        for _ in 0..40_000 {
            cell.step(&membrane);
        }
        assert!((cell.v_mv[0] - state.v_mv).abs() < 0.02, "{}", cell.v_mv[0]);
    }

    #[test]
    fn pacing_approaches_a_period() {
        let p = Parameters::default();
        let membrane = Membrane::new(p.clone(), 0.025);
        let stimulus = Stimulus::default();
        let tenth = paced(&membrane, &rest(&p), &stimulus, 800.0, 10);
        let next = paced(&membrane, &tenth, &stimulus, 800.0, 1);
        assert!(
            (tenth.v_mv - next.v_mv).abs() < 1e-3 && (tenth.x - next.x).abs() < 1e-5,
            "{tenth:?} {next:?}"
        );
        assert!(
            (tenth.x - rest(&p).x).abs() > 1e-3,
            "a paced cell is not at rest"
        );
    }
}

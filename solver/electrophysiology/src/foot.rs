//! Foot current, by which the eikonal solution triggers action potentials.

/// A current with the shape of an action potential's foot, I = C_m (A/τ) exp((t − t_a)/τ). It flows
/// from the activation time on, until the membrane takes over.
///
/// Source: Neic et al. 2017, J. Comput. Phys. 346, 191: the foot of a travelling action potential
/// is an exponential. Its time constant is that of the electrotonic current ahead of a wave of
/// speed v, τ = D/v²; it follows from V(t − x/v) in ∂V/∂t = D ∂²V/∂x². Amplitude, length and end
/// are our choices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootCurrent {
    /// Depolarisation A from which the exponential starts \[mV\].
    pub amplitude_mv: f64,
    /// Time constant τ \[ms\].
    pub tau_ms: f64,
    /// Longest duration of the current \[ms\].
    pub length_ms: f64,
    /// Potential above which the current ends \[mV\], because the current is subthreshold.
    pub end_mv: f64,
}

impl Default for FootCurrent {
    fn default() -> Self {
        let k = crate::tissue::SPEED_PER_ROOT_DIFFUSIVITY;
        let tau_ms = 1.0 / (k * k);
        Self {
            amplitude_mv: 1.0,
            tau_ms,
            length_ms: 5.0 * tau_ms,
            end_mv: -50.0,
        }
    }
}

impl FootCurrent {
    /// Depolarisation by the current between two times, of a cell that is activated at time zero
    /// \[mV\]. The value is exact for any step.
    #[must_use]
    pub fn depolarisation_mv(&self, from_ms: f64, to_ms: f64) -> f64 {
        let [from, to] = [from_ms, to_ms].map(|t| t.clamp(0.0, self.length_ms));
        self.amplitude_mv * ((to / self.tau_ms).exp() - (from / self.tau_ms).exp())
    }
}

/// Nodes into which the current flows, in the order of their activation.
#[derive(Debug, Clone)]
pub(crate) struct Feet {
    current: FootCurrent,
    /// Activation times in ascending order, and their nodes.
    times_ms: Vec<f64>,
    nodes: Vec<u32>,
    cycle_ms: Option<f64>,
}

impl Feet {
    pub(crate) fn new(current: FootCurrent, activation_ms: &[f64], cycle_ms: Option<f64>) -> Self {
        let mut nodes: Vec<u32> = (0..activation_ms.len() as u32).collect();
        nodes.sort_by(|a, b| activation_ms[*a as usize].total_cmp(&activation_ms[*b as usize]));
        let times_ms = nodes
            .iter()
            .map(|node| activation_ms[*node as usize])
            .collect();
        Self {
            current,
            times_ms,
            nodes,
            cycle_ms,
        }
    }

    /// Adds the current between two times.
    pub(crate) fn add(&self, from_ms: f64, to_ms: f64, v_mv: &mut [f64]) {
        let Some(cycle_ms) = self.cycle_ms else {
            return self.add_beat(from_ms, to_ms, v_mv);
        };
        // The current may extend beyond the end of the cycle.
        let first = ((from_ms - self.current.length_ms) / cycle_ms)
            .floor()
            .max(0.0) as usize;
        let last = (to_ms / cycle_ms).floor() as usize;
        for beat in first..=last {
            let begin = beat as f64 * cycle_ms;
            self.add_beat(from_ms - begin, to_ms - begin, v_mv);
        }
    }

    fn add_beat(&self, from_ms: f64, to_ms: f64, v_mv: &mut [f64]) {
        let first = self
            .times_ms
            .partition_point(|t| t + self.current.length_ms <= from_ms);
        let end = self.times_ms.partition_point(|t| *t < to_ms);
        for i in first..end {
            let v = &mut v_mv[self.nodes[i] as usize];
            if *v < self.current.end_mv {
                *v += self
                    .current
                    .depolarisation_mv(from_ms - self.times_ms[i], to_ms - self.times_ms[i]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURRENT: FootCurrent = FootCurrent {
        amplitude_mv: 1.0,
        tau_ms: 0.25,
        length_ms: 1.0,
        end_mv: 1e9,
    };

    #[test]
    fn the_charge_does_not_depend_on_the_step() {
        let whole = CURRENT.depolarisation_mv(-3.0, 7.0);
        assert!((whole - (4f64.exp() - 1.0)).abs() < 1e-12);
        for step in [0.3, 0.025, 2.0] {
            let parts: f64 = (0..100)
                .map(|i| {
                    CURRENT.depolarisation_mv(
                        -1.0 + step * f64::from(i),
                        -1.0 + step * f64::from(i + 1),
                    )
                })
                .sum();
            assert!((parts - whole).abs() < 1e-10, "{step}: {parts} {whole}");
        }
    }

    #[test]
    fn every_node_gets_its_charge_at_its_time_in_every_beat() {
        let times = [4.0, 0.0, 9.5, 4.01];
        let feet = Feet::new(CURRENT, &times, Some(10.0));
        let mut v = [0.0; 4];
        let whole = CURRENT.depolarisation_mv(0.0, 1.0);
        let mut at = 0.0;
        while at < 26.0 - 1e-9 {
            feet.add(at, at + 0.03125, &mut v);
            at += 0.03125;
        }
        // The third node's current extends beyond the end of the cycle.
        for (found, beats) in v.iter().zip([3.0, 3.0, 2.0, 3.0]) {
            assert!((found - beats * whole).abs() < 1e-9, "{v:?}");
        }
    }

    #[test]
    fn a_depolarised_node_gets_none() {
        let feet = Feet::new(
            FootCurrent {
                end_mv: -50.0,
                ..CURRENT
            },
            &[0.0, 0.0],
            None,
        );
        let mut v = [-84.0, 20.0];
        feet.add(0.0, 0.5, &mut v);
        assert!(v[0] > -84.0 && v[1] == 20.0);
    }
}

//! A valve whose leaflets take time to move, with inertia and kinetic loss of its blood.
//!
//! Mynard et al. 2012, Int J Numer Methods Biomed Eng 28:626: dζ/dt = K (1 − ζ) Δp while opening
//! and K ζ Δp while closing; Δp = R Q + B Q|Q| + L dQ/dt with B = ρ/(2 A²), L = ρ l/A and A the
//! open area.

/// Density of blood in mmHg s²/cm².
const DENSITY: f64 = 1.06 / 1333.22;
/// Area of a closed valve, which keeps the equations regular \[cm²\].
const CLOSED_CM2: f64 = 1e-3;

/// Parameters of one valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Valve {
    /// Effective area when open \[cm²\].
    pub open_cm2: f64,
    /// Effective area that leaks when closed \[cm²\].
    pub leak_cm2: f64,
    /// Length of the moving blood \[cm\].
    pub length_cm: f64,
    /// Linear resistance when open \[mmHg s/mL\].
    pub resistance: f64,
    /// Rate of opening \[1/(mmHg s)\].
    pub opening: f64,
    /// Rate of closing \[1/(mmHg s)\].
    pub closing: f64,
}

/// State of a valve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ValveState {
    /// Flow through the valve \[mL/s\].
    pub flow: f64,
    /// Opening of the leaflets, 0 to 1.
    pub opening: f64,
}

impl Valve {
    /// Area with this kinetic loss B \[mmHg s²/mL²\].
    #[must_use]
    pub fn area_of_loss(loss: f64) -> f64 {
        (0.5 * DENSITY / loss).sqrt()
    }

    /// Kinetic loss B of an area \[mmHg s²/mL²\].
    #[must_use]
    pub fn loss_of_area(area_cm2: f64) -> f64 {
        0.5 * DENSITY / (area_cm2 * area_cm2)
    }

    /// State after a step under a pressure difference \[mmHg\]; implicit in the flow.
    #[must_use]
    pub fn step(&self, state: ValveState, difference: f64, dt_s: f64) -> ValveState {
        let rate = if difference > 0.0 {
            self.opening * (1.0 - state.opening) * difference
        } else {
            self.closing * state.opening * difference
        };
        let opening = (state.opening + dt_s * rate).clamp(0.0, 1.0);
        let closed = self.leak_cm2.max(CLOSED_CM2);
        let area = closed + (self.open_cm2 - closed).max(0.0) * opening;
        let (inertance, loss) = (DENSITY * self.length_cm / area, Self::loss_of_area(area));
        let k = dt_s / inertance;
        let flow =
            (state.flow + k * difference) / (1.0 + k * (self.resistance + loss * state.flow.abs()));
        ValveState { flow, opening }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AORTIC: Valve = Valve {
        open_cm2: 5.0,
        leak_cm2: 0.0,
        length_cm: 1.5,
        resistance: 0.004,
        opening: 20.0,
        closing: 60.0,
    };

    fn settled(valve: &Valve, difference: f64) -> f64 {
        let mut state = ValveState::default();
        for _ in 0..40_000 {
            state = valve.step(state, difference, 1e-4);
        }
        state.flow
    }

    #[test]
    fn a_steady_flow_is_that_of_gorlin_and_resistance() {
        let flow = settled(&AORTIC, 5.0);
        let loss = Valve::loss_of_area(5.0);
        assert!(
            (AORTIC.resistance * flow + loss * flow * flow - 5.0).abs() < 1e-6,
            "{flow}"
        );
        assert!((Valve::area_of_loss(loss) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_closed_valve_holds_and_a_leaking_one_leaks_as_an_orifice() {
        assert!(settled(&AORTIC, -80.0).abs() < 0.5);
        let leaking = Valve {
            leak_cm2: 0.2,
            resistance: 0.0,
            ..AORTIC
        };
        let expected = -0.2 * (2.0 * 80.0 / DENSITY).sqrt();
        assert!((settled(&leaking, -80.0) / expected - 1.0).abs() < 1e-3);
    }
}

//! The generalised-α family for equations of motion `M a + G(u, v) = 0`.
//!
//! Source: Chung and Hulbert 1993, J Appl Mech 60:371. The inertia term is taken at `n + 1 − α_m`; of the forces the
//! weighted mean of both ends, `(1 − α_f) G_{n+1} + α_f G_n`, so that pressure and flow keep their meaning at the step's end.

/// Parameters of the family.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeneralisedAlpha {
    /// Weight of the old acceleration.
    pub alpha_m: f64,
    /// Weight of the old forces.
    pub alpha_f: f64,
    /// Coefficient β of Newmark's displacement.
    pub beta: f64,
    /// Coefficient γ of Newmark's velocity.
    pub gamma: f64,
}

/// Weights outside of the family's stable range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "generalised-α: alpha_m = {alpha_m}, alpha_f = {alpha_f}, but it must be alpha_m ≤ alpha_f ≤ 1/2"
)]
pub struct TimeIntegrationError {
    /// Weight α_m that was given.
    pub alpha_m: f64,
    /// Weight α_f that was given.
    pub alpha_f: f64,
}

impl GeneralisedAlpha {
    /// The member that damps the highest frequencies by the factor `rho` a step, 0 (at once) to 1 (never); cut to that range.
    #[must_use]
    pub fn with_spectral_radius(rho: f64) -> Self {
        let rho = rho.clamp(0.0, 1.0);
        Self::of_second_order((2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0))
    }

    /// The member with these weights.
    ///
    /// # Errors
    /// [`TimeIntegrationError`] where it would not be unconditionally stable for linear problems.
    pub fn with_weights(alpha_m: f64, alpha_f: f64) -> Result<Self, TimeIntegrationError> {
        if alpha_m <= alpha_f && alpha_f <= 0.5 {
            Ok(Self::of_second_order(alpha_m, alpha_f))
        } else {
            Err(TimeIntegrationError { alpha_m, alpha_f })
        }
    }

    fn of_second_order(alpha_m: f64, alpha_f: f64) -> Self {
        let shift = alpha_f - alpha_m;
        Self {
            alpha_m,
            alpha_f,
            beta: 0.25 * (1.0 + shift).powi(2),
            gamma: 0.5 + shift,
        }
    }

    /// `∂v/∂u` at the end of a step \[1/ms\].
    #[must_use]
    pub fn velocity_rate(&self, dt_ms: f64) -> f64 {
        self.gamma / (self.beta * dt_ms)
    }

    /// `∂a/∂u` at the end of a step \[1/ms²\].
    #[must_use]
    pub fn acceleration_rate(&self, dt_ms: f64) -> f64 {
        1.0 / (self.beta * dt_ms * dt_ms)
    }

    /// Displacement at the end of a step with constant acceleration: where Newton starts.
    pub fn predict(&self, dt_ms: f64, now: &Motion, u: &mut Vec<f64>) {
        u.clear();
        u.extend((0..now.u.len()).map(|k| now.u[k] + dt_ms * (now.v[k] + 0.5 * dt_ms * now.a[k])));
    }

    /// Velocity and acceleration that belong to the displacement `end.u` at the end of a step from `now`.
    pub fn advance(&self, dt_ms: f64, now: &Motion, end: &mut Motion) {
        let Self { beta, gamma, .. } = *self;
        let rate = self.acceleration_rate(dt_ms);
        end.v.resize(end.u.len(), 0.0);
        end.a.resize(end.u.len(), 0.0);
        for k in 0..end.u.len() {
            let (v, a) = (now.v[k], now.a[k]);
            end.a[k] = rate * (end.u[k] - now.u[k] - dt_ms * v) - (0.5 / beta - 1.0) * a;
            end.v[k] = v + dt_ms * ((1.0 - gamma) * a + gamma * end.a[k]);
        }
    }
}

/// Displacement \[mm\], velocity \[mm/ms\] and acceleration \[mm/ms²\], three numbers a node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Motion {
    /// Displacement from the reference configuration \[mm\].
    pub u: Vec<f64>,
    /// Velocity of the nodes \[mm/ms\].
    pub v: Vec<f64>,
    /// Acceleration of the nodes \[mm/ms²\].
    pub a: Vec<f64>,
}

impl Motion {
    /// At rest, displaced by `u`.
    #[must_use]
    pub fn at_rest(u: Vec<f64>) -> Self {
        Self {
            v: vec![0.0; u.len()],
            a: vec![0.0; u.len()],
            u,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A damped linear oscillator, m a + c v + k u = 0, from u = 1 at rest; returns u(t).
    fn oscillate(scheme: GeneralisedAlpha, [m, c, k]: [f64; 3], n: usize, t: f64) -> f64 {
        let dt = t / n as f64;
        let mut now = Motion {
            u: vec![1.0],
            v: vec![0.0],
            a: vec![-k / m],
        };
        let (am, af) = (scheme.alpha_m, scheme.alpha_f);
        for _ in 0..n {
            let mut end = Motion::default();
            scheme.predict(dt, &now, &mut end.u);
            scheme.advance(dt, &now, &mut end);
            let force = |s: &Motion| c * s.v[0] + k * s.u[0];
            let residual = m * ((1.0 - am) * end.a[0] + am * now.a[0])
                + (1.0 - af) * force(&end)
                + af * force(&now);
            let slope = (1.0 - am) * m * scheme.acceleration_rate(dt)
                + (1.0 - af) * (c * scheme.velocity_rate(dt) + k);
            end.u[0] -= residual / slope;
            scheme.advance(dt, &now, &mut end);
            now = end;
        }
        now.u[0]
    }

    #[test]
    fn every_member_is_of_second_order() {
        let (m, c, k) = (2.0_f64, 0.3_f64, 5.0_f64);
        let (d, w) = (
            c / (2.0 * m),
            (k / m - (c / (2.0 * m)) * (c / (2.0 * m))).sqrt(),
        );
        let exact = |t: f64| (-d * t).exp() * ((w * t).cos() + d / w * (w * t).sin());
        let benchmark = GeneralisedAlpha::with_weights(0.2, 0.4).expect("in the stable range");
        for scheme in [0.0, 0.5, 1.0]
            .map(GeneralisedAlpha::with_spectral_radius)
            .into_iter()
            .chain([benchmark])
        {
            let error = |n| (oscillate(scheme, [m, c, k], n, 3.0) - exact(3.0)).abs();
            let order = (error(100) / error(200)).log2();
            assert!((1.85..2.2).contains(&order), "{scheme:?}: order {order}");
        }
    }

    #[test]
    fn spectral_radius_is_what_a_stiff_oscillator_shows() {
        // At rho = 0 a stiff mode is gone after a few steps, at rho = 1 it never goes.
        let last = |rho| {
            oscillate(
                GeneralisedAlpha::with_spectral_radius(rho),
                [1.0, 0.0, 1e8],
                40,
                40.0,
            )
            .abs()
        };
        assert!(last(0.0) < 1e-6, "{}", last(0.0));
        assert!(last(1.0) > 0.9, "{}", last(1.0));
        assert!(GeneralisedAlpha::with_weights(0.5, 0.4).is_err());
    }
}

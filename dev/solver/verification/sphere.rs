//! The thick sphere as a problem in its radius alone: what the elements' solutions converge to at a finite bulk modulus.

use super::problems::SPHERE;

/// Pressure \[kPa\] in the incompressible neo-Hookean sphere, µ = 1 kPa, whose inner radius is stretched by `inner`.
pub fn incompressible_pressure(inner: f64) -> f64 {
    let [a, b] = SPHERE;
    let outer = (b.powi(3) + (inner * a).powi(3) - a.powi(3)).cbrt() / b;
    let f = |l: f64| 2.0 / l + 0.5 / l.powi(4);
    f(outer) - f(inner)
}

/// Derivatives of `µ/2 (Ī₁ − 3) + κ/2 (ln J)²` by the radial and the hoop stretch, which counts twice in `Ī₁` and `J`.
fn stress(radial: f64, hoop: f64, kappa: f64) -> [f64; 2] {
    let j = radial * hoop * hoop;
    let i1 = radial * radial + 2.0 * hoop * hoop;
    let shear = 0.5 * j.powf(-2.0 / 3.0);
    [
        shear * (2.0 * radial - 2.0 / 3.0 * i1 / radial) + kappa * j.ln() / radial,
        shear * (4.0 * hoop - 4.0 / 3.0 * i1 / hoop) + 2.0 * kappa * j.ln() / hoop,
    ]
}

/// The radial stretch at which the radial stress is `wanted`.
fn radial_stretch(wanted: f64, hoop: f64, kappa: f64) -> f64 {
    let (mut low, mut high) = (0.1, 3.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if stress(middle, hoop, kappa)[0] < wanted {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

/// Radial stress at the outer surface when the inner one is stretched by `inner` under `pressure`: (R² P)' = R ∂W/∂λ by the
/// classical Runge-Kutta method.
fn outer_stress(inner: f64, pressure: f64, kappa: f64) -> f64 {
    let [a, b] = SPHERE;
    let slope = |radius: f64, [r, s]: [f64; 2]| {
        let hoop = r / radius;
        let radial = radial_stretch(s / (radius * radius), hoop, kappa);
        [radial, radius * stress(radial, hoop, kappa)[1]]
    };
    let n = 200;
    let h = (b - a) / f64::from(n);
    let mut y = [inner * a, -pressure * (inner * a).powi(2)];
    for k in 0..n {
        let x = a + h * f64::from(k);
        let along = |d: [f64; 2], w: f64| [y[0] + w * d[0], y[1] + w * d[1]];
        let k1 = slope(x, y);
        let k2 = slope(x + 0.5 * h, along(k1, 0.5 * h));
        let k3 = slope(x + 0.5 * h, along(k2, 0.5 * h));
        let k4 = slope(x + h, along(k3, h));
        y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    y[1] / (b * b)
}

/// Stretch of the inner surface under `pressure` at a bulk modulus \[kPa\], by shooting for an outer surface without stress.
pub fn inner_stretch(pressure: f64, kappa: f64) -> f64 {
    // Secants: the stress outside grows with the stretch inside.
    let (mut x0, mut x1) = (1.29, 1.31);
    let (mut f0, mut f1) = (
        outer_stress(x0, pressure, kappa),
        outer_stress(x1, pressure, kappa),
    );
    for _ in 0..30 {
        if (x1 - x0).abs() < 1e-13 || f1 == f0 {
            break;
        }
        let x2 = x1 - f1 * (x1 - x0) / (f1 - f0);
        (x0, f0, x1) = (x1, f1, x2);
        f1 = outer_stress(x1, pressure, kappa);
    }
    x1
}

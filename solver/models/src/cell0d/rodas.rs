//! RODAS: a stiffly accurate, L-stable Rosenbrock method of order 4(3) with dense output of order 3 for the 0D cell.
//!
//! Coefficients: Hairer and Wanner, Solving Ordinary Differential Equations II (2nd ed. 1996), section VI.4. Each stage
//! solves `(M/(hγ) − J) u_i = f(t + c_i h, y + Σ a_ij u_j) + M Σ (c_ij/h) u_j + d_i h f_t`.

use super::system::{LAMBDA, N, System, Vector};

const GAMMA: f64 = 0.25;
const TIMES: [f64; 4] = [0.0, 0.386, 0.21, 0.63];
const D: [f64; 4] = [0.25, -0.1043, 0.1035, -0.036_200_000_000_000_23];
const A2: [f64; 1] = [1.544];
const A3: [f64; 2] = [0.946_678_528_081_582_6, 0.255_701_169_898_328_4];
const A4: [f64; 3] = [
    3.314_825_187_068_521,
    2.896_124_015_972_201,
    0.998_641_913_997_781_7,
];
const A5: [f64; 4] = [
    1.221_224_509_226_641,
    6.019_134_481_288_629,
    12.537_083_329_320_87,
    -0.687_886_036_105_895,
];
const C2: [f64; 1] = [-5.6688];
const C3: [f64; 2] = [-2.430_093_356_833_875, -0.206_359_915_709_191_5];
const C4: [f64; 3] = [
    -0.107_352_905_815_137_5,
    -9.594_562_251_023_355,
    -20.470_286_148_096_16,
];
const C5: [f64; 4] = [
    7.496_443_313_967_647,
    -10.246_804_314_643_52,
    -33.999_903_528_199_05,
    11.708_908_932_061_6,
];
const C6: [f64; 5] = [
    8.083_246_795_921_522,
    -7.981_132_988_064_893,
    -31.521_594_328_743_71,
    16.319_305_431_231_36,
    -6.058_818_238_834_054,
];
/// Dense output.
const H2: [f64; 5] = [
    10.126_235_083_445_86,
    -7.487_995_877_610_167,
    -34.800_918_615_557_47,
    -7.992_771_707_568_823,
    1.025_137_723_295_662,
];
const H3: [f64; 5] = [
    -0.676_280_339_280_125_3,
    6.087_714_651_680_015,
    16.430_843_208_924_78,
    24.767_225_114_183_86,
    -6.594_389_125_716_872,
];

/// A tried step: the new unknowns, the error estimate and what the dense output needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub t_ms: f64,
    pub h_ms: f64,
    start: Vector,
    pub end: Vector,
    pub error: Vector,
    dense2: Vector,
    dense3: Vector,
}

/// Everything of a step that depends on its start alone, kept when the step is tried again with another length.
#[derive(Debug)]
pub(crate) struct Linearised {
    rhs: Vector,
    time_rate: f64,
    jacobian: super::system::Jacobian,
}

/// `base + Σ weights · stages`.
#[inline]
fn combine<const K: usize>(base: &Vector, weights: &[f64; K], stages: &[Vector; 6]) -> Vector {
    let mut out = *base;
    for (weight, stage) in weights.iter().zip(stages) {
        for (value, u) in out.iter_mut().zip(stage) {
            *value += weight * u;
        }
    }
    out
}

/// Evaluates equations and Jacobian at the start of a step.
pub(crate) fn linearise(system: &System<'_>, t_ms: f64, y: &Vector) -> Linearised {
    let (rhs, time_rate, jacobian) = system.linearise(t_ms, y);
    Linearised {
        rhs,
        time_rate,
        jacobian,
    }
}

/// Tries one step of length `h_ms`; `None` where the step's matrix is singular.
pub(crate) fn try_step(
    system: &System<'_>,
    at: &Linearised,
    t_ms: f64,
    y: &Vector,
    h_ms: f64,
) -> Option<Step> {
    let factored = system.factor(&at.jacobian, 1.0 / (GAMMA * h_ms))?;
    let inverse_h = 1.0 / h_ms;
    // Right-hand side of a stage: the equations, the mass matrix times earlier stages (not for the balance), and f_t.
    let stage = |mut r: Vector, coupling: &Vector, d: f64| {
        for i in 0..LAMBDA {
            r[i] += inverse_h * coupling[i];
        }
        r[0] += d * h_ms * at.time_rate;
        factored.solve(&r)
    };
    let zero = [0.0; N];
    let mut u = [zero; 6];
    u[0] = stage(at.rhs, &zero, D[0]);
    u[1] = stage(
        system.rhs(t_ms + TIMES[1] * h_ms, &combine(y, &A2, &u)),
        &combine(&zero, &C2, &u),
        D[1],
    );
    u[2] = stage(
        system.rhs(t_ms + TIMES[2] * h_ms, &combine(y, &A3, &u)),
        &combine(&zero, &C3, &u),
        D[2],
    );
    u[3] = stage(
        system.rhs(t_ms + TIMES[3] * h_ms, &combine(y, &A4, &u)),
        &combine(&zero, &C4, &u),
        D[3],
    );
    let fifth = combine(y, &A5, &u);
    u[4] = stage(
        system.rhs(t_ms + h_ms, &fifth),
        &combine(&zero, &C5, &u),
        0.0,
    );
    let sixth: Vector = std::array::from_fn(|i| fifth[i] + u[4][i]);
    u[5] = stage(
        system.rhs(t_ms + h_ms, &sixth),
        &combine(&zero, &C6, &u),
        0.0,
    );
    Some(Step {
        t_ms,
        h_ms,
        start: *y,
        end: std::array::from_fn(|i| sixth[i] + u[5][i]),
        error: u[5],
        dense2: combine(&zero, &H2, &u),
        dense3: combine(&zero, &H3, &u),
    })
}

impl Step {
    /// Unknowns at a time inside the step.
    #[inline]
    pub fn at(&self, t_ms: f64) -> Vector {
        let s = (t_ms - self.t_ms) / self.h_ms;
        let s1 = 1.0 - s;
        std::array::from_fn(|i| {
            self.start[i] * s1 + s * (self.end[i] + s1 * (self.dense2[i] + s * self.dense3[i]))
        })
    }
}

//! RODAS (Hairer & Wanner, Solving Ordinary Differential Equations II, section VI.4): six stages, order 4 with an embedded
//! solution of order 3, stiffly accurate, for index-1 differential-algebraic systems.
//!
//! The form is that of their code: stages u_i solve (M/(hγ) − J) u_i = f(x + Σ a_ij u_j) + M Σ (c_ij/h) u_j + h d_i f_t.
//! Stage 6 takes stage 5's arguments plus u_5, and the new state stage 6's plus u_6; u_6 is the error estimate.
//! The coefficients are checked by the order of convergence that the engine shows (`fourth_order_in_states_and_stretch` in `step.rs`).

/// γ.
pub const GAMMA: f64 = 0.25;
/// Abscissae of stages 2 to 4; stages 5 and 6 stand at the end of the step. The third is three times the second.
pub const C2: f64 = 0.386;
/// Of stage 3.
pub const C3: f64 = 0.21;
/// Weights of the explicit time derivative in stages 1 to 4.
pub const D: [f64; 4] = [0.25, -0.1043, 0.1035, -0.0362];
/// Arguments of stage 2.
pub const A2: [f64; 1] = [1.544];
/// Arguments of stage 3.
pub const A3: [f64; 2] = [0.946_678_528_081_582_6, 0.255_701_169_898_328_4];
/// Arguments of stage 4.
pub const A4: [f64; 3] = [
    3.314_825_187_068_521,
    2.896_124_015_972_201,
    0.998_641_913_997_781_7,
];
/// Arguments of stage 5.
pub const A5: [f64; 4] = [
    1.221_224_509_226_641,
    6.019_134_481_288_629,
    12.537_083_329_320_87,
    -0.687_886_036_105_895,
];
/// Couplings of stage 2.
pub const G2: [f64; 1] = [-5.6688];
/// Couplings of stage 3.
pub const G3: [f64; 2] = [-2.430_093_356_833_875, -0.206_359_915_709_191_5];
/// Couplings of stage 4.
pub const G4: [f64; 3] = [
    -0.107_352_905_815_137_5,
    -9.594_562_251_023_355,
    -20.470_286_148_096_16,
];
/// Couplings of stage 5.
pub const G5: [f64; 4] = [
    7.496_443_313_967_647,
    -10.246_804_314_643_52,
    -33.999_903_528_199_05,
    11.708_908_932_061_6,
];
/// Couplings of stage 6.
pub const G6: [f64; 5] = [
    8.083_246_795_921_522,
    -7.981_132_988_064_893,
    -31.521_594_328_743_71,
    16.319_305_431_231_36,
    -6.058_818_238_834_054,
];

//! Coefficients of RODAS (Hairer and Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, section VI.4): six
//! stages, order 4 with an embedded solution of order 3, stiffly accurate, for index-1 differential-algebraic systems.
//!
//! The form is that of their code: stages u_i solve
//! `(M/(hγ) − J) u_i = f(t + c_i h, y + Σ a_ij u_j) + M Σ (c_ij/h) u_j + d_i h f_t`. Stage 6 takes the arguments of stage 5 plus u_5, and the new state those of stage 6 plus u_6; u_6 is the
//! error estimate. The order of convergence of the engine's lanes tests the coefficients of the stages.

/// Diagonal coefficient γ of all stages.
pub const GAMMA: f64 = 0.25;
/// Abscissae of stages 1 to 4; stages 5 and 6 stand at the end of the step. The fourth is three times the third.
pub const TIMES: [f64; 4] = [0.0, 0.386, 0.21, 0.63];
/// Weights of the explicit time derivative in stages 1 to 4.
pub const D: [f64; 4] = [0.25, -0.1043, 0.1035, -0.036_200_000_000_000_23];
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
pub const C2: [f64; 1] = [-5.6688];
/// Couplings of stage 3.
pub const C3: [f64; 2] = [-2.430_093_356_833_875, -0.206_359_915_709_191_5];
/// Couplings of stage 4.
pub const C4: [f64; 3] = [
    -0.107_352_905_815_137_5,
    -9.594_562_251_023_355,
    -20.470_286_148_096_16,
];
/// Couplings of stage 5.
pub const C5: [f64; 4] = [
    7.496_443_313_967_647,
    -10.246_804_314_643_52,
    -33.999_903_528_199_05,
    11.708_908_932_061_6,
];
/// Couplings of stage 6.
pub const C6: [f64; 5] = [
    8.083_246_795_921_522,
    -7.981_132_988_064_893,
    -31.521_594_328_743_71,
    16.319_305_431_231_36,
    -6.058_818_238_834_054,
];
/// Dense output, second-order term.
pub const H2: [f64; 5] = [
    10.126_235_083_445_86,
    -7.487_995_877_610_167,
    -34.800_918_615_557_47,
    -7.992_771_707_568_823,
    1.025_137_723_295_662,
];
/// Dense output, third-order term.
pub const H3: [f64; 5] = [
    -0.676_280_339_280_125_3,
    6.087_714_651_680_015,
    16.430_843_208_924_78,
    24.767_225_114_183_86,
    -6.594_389_125_716_872,
];

//! Quantiles of the standard normal distribution.

/// Value that a standard normal variable stays below with this probability; infinite at 0 and 1.
///
/// Source: Wichura 1988, Appl. Stat. 37:477, algorithm AS 241 (PPND16), relative accuracy about
/// 1e-16.
#[must_use]
pub fn quantile(probability: f64) -> f64 {
    let q = probability - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * polynomial(&CENTRE_UPPER, r) / polynomial(&CENTRE_LOWER, r);
    }
    let tail = if q < 0.0 {
        probability
    } else {
        1.0 - probability
    };
    if tail <= 0.0 {
        return if tail < 0.0 || tail.is_nan() {
            f64::NAN
        } else {
            f64::INFINITY.copysign(q)
        };
    }
    let r = (-tail.ln()).sqrt();
    let value = if r <= 5.0 {
        polynomial(&MIDDLE_UPPER, r - 1.6) / polynomial(&MIDDLE_LOWER, r - 1.6)
    } else {
        polynomial(&TAIL_UPPER, r - 5.0) / polynomial(&TAIL_LOWER, r - 5.0)
    };
    value.copysign(q)
}

/// Evaluates a polynomial whose coefficients start with the constant.
fn polynomial(coefficients: &[f64; 8], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

const CENTRE_UPPER: [f64; 8] = [
    3.387_132_872_796_366_5,
    133.141_667_891_784_38,
    1_971.590_950_306_551_3,
    13_731.693_765_509_46,
    45_921.953_931_549_87,
    67_265.770_927_008_7,
    33_430.575_583_588_13,
    2_509.080_928_730_122_7,
];
const CENTRE_LOWER: [f64; 8] = [
    1.0,
    42.313_330_701_600_91,
    687.187_007_492_057_9,
    5_394.196_021_424_751,
    21_213.794_301_586_597,
    39_307.895_800_092_71,
    28_729.085_735_721_943,
    5_226.495_278_852_854,
];
const MIDDLE_UPPER: [f64; 8] = [
    1.423_437_110_749_683_6,
    4.630_337_846_156_546,
    5.769_497_221_460_691,
    3.647_848_324_763_204_5,
    1.270_458_252_452_368_4,
    0.241_780_725_177_450_6,
    0.022_723_844_989_269_184,
    7.745_450_142_783_414e-4,
];
const MIDDLE_LOWER: [f64; 8] = [
    1.0,
    2.053_191_626_637_759,
    1.676_384_830_183_803_8,
    0.689_767_334_985_1,
    0.148_103_976_427_480_08,
    0.015_198_666_563_616_457,
    5.475_938_084_995_345e-4,
    1.050_750_071_644_416_9e-9,
];
const TAIL_UPPER: [f64; 8] = [
    6.657_904_643_501_103,
    5.463_784_911_164_114,
    1.784_826_539_917_291_3,
    0.296_560_571_828_504_87,
    0.026_532_189_526_576_124,
    0.001_242_660_947_388_078_4,
    2.711_555_568_743_487_6e-5,
    2.010_334_399_292_288_1e-7,
];
const TAIL_LOWER: [f64; 8] = [
    1.0,
    0.599_832_206_555_888,
    0.136_929_880_922_735_8,
    0.014_875_361_290_850_615,
    7.868_691_311_456_133e-4,
    1.846_318_317_510_054_8e-5,
    1.421_511_758_316_446e-7,
    2.044_263_103_389_939_8e-15,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(
        clippy::unreadable_literal,
        reason = "printed by SciPy 1.17.1, norm.ppf"
    )]
    fn quantiles_are_those_of_the_tables() {
        for (p, z) in [
            (1e-300, -37.0470962993612),
            (1e-20, -9.262340089798409),
            (1e-06, -4.753424308822899),
            (0.001, -3.090232306167813),
            (0.0249, -1.9616778690637864),
            (0.074, -1.4466320671589785),
            (0.0751, -1.4388253927525403),
            (0.2, -0.8416212335729142),
            (0.4, -0.2533471031357997),
        ] {
            assert!(
                (quantile(p) - z).abs() <= 4e-15 * z.abs().max(1e-300),
                "{p}: {} {z}",
                quantile(p)
            );
            // 1 - p is rounded by up to half a unit in the last place of one; for the smallest p
            // nothing remains.
            let rounding = 1e-16 / p;
            assert!(rounding >= 1.0 || (quantile(1.0 - p) + z).abs() <= rounding + 4e-15 * z.abs());
        }
        assert_eq!(
            (quantile(0.0), quantile(1.0)),
            (f64::NEG_INFINITY, f64::INFINITY)
        );
        assert!(quantile(-0.1).is_nan() && quantile(f64::NAN).is_nan());
    }
}

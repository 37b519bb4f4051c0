//! Functions with known indices, failed rows and prefixes of designs.

use super::*;
use crate::Interval;
use std::f64::consts::PI;

fn design(interval: Interval, n_parameters: usize, n_blocks: usize) -> SaltelliDesign {
    let settings = DesignSettings {
        n_blocks,
        ..DesignSettings::default()
    };
    SaltelliDesign::new(&vec![interval; n_parameters], settings).unwrap()
}

fn evaluate(design: &SaltelliDesign, f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    design
        .rows(0..design.n_blocks())
        .iter()
        .map(|x| f(x))
        .collect()
}

fn ishigami(x: &[f64]) -> f64 {
    x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
}

fn value(index: Option<SobolIndex>) -> f64 {
    index.unwrap().value
}

/// Ishigami and Homma 1990: V1 = (1 + b π⁴/5)²/2, V2 = a²/8, V13 = 8 b² π⁸/225.
#[test]
fn ishigami_s_indices() {
    let design = design(Interval::new(-PI, PI), 3, 1 << 14);
    let analysis = analyse(
        3,
        1,
        &evaluate(&design, ishigami),
        AnalysisSettings::default(),
    )
    .unwrap();
    let output = &analysis.outputs[0];
    let (v1, v2) = (0.5 * (1.0 + 0.1 * PI.powi(4) / 5.0).powi(2), 49.0 / 8.0);
    let v13 = 8.0 * 0.01 * PI.powi(8) / 225.0;
    let v = v1 + v2 + v13;
    for (p, (first, total)) in [(v1, v1 + v13), (v2, v2), (0.0, v13)]
        .into_iter()
        .enumerate()
    {
        assert!(
            (value(output.first[p]) - first / v).abs() < 5e-3,
            "{output:?}"
        );
        assert!(
            (value(output.total[p]) - total / v).abs() < 5e-3,
            "{output:?}"
        );
        assert!(
            (value(output.first[p]) - first / v).abs()
                <= 3.0 * output.first[p].unwrap().half_width.unwrap()
        );
    }
    for ([j, k], expected) in [([0, 1], 0.0), ([0, 2], v13 / v), ([1, 2], 0.0)] {
        assert!(
            (value(output.second_of(k, j)) - expected).abs() < 1e-2,
            "{output:?}"
        );
    }
    assert!((output.sum_of_first() - (v1 + v2) / v).abs() < 1e-2);
    assert!(
        (output.mean.unwrap() - 3.5).abs() < 1e-2
            && (output.standard_deviation.unwrap() - v.sqrt()).abs() < 2e-2
    );
}

/// Saltelli and Sobol 1995: Vi = 1/(3 (1 + ai)²), V = Π(1 + Vi) - 1, total of i = Vi Π(others' 1 +
/// V).
#[test]
fn sobol_s_g_function() {
    let a = [0.0, 0.5, 3.0, 9.0, 99.0];
    let design = design(Interval::new(0.0, 1.0), 5, 1 << 14);
    let g = |x: &[f64]| {
        x.iter()
            .zip(a)
            .map(|(x, a)| ((4.0 * x - 2.0).abs() + a) / (1.0 + a))
            .product()
    };
    let analysis = analyse(5, 1, &evaluate(&design, g), AnalysisSettings::default()).unwrap();
    let parts = a.map(|a| 1.0 / (3.0 * (1.0 + a) * (1.0 + a)));
    let product: f64 = parts.iter().map(|v| 1.0 + v).product();
    for (p, v) in parts.into_iter().enumerate() {
        let (first, total) = (
            v / (product - 1.0),
            v * product / (1.0 + v) / (product - 1.0),
        );
        assert!((value(analysis.outputs[0].first[p]) - first).abs() < 6e-3);
        assert!((value(analysis.outputs[0].total[p]) - total).abs() < 6e-3);
    }
}

/// A failed row does not change the indices that do not need it. The other indices equal those over
/// the remaining blocks.
#[test]
fn failures_are_dropped_pairwise() {
    let design = design(Interval::new(-PI, PI), 3, 64);
    let settings = AnalysisSettings {
        n_resamples: 50,
        ..AnalysisSettings::default()
    };
    let values = evaluate(&design, ishigami);
    let mut failed = values.clone();
    let (block, ab_1) = (17, 1 + 1);
    failed[block * 8 + ab_1] = f64::NAN;
    let output = &analyse(3, 1, &failed, settings).unwrap().outputs[0];
    assert_eq!(output.n_failed_rows, 1);
    let n = |i: Option<SobolIndex>| i.unwrap().n_blocks;
    assert_eq!(
        output.first.iter().map(|i| n(*i)).collect::<Vec<_>>(),
        [64, 63, 64]
    );
    assert_eq!(
        output.total.iter().map(|i| n(*i)).collect::<Vec<_>>(),
        [64, 63, 64]
    );
    // AB of the second parameter belongs to all its pairs; BA of a pair's first parameter belongs
    // only to that pair.
    assert_eq!(
        output.second.iter().map(|p| n(p.index)).collect::<Vec<_>>(),
        [63, 64, 63]
    );
    let without: Vec<f64> = values
        .chunks(8)
        .enumerate()
        .filter(|(b, _)| *b != block)
        .flat_map(|(_, rows)| rows.to_vec())
        .collect();
    let rest = &analyse(3, 1, &without, settings).unwrap().outputs[0];
    let whole = &analyse(3, 1, &values, settings).unwrap().outputs[0];
    // Totals do not depend on the mean that is subtracted and are equal to rounding.
    assert!((value(output.total[1]) - value(rest.total[1])).abs() < 1e-13);
    for p in [0, 2] {
        assert!((value(output.total[p]) - value(whole.total[p])).abs() < 1e-13);
    }
    // The other indices depend on it weakly.
    assert!((value(output.first[1]) - value(rest.first[1])).abs() < 5e-3);
    assert!(
        output
            .total
            .iter()
            .all(|i| i.unwrap().half_width.unwrap() > 0.0)
    );

    let mut failed = values.clone();
    failed[block * 8 + 7] = f64::INFINITY;
    let output = &analyse(3, 1, &failed, settings).unwrap().outputs[0];
    assert!(
        output
            .first
            .iter()
            .chain(&output.total)
            .all(|i| n(*i) == 63)
    );
}

#[test]
fn an_output_without_enough_blocks_or_variation_has_no_indices() {
    let design = design(Interval::new(-PI, PI), 3, 8);
    let values = evaluate(&design, ishigami);
    let settings = AnalysisSettings::default();
    for bad in [vec![f64::NAN; values.len()], vec![0.1; values.len()]] {
        let output = &analyse(3, 1, &bad, settings).unwrap().outputs[0];
        assert!(
            output
                .first
                .iter()
                .chain(&output.total)
                .all(Option::is_none)
        );
        assert!(output.second.len() == 3 && output.second.iter().all(|p| p.index.is_none()));
    }
    // The rows of one parameter failed in all blocks but one.
    let mut failed = values.clone();
    for block in 1..8 {
        failed[block * 8 + 1] = f64::NAN;
    }
    let output = &analyse(3, 1, &failed, settings).unwrap().outputs[0];
    assert!(
        output.first[0].is_none() && output.total[0].is_none() && output.second_of(0, 1).is_none()
    );
    assert!(output.first[1].is_some() && output.second_of(1, 2).is_some());
}

/// Any number of first blocks gives the analysis of the smaller design.
#[test]
fn a_prefix_is_a_design() {
    let whole = design(Interval::new(-PI, PI), 3, 64);
    let values = evaluate(&whole, ishigami);
    for n_blocks in [2, 16, 37] {
        let part = evaluate(&design(Interval::new(-PI, PI), 3, n_blocks), ishigami);
        let settings = AnalysisSettings::default();
        assert_eq!(
            analyse(3, 1, &values[..n_blocks * 8], settings),
            analyse(3, 1, &part, settings)
        );
    }
}

/// Several outputs are analysed independently, each in its own units.
#[test]
fn outputs_do_not_meet() {
    let design = design(Interval::new(-PI, PI), 3, 32);
    let values = evaluate(&design, ishigami);
    let both: Vec<f64> = values
        .iter()
        .flat_map(|v| [1e6 * v - 7e6, v.cos()])
        .collect();
    let settings = AnalysisSettings::default();
    let together = analyse(3, 2, &both, settings).unwrap();
    let alone = analyse(3, 1, &values, settings).unwrap();
    for (a, b) in together.outputs[0]
        .first
        .iter()
        .zip(&alone.outputs[0].first)
    {
        assert!((value(*a) - value(*b)).abs() < 1e-9);
        assert!((a.unwrap().half_width.unwrap() - b.unwrap().half_width.unwrap()).abs() < 1e-9);
    }
    let cosines: Vec<f64> = values.iter().map(|v| v.cos()).collect();
    assert_eq!(
        together.outputs[1],
        analyse(3, 1, &cosines, settings).unwrap().outputs[0]
    );
}

/// Intervals of 95 % cover the known index in about 95 % of scrambled designs of few points.
#[test]
fn intervals_cover() {
    let n_designs = 200;
    let covered: usize = (0..n_designs)
        .map(|seed| {
            let settings = DesignSettings {
                n_blocks: 128,
                scramble: Some(seed),
                ..DesignSettings::default()
            };
            let design = SaltelliDesign::new(&[Interval::new(-1.0, 1.0); 2], settings).unwrap();
            let values = evaluate(&design, |x| x[0] + x[1] + x[0] * x[1]);
            let analysis = analyse(2, 1, &values, AnalysisSettings::default()).unwrap();
            // Variances 1/3, 1/3, 1/9: totals 4/7.
            let covers = |i: SobolIndex| (i.value - 4.0 / 7.0).abs() <= i.half_width.unwrap();
            analysis.outputs[0]
                .total
                .iter()
                .flatten()
                .filter(|i| covers(**i))
                .count()
        })
        .sum();
    // Sobol points are more even than the independent points that the bootstrap assumes, so that it
    // errs on the safe side.
    assert!(covered as f64 >= 0.95 * 2.0 * n_designs as f64, "{covered}");
}

#[test]
fn nonsense_is_refused() {
    let settings = AnalysisSettings::default();
    assert!(matches!(
        analyse(3, 1, &[0.0; 17], settings),
        Err(SobolError::Incomplete {
            rows_per_block: 8,
            ..
        })
    ));
    assert!(matches!(
        analyse(3, 1, &[0.0; 8], settings),
        Err(SobolError::TooFewBlocks { n_blocks: 1 })
    ));
    assert!(analyse(0, 1, &[0.0; 4], settings).is_err() && analyse(1, 0, &[], settings).is_err());
    let settings = AnalysisSettings {
        confidence_level: 1.0,
        ..settings
    };
    assert!(matches!(
        analyse(1, 1, &[0.0; 8], settings),
        Err(SobolError::Confidence { .. })
    ));
}

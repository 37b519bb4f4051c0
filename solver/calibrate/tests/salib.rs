//! Sobol points, Saltelli designs, indices and bootstrap half-widths against recorded numbers of
//! `SALib`. The header of `data/salib.json` describes the script that recorded them.

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::sobol::{
    AnalysisSettings, DesignSettings, SaltelliDesign, SobolIndex, SobolPoints, analyse,
};
use serde::Deserialize;

/// Largest difference of an index or a half-width, dimensionless.
const TOLERANCE: f64 = 1e-10;

#[derive(Deserialize)]
struct Reference {
    points: Vec<Points>,
    legacy: Legacy,
    analyses: Vec<Case>,
}

#[derive(Deserialize)]
struct Points {
    n_dimensions: usize,
    scramble: Option<u64>,
    skip_points: u64,
    point_idx: Vec<u64>,
    points: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Legacy {
    skip_points: u64,
    row_idx: Vec<usize>,
    rows: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
#[expect(non_snake_case, reason = "SALib's names")]
struct Case {
    function: String,
    bounds: [f64; 2],
    n_parameters: usize,
    n_blocks: usize,
    scramble: Option<u64>,
    skip_points: u64,
    n_resamples: usize,
    seed: u64,
    output_sum: f64,
    row_idx: Vec<usize>,
    rows: Vec<Vec<f64>>,
    column_sums: Vec<f64>,
    S1: Vec<f64>,
    S1_conf: Vec<f64>,
    ST: Vec<f64>,
    ST_conf: Vec<f64>,
    S2: Vec<f64>,
    S2_conf: Vec<f64>,
}

fn reference() -> Reference {
    serde_json::from_str(include_str!("data/salib.json")).unwrap()
}

fn evaluate(function: &str, x: &[f64]) -> f64 {
    match function {
        "ishigami" => x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin(),
        "g" => x
            .iter()
            .zip([0.0, 0.5, 3.0, 9.0, 99.0, 99.0])
            .map(|(x, a)| ((4.0 * x - 2.0).abs() + a) / (1.0 + a))
            .product(),
        "synthetic" => {
            let n = x.len();
            let sum: f64 = (0..n)
                .map(|i| x[i] / (1 + i) as f64 + 0.5 * x[i] * x[(i + 1) % n])
                .sum();
            100.0 + sum + (x[0] * x[20]).exp()
        }
        other => panic!("no function {other}"),
    }
}

#[test]
fn points_are_scipy_s_bit_for_bit() {
    for case in reference().points {
        let sequence = SobolPoints::new(case.n_dimensions, case.scramble).unwrap();
        for (idx, expected) in case.point_idx.iter().zip(&case.points) {
            let expected: Vec<f64> = expected
                .iter()
                .map(|digits| digits / (1u64 << 30) as f64)
                .collect();
            assert_eq!(sequence.point(case.skip_points + idx).unwrap(), expected);
        }
    }
}

#[test]
fn the_older_sampler_differs_in_what_it_skips_alone() {
    let legacy = reference().legacy;
    let settings = DesignSettings::older_sampler(8);
    assert_eq!(
        (
            settings.skip_points,
            DesignSettings::older_sampler(1000).skip_points
        ),
        (legacy.skip_points, 1024)
    );
    let rows = SaltelliDesign::new(&[Interval::new(0.0, 1.0); 4], settings)
        .unwrap()
        .rows(0..8);
    for (idx, expected) in legacy.row_idx.iter().zip(&legacy.rows) {
        assert_eq!(&rows[*idx], expected);
    }
}

#[test]
fn designs_indices_and_half_widths_are_salib_s() {
    for case in reference().analyses {
        let intervals = vec![Interval::new(case.bounds[0], case.bounds[1]); case.n_parameters];
        let settings = DesignSettings {
            n_blocks: case.n_blocks,
            skip_points: case.skip_points,
            scramble: case.scramble,
        };
        let design = SaltelliDesign::new(&intervals, settings).unwrap();
        let rows = design.rows(0..case.n_blocks);
        assert_eq!(rows.len(), design.n_rows());
        for (idx, expected) in case.row_idx.iter().zip(&case.rows) {
            assert_eq!(&rows[*idx], expected, "row {idx} of {}", case.function);
        }
        for (d, expected) in case.column_sums.iter().enumerate() {
            let sum: f64 = rows.iter().map(|r| r[d]).sum();
            assert!(
                (sum - expected).abs() < 1e-9,
                "column {d} of {}: {sum} {expected}",
                case.function
            );
        }
        let values: Vec<f64> = rows.iter().map(|x| evaluate(&case.function, x)).collect();
        assert!((values.iter().sum::<f64>() / case.output_sum - 1.0).abs() < 1e-12);

        let settings = AnalysisSettings {
            n_resamples: case.n_resamples,
            seed: case.seed,
            ..AnalysisSettings::default()
        };
        let analysis = analyse(case.n_parameters, 1, &values, settings).unwrap();
        let output = &analysis.outputs[0];
        let second: Vec<Option<SobolIndex>> = output.second.iter().map(|p| p.index).collect();
        let mut largest: f64 = 0.0;
        for (ours, values, half_widths) in [
            (&output.first, &case.S1, &case.S1_conf),
            (&output.total, &case.ST, &case.ST_conf),
            (&second, &case.S2, &case.S2_conf),
        ] {
            assert_eq!(ours.len(), values.len());
            for (ours, (value, half_width)) in ours.iter().zip(values.iter().zip(half_widths)) {
                let ours = ours.unwrap();
                assert_eq!(ours.n_blocks, case.n_blocks as u64);
                largest = largest
                    .max((ours.value - value).abs())
                    .max((ours.half_width.unwrap() - half_width).abs());
            }
        }
        println!(
            "{}, {} blocks: largest difference {largest:.1e}",
            case.function, case.n_blocks
        );
        assert!(largest <= TOLERANCE, "{}: {largest}", case.function);
    }
}

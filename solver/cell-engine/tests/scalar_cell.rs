//! The engine next to the scalar cell of `cardiotwin-models`: the same equations, with another solver and search for the
//! periodic beat.

mod common;

use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, CellTrace, EngineSettings, NegativeKwu, SampledCalcium,
    Workspace,
};
use std::sync::Arc;

use cardiotwin_models::calcium::{self, Rice2008Parameters};
use cardiotwin_models::cell0d::{
    CalciumInput, CellParameters, CellSolverSettings, LandPassiveParameters,
};
use cardiotwin_models::contraction::Land2017Parameters;
use cardiotwin_units::Ms;
use common::{sensitivity_cells, step_2_cells};

fn scalar(cell: &CellInput) -> CellParameters {
    let p = &cell.parameters;
    CellParameters {
        land: Land2017Parameters {
            k_trpn_per_ms: p[0],
            n_trpn: p[1],
            ca50_ref_um: p[2],
            k_u_per_ms: p[3],
            n_tm: p[4],
            trpn50: p[5],
            k_uw_per_ms: p[6],
            k_ws_per_ms: p[7],
            r_w: p[8],
            r_s: p[9],
            gamma_s_per_ms: p[10],
            gamma_w_per_ms: p[11],
            phi: p[12],
            a_eff: p[13],
            beta0: p[14],
            beta1_um: p[15],
            smax_ref_kpa: p[16],
            cap_unblocking: false,
            allow_negative_k_wu: true,
        },
        passive: LandPassiveParameters {
            a_p_kpa: p[21],
            ..LandPassiveParameters::default()
        },
        calcium: CalciumInput::Rice(Rice2008Parameters {
            ca_res_um: p[17],
            ca_max_um: p[18],
            tau_cr_ms: p[19],
            tau_cd_ms: p[20],
        }),
        cycle_length_ms: cell.cycle_length_ms,
        lambda0: cell.lambda_0,
    }
}

fn engine() -> CellEngine {
    let settings = EngineSettings {
        tolerance: 1e-6,
        negative_kwu: NegativeKwu::Keep,
        ..EngineSettings::default()
    };
    CellEngine::new(settings).unwrap()
}

fn compare(
    engine: &CellEngine,
    cells: &[CellInput],
    scalar: impl Fn(&CellInput) -> CellParameters,
) {
    let mut outputs = vec![CellOutput::default(); cells.len()];
    let mut traces = vec![CellTrace::default(); cells.len()];
    engine
        .evaluate_with_traces(cells, &mut Workspace::new(), &mut outputs, &mut traces)
        .unwrap();
    for ((input, output), trace) in cells.iter().zip(&outputs).zip(&traces) {
        let cell = scalar(input).build().unwrap();
        let beat = cell.solve_periodic(&CellSolverSettings::default()).unwrap();
        assert!(output.is_periodic(), "{input:?}");
        assert_eq!(beat.sa_kpa.len(), trace.sa_kpa.len());
        for k in 0..beat.sa_kpa.len() {
            assert!(
                (beat.sa_kpa[k] - trace.sa_kpa[k]).abs() < 0.002,
                "{input:?} at {k} ms"
            );
            assert!(
                (beat.lambda[k] - trace.lambda[k]).abs() < 1e-5,
                "{input:?} at {k} ms"
            );
            assert!(
                (beat.ca_um[k] - trace.calcium_um[k]).abs() < 1e-12,
                "{input:?} at {k} ms"
            );
        }
        let (b, c, o) = (
            beat.read().unwrap().biomarkers,
            cell.calcium_biomarkers().unwrap(),
            &output.reading,
        );
        assert!(
            (b.sa_max_kpa - o.biomarkers.sa_max_kpa).abs() < 0.002
                && (b.lambda_min - o.biomarkers.lambda_min).abs() < 1e-5,
            "{input:?}"
        );
        assert!(
            (c.ctd50_ms - o.ctd50_ms).abs() < 1e-6 && (c.ctd90_ms - o.ctd90_ms).abs() < 1e-6,
            "{input:?}"
        );
    }
}

#[test]
fn both_cells_beat_alike() {
    let cells: Vec<_> = step_2_cells(40, 31)
        .into_iter()
        .chain(sensitivity_cells(40, 32))
        .collect();
    compare(&engine(), &cells, scalar);
}

#[test]
fn and_alike_with_a_sampled_transient() {
    let shape = |t: f64| {
        0.12 + 0.7 * (t / 70.0) * (1.0 - t / 70.0).exp()
            + 0.05 * (-(t - 300.0).powi(2) / 5000.0).exp()
    };
    let samples: Vec<f64> = (0..=350).map(|k| shape(2.0 * f64::from(k))).collect();
    let sampled = calcium::SampledCalcium::new(Ms(2.0), samples.clone()).unwrap();
    let input = CalciumInput::Sampled(Arc::new(sampled));
    let engine = engine().with_calcium(SampledCalcium::new(2.0, samples).unwrap());
    compare(&engine, &step_2_cells(30, 33), |cell| CellParameters {
        calcium: input.clone(),
        ..scalar(cell)
    });
    assert!(
        SampledCalcium::new(1.0, vec![0.1, -0.1, 0.1]).is_err()
            && SampledCalcium::new(1.0, vec![0.1]).is_err()
    );
}

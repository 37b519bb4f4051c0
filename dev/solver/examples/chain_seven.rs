//! Personalises the seven bundled patients in this process: step 1 to its first iterate within the
//! tolerance, targets, step 2, verification beat. `cargo run --release --manifest-path dev/Cargo.toml
//! --example chain_seven -- THREADS`

#[path = "../../../worker/tests/support/mod.rs"]
mod support;

use std::time::Instant;

use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::ContractionSpec;
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::settings::{CellFitSettings, Step1Settings};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_worker::context::Context;

fn main() {
    let threads = std::env::args()
        .nth(1)
        .and_then(|text| text.parse().ok())
        .unwrap_or(1);
    let scratch = tempfile::tempdir().expect("a temporary directory");
    for id in support::PATIENTS {
        let step0 = support::step0(id);
        let mut context = Context::plain(scratch.path(), threads);
        let state = support::passive_state(&step0, &mut context);
        let (iterations, best, how) = support::step1(
            step0.cycle_length_ms,
            &state,
            &Step1Settings::default(),
            &mut context,
        );
        let best = &iterations[best.expect("an iteration succeeded")];
        let tanh = ContractionSpec::Tanh {
            parameters: best.parameters.tanh,
        };
        let spec = support::beat_spec(step0.cycle_length_ms, &state, &best.parameters, tanh);
        let _ = support::succeed(&TaskSpec::OrganBeat(Box::new(spec)), &mut context);
        let targets = support::targets(scratch.path(), &mut context);

        let fit_spec =
            support::cell_fit_spec(step0.cycle_length_ms, &targets, CellFitSettings::default());
        let begin = Instant::now();
        let TaskResult::CellFit(fit) =
            support::succeed(&TaskSpec::CellFit(Box::new(fit_spec)), &mut context)
        else {
            unreachable!("a cell fit gives the result of one")
        };
        let seconds = begin.elapsed().as_secs_f64();
        println!(
            "{id}: step 1 {how} after {} simulations, cost {:.3}",
            iterations.len(),
            best.cost
        );
        println!(
            "    targets {:.3?} lambda_0 {:.4}",
            targets.targets, targets.lambda_0
        );
        println!("    reached {:.3?}", fit.reached);
        println!(
            "    cost {:.4}, {} generations, {} evaluations, {seconds:.1} s, {:.3} ms each, converged {}",
            fit.cost,
            fit.generations,
            fit.evaluations,
            1e3 * seconds / fit.evaluations as f64,
            fit.converged
        );
        let terms: Vec<String> = fit
            .cost_terms
            .iter()
            .filter(|(_, v)| **v > 1e-4)
            .map(|(name, value)| format!("{name} {value:.4}"))
            .collect();
        println!("    terms: {}", terms.join(", "));
        let values: Vec<String> = fit
            .parameters
            .iter()
            .map(|p| {
                format!(
                    "{} {:.3}{}",
                    p.name,
                    p.value,
                    if p.at_bound { "*" } else { "" }
                )
            })
            .collect();
        println!("    {}", values.join(", "));
        for text in &fit.unreachable_targets {
            println!("    {text}");
        }
        let spec = support::beat_spec(
            step0.cycle_length_ms,
            &state,
            &best.parameters,
            support::fitted_contraction(&fit),
        );
        let TaskResult::OrganBeat(verified) =
            support::succeed(&TaskSpec::OrganBeat(Box::new(spec)), &mut context)
        else {
            unreachable!("a beat gives the result of one")
        };
        let error = |of: fn(&Biomarkers) -> Option<f64>| {
            let (measured, simulated) = (of(&state.measured), of(&verified.biomarkers));
            measured
                .zip(simulated)
                .map_or(f64::NAN, |(m, s)| 100.0 * (s - m) / m)
        };
        println!(
            "    verification: P_max {:+.1} PTD90 {:+.1} dPdt_max {:+.1} dPdt_min {:+.1} SV {:+.1} %; lambda_min {:.3}; failed {:?}; {:?}",
            error(|b| b.p_max_mmhg),
            error(|b| b.ptd90_ms),
            error(|b| b.dpdt_max_mmhg_per_ms),
            error(|b| b.dpdt_min_mmhg_per_ms),
            error(|b| b.sv_ml),
            verified.lambda_min,
            verified.failed_check(),
            verified.remarks,
        );
    }
}

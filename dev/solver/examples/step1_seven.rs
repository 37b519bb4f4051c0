//! Runs step 1 for the seven bundled patients in this process and prints costs, errors, minimal
//! stretch, and the difference between the volumes at the beginning and the end of the beat. `cargo
//! run --release --manifest-path dev/Cargo.toml --example step1_seven -- [onset=MS] [nodes=N] [patient=ID]
//! [stop=first|best]`; `nodes` selects the finite-element ventricle.

#[path = "../../../worker/tests/support/mod.rs"]
mod support;

use std::time::Instant;

use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::finite_element::FiniteElementSettings;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::settings::{Step1Settings, StopRule};
use cardiotwin_worker::context::Context;

type Of = fn(&Biomarkers) -> Option<f64>;

/// Biomarkers whose mean errors the paper reports, in its order.
const ERRORS: [(&str, Of); 5] = [
    ("P_max", |b| b.p_max_mmhg),
    ("PTD90", |b| b.ptd90_ms),
    ("dPdt_max", |b| b.dpdt_max_mmhg_per_ms),
    ("dPdt_min", |b| b.dpdt_min_mmhg_per_ms),
    ("SV", |b| b.sv_ml),
];

fn main() {
    let scratch = tempfile::tempdir().expect("a temporary directory");
    let argument = |name: &str| {
        std::env::args().find_map(|a| Some(a.strip_prefix(name)?.strip_prefix('=')?.to_owned()))
    };
    let onset = argument("onset").and_then(|text| text.parse().ok());
    let nodes: Option<u32> = argument("nodes").and_then(|text| text.parse().ok());
    let (patient, wanted) = (argument("patient"), argument("stop"));
    for (name, stop) in [
        ("first", StopRule::FirstConverged),
        ("best", StopRule::BestOfLimit),
    ] {
        if wanted.as_ref().is_some_and(|wanted| wanted != name) {
            continue;
        }
        println!("\nstop = {stop:?}");
        let mut sums = [0.0; 5];
        let mut counted = 0;
        for id in support::PATIENTS
            .into_iter()
            .filter(|id| patient.as_ref().is_none_or(|wanted| wanted == id))
        {
            let mut spec = support::step0(id);
            spec.finite_element = nodes.map(|mesh_nodes| {
                FiniteElementSettings {
                    mesh_nodes,
                    ..FiniteElementSettings::default()
                }
                .anatomy(&[])
            });
            let begun = Instant::now();
            spec.activation.onset_ms = onset;
            let mut context = Context::plain(scratch.path(), 1);
            let state = support::passive_state(&spec, &mut context);
            let settings = Step1Settings {
                stop,
                ..Step1Settings::default()
            };
            let (iterations, best, how) =
                support::step1(spec.cycle_length_ms, &state, &settings, &mut context);
            let costs: Vec<String> = iterations
                .iter()
                .map(|iteration| format!("{:.3}", iteration.cost))
                .collect();
            let organ = match &state.organ {
                OrganSpec::Reduced {
                    passive,
                    activation,
                } => {
                    format!(
                        "onset {:.1} ms, b {:.1}",
                        activation.onset_ms, passive.exponent
                    )
                }
                OrganSpec::External(_) => "another solver's".to_owned(),
                OrganSpec::FiniteElement(organ) => {
                    format!("{:.2?}, {:.1?}", organ.figures, state.counters)
                }
            };
            let (seconds, costs) = (begun.elapsed().as_secs_f64(), costs.join(" "));
            println!("{id}: {how}, best {best:?}; {organ}; {seconds:.1} s; costs {costs}");
            for iteration in &iterations {
                match &iteration.result {
                    Err(reason) => println!("    failed: {reason}"),
                    Ok(beat) if nodes.is_some() => println!(
                        "    cost {:.3}: P_max {:.1?}, {:.1?} s, {:?} Newton a step, {:?} cut",
                        iteration.cost,
                        beat.biomarkers.p_max_mmhg,
                        beat.counters.get("seconds_beat"),
                        beat.counters.get("newton_iterations_per_step"),
                        beat.counters.get("cut_steps"),
                    ),
                    Ok(_) => {}
                }
            }
            let Some(iteration) = best.map(|best| &iterations[best]) else {
                continue;
            };
            let Ok(result) = &iteration.result else {
                continue;
            };
            let errors =
                ERRORS.map(
                    |(_, of)| match (of(&state.measured), of(&result.biomarkers)) {
                        (Some(measured), Some(simulated)) => {
                            100.0 * ((measured - simulated) / measured).abs()
                        }
                        _ => f64::NAN,
                    },
                );
            let tanh = &iteration.parameters.tanh;
            println!(
                "    errors % {errors:.1?}; lambda_min {:.3}, open at the end {:.1} mL; Smax {:.0} tau_SR {:.2} tau_SD {:.0} t_CR {:.0} R_AV {:.4} R_MV {:.4}; {:?}",
                result.lambda_min,
                result.biomarkers.end_of_beat_gap_ml.unwrap_or(f64::NAN),
                tanh.smax_ref_kpa,
                tanh.tau_sr_ref_ms,
                tanh.tau_sd_ms,
                tanh.t_cr_ms,
                iteration.parameters.valves.r_av_f_mmhg_s_per_ml,
                iteration.parameters.valves.r_mv_f_mmhg_s_per_ml,
                result.remarks,
            );
            if id != "04-CoA" {
                counted += 1;
                sums.iter_mut()
                    .zip(errors)
                    .for_each(|(sum, error)| *sum += error);
            }
        }
        let means: Vec<String> = ERRORS
            .iter()
            .zip(sums)
            .map(|((name, _), sum)| format!("{name} {:.1}", sum / f64::from(counted)))
            .collect();
        println!(
            "mean errors % of {counted} without 04-CoA: {} (paper: 5.4, 1.4, 13.6, 7.7, 10.0)",
            means.join(", ")
        );
    }
}

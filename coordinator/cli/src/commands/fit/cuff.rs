//! `cardiotwin fit afterload --cuff`: fit of the three-element Windkessel to cuff pressures.

use cardiotwin_calibrate::afterload::{CUFF_SD_MMHG, CuffFit, CuffPressures, fit_cuff};
use cardiotwin_calibrate::normal;
use cardiotwin_input::preparation::afterload_table as table;
use cardiotwin_report::html::cuff_fit_svg;
use cardiotwin_schemas::afterload::{AfterloadQuantity, CuffFitAnswer, Determined};
use cardiotwin_signals::Problem;
use cardiotwin_signals::checks::Facts;

use super::afterload_answer::{Said, estimates, in_a_word, one_line, parameters, say};
use super::afterload_args::AfterloadArgs;
use super::record::FlowSource;
use super::trace;
use crate::error::CliError;
use crate::exit::Exit;
use crate::table::number;
use crate::talk::Talk;

/// Half width of an interval over the value, above which a parameter counts as poorly determined.
const POOR: f64 = 0.3;

/// Fits the Windkessel and prints the answer.
///
/// # Errors
/// [`CliError::Trace`] if the flow cannot be used, or if no load gives the pressures with this
/// flow.
pub fn execute(
    args: &AfterloadArgs,
    source: FlowSource<'_>,
    talk: &Talk,
) -> Result<Exit, CliError> {
    let Some(given) = args.cuff else {
        return Err(CliError::Usage("--cuff is not given".to_owned()));
    };
    let flow = source.read(talk)?;
    let n = flow.n_samples();
    let step_ms = (flow.end_ms() - flow.time_ms()[0]) / (n - 1) as f64;
    // The flow's samples may have any spacing, but the load is computed on an even grid.
    let even: Vec<f64> = (0..n)
        .map(|i| flow.at(flow.time_ms()[0] + i as f64 * step_ms))
        .collect();
    let cuff = CuffPressures {
        sd_mmhg: args.cuff_sd,
        ..given
    };
    let fit = fit_cuff(&even, step_ms, cuff).map_err(|error| {
        let remedy = "give one whole cycle of flow out of the heart, and cuff pressures of the same \
                      patient at rest";
        trace::refused(
            Problem::error(source.file(), error.to_string(), "a flow with the cuff's pressures", remedy),
            talk,
        )
    })?;
    let facts = Facts {
        aortic_flow_ml_per_s: Some(fit.mean_flow_ml_per_s),
        ..Facts::default()
    };
    trace::checked(args.accepted().doubts(&facts, source.file()), talk)?;
    let answer = answer(&source, &cuff, &fit, args.confidence);
    let plot = || {
        let points: Vec<(f64, f64)> = fit
            .pressure_mmhg
            .iter()
            .enumerate()
            .map(|(i, p)| (i as f64 * step_ms, *p))
            .collect();
        cuff_fit_svg(&answer, &points)
    };
    let said = Said {
        toml: &answer.patient_toml,
        warnings: &answer.warnings,
        text: text(&answer, talk),
    };
    say(args, &answer, &said, plot, talk)
}

fn answer(
    source: &FlowSource<'_>,
    cuff: &CuffPressures,
    fit: &CuffFit,
    confidence: f64,
) -> CuffFitAnswer {
    let names = [
        "characteristic_resistance_mmHg_s_per_mL",
        "peripheral_resistance_mmHg_s_per_mL",
        "compliance_mL_per_mmHg",
        "time_constant_s",
    ];
    let z = normal::quantile(0.5 + 0.5 * confidence);
    let quantity = |k: usize| {
        let (value, sd) = (fit.values[k], fit.sd[k]);
        AfterloadQuantity {
            name: names[k].to_owned(),
            value,
            standard_error: Some(sd),
            lower: Some((value - z * sd).max(0.0)),
            upper: Some(value + z * sd),
            determined: if z * sd <= POOR * value {
                Determined::Well
            } else {
                Determined::Poorly
            },
        }
    };
    let afterload = parameters([fit.values[0], fit.values[1], fit.values[2]]);
    let mut warnings = Vec::new();
    if fit.assumed_share {
        let why = if cuff.mean_mmhg.is_some() {
            "no characteristic resistance is compatible with this mean pressure"
        } else {
            "the resistances cannot be separated without a mean pressure"
        };
        warnings.push(format!(
            "{why}: R1 is assumed to be 0.06 R2, as in adults at rest"
        ));
    }
    let shown = cuff
        .mean_mmhg
        .map_or(String::new(), |mean| format!(", mean {mean}"));
    let from = format!(
        "Through the cuff's {}/{} mmHg{shown} by `cardiotwin fit afterload`, flow: {}.",
        cuff.systolic_mmhg,
        cuff.diastolic_mmhg,
        one_line(&source.name())
    );
    CuffFitAnswer {
        schema_version: cardiotwin_schemas::formats::CUFF_FIT.version,
        flow: source.name(),
        mean_flow_ml_per_s: fit.mean_flow_ml_per_s,
        systolic_mmhg: cuff.systolic_mmhg,
        diastolic_mmhg: cuff.diastolic_mmhg,
        mean_mmhg: cuff.mean_mmhg,
        sd_mmhg: cuff.sd_mmhg.unwrap_or(CUFF_SD_MMHG),
        patient_toml: table(&afterload, &from),
        afterload,
        estimates: (0..4).map(quantity).collect(),
        confidence_level: confidence,
        assumed_share: fit.assumed_share,
        warnings,
    }
}

fn text(answer: &CuffFitAnswer, talk: &Talk) -> String {
    let word = |q: &AfterloadQuantity| in_a_word(q.determined);
    let mut text = estimates(&answer.estimates, answer.confidence_level, word, talk);
    text.push_str(&format!(
        "\nflow: {}, mean {} mL/s; standard deviation of the cuff {} mmHg\n",
        answer.flow,
        number(answer.mean_flow_ml_per_s),
        number(answer.sd_mmhg)
    ));
    for warning in &answer.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}

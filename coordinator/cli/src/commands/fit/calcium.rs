//! `cardiotwin fit calcium`: fit of Rice's calcium transient to a measured one.

use std::path::{Path, PathBuf};

use cardiotwin_calibrate::calcium_fit::{
    CalciumFit, CalciumFitError, CalciumFitSettings, Estimate, fit_calcium,
};
use cardiotwin_report::html::calcium_fit_svg;
use cardiotwin_report::results::atomic;
use cardiotwin_schemas::fit::{CalciumFitAnswer, FittedQuantity};
use cardiotwin_signals::checks::Facts;
use cardiotwin_signals::{Problem, Quantity, Trace};
use clap::{Args, ValueEnum};

use super::cohort_toml;
use super::estimates;
use super::trace::{self, Accepted};
use crate::error::CliError;
use crate::exit::Exit;
use crate::table::{self, number};
use crate::talk::Talk;

/// Correlation of neighbouring residuals above which a warning says that the curve misses the
/// trace's shape.
const CORRELATED: f64 = 0.5;
/// Number of intervals between the points of the fitted curve in the plot.
const CURVE_POINTS: usize = 400;

/// Fit Rice's calcium (resting and peak calcium, two time constants) to one measured transient
#[derive(Debug, Args)]
#[command(
    after_help = "TRACE.csv has the columns time_ms and calcium_uM and holds one beat with samples \
                  of any spacing; lines that begin with # are comments.\n\
                  The fit is least squares over all samples; the profile intervals assume \
                  independent residuals."
)]
pub struct CalciumArgs {
    /// CSV file of the transient with the columns time_ms,calcium_uM
    #[arg(value_name = "TRACE.csv")]
    trace: PathBuf,
    /// Time of activation on the trace's clock, in ms; calcium rises from then on
    #[arg(
        long,
        value_name = "MS",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    activation: f64,
    /// Coverage probability of the intervals
    #[arg(long, value_name = "SHARE", default_value_t = 0.95)]
    confidence: f64,
    /// Accept what a rule of consistency reports, by its name (calcium-range)
    #[arg(long, value_name = "RULE")]
    accept: Vec<String>,
    /// Draw the trace and the fit into this SVG file
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print tables for cohort.toml instead: calcium frozen at the values, or bounded by the
    /// intervals
    #[arg(
        long,
        value_name = "frozen|bounds",
        value_enum,
        hide_possible_values = true,
        conflicts_with = "json"
    )]
    toml: Option<Defaults>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// How a cohort may use the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Defaults {
    Frozen,
    Bounds,
}

/// Fits the transient and prints the answer.
///
/// # Errors
/// The same as for [`super::execute`].
pub fn execute(args: &CalciumArgs, talk: &Talk) -> Result<Exit, CliError> {
    if !(args.activation.is_finite() && args.confidence > 0.0 && args.confidence < 1.0) {
        return Err(CliError::Usage(
            "--activation must be finite, and --confidence must lie between 0 and 1".to_owned(),
        ));
    }
    let measured = trace::read(&args.trace, Quantity::Calcium, talk)?;
    let facts = Facts {
        calcium: Some(&measured),
        ..Facts::default()
    };
    let accepted = Accepted {
        rules: &args.accept,
        option: "--accept",
    };
    trace::checked(accepted.doubts(&facts, &args.trace), talk)?;
    let settings = CalciumFitSettings {
        activation_ms: args.activation,
        confidence_level: args.confidence,
    };
    let fit = fit_calcium(measured.time_ms(), measured.values(), settings)
        .map_err(|error| trace::refused(problem(&args.trace, &error), talk))?;
    let answer = answer(&args.trace.display().to_string(), args.activation, &fit);
    if let Some(file) = &args.plot {
        plot(file, &answer, &measured, &fit)?;
    }
    match args.toml {
        _ if args.json => talk.json(&answer)?,
        Some(Defaults::Frozen) => talk.data(&answer.cohort_toml.frozen)?,
        Some(Defaults::Bounds) => talk.data(&answer.cohort_toml.bounds)?,
        None => {
            talk.data(&text(&answer, talk))?;
            talk.hint("`--toml frozen` and `--toml bounds` print tables for cohort.toml");
        }
    }
    if args.json || args.toml.is_some() {
        answer
            .warnings
            .iter()
            .for_each(|warning| talk.say(&format!("warning: {warning}")));
    }
    Ok(Exit::Ok)
}

/// Error of the fit as a problem of the trace's file.
fn problem(file: &Path, error: &CalciumFitError) -> Problem {
    match error {
        CalciumFitError::Samples { n_times, .. } => {
            let found = format!("{n_times} samples");
            Problem::error(
                file,
                found,
                "at least 8 samples over one transient",
                "export the trace with more samples",
            )
        }
        CalciumFitError::NoTransient {
            activation_ms,
            peak_ms,
        } => {
            let found = format!("no peak; the largest value is at {peak_ms} ms");
            let expected = format!("a rise after activation at {activation_ms} ms and a fall");
            let remedy = "give one whole transient, and --activation if it does not begin at 0 ms";
            Problem::error(file, found, expected, remedy).at_key("calcium_uM")
        }
        CalciumFitError::Sample { .. }
        | CalciumFitError::Confidence { .. }
        | CalciumFitError::LeastSquares(_) => Problem::error(
            file,
            error.to_string(),
            "a calcium transient",
            "check the trace",
        ),
    }
}

fn answer(trace: &str, activation_ms: f64, fit: &CalciumFit) -> CalciumFitAnswer {
    let named = [
        ("Ca_res_uM", &fit.ca_res_um),
        ("Ca_max_uM", &fit.ca_max_um),
        ("tau_CR_ms", &fit.tau_cr_ms),
        ("tau_CD_ms", &fit.tau_cd_ms),
        ("tau_mean_ms", &fit.tau_mean_ms),
    ];
    CalciumFitAnswer {
        schema_version: cardiotwin_schemas::formats::CALCIUM_FIT.version,
        trace: trace.to_owned(),
        activation_ms,
        ca_res_um: fit.parameters.ca_res_um,
        ca_max_um: fit.parameters.ca_max_um,
        tau_cr_ms: fit.parameters.tau_cr_ms,
        tau_cd_ms: fit.parameters.tau_cd_ms,
        estimates: named
            .into_iter()
            .map(|(name, estimate)| quantity(name, estimate))
            .collect(),
        confidence_level: fit.confidence_level,
        time_constants: fit.time_constants,
        time_constants_in_words: fit.time_constants.explanation().to_owned(),
        n_samples: fit.n_samples,
        root_mean_square_um: fit.root_mean_square_um,
        residual_correlation: fit.residual_correlation,
        converged: fit.converged,
        warnings: warnings(fit),
        cohort_toml: cohort_toml::cohort_defaults(fit, trace),
    }
}

fn quantity(name: &str, estimate: &Estimate) -> FittedQuantity {
    let Estimate {
        value,
        standard_error,
        lower,
        upper,
    } = *estimate;
    FittedQuantity {
        name: name.to_owned(),
        value,
        standard_error,
        lower,
        upper,
    }
}

fn warnings(fit: &CalciumFit) -> Vec<String> {
    let mut found = Vec::new();
    if !fit.converged {
        found.push(
            "the minimisation stopped before it reached its tolerance: check the plot".to_owned(),
        );
    }
    let rho = fit.residual_correlation;
    if rho > CORRELATED {
        // The correlation is close to one for traces without noise and for curves that miss the
        // shape altogether.
        let factor = ((1.0 + rho) / (1.0 - rho.min(0.999))).sqrt();
        found.push(format!(
            "neighbouring residuals are correlated ({rho:.2}): the curve does not fit the trace's \
             shape, or the noise is smooth, and the intervals are too narrow by a factor of about \
             {factor:.1}; check that the trace begins at its activation (--activation)"
        ));
    }
    found
}

fn text(answer: &CalciumFitAnswer, talk: &Talk) -> String {
    let table = estimates::table(&answer.estimates, answer.confidence_level);
    let mut text = table::text(&table, talk);
    text.push_str(&format!(
        "\nresidual: {} µM (root mean square of {} samples), correlation between neighbours {:.2}\n",
        number(answer.root_mean_square_um),
        answer.n_samples,
        answer.residual_correlation
    ));
    text.push_str(&format!(
        "time constants: {}\n",
        answer.time_constants_in_words
    ));
    for warning in &answer.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}

fn plot(
    file: &Path,
    answer: &CalciumFitAnswer,
    measured: &Trace,
    fit: &CalciumFit,
) -> Result<(), CliError> {
    let times = measured.time_ms();
    let (first, last) = (times[0], times[times.len() - 1]);
    let grid: Vec<f64> = (0..=CURVE_POINTS)
        .map(|i| first + (last - first) * i as f64 / CURVE_POINTS as f64)
        .collect();
    let since: Vec<f64> = grid.iter().map(|t| t - answer.activation_ms).collect();
    let fitted: Vec<_> = std::iter::zip(grid, fit.parameters.transient_um(&since)).collect();
    let samples: Vec<_> = std::iter::zip(times, measured.values())
        .map(|(t, c)| (*t, *c))
        .collect();
    let svg = calcium_fit_svg(answer, &samples, &fitted).unwrap_or_default();
    atomic::write(file, |out| out.write_all(svg.as_bytes())).map_err(CliError::file("write", file))
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::fit::TimeConstants;

    use super::*;

    fn talk() -> Talk {
        Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        }
    }

    fn fitted(text: &str) -> CalciumFit {
        let trace =
            cardiotwin_signals::parse_trace(text.as_bytes(), Path::new("t.csv"), Quantity::Calcium)
                .trace;
        let trace = trace.unwrap();
        fit_calcium(
            trace.time_ms(),
            trace.values(),
            CalciumFitSettings::default(),
        )
        .unwrap()
    }

    #[test]
    fn the_example_as_people_see_it() {
        let fit = fitted(include_str!(
            "../../../../../examples/calcium/transient.csv"
        ));
        let answer = answer("transient.csv", 0.0, &fit);
        insta::assert_snapshot!(format!(
            "{}\n{}\n{}",
            text(&answer, &talk()),
            answer.cohort_toml.frozen,
            answer.cohort_toml.bounds
        ));
    }

    /// A narrow gamma curve: no pair of time constants fits it, and the answer says so.
    #[test]
    fn a_shape_that_rice_does_not_have_is_said() {
        let mut csv = "time_ms,calcium_uM\n".to_owned();
        for i in 0..80 {
            let x = f64::from(i) / 6.0;
            csv.push_str(&format!(
                "{},{}\n",
                10 * i,
                0.15 + 0.45 * (x / 2.0).powi(2) * (2.0 - x).exp()
            ));
        }
        let answer = answer("narrow.csv", 0.0, &fitted(&csv));
        assert_eq!(answer.time_constants, TimeConstants::Equal);
        assert!(
            answer.warnings.len() == 1
                && answer.warnings[0].contains("does not fit the trace's shape"),
            "{answer:?}"
        );
        let said = text(&answer, &talk());
        assert!(
            said.contains("time constants: the best time constants are equal")
                && said.contains("warning:"),
            "{said}"
        );
    }

    #[test]
    fn nanomoles_are_refused_with_their_factor() {
        let csv = "time_ms,calcium_uM\n0,100\n10,350\n20,600\n30,400\n300,120\n";
        let file = Path::new("t.csv");
        let trace = cardiotwin_signals::parse_trace(csv.as_bytes(), file, Quantity::Calcium)
            .trace
            .unwrap();
        let doubts = |rules: &[&str]| {
            let facts = Facts {
                calcium: Some(&trace),
                ..Facts::default()
            };
            let rules: Vec<String> = rules.iter().map(|rule| (*rule).to_owned()).collect();
            Accepted {
                rules: &rules,
                option: "--accept",
            }
            .doubts(&facts, file)
        };
        let found = doubts(&[]);
        let said = found[0].to_string();
        for part in [
            "t.csv: calcium_uM: found calcium from 100 to 600 µM",
            "0.60 µM if the numbers are in nM: multiply by 0.001",
            "--accept calcium-range",
        ] {
            assert!(said.contains(part), "{part} is not in {said}");
        }
        assert!(found.len() == 1 && found[0].is_error());
        assert!(doubts(&["calcium-range"]).is_empty());
        let misspelt = doubts(&["calcium"]);
        assert!(
            misspelt
                .iter()
                .any(|p| p.key.as_deref() == Some("--accept"))
        );
    }

    #[test]
    fn what_the_fit_refuses_names_the_file() {
        let error = CalciumFitError::NoTransient {
            activation_ms: 0.0,
            peak_ms: 0.0,
        };
        let said = problem(Path::new("t.csv"), &error).to_string();
        assert!(
            said.contains("t.csv: calcium_uM: found no peak") && said.contains("--activation"),
            "{said}"
        );
    }
}

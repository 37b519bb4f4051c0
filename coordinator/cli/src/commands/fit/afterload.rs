//! `cardiotwin fit afterload`: fit of the three-element Windkessel to a measured flow and pressure.

use cardiotwin_calibrate::afterload::{
    Estimate, Start, WindkesselFit, WindkesselFitSettings, fit_windkessel,
};
use cardiotwin_input::preparation::afterload_table as table;
use cardiotwin_report::html::afterload_fit_svg;
use cardiotwin_schemas::afterload::{AfterloadFitAnswer, AfterloadQuantity, Determined};

use super::afterload_answer::{Said, estimates, in_a_word, one_line, parameters, say};
use super::afterload_args::{AfterloadArgs, sources};
use super::cuff;
use super::record::{self, Measured};
use crate::error::CliError;
use crate::exit::Exit;
use crate::table::number;
use crate::talk::Talk;

/// Misfit over the pulse pressure above which a warning says that the record needs more than three
/// elements.
const LARGE_MISFIT: f64 = 0.05;
/// Correlation of two estimates above which a warning says that they cannot be told apart.
const STRONG_CORRELATION: f64 = 0.95;

/// Fits the Windkessel and prints the answer.
///
/// # Errors
/// The same as for [`super::execute`].
pub fn execute(args: &AfterloadArgs, talk: &Talk) -> Result<Exit, CliError> {
    if !(args.confidence > 0.0 && args.confidence < 1.0) {
        return Err(CliError::Usage(
            "--confidence must lie between 0 and 1".to_owned(),
        ));
    }
    let (source, pressure) = sources(args)?;
    let Some(pressure) = pressure else {
        return cuff::execute(args, source, talk);
    };
    let measured = record::read_from(source, pressure, args.accepted(), talk)?;
    // One cycle of volume carries no information about the time before it.
    let periodic = args.periodic || args.volume.is_some();
    let start = if periodic {
        Start::Periodic
    } else {
        Start::Free
    };
    let settings = WindkesselFitSettings {
        start,
        confidence_level: args.confidence,
    };
    let fit = fit_windkessel(&measured.record, settings)
        .map_err(|error| CliError::Usage(format!("the record cannot be fitted: {error}")))?;
    let answer = answer(&measured, periodic, &fit);
    let plot = || {
        let points = |(sample, residual): (&(f64, f64), &f64)| (sample.0, sample.1 + residual);
        let fitted: Vec<(f64, f64)> = std::iter::zip(&measured.pressure, &fit.residuals_mmhg)
            .map(points)
            .collect();
        afterload_fit_svg(&answer, &measured.pressure, &fitted)
    };
    let said = Said {
        toml: &answer.patient_toml,
        warnings: &answer.warnings,
        text: text(&answer, talk),
    };
    say(args, &answer, &said, plot, talk)
}

fn answer(measured: &Measured, periodic: bool, fit: &WindkesselFit) -> AfterloadFitAnswer {
    let record = &measured.described;
    let named = [
        ("characteristic_resistance_mmHg_s_per_mL", &fit.r1),
        ("peripheral_resistance_mmHg_s_per_mL", &fit.r2),
        ("compliance_mL_per_mmHg", &fit.compliance),
        ("time_constant_s", &fit.time_constant),
        ("start_pressure_mmHg", &fit.start),
    ];
    let afterload = parameters([fit.r1.value, fit.r2.value, fit.compliance.value]);
    let from = format!(
        "Fitted by `cardiotwin fit afterload` to {} and {}.",
        one_line(&record.flow),
        one_line(&record.pressure)
    );
    let share_of_pulse = fit.root_mean_square_mmhg / record.pulse_pressure_mmhg;
    let mut answer = AfterloadFitAnswer {
        schema_version: cardiotwin_schemas::formats::AFTERLOAD_FIT.version,
        record: record.clone(),
        patient_toml: table(&afterload, &from),
        afterload,
        estimates: named
            .into_iter()
            .map(|(name, estimate)| quantity(name, estimate))
            .collect(),
        confidence_level: fit.confidence_level,
        correlations: fit.correlations,
        periodic,
        root_mean_square_mmhg: fit.root_mean_square_mmhg,
        share_of_pulse,
        noise: fit.sample_size,
        converged: fit.converged,
        warnings: Vec::new(),
    };
    answer.warnings.clone_from(&measured.doubts);
    answer
        .warnings
        .extend(measured.against(fit.r1.value, fit.r2.value));
    answer
        .warnings
        .extend(measured.against_pulse(fit.compliance.value));
    let of_fit = warnings(&answer);
    answer.warnings.extend(of_fit);
    answer
}

fn quantity(name: &str, estimate: &Estimate) -> AfterloadQuantity {
    let Estimate {
        value,
        standard_error,
        lower,
        upper,
        determined,
    } = *estimate;
    AfterloadQuantity {
        name: name.to_owned(),
        value,
        standard_error,
        lower,
        upper,
        determined,
    }
}

fn warnings(answer: &AfterloadFitAnswer) -> Vec<String> {
    let mut found = Vec::new();
    if !answer.converged {
        found.push(
            "the minimisation stopped before it reached its tolerance: check the plot".to_owned(),
        );
    }
    let open: Vec<&str> = answer
        .estimates
        .iter()
        .filter(|q| q.determined == Determined::Not)
        .map(|q| q.name.as_str())
        .collect();
    if !open.is_empty() {
        found.push(format!(
            "the record does not determine {}: the interval is open on one side or both",
            open.join(", ")
        ));
    }
    let pairs = ["R1 and R2", "R1 and C", "R2 and C"];
    for (pair, correlation) in pairs.iter().zip(answer.correlations) {
        if correlation.is_some_and(|c| c.abs() > STRONG_CORRELATION) {
            found.push(format!(
                "{pair} cannot be distinguished: their estimates are strongly correlated"
            ));
        }
    }
    if answer.share_of_pulse > LARGE_MISFIT {
        found.push(format!(
            "three elements misfit by {:.0} % of the pulse pressure; `cardiotwin discover \
             --afterload` searches for the missing effect",
            100.0 * answer.share_of_pulse
        ));
    }
    found
}

fn text(answer: &AfterloadFitAnswer, talk: &Talk) -> String {
    let word = |q: &AfterloadQuantity| match q.determined {
        _ if q.lower.is_none()
            && q.upper.is_none()
            && answer.periodic
            && q.name.starts_with("start") =>
        {
            "-"
        }
        determined => in_a_word(determined),
    };
    let mut text = estimates(&answer.estimates, answer.confidence_level, word, talk);
    let record = &answer.record;
    text.push_str(&format!(
        "\nresidual: {} mmHg (root mean square), {:.1} % of the pulse pressure of {} mmHg\n",
        number(answer.root_mean_square_mmhg),
        100.0 * answer.share_of_pulse,
        number(record.pulse_pressure_mmhg)
    ));
    let alike = answer.noise.beat_correlation.map_or(String::new(), |c| {
        format!(", correlation between beats {c:.2}")
    });
    text.push_str(&format!(
        "samples: {}, worth {} independent ones (correlation time {} ms{alike}); {} of {} ms, mean flow {} mL/s\n",
        record.n_samples,
        number(answer.noise.n_effective),
        number(answer.noise.correlation_time_ms),
        crate::talk::count(record.n_beats, "beat"),
        number(record.cycle_length_ms),
        number(record.mean_flow_ml_per_s)
    ));
    let shown = answer
        .correlations
        .map(|c| c.map_or_else(|| "-".to_owned(), |c| format!("{c:.2}")));
    text.push_str(&format!(
        "correlations: R1-R2 {}, R1-C {}, R2-C {}\n",
        shown[0], shown[1], shown[2]
    ));
    for warning in &answer.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::trace::Accepted;
    use super::*;

    fn talk() -> Talk {
        Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        }
    }

    fn example(case: &str, part: &str) -> AfterloadFitAnswer {
        let folder = Path::new(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/afterload"
        ))
        .join(case);
        let file = |trace: &str| folder.join(format!("{trace}{part}.csv"));
        let accepted = Accepted {
            rules: &[],
            option: "--accept",
        };
        let mut measured =
            record::read(&file("flow"), &file("pressure"), accepted, &talk()).unwrap();
        (measured.described.flow, measured.described.pressure) =
            ("flow.csv".to_owned(), "pressure.csv".to_owned());
        let fit = fit_windkessel(&measured.record, WindkesselFitSettings::default()).unwrap();
        answer(&measured, false, &fit)
    }

    #[test]
    fn the_examples_as_people_see_them() {
        let shown: Vec<String> = [
            ("human-1999", ""),
            ("porcine-in-vivo", "-1"),
            ("porcine-ex-vivo", "-1"),
        ]
        .map(|(case, part)| {
            let answer = example(case, part);
            format!(
                "{case}\n{}\n{}",
                text(&answer, &talk()),
                answer.patient_toml
            )
        })
        .into();
        insta::assert_snapshot!(shown.join("\n"));
    }
}

//! `cardiotwin fit afterload`: fit of the three-element Windkessel to a measured flow and pressure.

use std::path::{Path, PathBuf};

use cardiotwin_calibrate::afterload::{
    CuffPressures, Estimate, Start, WindkesselFit, WindkesselFitSettings, fit_windkessel,
};
use cardiotwin_schemas::afterload::{AfterloadFitAnswer, AfterloadQuantity, Determined};
use cardiotwin_schemas::organ::WindkesselParameters;
use clap::Args;
use serde::Serialize;

use super::record::{self, FlowSource, Measured};
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::table::{Columns, number, optional};
use crate::cli::talk::Talk;
pub use crate::preparation::afterload_table as table;
use crate::report::afterload_fit_svg;
use crate::results::atomic;

/// Misfit over the pulse pressure above which a warning says that the record needs more than three
/// elements.
const LARGE_MISFIT: f64 = 0.05;
/// Correlation of two estimates above which a warning says that they cannot be told apart.
const STRONG_CORRELATION: f64 = 0.95;

/// Fit the three-element Windkessel (characteristic and peripheral resistance, compliance) to
/// measured flow and pressure
#[derive(Debug, Args)]
#[command(
    after_help = "FLOW.csv has the columns time_ms and flow_mL_per_s, and PRESSURE.csv time_ms and \
                  pressure_mmHg, with times from the same instant. They hold one or more beats with \
                  samples of any spacing; lines that begin with # are comments.\n\
                  `cardiotwin discover --afterload FLOW.csv PRESSURE.csv` searches for effects that \
                  three elements lack."
)]
pub struct AfterloadArgs {
    /// FLOW.csv and PRESSURE.csv; only PRESSURE.csv with --volume, only FLOW.csv with --cuff, no
    /// file with both
    #[arg(value_name = "TRACE.csv", num_args = 0..=2)]
    traces: Vec<PathBuf>,
    /// Take -dV/dt of this volume in ejection as the flow; one cycle in the columns
    /// time_ms,volume_mL
    #[arg(long, value_name = "VOLUME.csv")]
    volume: Option<PathBuf>,
    /// Length of the volume's cycle in ms [default: until one step after the last sample]
    #[arg(long, value_name = "MS", requires = "volume")]
    cycle_length: Option<f64>,
    /// Fit to cuff pressures in mmHg instead of a measured pressure trace
    #[arg(
        long,
        value_name = "SYSTOLIC/DIASTOLIC[/MEAN]",
        value_parser = super::cuff::pressures,
        conflicts_with = "periodic"
    )]
    pub(super) cuff: Option<CuffPressures>,
    /// Standard deviation of the cuff pressures in mmHg [default: 4]
    #[arg(long, value_name = "MMHG", requires = "cuff")]
    pub(super) cuff_sd: Option<f64>,
    /// Start from the periodic steady state of the first cycle instead of fitting the initial
    /// pressure
    #[arg(long)]
    periodic: bool,
    /// Coverage probability of the intervals
    #[arg(long, value_name = "SHARE", default_value_t = 0.95)]
    pub(super) confidence: f64,
    /// Draw the pressure and the fit into this SVG file
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<PathBuf>,
    /// Print lines for patient.toml instead of a table
    #[arg(long, conflicts_with = "json")]
    pub(super) toml: bool,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(super) json: bool,
}

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
        return super::cuff::execute(args, source, talk);
    };
    let measured = record::read_from(source, pressure, talk)?;
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

/// Printable answer of a fit, other than its JSON.
pub(super) struct Said<'a> {
    /// Lines for patient.toml that set the fitted Windkessel.
    pub toml: &'a str,
    /// Warnings, one sentence each; `text` repeats them.
    pub warnings: &'a [String],
    /// Tables and sentences for the terminal.
    pub text: String,
}

/// Draws the plot if one was requested, and prints JSON, TOML or text as the arguments say.
pub(super) fn say(
    args: &AfterloadArgs,
    answer: &impl Serialize,
    said: &Said<'_>,
    plot: impl FnOnce() -> Option<String>,
    talk: &Talk,
) -> Result<Exit, CliError> {
    if let Some(file) = &args.plot {
        let svg = plot().unwrap_or_default();
        atomic::write(file, |out| out.write_all(svg.as_bytes()))
            .map_err(CliError::file("write", file))?;
    }
    if args.json {
        talk.json(answer)?;
    } else if args.toml {
        talk.data(said.toml)?;
    } else {
        talk.data(&said.text)?;
        talk.hint("`--toml` prints lines for patient.toml");
    }
    if args.json || args.toml {
        said.warnings
            .iter()
            .for_each(|warning| talk.say(&format!("warning: {warning}")));
    }
    Ok(Exit::Ok)
}

/// Table of the estimates. `determined` gives the word for how well an estimate is determined.
pub(super) fn estimates(
    estimates: &[AfterloadQuantity],
    confidence_level: f64,
    determined: impl Fn(&AfterloadQuantity) -> &'static str,
    talk: &Talk,
) -> String {
    let interval = format!(
        ">{} % FROM",
        number(100.0 * confidence_level).trim_end_matches(".00")
    );
    let mut table = Columns::new(
        talk,
        &[
            "PARAMETER",
            ">VALUE",
            ">STANDARD ERROR",
            &interval,
            ">TO",
            "DETERMINED",
        ],
    );
    for q in estimates {
        let ends = [q.standard_error, q.lower, q.upper].map(optional);
        let [error, lower, upper] = &ends;
        table.row([
            &q.name,
            &number(q.value),
            error,
            lower,
            upper,
            determined(q),
        ]);
    }
    table.text()
}

/// Word for how well a quantity is determined.
pub(super) fn in_a_word(determined: Determined) -> &'static str {
    match determined {
        Determined::Well => "well",
        Determined::Poorly => "poorly",
        Determined::Not => "not",
    }
}

/// Sources of flow and pressure. With a cuff there is no pressure file.
fn sources(args: &AfterloadArgs) -> Result<(FlowSource<'_>, Option<&Path>), CliError> {
    let usage = |text: &str| Err(CliError::Usage(text.to_owned()));
    if args
        .cycle_length
        .is_some_and(|ms| !(200.0..=3000.0).contains(&ms))
    {
        return usage("--cycle-length must lie between 200 and 3000 ms");
    }
    if args.cuff_sd.is_some_and(|sd| !(0.1..=50.0).contains(&sd)) {
        return usage("--cuff-sd must lie between 0.1 and 50 mmHg");
    }
    let volume = args
        .volume
        .as_deref()
        .map(|file| FlowSource::Ejected(file, args.cycle_length));
    match (volume, args.cuff, &args.traces[..]) {
        (None, None, [flow, pressure]) => Ok((FlowSource::Measured(flow), Some(pressure))),
        (Some(volume), None, [pressure]) => Ok((volume, Some(pressure))),
        (None, Some(_), [flow]) => Ok((FlowSource::Measured(flow), None)),
        (Some(volume), Some(_), []) => Ok((volume, None)),
        (None, None, _) => usage(
            "give FLOW.csv and PRESSURE.csv, or --volume instead of FLOW.csv, or --cuff instead of \
             PRESSURE.csv",
        ),
        (Some(_), None, _) => usage("with --volume, give only PRESSURE.csv, or --cuff"),
        (None, Some(_), _) => usage("with --cuff, give only FLOW.csv, or --volume"),
        (Some(_), Some(_), _) => usage("--volume and --cuff replace both files: give no file"),
    }
}

/// R1, R2 and C (mmHg·s/mL, mmHg·s/mL, mL/mmHg) under their names in files.
#[must_use]
pub fn parameters(three: [f64; 3]) -> WindkesselParameters {
    WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: three[0],
        peripheral_resistance_mmhg_s_per_ml: three[1],
        compliance_ml_per_mmhg: three[2],
    }
}

/// A file's name as it may stand in a TOML comment: a line feed in it would end the comment.
pub(super) fn one_line(name: &str) -> String {
    name.chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
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
    answer.warnings = warnings(&answer);
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
        crate::cli::talk::count(record.n_beats, "beat"),
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
            "/../examples/afterload"
        ))
        .join(case);
        let file = |trace: &str| folder.join(format!("{trace}{part}.csv"));
        let mut measured = record::read(&file("flow"), &file("pressure"), &talk()).unwrap();
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

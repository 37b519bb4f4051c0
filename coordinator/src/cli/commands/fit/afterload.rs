//! `cardiotwin fit afterload`: the three-element Windkessel from a measured flow and pressure.

use std::path::{Path, PathBuf};

use cardiotwin_calibrate::afterload::{
    self, Estimate, Start, WindkesselFit, WindkesselFitSettings, fit_windkessel,
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

/// Misfit over the pulse pressure from which the record is said to want more than three elements.
const LARGE_MISFIT: f64 = 0.05;
/// Correlation of two estimates from which only their combination is said to be determined.
const STRONG_CORRELATION: f64 = 0.95;

/// The three-element Windkessel (characteristic and peripheral resistance, compliance) from measured flow and pressure
#[derive(Debug, Args)]
#[command(
    after_help = "FLOW.csv has the columns time_ms and flow_mL_per_s, PRESSURE.csv time_ms and pressure_mmHg, on one clock, \
                        one beat or more, samples of any spacing; lines that begin with # are comments.\n\
                        What three elements miss in the record: `cardiotwin discover --afterload FLOW.csv PRESSURE.csv`."
)]
pub struct AfterloadArgs {
    /// FLOW.csv and PRESSURE.csv; with --volume the pressure alone, with --cuff the flow alone, with both none
    #[arg(value_name = "TRACE.csv", num_args = 0..=2)]
    traces: Vec<PathBuf>,
    /// In the place of a flow: -dV/dt in ejection of this volume, one cycle in the columns time_ms,volume_mL
    #[arg(long, value_name = "VOLUME.csv")]
    volume: Option<PathBuf>,
    /// Length of the volume's cycle in ms [default: to one step after its last sample]
    #[arg(long, value_name = "MS", requires = "volume")]
    cycle_length: Option<f64>,
    /// In the place of a pressure: the cuff's in mmHg
    #[arg(
        long,
        value_name = "SYSTOLIC/DIASTOLIC[/MEAN]",
        conflicts_with = "periodic"
    )]
    pub(super) cuff: Option<super::cuff::Pressures>,
    /// Standard deviation of the cuff's pressures in mmHg [default: 4]
    #[arg(long, value_name = "MMHG", requires = "cuff")]
    pub(super) cuff_sd: Option<f64>,
    /// Begin in the periodic steady state of the first cycle, instead of fitting the pressure at the beginning
    #[arg(long)]
    periodic: bool,
    /// Probability that an interval covers
    #[arg(long, value_name = "SHARE", default_value_t = 0.95)]
    pub(super) confidence: f64,
    /// Draw pressure and fit into this SVG file
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<PathBuf>,
    /// Print the lines for patient.toml instead
    #[arg(long, conflicts_with = "json")]
    pub(super) toml: bool,
    /// One JSON object instead of a table
    #[arg(long)]
    pub(super) json: bool,
}

/// Fits.
///
/// # Errors
/// As [`super::execute`].
pub fn execute(args: &AfterloadArgs, talk: &Talk) -> Result<Exit, CliError> {
    if !(args.confidence > 0.0 && args.confidence < 1.0) {
        return Err(CliError::Usage(
            "--confidence lies between 0 and 1".to_owned(),
        ));
    }
    let (source, pressure) = sources(args)?;
    let Some(pressure) = pressure else {
        return super::cuff::execute(args, source, talk);
    };
    let measured = record::read_from(source, pressure, talk)?;
    // One cycle of volume says nothing of what was before it.
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

/// What a fit says, but for JSON.
pub(super) struct Said<'a> {
    /// Lines of patient.toml.
    pub toml: &'a str,
    /// A sentence each; the text has them, too.
    pub warnings: &'a [String],
    /// For people.
    pub text: String,
}

/// Draws and prints what was asked for.
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
        talk.hint("`--toml` prints the lines for patient.toml");
    }
    if args.json || args.toml {
        said.warnings
            .iter()
            .for_each(|warning| talk.say(&format!("warning: {warning}")));
    }
    Ok(Exit::Ok)
}

/// The table of estimates; `determined` says how well one is known.
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

/// How well it is known, in a word.
pub(super) fn in_a_word(determined: Determined) -> &'static str {
    match determined {
        Determined::Well => "well",
        Determined::Poorly => "poorly",
        Determined::Not => "not",
    }
}

/// Where flow and pressure come from; no pressure with a cuff.
fn sources(args: &AfterloadArgs) -> Result<(FlowSource<'_>, Option<&Path>), CliError> {
    let usage = |text: &str| Err(CliError::Usage(text.to_owned()));
    if args
        .cycle_length
        .is_some_and(|ms| !(200.0..=3000.0).contains(&ms))
    {
        return usage("--cycle-length is 200 to 3000 ms");
    }
    if args.cuff_sd.is_some_and(|sd| !(0.1..=50.0).contains(&sd)) {
        return usage("--cuff-sd is 0.1 to 50 mmHg");
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
            "give FLOW.csv and PRESSURE.csv; --volume takes the place of the one, --cuff of the other",
        ),
        (Some(_), None, _) => usage("with --volume give PRESSURE.csv alone, or --cuff"),
        (None, Some(_), _) => usage("with --cuff give FLOW.csv alone, or --volume"),
        (Some(_), Some(_), _) => {
            usage("--volume and --cuff take the place of both files: give none")
        }
    }
}

/// R1, R2, C with their names in files.
#[must_use]
pub fn parameters(three: [f64; 3]) -> WindkesselParameters {
    WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: three[0],
        peripheral_resistance_mmhg_s_per_ml: three[1],
        compliance_ml_per_mmhg: three[2],
    }
}

/// A file's name in a comment: a line feed in it would end the comment.
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
        schema_version: cardiotwin_schemas::SCHEMA_VERSION,
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
    let determined = match determined {
        afterload::Determined::Well => Determined::Well,
        afterload::Determined::Poorly => Determined::Poorly,
        afterload::Determined::Not => Determined::Not,
    };
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
            "the minimisation ended before it met its tolerance: look at the plot".to_owned(),
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
            "the record does not determine {}: its interval has no end on a side",
            open.join(", ")
        ));
    }
    let pairs = ["R1 and R2", "R1 and C", "R2 and C"];
    for (pair, correlation) in pairs.iter().zip(answer.correlations) {
        if correlation.is_some_and(|c| c.abs() > STRONG_CORRELATION) {
            found.push(format!(
                "{pair} are not told apart: their estimates go together"
            ));
        }
    }
    if answer.share_of_pulse > LARGE_MISFIT {
        found.push(format!(
            "three elements miss {:.0} % of the pulse pressure; `cardiotwin discover --afterload` says what is lacking",
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
    let alike = answer
        .noise
        .beat_correlation
        .map_or(String::new(), |c| format!(", beats alike {c:.2}"));
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

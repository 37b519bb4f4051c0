//! Arguments of `cardiotwin fit afterload`: sources of flow and pressure, and cuff pressures.

use std::path::{Path, PathBuf};

use cardiotwin_calibrate::afterload::CuffPressures;
use clap::Args;

use super::record::FlowSource;
use super::trace::Accepted;
use crate::error::CliError;

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
    pub(super) volume: Option<PathBuf>,
    /// Length of the volume's cycle in ms [default: until one step after the last sample]
    #[arg(long, value_name = "MS", requires = "volume")]
    cycle_length: Option<f64>,
    /// Fit to cuff pressures in mmHg instead of a measured pressure trace
    #[arg(
        long,
        value_name = "SYSTOLIC/DIASTOLIC[/MEAN]",
        value_parser = pressures,
        conflicts_with = "periodic"
    )]
    pub(super) cuff: Option<CuffPressures>,
    /// Standard deviation of the cuff pressures in mmHg [default: 4]
    #[arg(long, value_name = "MMHG", requires = "cuff")]
    pub(super) cuff_sd: Option<f64>,
    /// Start from the periodic steady state of the first cycle instead of fitting the initial
    /// pressure
    #[arg(long)]
    pub(super) periodic: bool,
    /// Coverage probability of the intervals
    #[arg(long, value_name = "SHARE", default_value_t = 0.95)]
    pub(super) confidence: f64,
    /// Accept what a rule of consistency reports, by its name: aortic-mean-flow or
    /// aortic-mean-pressure (may be given several times)
    #[arg(long, value_name = "RULE")]
    accept: Vec<String>,
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

impl AfterloadArgs {
    /// Rules of consistency that are accepted.
    pub(super) fn accepted(&self) -> Accepted<'_> {
        Accepted {
            rules: &self.accept,
            option: "--accept",
        }
    }
}

/// Sources of flow and pressure. With a cuff there is no pressure file.
///
/// # Errors
/// [`CliError::Usage`] for arguments that contradict each other.
pub(super) fn sources(args: &AfterloadArgs) -> Result<(FlowSource<'_>, Option<&Path>), CliError> {
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

/// Cuff pressures, written as `115/70` or `115/70/88` (systolic/diastolic/mean, mmHg).
///
/// # Errors
/// What is wrong with the text, in words.
fn pressures(text: &str) -> Result<CuffPressures, String> {
    let numbers: Result<Vec<f64>, _> = text
        .split('/')
        .map(|part| part.trim().parse::<f64>())
        .collect();
    let numbers = numbers.unwrap_or_default();
    let in_range = numbers.iter().all(|p| (10.0..=350.0).contains(p));
    match numbers[..] {
        [systolic_mmhg, diastolic_mmhg, ref mean @ ..] if mean.len() < 2 && in_range => {
            let mean_mmhg = mean.first().copied();
            let between =
                mean_mmhg.is_none_or(|mean| mean > diastolic_mmhg && mean < systolic_mmhg);
            if systolic_mmhg > diastolic_mmhg && between {
                return Ok(CuffPressures {
                    systolic_mmhg,
                    diastolic_mmhg,
                    mean_mmhg,
                    sd_mmhg: None,
                });
            }
            Err(
                "systolic pressure must exceed diastolic pressure, and the mean must lie \
                     between them"
                    .to_owned(),
            )
        }
        _ => Err("write it as 115/70 or 115/70/88, in mmHg".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressures_are_read_and_nonsense_is_not() {
        assert_eq!(pressures("115/70").unwrap().mean_mmhg, None);
        assert_eq!(pressures("115/70/88").unwrap().mean_mmhg, Some(88.0));
        for text in [
            "115",
            "70/115",
            "115/70/60",
            "115/70/80/2",
            "a/b",
            "1.15/0.7",
            "",
            "115/70/",
        ] {
            assert!(pressures(text).is_err(), "{text}");
        }
    }
}

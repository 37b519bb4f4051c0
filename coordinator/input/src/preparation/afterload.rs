//! The Windkessel of a prepared patient, fitted to the aorta's or the cuff's pressure with the
//! measured flow or the fall of the volume in ejection.

use cardiotwin_calibrate::afterload::{
    AfterloadError, CuffFit, CuffPressures, Record, Start, WindkesselFit, WindkesselFitSettings,
    ejected, fit_cuff, fit_windkessel,
};
use cardiotwin_recordings::prepare::Prepared;
use cardiotwin_schemas::organ::WindkesselParameters;
use cardiotwin_signals::resample::ResampleError;
use cardiotwin_signals::{Continuation, Quantity, Trace, resample};
use cardiotwin_units::Ms;

use super::facts::Facts;
use crate::RawFolder;

/// Misfit over the pulse pressure above which a warning says that three elements are not enough.
const LARGE_MISFIT: f64 = 0.05;

/// Flow of one cycle, sampled evenly.
#[derive(Debug, Clone, PartialEq)]
pub struct EjectionFlow {
    /// Flow from the beat's beginning on, mL/s.
    pub flow_ml_per_s: Vec<f64>,
    /// Distance between samples, ms.
    pub step_ms: f64,
}

/// Reasons why a volume trace gives no flow.
#[derive(Debug, thiserror::Error)]
pub enum EjectionFlowError {
    /// The trace cannot be resampled.
    #[error(transparent)]
    Resample(#[from] ResampleError),
    /// The volume does not fall.
    #[error(transparent)]
    Ejection(#[from] AfterloadError),
}

/// Flow from the fall of a volume trace in ejection, sampled every ms.
///
/// # Errors
/// [`EjectionFlowError`] if the trace cannot be resampled or the volume does not fall.
pub fn ejection_flow(volume: &Trace, cycle_length: Ms) -> Result<EjectionFlow, EjectionFlowError> {
    let every_ms = resample(volume, Continuation::periodic(cycle_length), Ms(1.0))?;
    let flow_ml_per_s = ejected(every_ms.values(), 1.0)?;
    Ok(EjectionFlow {
        flow_ml_per_s,
        step_ms: 1.0,
    })
}

/// Outcome of the fit.
#[derive(Debug, Clone, PartialEq)]
pub enum Load {
    /// A fit to the aorta's mean pressure trace.
    Catheter {
        /// Result of the fit.
        fit: Box<WindkesselFit>,
        /// Origin of the flow, in words.
        flow: &'static str,
        /// Root mean square residual over the pulse pressure.
        share_of_pulse: f64,
    },
    /// A fit to the cuff's pressures.
    Cuff {
        /// Result of the fit.
        fit: CuffFit,
        /// Origin of the flow, in words.
        flow: &'static str,
    },
    /// The step is switched off.
    Off,
    /// The recordings lack data for a fit; the text says which.
    Lacking(&'static str),
    /// The fit failed, with the reason.
    Failed(String),
}

/// Fits the load to the aortic pressure if it was recorded, otherwise to the cuff's pressures.
pub fn fit(folder: &RawFolder, prepared: &Prepared, facts: &Facts) -> Load {
    if !folder.file.steps.afterload.enabled {
        return Load::Off;
    }
    let average = &prepared.average;
    let (flow, origin) = match flow(prepared) {
        Ok(Some(found)) => found,
        Ok(None) => {
            return Load::Lacking("neither a flow on the catheter's clock nor a cine series");
        }
        Err(why) => return Load::Failed(why),
    };
    if let Some(aorta) = &average.aortic_pressure {
        let times = |n: usize, step: f64| (0..n).map(|i| i as f64 * step).collect::<Vec<f64>>();
        let record = Record::new(
            &times(flow.flow_ml_per_s.len(), flow.step_ms),
            &flow.flow_ml_per_s,
            &times(aorta.mean.len(), average.step_ms),
            &aorta.mean,
        );
        let settings = WindkesselFitSettings {
            start: Start::Periodic,
            ..WindkesselFitSettings::default()
        };
        let fitted = record.and_then(|record| {
            let record = record.of_one_cycle(average.cycle_length_ms);
            let pulse = record.pulse_pressure_mmhg();
            Ok((fit_windkessel(&record, settings)?, pulse))
        });
        return match fitted {
            Ok((fit, pulse)) => {
                let share_of_pulse = fit.root_mean_square_mmhg / pulse;
                Load::Catheter {
                    fit: Box::new(fit),
                    flow: origin,
                    share_of_pulse,
                }
            }
            Err(error) => Load::Failed(error.to_string()),
        };
    }
    let Some((systolic_mmhg, diastolic_mmhg, sd_mmhg, _)) = facts.aortic else {
        return Load::Lacking("neither an aortic pressure nor a cuff pressure");
    };
    let cuff = CuffPressures {
        systolic_mmhg,
        diastolic_mmhg,
        mean_mmhg: facts.mean_aortic_mmhg,
        sd_mmhg,
    };
    match fit_cuff(&flow.flow_ml_per_s, flow.step_ms, cuff) {
        Ok(fit) => Load::Cuff { fit, flow: origin },
        Err(error) => Load::Failed(error.to_string()),
    }
}

/// The flow on the beat's clock, and its origin; `None` if neither flow nor volume was recorded.
fn flow(prepared: &Prepared) -> Result<Option<(EjectionFlow, &'static str)>, String> {
    if let Some(flow) = &prepared.average.flow {
        let step_ms = prepared.average.step_ms;
        return Ok(Some((
            EjectionFlow {
                flow_ml_per_s: flow.mean.clone(),
                step_ms,
            },
            "the measured flow",
        )));
    }
    let Some(volume) = &prepared.volume else {
        return Ok(None);
    };
    let frames = &volume.synchronised;
    let trace = Trace::new(
        Quantity::Volume,
        frames.time_ms.clone(),
        frames.volume_ml.clone(),
    );
    let trace = trace.map_err(|error| error.to_string())?;
    let flow = ejection_flow(&trace, Ms(prepared.average.cycle_length_ms))
        .map_err(|error| error.to_string())?;
    Ok(Some((flow, "-dV/dt in ejection")))
}

impl Load {
    /// Fitted R1, R2 and C; `None` if nothing was fitted.
    pub fn parameters(&self) -> Option<WindkesselParameters> {
        let [r1, r2, c] = match self {
            Self::Catheter { fit, .. } => [fit.r1.value, fit.r2.value, fit.compliance.value],
            Self::Cuff { fit, .. } => [fit.values[0], fit.values[1], fit.values[2]],
            _ => return None,
        };
        Some(WindkesselParameters {
            characteristic_resistance_mmhg_s_per_ml: r1,
            peripheral_resistance_mmhg_s_per_ml: r2,
            compliance_ml_per_mmhg: c,
        })
    }

    /// Description of the fit; `None` if nothing was fitted.
    pub fn how(&self) -> Option<String> {
        match self {
            Self::Catheter { flow, .. } => {
                Some(format!("fitted to the mean aortic pressure with {flow}"))
            }
            Self::Cuff { flow, fit } if fit.assumed_share => Some(format!(
                "through the cuff pressures with {flow}; R1 is the usual fraction of R2"
            )),
            Self::Cuff { flow, .. } => Some(format!(
                "through the cuff pressures, including the mean, with {flow}"
            )),
            _ => None,
        }
    }

    /// Table `[afterload]` of a patient file; `None` if nothing was fitted.
    pub fn toml(&self) -> Option<String> {
        Some(table(&self.parameters()?, &self.how()?))
    }

    /// Warning about a failed or poor fit.
    pub fn warning(&self) -> Option<String> {
        match self {
            Self::Failed(why) => Some(format!(
                "no Windkessel was fitted: {why}; step 0 will estimate one"
            )),
            Self::Catheter { share_of_pulse, .. } if *share_of_pulse > LARGE_MISFIT => {
                Some(format!(
                    "three elements misfit by {:.0} % of the aorta's pulse pressure; if flow was \
                     measured, `cardiotwin discover --afterload` on aortic_flow.csv and \
                     aortic_pressure.csv searches for the missing effect",
                    100.0 * share_of_pulse
                ))
            }
            _ => None,
        }
    }
}

/// Table `[afterload]` for `patient.toml`, with five significant digits.
#[must_use]
pub fn table(afterload: &WindkesselParameters, comment: &str) -> String {
    let rounded = |value: f64| {
        format!(
            "{:?}",
            format!("{value:.4e}").parse::<f64>().unwrap_or(value)
        )
    };
    format!(
        "# {comment}\n[afterload]\ncharacteristic_resistance_mmHg_s_per_mL = {}\nperipheral_resistance_mmHg_s_per_mL = {}\n\
         compliance_mL_per_mmHg = {}\n",
        rounded(afterload.characteristic_resistance_mmhg_s_per_ml),
        rounded(afterload.peripheral_resistance_mmhg_s_per_ml),
        rounded(afterload.compliance_ml_per_mmhg)
    )
}

//! Estimates of data that the patient file lacks. The result lists every estimate with its method.

use cardiotwin_models::circulation::filling::{self, FilledVolume};
use cardiotwin_models::circulation::{LeftHeart, StartPressure, estimate};
use cardiotwin_schemas::further::FurtherTraceSpec;
use cardiotwin_schemas::organ::WindkesselParameters;
use cardiotwin_schemas::outcome::Estimate;
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{Continuation, Trace, resample};
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::measurements::{EndDiastole, Measurements};
use crate::error::TaskError;
use crate::inputs::{read_trace, within_cycle};

/// Ratio of wall volume to end-diastolic volume; 0.7 to 0.8 in a normal left ventricle.
const WALL_SHARE: f64 = 0.75;
/// Ejection fraction if no stroke volume is known.
const EJECTION_FRACTION: f64 = 0.6;
/// Relative standard deviation of a stroke volume from the volume trace, and of one from flow imaging.
const STROKE_SD: f64 = 0.08;
const FORWARD_SD: f64 = 0.07;
/// Relative standard deviation of a flow MRI's volume through the mitral valve, our value.
const MITRAL_FLOW_SD: f64 = 0.1;
/// Start of ejection, and its duration as a share of the cycle, if there is no volume trace.
const EJECTION_BEGIN_MS: f64 = 80.0;
const EJECTION_SHARE: f64 = 1.0 / 3.0;

/// Estimates the wall volume from the end-diastolic volume.
pub(super) fn wall_volume(end_diastole: EndDiastole, estimates: &mut Vec<Estimate>) -> f64 {
    let value = WALL_SHARE * end_diastole.volume_ml;
    push(
        estimates,
        "anatomy.wall_volume_mL",
        value,
        "0.75 of the end-diastolic volume",
    );
    value
}

/// Data from which the loads are estimated.
pub(super) struct Loads<'a> {
    spec: &'a PassiveStateSpec,
    measured: &'a Measurements,
    end_diastole: EndDiastole,
    /// Volume that the ventricle ejects, through whatever opening.
    stroke_volume: Volume,
    /// Volume that stays in the arteries.
    forward_volume: Volume,
}

/// A volume of a beat \[mL\] with its standard deviation and its origin.
#[derive(Clone, Copy)]
struct Volume {
    ml: f64,
    sd_ml: f64,
    origin: &'static str,
}

/// What stays in the arteries of a beat's volume. A flow measured in the aorta is that volume itself,
/// but a less exact one than the ventricle's stroke volume: both count by their variances as long as
/// they are the same to two standard deviations. Where they are not, blood leaks, and the flow counts
/// alone.
fn forward(stroke: Option<Volume>, flow: Option<Volume>) -> Option<Volume> {
    let (Some(stroke), Some(flow)) = (stroke, flow) else {
        return flow.or(stroke);
    };
    if (stroke.ml - flow.ml).abs() > 2.0 * stroke.sd_ml.hypot(flow.sd_ml) {
        return Some(flow);
    }
    let [a, b] = [stroke.sd_ml, flow.sd_ml].map(|sd| sd.powi(-2));
    Some(Volume {
        ml: (a * stroke.ml + b * flow.ml) / (a + b),
        sd_ml: (a + b).powf(-0.5),
        origin: "the stroke and the forward volume",
    })
}

impl<'a> Loads<'a> {
    pub(super) fn new(
        spec: &'a PassiveStateSpec,
        measured: &'a Measurements,
        end_diastole: EndDiastole,
    ) -> Self {
        let stroke = measured.biomarkers.sv_ml.map(|ml| Volume {
            ml,
            sd_ml: STROKE_SD * ml,
            origin: "the stroke volume",
        });
        let flow = spec.flows.forward_stroke_volume.as_ref();
        let flow = flow.map(|flow| Volume {
            ml: flow.volume_ml,
            sd_ml: (flow.sd_ml.filter(|sd| *sd > 0.0)).unwrap_or(FORWARD_SD * flow.volume_ml),
            origin: "the forward stroke volume",
        });
        let usual_ml = EJECTION_FRACTION * end_diastole.volume_ml;
        let usual = Volume {
            ml: usual_ml,
            sd_ml: 0.2 * usual_ml,
            origin: "a usual stroke volume",
        };
        Self {
            spec,
            measured,
            end_diastole,
            stroke_volume: stroke.or(flow).unwrap_or(usual),
            forward_volume: forward(stroke, flow).unwrap_or(usual),
        }
    }

    /// Windkessel pressure at the beginning of a cycle that is periodic with the measured forward
    /// volume.
    pub(super) fn periodic_windkessel_pressure(&self, load: &WindkesselParameters) -> f64 {
        let heart = LeftHeart {
            left_atrial_pressure: Mmhg(self.end_diastole.pressure_mmhg),
            mitral_forward: LeftHeart::FORWARD,
            mitral_backward: LeftHeart::BACKWARD,
            aortic_forward: LeftHeart::FORWARD,
            aortic_backward: LeftHeart::BACKWARD,
            windkessel: *load,
            start: StartPressure::StrokeVolume(Ml(self.forward_volume.ml)),
            cycle_length: Ms(self.spec.cycle_length_ms),
        };
        heart.start_pressure().0
    }

    /// Load that reproduces the arterial pressures under the measured ejection.
    pub(super) fn afterload(
        &self,
        estimates: &mut Vec<Estimate>,
    ) -> Result<WindkesselParameters, TaskError> {
        let (systolic, diastolic, origin) = self.arterial_pressures()?;
        let (volume, shape) = match self.measured.quiet_volume(self.spec.cycle_length_ms) {
            Some(volume) => (self.arterial_volume(volume), "measured ejection"),
            None => (
                self.assumed_volume(),
                "an assumed ejection of the stroke volume",
            ),
        };
        let found = estimate::windkessel(&volume, Ms(1.0), Mmhg(systolic), Mmhg(diastolic))?;
        let load = found.value;
        let method = format!("{}; {shape}, {origin}", found.how);
        for (key, value) in [
            (
                "afterload.characteristic_resistance_mmHg_s_per_mL",
                load.characteristic_resistance_mmhg_s_per_ml,
            ),
            (
                "afterload.peripheral_resistance_mmHg_s_per_mL",
                load.peripheral_resistance_mmhg_s_per_ml,
            ),
            (
                "afterload.compliance_mL_per_mmHg",
                load.compliance_ml_per_mmhg,
            ),
        ] {
            push(estimates, key, value, &method);
        }
        Ok(load)
    }

    /// The volume trace, scaled so that its stroke is the volume that stays in the arteries.
    fn arterial_volume(&self, mut volume: Vec<f64>) -> Vec<f64> {
        let range = |(low, high): (f64, f64), v: &f64| (v.min(low), v.max(high));
        let (low, high) = volume.iter().fold((f64::MAX, f64::MIN), range);
        let flow = &self.spec.flows.forward_stroke_volume;
        if flow.is_some() && high > low {
            let share = self.forward_volume.ml / (high - low);
            volume
                .iter_mut()
                .for_each(|v| *v = high - share * (high - *v));
        }
        volume
    }

    /// Volume that falls by the forward volume, with the flow of a half sine, and rises again; one
    /// sample per millisecond of a cycle.
    fn assumed_volume(&self) -> Vec<f64> {
        let length = self.spec.cycle_length_ms;
        let duration = EJECTION_SHARE * length;
        let end = EJECTION_BEGIN_MS + duration;
        let ejected = |time: f64| {
            let phase = ((time - EJECTION_BEGIN_MS) / duration).clamp(0.0, 1.0);
            let filled = ((time - end) / (length - end)).clamp(0.0, 1.0);
            0.5 * (1.0 - (std::f64::consts::PI * phase).cos()) - filled
        };
        let samples = 0..length.floor() as usize;
        samples
            .map(|idx| self.end_diastole.volume_ml - self.forward_volume.ml * ejected(idx as f64))
            .collect()
    }

    /// Systolic and diastolic arterial pressure, with their origin.
    fn arterial_pressures(&self) -> Result<(f64, f64, &'static str), TaskError> {
        if let (Some(systolic), Some(diastolic)) = (
            self.spec.aortic_systolic_mmhg,
            self.spec.aortic_diastolic_mmhg,
        ) {
            return Ok((systolic, diastolic, "measured arterial pressure"));
        }
        // Without a cuff pressure, take the ventricle's own peak, and its pressure at the start of
        // ejection.
        let opening = self
            .measured
            .pressure
            .as_ref()
            .zip(self.measured.read.time_points.t4_ms)
            .map(|(p, t)| p.at(t));
        match (
            self.measured.biomarkers.p_max_mmhg,
            self.spec.aortic_diastolic_mmhg.or(opening),
        ) {
            (Some(systolic), Some(diastolic)) => Ok((
                systolic,
                diastolic,
                "the ventricle's peak pressure and its pressure when ejection begins",
            )),
            _ => Err(TaskError::NotMeasured {
                what: "arterial pressure",
                remedy: "give [afterload], or [measured.aortic_pressure] with systolic and diastolic pressure",
            }),
        }
    }

    /// Filling pressure: a measured atrial or wedge pressure, else the one that closes the volume of
    /// the measured beat, else a share of the end-diastolic one.
    pub(super) fn left_atrial_pressure(
        &self,
        estimates: &mut Vec<Estimate>,
    ) -> Result<f64, TaskError> {
        let found = match (&self.spec.flows.atrial_pressure, &self.measured.pressure) {
            (Some(atrium), _) => {
                let is_wedge = atrium.delay_ms.is_some_and(|delay| delay > 0.0);
                filling::from_atrium(self.over_cycle(atrium)?.values(), is_wedge)?
            }
            (None, Some(pressure)) => {
                filling::from_beat(pressure.values(), STEP, self.filled_volume()?)?
            }
            (None, None) => filling::from_end_diastole(Mmhg(self.end_diastole.pressure_mmhg))?,
        };
        estimates.push(Estimate {
            key: "preload.left_atrial_pressure_mmHg".to_owned(),
            value: found.value.0,
            sd: Some(found.sd.0),
            method: found.how,
        });
        Ok(found.value.0)
    }

    /// Volume that enters through the mitral valve in a cycle: its measured flow, else what the
    /// ventricle ejects.
    fn filled_volume(&self) -> Result<FilledVolume, TaskError> {
        let Some(flow) = &self.spec.flows.mitral_flow else {
            let Volume { ml, sd_ml, origin } = self.stroke_volume;
            return Ok(FilledVolume {
                volume: Ml(ml),
                sd: Ml(sd_ml),
                origin,
            });
        };
        let flow = self.over_cycle(flow)?;
        let volume_ml: f64 = flow.values().iter().map(|q| q.max(0.0)).sum::<f64>() * STEP.0 * 1e-3;
        Ok(FilledVolume {
            volume: Ml(volume_ml),
            sd: Ml(MITRAL_FLOW_SD * volume_ml),
            origin: "the measured mitral flow",
        })
    }

    /// A further trace, resampled over the cycle.
    fn over_cycle(&self, stated: &FurtherTraceSpec) -> Result<Trace, TaskError> {
        let trace = read_trace(&stated.file, stated.quantity.into())?;
        let periodic = Continuation::periodic(Ms(self.spec.cycle_length_ms));
        Ok(resample(
            &within_cycle(trace, self.spec.cycle_length_ms)?,
            periodic,
            STEP,
        )?)
    }
}

fn push(estimates: &mut Vec<Estimate>, key: &str, value: f64, method: &str) {
    estimates.push(Estimate {
        key: key.to_owned(),
        value,
        sd: None,
        method: method.to_owned(),
    });
}

//! Estimates of data that the patient file lacks. The result lists every estimate with its method.

use cardiotwin_models::circulation::{LeftHeart, StartPressure, estimate};
use cardiotwin_schemas::organ::WindkesselParameters;
use cardiotwin_schemas::outcome::Estimate;
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::measurements::{EndDiastole, Measurements};
use crate::error::TaskError;

/// Ratio of wall volume to end-diastolic volume; 0.7 to 0.8 in a normal left ventricle.
const WALL_SHARE: f64 = 0.75;
/// Ejection fraction if no stroke volume is known.
const EJECTION_FRACTION: f64 = 0.6;
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
    stroke_volume_ml: f64,
}

impl<'a> Loads<'a> {
    pub(super) fn new(
        spec: &'a PassiveStateSpec,
        measured: &'a Measurements,
        end_diastole: EndDiastole,
    ) -> Self {
        let stroke_volume_ml = measured
            .biomarkers
            .sv_ml
            .unwrap_or(EJECTION_FRACTION * end_diastole.volume_ml);
        Self {
            spec,
            measured,
            end_diastole,
            stroke_volume_ml,
        }
    }

    /// Windkessel pressure at the beginning of a cycle that is periodic with the measured stroke
    /// volume.
    pub(super) fn periodic_windkessel_pressure(&self, load: &WindkesselParameters) -> f64 {
        let heart = LeftHeart {
            left_atrial_pressure: Mmhg(self.end_diastole.pressure_mmhg),
            mitral_forward: LeftHeart::FORWARD,
            mitral_backward: LeftHeart::BACKWARD,
            aortic_forward: LeftHeart::FORWARD,
            aortic_backward: LeftHeart::BACKWARD,
            windkessel: *load,
            start: StartPressure::StrokeVolume(Ml(self.stroke_volume_ml)),
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
            Some(volume) => (volume, "measured ejection"),
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

    /// Volume that falls by the stroke volume, with the flow of a half sine, and rises again; one
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
            .map(|idx| self.end_diastole.volume_ml - self.stroke_volume_ml * ejected(idx as f64))
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

    /// Estimates the filling pressure from end-diastole and diastasis.
    pub(super) fn left_atrial_pressure(
        &self,
        estimates: &mut Vec<Estimate>,
    ) -> Result<f64, TaskError> {
        let diastasis = self
            .measured
            .pressure
            .as_ref()
            .zip(self.spec.diastasis_time_ms);
        let pressure = diastasis.map(|(trace, time)| Mmhg(trace.at(time)));
        let found =
            estimate::left_atrial_pressure(Mmhg(self.end_diastole.pressure_mmhg), pressure)?;
        push(
            estimates,
            "preload.left_atrial_pressure_mmHg",
            found.value.0,
            &found.how,
        );
        Ok(found.value.0)
    }
}

fn push(estimates: &mut Vec<Estimate>, key: &str, value: f64, method: &str) {
    estimates.push(Estimate {
        key: key.to_owned(),
        value,
        method: method.to_owned(),
    });
}

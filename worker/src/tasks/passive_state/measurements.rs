//! Measured data of a patient: traces, biomarkers, and the state at end-diastole.

use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::outcome::Estimate;
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{
    BeatBiomarkers, Continuation, NoiseWindows, Quantity, Trace, noise_windows, resample,
};
use cardiotwin_units::{Mmhg, Ms};

use super::corrections;
use crate::error::TaskError;
use crate::inputs::read_trace;

/// Measured data, with traces resampled to 1 ms.
pub(super) struct Measurements {
    pub(super) pressure: Option<Trace>,
    pub(super) volume: Option<Trace>,
    pub(super) read: BeatBiomarkers,
    /// Biomarkers of the traces, replaced by directly given values where there are any.
    pub(super) biomarkers: Biomarkers,
    /// Windows over which biomarkers of noisy traces are read.
    pub(super) windows: NoiseWindows,
    /// Change of the end-diastolic pressure by the corrections \[mmHg\].
    pub(super) moved_by: Mmhg,
}

/// Volumes and pressures at end-diastole, in mL and mmHg.
#[derive(Clone, Copy)]
pub(super) struct EndDiastole {
    pub(super) volume_ml: f64,
    pub(super) pressure_mmhg: f64,
}

impl Measurements {
    pub(super) fn read(spec: &PassiveStateSpec) -> Result<Self, TaskError> {
        let periodic = Continuation::periodic(Ms(spec.cycle_length_ms));
        let read = |input: &Option<_>, quantity| -> Result<Option<Trace>, TaskError> {
            let trace = input
                .as_ref()
                .map(|file| read_trace(file, quantity))
                .transpose()?;
            trace
                .map(|trace| resample(&trace, periodic, STEP))
                .transpose()
                .map_err(TaskError::from)
        };
        let frames = spec
            .volume
            .as_ref()
            .map(|file| read_trace(file, Quantity::Volume))
            .transpose()?;
        let mut pressure = read(&spec.pressure, Quantity::Pressure)?;
        let mut volume = read(&spec.volume, Quantity::Volume)?;
        let moved_by = corrections::apply(
            &spec.corrections,
            spec.cycle_length_ms,
            &mut pressure,
            &mut volume,
        )?;
        // Biomarkers that are given directly were read by another method.
        let given = &spec.biomarkers;
        let of_pressure = [
            given.p_max_mmhg,
            given.dpdt_max_mmhg_per_ms,
            given.dpdt_min_mmhg_per_ms,
        ];
        let of_volume = [given.sv_ml, given.tau_vd_ms, given.tau_vr_ms];
        let ours = |given: &[Option<f64>]| given.iter().all(Option::is_none);
        let windows = noise_windows::of(
            pressure.as_ref().filter(|_| ours(&of_pressure)),
            frames.as_ref().filter(|_| ours(&of_volume)),
            periodic,
        );
        let read = BeatBiomarkers::over(pressure.as_ref(), volume.as_ref(), periodic, windows)?;
        let biomarkers = read.values.overridden_by(given);
        Ok(Self {
            pressure,
            volume,
            read,
            biomarkers,
            windows,
            moved_by,
        })
    }

    /// The volume trace, smoothed over its noise window if it has one.
    pub(super) fn quiet_volume(&self, cycle_length_ms: f64) -> Option<Vec<f64>> {
        let volume = self.volume.as_ref()?;
        let periodic = Continuation::periodic(Ms(cycle_length_ms));
        Some(match self.windows.volume_ms {
            Some(window) => noise_windows::smoothed(volume, periodic, Ms(window)),
            None => volume.values().to_vec(),
        })
    }

    pub(super) fn end_diastole(
        &self,
        spec: &PassiveStateSpec,
        estimates: &mut Vec<Estimate>,
    ) -> Result<EndDiastole, TaskError> {
        // A directly given pressure comes from the same catheter, so the same correction applies.
        let stated = spec
            .end_diastolic_pressure_mmhg
            .map(|pressure| pressure + self.moved_by.0);
        let pressure = stated.or(self.biomarkers.edp_mmhg);
        let pressure_mmhg = pressure.ok_or(TaskError::NotMeasured {
            what: "end-diastolic pressure",
            remedy: "give `end_diastolic_pressure_mmHg` in [measured], or a pressure trace",
        })?;
        let volume = self.biomarkers.edv_ml.or(spec.end_diastolic_volume_ml);
        let volume_ml = match (volume, spec.diastasis_volume_ml) {
            (Some(volume), _) => volume,
            (None, Some(image)) => {
                let method =
                    "volume of the whole-heart image, for lack of a volume at end-diastole"
                        .to_owned();
                let key = "measured.end_diastolic_volume_mL".to_owned();
                estimates.push(Estimate {
                    key,
                    value: image,
                    sd: None,
                    method,
                });
                image
            }
            (None, None) => {
                return Err(TaskError::NotMeasured {
                    what: "end-diastolic volume",
                    remedy: "give `end_diastolic_volume_mL` in [measured], a volume trace or [measured.diastasis]",
                });
            }
        };
        Ok(EndDiastole {
            volume_ml,
            pressure_mmhg,
        })
    }
}

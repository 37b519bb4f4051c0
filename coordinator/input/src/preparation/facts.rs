//! Numbers of a prepared patient's file that no trace contains.

use cardiotwin_recordings::average::MeanTrace;
use cardiotwin_recordings::prepare::Prepared;
use cardiotwin_schemas::raw::NoiseOf;

use crate::RawFolder;

/// Numbers of the patient's file that no trace contains.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Facts {
    /// Pressure at the beat's beginning, mmHg.
    pub end_diastolic_pressure_mmhg: Option<f64>,
    /// Systolic and diastolic pressure of the aorta, their standard deviation, mmHg, and their
    /// origin.
    pub aortic: Option<(f64, f64, Option<f64>, &'static str)>,
    /// Mean pressure of the aorta, mmHg.
    pub mean_aortic_mmhg: Option<f64>,
    /// Net forward volume of a beat, mL, its standard deviation, mL, and its origin.
    pub forward: Option<(f64, Option<f64>, &'static str)>,
    /// Noise of the pressure, mmHg, and its correlation time, ms.
    pub pressure_noise: (Option<f64>, Option<f64>),
    /// Noise of a frame, mL.
    pub volume_noise_ml: Option<f64>,
}

impl Facts {
    /// Numbers from the recordings, unless `prepare.toml` gives others.
    pub fn of(folder: &RawFolder, prepared: &Prepared) -> Self {
        let average = &prepared.average;
        let noise = &folder.file.steps.noise;
        let seen = prepared.noise.filter(|_| noise.enabled);
        let rms = seen.map(|seen| match noise.of {
            NoiseOf::Mean => seen.mean_rms_mmhg,
            // Level and strength also differ from beat to beat, but do not have the correlation of
            // the noise.
            NoiseOf::Beat => seen.beat_rms_mmhg,
        });
        let frames = prepared
            .volume
            .as_ref()
            .filter(|_| noise.enabled)
            .map(|volume| volume.noise_rms_ml);
        Self {
            end_diastolic_pressure_mmhg: average.lv_pressure.as_ref().map(|lv| lv.mean[0]),
            aortic: aortic(folder, average.aortic_pressure.as_ref()),
            mean_aortic_mmhg: average
                .aortic_pressure
                .as_ref()
                .map(|aorta| aorta.mean.iter().sum::<f64>() / aorta.mean.len() as f64)
                .or(folder.file.cuff.as_ref().and_then(|cuff| cuff.mean_mmhg)),
            forward: forward(folder, prepared),
            pressure_noise: (
                noise.pressure_rms_mmhg.or(rms),
                noise
                    .pressure_correlation_ms
                    .or(seen.map(|seen| seen.correlation_ms)),
            ),
            volume_noise_ml: noise.volume_rms_ml.or(frames),
        }
    }
}

fn aortic(
    folder: &RawFolder,
    measured: Option<&MeanTrace>,
) -> Option<(f64, f64, Option<f64>, &'static str)> {
    if let Some(aorta) = measured {
        let top = (0..aorta.mean.len()).max_by(|a, b| aorta.mean[*a].total_cmp(&aorta.mean[*b]))?;
        let low = aorta.mean.iter().copied().fold(f64::INFINITY, f64::min);
        return Some((
            aorta.mean[top],
            low,
            Some(aorta.sd[top]),
            "aortic catheter, mean beat",
        ));
    }
    let cuff = folder.file.cuff.as_ref()?;
    Some((
        cuff.systolic_mmhg,
        cuff.diastolic_mmhg,
        cuff.sd_mmhg,
        "cuff",
    ))
}

fn forward(folder: &RawFolder, prepared: &Prepared) -> Option<(f64, Option<f64>, &'static str)> {
    let sd = folder.file.flow.sd_ml;
    if let Some((time, flow)) = &folder.flow {
        // One cycle consists of phases, each as long as the mean step.
        let n = flow.len() as f64;
        let step = (time.last()? - time.first()?) / (n - 1.0);
        return Some((
            flow.iter().sum::<f64>() * step * 1e-3,
            sd,
            "flow of one cycle",
        ));
    }
    let flow = prepared.average.flow.as_ref()?;
    Some((
        flow.mean.iter().sum::<f64>() * prepared.average.step_ms * 1e-3,
        sd,
        "flow probe, mean beat",
    ))
}

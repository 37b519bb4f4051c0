//! `patient.toml` of a prepared patient.

use std::fmt::Write as _;

use cardiotwin_recordings::average::MeanTrace;
use cardiotwin_recordings::prepare::Prepared;
use cardiotwin_schemas::raw::NoiseOf;

use super::afterload::Load;
use crate::input::RawFolder;

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

/// Text of the file.
pub fn toml(
    id: &str,
    folder: &RawFolder,
    prepared: &Prepared,
    facts: &Facts,
    load: &Load,
) -> String {
    let average = &prepared.average;
    let file = &folder.file;
    let mut text = String::new();
    let mut line = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    let named: Vec<&str> = folder
        .inputs
        .iter()
        .map(|input| input.file.as_str())
        .collect();
    let plain = |text: &str| {
        text.chars()
            .map(|c| if c.is_control() { '?' } else { c })
            .collect::<String>()
    };
    line(format!(
        "# Made by `cardiotwin prepare` from {}; prepared/prepare.json records the steps.",
        plain(&named.join(", "))
    ));
    line(format!("id = {}", quoted(id)));
    line(format!(
        "cycle_length_ms = {}",
        number(average.cycle_length_ms, 2)
    ));
    line("\n[measured]".to_owned());
    if average.lv_pressure.is_some() {
        line("pressure = \"pressure.csv\"".to_owned());
    }
    if prepared.volume.is_some() {
        line("volume = \"volume.csv\"".to_owned());
    }
    if let Some(edp) = facts.end_diastolic_pressure_mmhg {
        line(format!("end_diastolic_pressure_mmHg = {}", number(edp, 2)));
    }
    line(format!("beats_averaged = {}", average.n_averaged));
    let (rms, correlation) = facts.pressure_noise;
    let frames = prepared
        .volume
        .as_ref()
        .map(|volume| volume.original.time_ms.len());
    let noise = [
        (
            "pressure_rms_mmHg",
            rms.filter(|_| average.lv_pressure.is_some()),
        ),
        (
            "pressure_correlation_ms",
            correlation.filter(|_| average.lv_pressure.is_some()),
        ),
        ("volume_rms_mL", facts.volume_noise_ml),
        ("volume_frames", frames.map(|n| n as f64)),
    ];
    if noise.iter().any(|(_, value)| value.is_some()) {
        line("\n[measured.noise]".to_owned());
        for (key, value) in noise {
            value
                .into_iter()
                .for_each(|value| line(format!("{key} = {}", number(value, 3))));
        }
    }
    if let Some((systolic, diastolic, sd, origin)) = facts.aortic {
        line(format!(
            "\n[measured.aortic_pressure]              # {origin}"
        ));
        line(format!("systolic_mmHg = {}", number(systolic, 1)));
        line(format!("diastolic_mmHg = {}", number(diastolic, 1)));
        sd.into_iter()
            .for_each(|sd| line(format!("sd_mmHg = {}", number(sd, 2))));
    }
    if let Some((volume, sd, origin)) = facts.forward {
        line(format!(
            "\n[measured.forward_stroke_volume]        # {origin}"
        ));
        line(format!("volume_mL = {}", number(volume, 2)));
        sd.into_iter()
            .for_each(|sd| line(format!("sd_mL = {}", number(sd, 2))));
    }
    let at = prepared
        .volume
        .as_ref()
        .and_then(|volume| volume.image_time_ms);
    if let (Some(image), Some(time)) = (&file.whole_heart, at) {
        line("\n[measured.diastasis]                    # the whole-heart image, on the beat's clock".to_owned());
        line(format!("time_ms = {}", number(time, 1)));
        line(format!("volume_mL = {}", number(image.volume_ml, 3)));
        image
            .sd_ml
            .into_iter()
            .for_each(|sd| line(format!("sd_mL = {}", number(sd, 3))));
    }
    if let Some(wall) = file.anatomy.wall_volume_ml {
        line(format!("\n[anatomy]\nwall_volume_mL = {}", number(wall, 3)));
    }
    if let Some(table) = load.toml() {
        let _ = write!(text, "\n{table}");
    }
    if let Some(preload) = &file.preload {
        let _ = writeln!(
            text,
            "\n[preload]\nleft_atrial_pressure_mmHg = {}",
            number(preload.left_atrial_pressure_mmhg, 3)
        );
    }
    text
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A number with at most this many decimals.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

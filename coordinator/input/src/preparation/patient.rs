//! `patient.toml` of a prepared patient.

use std::fmt::Write as _;

use cardiotwin_recordings::prepare::Prepared;

use super::afterload::Load;
use super::facts::Facts;
use crate::RawFolder;

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
        "# Made by `{}` from {}; prepared/prepare.json records the steps.",
        folder.made_by,
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
    if !file.accept.is_empty() {
        let names: Vec<String> = file.accept.iter().map(|name| quoted(name)).collect();
        line(format!("accept = [{}]", names.join(", ")));
    }
    let (rms, correlation) = facts.pressure_noise;
    // Samples of a continuous volume are no independent frames.
    let frames = prepared
        .volume
        .as_ref()
        .filter(|volume| !volume.on_pressure_clock)
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

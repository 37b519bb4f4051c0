//! Writes a folder of synthetic recordings with their ground truth: `make-recordings FOLDER
//! [MINUTES [SEED [HZ]]]`. `examples/recordings` was made by `make-recordings
//! examples/recordings/P001-raw 0.7 5 250`.

#[path = "../../../solver/recordings/tests/made/mod.rs"]
#[allow(dead_code)]
mod made;

use std::fmt::Write as _;
use std::path::PathBuf;

use cardiotwin_vocabulary::preparation::RawImage;
use made::{Kind, Wish, make};

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = PathBuf::from(
        arguments
            .first()
            .expect("make-recordings FOLDER [MINUTES [SEED [HZ]]]"),
    );
    let number = |k: usize, otherwise: f64| {
        arguments
            .get(k)
            .map_or(otherwise, |text| text.parse().expect("a number"))
    };
    let (minutes, seed, hz) = (number(1, 0.7), number(2, 5.0) as u64, number(3, 250.0));
    let wish = Wish {
        n_beats: (minutes * 72.0) as usize + 6,
        step_ms: 1000.0 / hz,
        ectopic_every: 15,
        damage_every: 21,
        drift_mmhg_per_min: 4.0,
        line: Some((28.0, 0.35)),
        frame_noise_ml: 1.5,
        ..Wish::usual(seed)
    };
    let (raw, truth) = make(&wish);
    let recording = &raw.recording;
    std::fs::create_dir_all(&folder)?;
    let channel = |c: &Option<Vec<f64>>| c.clone().unwrap_or_default();
    let (lv, aorta) = (
        channel(&recording.channels.lv_pressure_mmhg),
        channel(&recording.channels.aortic_pressure_mmhg),
    );
    let ecg = channel(&recording.channels.ecg_mv);
    let n = recording
        .n_samples()
        .min((minutes * 60_000.0 / recording.step_ms) as usize);
    let mut text = String::from("time_s,lv_pressure_mmHg,aortic_pressure_mmHg,ecg_mV\n");
    let shown = |value: f64, decimals: usize| {
        if value.is_finite() {
            format!("{value:.decimals$}")
        } else {
            String::new()
        }
    };
    for i in 0..n {
        let t = i as f64 * recording.step_ms * 1e-3;
        let _ = writeln!(
            text,
            "{t:.3},{},{},{}",
            shown(lv[i], 1),
            shown(aorta[i], 1),
            shown(ecg[i], 2)
        );
    }
    std::fs::write(folder.join("catheter.csv"), text)?;
    let cine = raw.cine.expect("made");
    let mut text = String::from("time_ms,volume_mL\n");
    for (t, v) in cine.time_ms.iter().zip(&cine.volume_ml) {
        let _ = writeln!(text, "{t:.1},{v:.1}");
    }
    std::fs::write(folder.join("cine.csv"), text)?;
    let RawImage {
        time_ms, volume_ml, ..
    } = raw.whole_heart.expect("made");
    println!("[cine]\ncycle_length_ms = {:.1}\n", cine.cycle_length_ms);
    println!("[whole_heart]\ntime_ms = {time_ms:.0}\nvolume_mL = {volume_ml:.1}\nsd_mL = 4\n");
    let end = |kind: Kind| truth.kinds.iter().filter(|k| **k == kind).count();
    println!(
        "# truth: cycle {} ms, ejection {:?} ms after the R wave,",
        truth.cycle_ms, truth.ejection_ms
    );
    println!(
        "# {} ectopic and {} damaged beats, drift 4 mmHg/min,",
        end(Kind::Ectopic),
        end(Kind::Damaged)
    );
    let (systole, diastole, lag) = truth.cine;
    println!(
        "# cine: systole times {systole:.3}, diastole times {diastole:.3}, lag {lag:.1} ms; line delays {:.1} ms,",
        truth.delay_ms
    );
    println!("# volumes times {:.4} are right", truth.volume_factor);
    Ok(())
}

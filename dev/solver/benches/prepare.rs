//! Preparation of half an hour at 1 kHz (pressures of ventricle and aorta with an
//! electrocardiogram), from text and from numbers.

#[path = "../../../solver/recordings/tests/made/mod.rs"]
#[allow(dead_code)]
mod made;

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;

use cardiotwin_lab_files::Wanted;
use cardiotwin_lab_files::delimited::parse;
use cardiotwin_recordings::prepare;
use cardiotwin_vocabulary::preparation::RawSteps;
use criterion::{Criterion, criterion_group, criterion_main};
use made::{Wish, make};

fn half_an_hour(c: &mut Criterion) {
    let wish = Wish {
        n_beats: 2400,
        ectopic_every: 40,
        damage_every: 120,
        ..Wish::usual(11)
    };
    let (mut raw, _) = make(&wish);
    let n = (30 * 60 * 1000).min(raw.recording.n_samples());
    let channels = [
        &mut raw.recording.channels.lv_pressure_mmhg,
        &mut raw.recording.channels.aortic_pressure_mmhg,
        &mut raw.recording.channels.ecg_mv,
    ];
    channels
        .into_iter()
        .flatten()
        .for_each(|channel| channel.truncate(n));
    let minutes = raw.recording.length_ms() / 60_000.0;
    let mut group = c.benchmark_group(format!("prepare {minutes:.1} minutes at 1 kHz"));
    group.sample_size(10);
    group.bench_function("all steps", |b| {
        b.iter(|| prepare(black_box(&raw), &RawSteps::default()).unwrap())
    });
    let text = csv(&raw);
    let wanted: Vec<Wanted> = [
        "time_ms",
        "lv_pressure_mmHg",
        "aortic_pressure_mmHg",
        "ecg_mV",
    ]
    .map(|name| Wanted {
        quantity: name,
        names: vec![(name.to_owned(), 1.0)],
        given: false,
        required: true,
        may_lack: name != "time_ms",
    })
    .into();
    group.bench_function(format!("reading {:.0} MB", text.len() as f64 / 1e6), |b| {
        b.iter(|| {
            parse(
                black_box(text.as_bytes()),
                Path::new("catheter.csv"),
                &wanted,
            )
            .table
            .unwrap()
        });
    });
    group.finish();
}

fn csv(raw: &cardiotwin_recordings::Raw) -> String {
    let channel = |c: &Option<Vec<f64>>| c.clone().unwrap_or_default();
    let r = &raw.recording;
    let (lv, aorta, ecg) = (
        channel(&r.channels.lv_pressure_mmhg),
        channel(&r.channels.aortic_pressure_mmhg),
        channel(&r.channels.ecg_mv),
    );
    let mut text = String::from("time_ms,lv_pressure_mmHg,aortic_pressure_mmHg,ecg_mV\n");
    for i in 0..r.n_samples() {
        let _ = writeln!(text, "{},{:.2},{:.2},{:.3}", i, lv[i], aorta[i], ecg[i]);
    }
    text
}

criterion_group!(benches, half_an_hour);
criterion_main!(benches);

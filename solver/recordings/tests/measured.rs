//! Measured aortic records; docs/prepare.md lists the results.

use std::path::Path;

use cardiotwin_lab_files::Wanted;
use cardiotwin_lab_files::delimited::parse;
use cardiotwin_recordings::beats::BeatError;
use cardiotwin_recordings::prepare::{PrepareError, Prepared, prepare};
use cardiotwin_recordings::recording::Channels;
use cardiotwin_recordings::{Raw, Recording};
use cardiotwin_vocabulary::preparation::{BeatSource, RawSteps};

fn column(file: &str, name: &str) -> (Vec<f64>, Vec<f64>) {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../examples/afterload"
    ))
    .join(file);
    let wanted = |quantity, name: &str| Wanted {
        quantity,
        names: vec![(name.to_owned(), 1.0)],
        given: false,
        required: true,
        may_lack: false,
    };
    let reading = parse(
        &std::fs::read(&path).unwrap(),
        &path,
        &[wanted("time", "time_ms"), wanted("value", name)],
    );
    let mut table = reading
        .table
        .unwrap_or_else(|| panic!("{:?}", reading.problems));
    (
        table.columns.remove("time").unwrap(),
        table.columns.remove("value").unwrap(),
    )
}

/// Interpolates the flow to the pressure's times, which differ by up to 2 ms.
fn record(pressure: &str, flow: &str) -> Result<Prepared, PrepareError> {
    let (time_ms, p) = column(pressure, "pressure_mmHg");
    let (flow_time, q) = column(flow, "flow_mL_per_s");
    let at = |t: &f64| {
        let i = flow_time
            .partition_point(|x| x <= t)
            .clamp(1, flow_time.len() - 1);
        let share = ((t - flow_time[i - 1]) / (flow_time[i] - flow_time[i - 1])).clamp(0.0, 1.0);
        q[i - 1] + share * (q[i] - q[i - 1])
    };
    let flow = time_ms.iter().map(at).collect();
    let channels = Channels {
        aortic_pressure_mmhg: Some(p),
        flow_ml_per_s: Some(flow),
        ..Channels::default()
    };
    prepare(
        &Raw {
            recording: Recording::new(&time_ms, channels).unwrap(),
            cine: None,
            whole_heart: None,
        },
        &RawSteps::default(),
    )
}

#[test]
fn porcine_aortas_have_their_beats_and_their_mean() {
    for (kind, cycle) in [("in-vivo", 800.0..900.0), ("ex-vivo", 460.0..510.0)] {
        for part in 1..=4 {
            let folder = format!("porcine-{kind}");
            let prepared = record(
                &format!("{folder}/pressure-{part}.csv"),
                &format!("{folder}/flow-{part}.csv"),
            )
            .unwrap();
            let (average, found) = (&prepared.average, &prepared.found);
            assert_eq!(found.source, BeatSource::PressureRise);
            let (p, q) = (
                &average.aortic_pressure.as_ref().unwrap(),
                &average.flow.as_ref().unwrap().mean,
            );
            let peak = |v: &[f64]| {
                (0..v.len()).max_by(|a, b| v[*a].total_cmp(&v[*b])).unwrap() as f64
                    * average.step_ms
            };
            let (low, high) = p
                .mean
                .iter()
                .fold((f64::MAX, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
            let stroke = q.iter().sum::<f64>() * average.step_ms * 1e-3;
            println!(
                "{kind} {part}: {} beats, {} kept, cycle {:.0} ms ({:.0} to {:.0}), {high:.1}/{low:.1} mmHg, {stroke:.1} mL, flow peaks \
                 {:.0} ms after the pressure's steepest rise; {:?}; left out {:?}",
                found.beats.len(),
                average.n_averaged,
                average.cycle_length_ms,
                average.lengths_ms[0],
                average.lengths_ms[1],
                peak(q) - average.rise_ms,
                prepared.noise.map(|n| format!(
                    "beats differ by {:.2} mmHg over {:.0} ms",
                    n.beat_rms_mmhg, n.correlation_ms
                )),
                prepared
                    .reasons
                    .iter()
                    .flatten()
                    .map(ToString::to_string)
                    .collect::<Vec<_>>(),
            );
            // Five beats were recorded, three to five of which are complete in the record.
            assert!(
                (3..=5).contains(&found.beats.len()),
                "{}",
                found.beats.len()
            );
            assert!(
                cycle.contains(&average.cycle_length_ms),
                "{}",
                average.cycle_length_ms
            );
            assert!(average.n_averaged >= 3 && high - low > 8.0);
            // The first rise lies at the record's begin; it is aligned by the part that was recorded.
            assert_eq!(average.n_averaged, found.beats.len(), "every beat is alike");
        }
    }
}

#[test]
fn one_human_beat_is_no_recording_of_many() {
    let error = record("human-1999/pressure.csv", "human-1999/flow.csv").unwrap_err();
    assert!(
        matches!(error, PrepareError::Beats(BeatError::NoBeats { .. })),
        "{error}"
    );
}

//! Tests of the rules of consistency.

use super::*;
use crate::{Quantity, Trace};
use cardiotwin_vocabulary::circulation::WindkesselParameters;

fn pressure(top: f64, roll_ms: f64) -> Trace {
    let values = (0..800).map(|i| {
        let t = (f64::from(i) + roll_ms).rem_euclid(800.0);
        let bell = (std::f64::consts::PI * (t - 40.0) / 300.0).sin().powi(2);
        (8.0 + if (40.0..340.0).contains(&t) {
            112.0 * bell
        } else {
            0.0
        })
        .min(top)
    });
    Trace::uniform(Quantity::Pressure, 1.0, values.collect()).unwrap()
}

/// A pressure in the aorta, which rises some 30 ms after the ventricle's and the delay.
fn aorta(delay_ms: f64) -> Trace {
    let at = |t: f64| {
        let t = (t - delay_ms).rem_euclid(800.0);
        let up = 1.0 / (1.0 + (-(t - 110.0) / 10.0).exp());
        let fall = (-(t - 250.0_f64).max(0.0) / 700.0).exp();
        // A rounded peak: a flat one is that of a cut trace.
        let dome = (std::f64::consts::PI * (t.clamp(110.0, 350.0) - 110.0) / 240.0).sin();
        70.0 - 0.02 * t.min(110.0) + up * (44.0 + 4.0 * dome) * fall
    };
    Trace::uniform(
        Quantity::Pressure,
        4.0,
        (0..200).map(|i| at(4.0 * f64::from(i))).collect(),
    )
    .unwrap()
}

fn volume() -> Trace {
    let values =
        (0..32).map(|i| 100.0 + 35.0 * (f64::from(i) / 32.0 * std::f64::consts::TAU).cos());
    Trace::uniform(Quantity::Volume, 25.0, values.collect()).unwrap()
}

fn told(facts: &Facts<'_>, accepted: &[&str]) -> Vec<String> {
    let accepted: Vec<String> = accepted.iter().map(|name| (*name).to_owned()).collect();
    let problems = contradictions(facts, &accepted, Path::new("patient.toml"));
    problems.iter().map(ToString::to_string).collect()
}

fn windkessel([r1, r2, c]: [f64; 3]) -> WindkesselParameters {
    WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: r1,
        peripheral_resistance_mmhg_s_per_ml: r2,
        compliance_ml_per_mmhg: c,
    }
}

#[test]
fn each_rule_is_broken_by_its_fault_alone_and_can_be_accepted() {
    let (sound, cut, cut_alone, rolled) = (
        pressure(200.0, 0.0),
        pressure(90.0, 0.0),
        pressure(90.0, 0.0),
        pressure(200.0, 400.0),
    );
    let (in_time, late) = (aorta(0.0), aorta(240.0));
    let volume = volume();
    let [in_um, in_nm, in_mm, ratio] =
        [[0.1, 0.6], [100.0, 600.0], [1e-4, 6e-4], [1.0, 2.5]].map(transient);
    let facts = Facts {
        calcium: Some(&in_um),
        cut_beats: None,
        cycle_ms: 800.0,
        pressure: Some(&sound),
        volume: Some(&volume),
        aorta: Some([118.0, 70.0]),
        stated_p_max: Some(119.0),
        stated_edv: Some(134.0),
        stated_esv: Some(66.0),
        stated_sv: Some(69.0),
        stated_edp: Some(9.0),
        diastasis_ml: Some(115.0),
        forward_ml: Some(70.0),
        windkessel: Some(windkessel([0.05, 0.95, 1.5])),
        aortic_pressure: None,
        aortic_mean_mmhg: Some(85.0),
        aortic_flow_ml_per_s: Some(85.0),
    };
    assert_eq!(told(&facts, &[]), Vec::<String>::new());
    let of_root = Facts {
        aortic_pressure: Some(&in_time),
        ..facts
    };
    assert_eq!(told(&of_root, &[]), Vec::<String>::new());
    let no_aorta = Facts {
        aorta: None,
        ..facts
    };
    assert_eq!(told(&no_aorta, &[]), Vec::<String>::new());
    assert_eq!(told(&facts, &COMPARISONS), Vec::<String>::new());
    // The smallest frame, so that neither extreme of the trace changes by much.
    let mut frames = volume.values().to_vec();
    frames[16] *= 2.0;
    let doubled = Trace::uniform(Quantity::Volume, 25.0, frames).unwrap();
    for (name, broken, severity) in [
        (
            "aortic-mean-pressure",
            Facts {
                aortic_mean_mmhg: Some(11.3),
                ..facts
            },
            "error",
        ),
        (
            "aortic-mean-flow",
            Facts {
                aortic_flow_ml_per_s: Some(-85.0),
                ..facts
            },
            "error",
        ),
        (
            "ventricle-below-aorta",
            Facts {
                aorta: Some([140.0, 90.0]),
                ..facts
            },
            "error",
        ),
        (
            "aorta-below-filling",
            Facts {
                aorta: Some([118.0, 7.0]),
                windkessel: None,
                ..facts
            },
            "error",
        ),
        (
            "diastasis-volume",
            Facts {
                diastasis_ml: Some(150.0),
                ..facts
            },
            "warning",
        ),
        (
            "diastasis-volume",
            Facts {
                diastasis_ml: Some(0.115),
                ..facts
            },
            "error",
        ),
        // Without the aorta's pressure: Wood units, and mL/kPa.
        (
            "resistance",
            Facts {
                aorta: None,
                windkessel: Some(windkessel([0.8, 15.0, 1.5])),
                ..facts
            },
            "error",
        ),
        (
            "compliance",
            Facts {
                aorta: None,
                windkessel: Some(windkessel([0.05, 0.95, 11.0])),
                ..facts
            },
            "warning",
        ),
        (
            "ventricle-above-aorta",
            Facts {
                aorta: Some([85.0, 60.0]),
                ..facts
            },
            "warning",
        ),
        (
            "clipped",
            Facts {
                pressure: Some(&cut),
                aorta: Some([100.0, 60.0]),
                stated_p_max: None,
                ..facts
            },
            "error",
        ),
        (
            "clipped",
            Facts {
                pressure: Some(&cut_alone),
                aorta: None,
                stated_p_max: None,
                ..facts
            },
            "warning",
        ),
        (
            "beat-begin",
            Facts {
                pressure: Some(&rolled),
                ..facts
            },
            "error",
        ),
        (
            "largest-pressure",
            Facts {
                stated_p_max: Some(180.0),
                ..facts
            },
            "error",
        ),
        (
            "volumes-sum",
            Facts {
                stated_esv: Some(67.0),
                stated_sv: Some(55.0),
                volume: None,
                ..facts
            },
            "warning",
        ),
        (
            "end-diastolic-volume",
            Facts {
                stated_edv: Some(190.0),
                stated_esv: None,
                ..facts
            },
            "error",
        ),
        (
            "end-systolic-volume",
            Facts {
                stated_esv: Some(40.0),
                stated_edv: None,
                ..facts
            },
            "error",
        ),
        (
            "stroke-volume",
            Facts {
                stated_sv: Some(110.0),
                stated_esv: None,
                ..facts
            },
            "error",
        ),
        (
            "resistance",
            Facts {
                windkessel: Some(windkessel([0.05 / 7.5, 0.95 / 7.5, 1.5])),
                ..facts
            },
            "error",
        ),
        (
            "compliance",
            Facts {
                windkessel: Some(windkessel([0.05, 0.95, 1500.0])),
                ..facts
            },
            "error",
        ),
        (
            "calcium-range",
            Facts {
                calcium: Some(&in_nm),
                ..facts
            },
            "error",
        ),
        (
            "calcium-range",
            Facts {
                calcium: Some(&in_mm),
                ..facts
            },
            "error",
        ),
        (
            "aorta-apart",
            Facts {
                aortic_pressure: Some(&late),
                ..facts
            },
            "warning",
        ),
        (
            "lone-volume",
            Facts {
                volume: Some(&doubled),
                ..facts
            },
            "error",
        ),
        (
            "calcium-range",
            Facts {
                calcium: Some(&ratio),
                ..facts
            },
            "warning",
        ),
    ] {
        let found = told(&broken, &[]);
        let own: Vec<&String> = found
            .iter()
            .filter(|text| text.contains(&format!("accept = [{name:?}]")))
            .collect();
        assert_eq!((own.len(), found.len()), (1, 1), "{name}: {found:#?}");
        assert!(own[0].starts_with(severity), "{name}: {found:#?}");
        assert_eq!(told(&broken, &[name]), Vec::<String>::new(), "{name}");
    }
    assert!(told(&facts, &["clippd"])[0].contains("names of rules"));
}

fn transient([rest, peak]: [f64; 2]) -> Trace {
    let values = (0..80).map(|i| {
        let x = f64::from(i) / 8.0;
        rest + (peak - rest) * x * (1.0 - x).exp()
    });
    Trace::uniform(Quantity::Calcium, 10.0, values.collect()).unwrap()
}

#[test]
fn calcium_in_another_unit_is_named_with_its_factor() {
    let said = |ends: [f64; 2]| {
        let calcium = transient(ends);
        told(
            &Facts {
                calcium: Some(&calcium),
                ..Facts::default()
            },
            &[],
        )
    };
    for (ends, parts) in [
        (
            [100.0, 600.0],
            [
                "from 100 to 600 µM",
                "0.60 µM if the numbers are in nM: multiply by 0.001",
            ],
        ),
        (
            [1e-4, 6e-4],
            ["µM", "0.60 µM if the numbers are in mM: multiply by 1000"],
        ),
        (
            [1e-7, 6e-7],
            ["µM", "0.60 µM if the numbers are in M: multiply by 1000000"],
        ),
    ] {
        let found = said(ends);
        assert!(
            found.len() == 1 && parts.iter().all(|part| found[0].contains(part)),
            "{found:#?}"
        );
        assert!(found[0].starts_with("error"), "{found:#?}");
    }
    // Slow cells at rest and strongly stimulated ones are neither.
    for ends in [[0.05, 0.15], [0.3, 4.0]] {
        assert_eq!(said(ends), Vec::<String>::new(), "{ends:?}");
    }
}

#[test]
fn a_beat_that_is_rolled_is_told_for_every_shift() {
    // A beat begins some 60 ms before the middle of the rise; 60 ms more are doubtful at most.
    for shift in (0..800).step_by(10) {
        let pressure = pressure(200.0, f64::from(shift));
        let facts = Facts {
            cycle_ms: 800.0,
            pressure: Some(&pressure),
            ..Facts::default()
        };
        let n = told(&facts, &[]).len();
        let rise = (115.0 - f64::from(shift)).rem_euclid(800.0);
        assert_eq!(n == 0, rise < 0.25 * 800.0, "{shift} ms: {rise}");
    }
}

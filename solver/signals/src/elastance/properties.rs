//! Scaling and shifts: what a change of unit or of the volume's zero may do.

use super::internal_resistance::InternalResistance;
use super::model_heart::{CYCLE_MS, Heart};
use super::single_beat::{Recording, bilinear, isovolumic_maximum, normalised_elastance};
use super::*;
use crate::{Continuation, Trace};
use cardiotwin_units::Ms;
use proptest::prelude::*;
use std::sync::LazyLock;

type Loads = (Vec<(Trace, Trace)>, [f64; 2]);

/// One heart at three loads, with arterial pressures of the first.
static LOADS: LazyLock<Loads> = LazyLock::new(|| {
    let heart = Heart {
        internal_mmhg_s_per_ml: 0.03,
        ..Heart::default()
    };
    let loads = [(1.0, 1.0), (0.8, 0.9), (0.9, 1.2)].map(|(filling, resistance)| {
        Heart {
            filling_mmhg: filling * heart.filling_mmhg,
            peripheral_mmhg_s_per_ml: resistance * heart.peripheral_mmhg_s_per_ml,
            ..heart
        }
        .traces()
    });
    let arterial = heart.arterial();
    (
        loads.into(),
        [arterial.systolic_mmhg, arterial.diastolic_mmhg],
    )
});

fn changed(pressure: f64, volume: f64, shift_ml: f64) -> Vec<Beat> {
    let map = |trace: &Trace, f: &dyn Fn(f64) -> f64| {
        let values = trace.values().iter().map(|x| f(*x)).collect();
        Trace::uniform(trace.quantity(), 1.0, values).unwrap()
    };
    LOADS
        .0
        .iter()
        .map(|(p, v)| {
            let p = map(p, &|x| pressure * x);
            let v = map(v, &|x| volume * x + shift_ml);
            Beat::of(&p, &v, Continuation::periodic(Ms(CYCLE_MS))).unwrap()
        })
        .collect()
}

fn recording(beat: &Beat, pressure: f64) -> Recording<'_> {
    Recording {
        beat,
        qrs_begins_ms: Some(-40.0),
        arterial_systolic_mmhg: Some(pressure * LOADS.1[0]),
        arterial_diastolic_mmhg: Some(pressure * LOADS.1[1]),
    }
}

/// Elastance and intercept of the line, the isovolumic and the bilinear estimate.
fn elastances(beats: &[Beat], pressure: f64) -> [[f64; 2]; 3] {
    let line = EndSystolicLine::through(beats).unwrap();
    let isovolumic = isovolumic_maximum::Estimate::of(&beats[0]).unwrap();
    let bilinear = bilinear::Estimate::of(&recording(&beats[0], pressure)).unwrap();
    [
        [line.elastance_mmhg_per_ml, line.intercept_ml],
        [isovolumic.elastance_mmhg_per_ml, isovolumic.intercept_ml],
        [bilinear.elastance_mmhg_per_ml, bilinear.intercept_ml],
    ]
}

fn chen(beats: &[Beat], pressure: f64) -> f64 {
    normalised_elastance::Estimate::of(&recording(&beats[0], pressure))
        .unwrap()
        .elastance_mmhg_per_ml
}

fn near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-6 * expected.abs().max(1.0)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn elastance_scales_with_pressure_and_with_the_inverse_of_volume(
        pressure in 0.5..2.0f64,
        volume in 0.5..2.0f64,
    ) {
        let (plain, scaled) = (changed(1.0, 1.0, 0.0), changed(pressure, volume, 0.0));
        let factor = pressure / volume;
        for ([e, v], [e_scaled, v_scaled]) in
            elastances(&plain, 1.0).into_iter().zip(elastances(&scaled, pressure))
        {
            prop_assert!(near(e_scaled, factor * e), "{e_scaled} {}", factor * e);
            prop_assert!(near(v_scaled, volume * v), "{v_scaled} {}", volume * v);
        }
        prop_assert!(near(chen(&scaled, pressure), factor * chen(&plain, 1.0)));
        let work = |beats: &[Beat]| PreloadRecruitableStrokeWork::through(beats).unwrap();
        prop_assert!(near(work(&scaled).slope_mmhg, pressure * work(&plain).slope_mmhg));
        let resistance = |beats: &[Beat], v0: f64| {
            InternalResistance::of(beats, v0).unwrap()
        };
        let (before, after) = (resistance(&plain, 12.0), resistance(&scaled, 12.0 * volume));
        prop_assert!(near(
            after.resistance_mmhg_s_per_ml,
            factor * before.resistance_mmhg_s_per_ml
        ));
        prop_assert!(near(after.loss_s_per_ml, before.loss_s_per_ml / volume));
    }

    #[test]
    fn a_shift_of_volume_shifts_the_intercept_alone(shift_ml in -40.0..80.0f64) {
        let (plain, shifted) = (changed(1.0, 1.0, 0.0), changed(1.0, 1.0, shift_ml));
        for ([e, v], [e_shifted, v_shifted]) in
            elastances(&plain, 1.0).into_iter().zip(elastances(&shifted, 1.0))
        {
            prop_assert!(near(e_shifted, e), "{e_shifted} {e}");
            prop_assert!(near(v_shifted, v + shift_ml), "{v_shifted} {}", v + shift_ml);
        }
        let work = |beats: &[Beat]| PreloadRecruitableStrokeWork::through(beats).unwrap();
        prop_assert!(near(work(&shifted).slope_mmhg, work(&plain).slope_mmhg));
        prop_assert!(near(work(&shifted).intercept_ml, work(&plain).intercept_ml + shift_ml));
    }
}

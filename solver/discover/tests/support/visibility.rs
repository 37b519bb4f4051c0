//! Visibility of a hidden effect: the misfit of the fitted model on noise-free data, without and
//! with the right effects.

use cardiotwin_discover::Reduced;
use cardiotwin_discover::fit::Fit;
use cardiotwin_discover::forward::Forward;
use cardiotwin_discover::further::{Further, FurtherTrace, LoadedBeat};
use cardiotwin_discover::least_squares::Settings;
use cardiotwin_discover::measured::{Cuff, GivenLoads, Measured, SideData, Uncertain, WholeHeart};
use cardiotwin_discover::noise::ErrorModel;
use cardiotwin_discover::problem::{Data, Problem};
use cardiotwin_discover::search::{add_term, fit_base};
use cardiotwin_validation::{Case, Side, further as simulated};
use cardiotwin_vocabulary::measurements::FurtherQuantity;
use cardiotwin_vocabulary::trace_noise::Noise;

/// Misfits of the fits.
#[derive(Debug, Clone, Copy)]
pub struct Visibility {
    /// Fall of the misfit when the right effects are added, including side data and priors.
    pub delta_chi2: f64,
    /// Remaining misfit of the data, due to differences of the fitted model besides the effects.
    pub left_chi2: f64,
}

impl Visibility {
    /// `none`, `at the limit` (below 20), `weak` (below 50), `moderate` (below 150), `strong`.
    pub fn band(&self, nothing_hidden: bool) -> &'static str {
        match self.delta_chi2 {
            _ if nothing_hidden => "none",
            x if x < 20.0 => "at the limit",
            x if x < 50.0 => "weak",
            x if x < 150.0 => "moderate",
            _ => "strong",
        }
    }
}

fn side(side: &Side) -> SideData {
    let with = |value: f64, sd: f64| Uncertain { value, sd };
    SideData {
        cuff: Some(Cuff {
            systolic: with(side.cuff.0, side.cuff_sd),
            diastolic: with(side.cuff.1, side.cuff_sd),
        }),
        forward_stroke_volume: Some(with(side.forward.0, side.forward.1)),
        whole_heart: Some(WholeHeart {
            time_ms: side.whole_heart_ms,
            volume: with(side.whole_heart.0, side.whole_heart.1),
        }),
        ..SideData::default()
    }
}

/// The case as given to the search, with traces and scalars either as measured or without noise.
fn given(case: &Case, pressure: &[f64], frames: &[f64], scalars: &Side) -> Measured {
    Measured {
        cycle_ms: case.cycle_ms,
        pressure_time_ms: (0..pressure.len()).map(|i| i as f64).collect(),
        pressure_mmhg: pressure.to_vec(),
        frame_time_ms: case.frame_ms.clone(),
        frame_volume_ml: frames.to_vec(),
        noise: Noise {
            pressure_rms_mmhg: Some(case.stated.pressure_rms_mmhg),
            pressure_correlation_ms: Some(case.stated.pressure_correlation_ms),
            volume_rms_ml: Some(case.stated.volume_rms_ml),
            ..Noise::default()
        },
        side: side(scalars),
        wall_volume: Uncertain {
            value: scalars.wall_ml,
            sd: 0.05 * scalars.wall_ml,
        },
        given: GivenLoads::default(),
        further: Further::default(),
    }
}

/// The case as given to the search, without its noise.
pub fn noise_free(case: &Case) -> Measured {
    let (pressure, frames) = (&case.clean_pressure_mmhg, &case.clean_frame_ml);
    given(case, pressure, frames, &case.clean_side)
}

/// The case as given to the search, with its noise and with further measurements.
pub fn with_noise(case: &Case, further: &simulated::Further) -> Measured {
    let mut measured = given(case, &case.pressure_mmhg, &case.frame_ml, &case.side);
    let with = |value: f64, sd: f64| Uncertain { value, sd };
    for trace in &further.traces {
        let quantity = (FurtherQuantity::ALL.into_iter()).find(|q| q.name() == trace.kind.name());
        measured
            .further
            .traces
            .extend(quantity.map(|quantity| FurtherTrace {
                quantity,
                time_ms: trace.time_ms.clone(),
                value: trace.value.clone(),
                rms: trace.rms,
                correlation_ms: trace.correlation_ms,
                delay: with(0.0, 0.0),
            }));
    }
    measured
        .further
        .loaded
        .extend(further.loaded.as_ref().map(|beat| LoadedBeat {
            cycle_ms: case.cycle_ms,
            pressure_time_ms: (0..beat.pressure_mmhg.len()).map(|i| i as f64).collect(),
            pressure_mmhg: beat.pressure_mmhg.clone(),
            frame_time_ms: beat.frame_ms.clone(),
            frame_volume_ml: beat.frame_ml.clone(),
        }));
    if let Some((times, sd)) = further.valve_times_ms {
        for (time, value) in (measured.side.valve_times.all_mut().into_iter()).zip(times) {
            *time = Some(with(value, sd));
        }
    }
    measured.side.qrs_ms = further.qrs_ms.map(|(duration, sd)| with(duration, sd));
    measured
}

/// Fits the base and the base with the hidden effects of the catalogue.
pub fn of(case: &Case) -> Visibility {
    let measured = noise_free(case);
    let forward = Reduced::new(&measured);
    let data = Data::new(measured, &ErrorModel::default(), None);
    let problem = Problem {
        forward: &forward,
        data: &data,
    };
    let settings = Settings::default();
    let total =
        |fit: &Fit| fit.misfit.pressure + fit.misfit.volume + fit.misfit.side + fit.misfit.prior;
    let Some(base) = fit_base(&problem, &settings) else {
        return Visibility {
            delta_chi2: f64::INFINITY,
            left_chi2: f64::INFINITY,
        };
    };
    let mut with = base.clone();
    for hidden in &case.hidden {
        if let Some(term) = forward
            .candidates()
            .iter()
            .position(|c| c.name == hidden.effect)
        {
            with = add_term(&problem, &with, term, &settings)
                .filter(|f| total(f) < total(&with))
                .unwrap_or(with);
        }
    }
    Visibility {
        delta_chi2: total(&base) - total(&with),
        left_chi2: with.misfit.pressure + with.misfit.volume + with.misfit.side,
    }
}

//! Cases made by the model that is fitted: they show that the search works, not that it is right.

use crate::visibility::noise_free;
use cardiotwin_discover::forward::{Forward, Prediction, Request};
use cardiotwin_discover::{Measured, Reduced};
use cardiotwin_validation::circulation::Beat;
use cardiotwin_validation::hidden::{self, Hidden};
use cardiotwin_validation::patient::implausible;
use cardiotwin_validation::random::Random;
use cardiotwin_validation::{Case, PlannedCase};

/// Patients that are drawn before a case is given up.
const TRIES: u64 = 40;
/// Spread of the base values in standard deviations of their priors.
const SPREAD: f64 = 0.7;

/// The case: base values around the priors of a patient of the other model, effects at the same levels and noise as there.
pub fn make(planned: &PlannedCase) -> Option<Case> {
    // Only the frame comes from there: cycle length, frames, size.
    let frame = Case::draw(planned.seed(), &[], planned.noise)?;
    let template: Measured = noise_free(&frame);
    let model = Reduced::new(&template);
    (0..TRIES).find_map(|attempt| {
        let mut random = Random::new(planned.seed(), 1000 + attempt);
        let base: Vec<f64> = (model.base().iter())
            .map(|p| p.value((SPREAD * random.normal()).clamp(p.z_bounds().0, p.z_bounds().1)))
            .collect();
        let hidden: Vec<Hidden> = planned
            .effects
            .iter()
            .map(|(name, level)| hidden::draw(name, *level, &mut random))
            .collect();
        let terms: Option<Vec<(usize, Vec<f64>)>> =
            hidden.iter().map(|h| term(&model, h)).collect();
        let terms = terms?;
        let terms: Vec<(usize, &[f64])> = terms
            .iter()
            .map(|(idx, values)| (*idx, values.as_slice()))
            .collect();
        let predicted = model.predict(
            &Request {
                base: &base,
                terms: &terms,
                bumps: &[],
            },
            None,
        )?;
        let n = template.cycle_ms as usize;
        let (beat, traces) = beat(&predicted, n);
        if implausible(&beat).is_some() {
            return None;
        }
        let case = Case::observe(&beat, traces, base[5], planned.noise, &mut random);
        Some(Case {
            hidden,
            n_refused: attempt as usize,
            ..case
        })
    })
}

/// A candidate with the values of a hidden effect, as far as the catalogue has them; the first start's elsewhere.
fn term(model: &Reduced, hidden: &Hidden) -> Option<(usize, Vec<f64>)> {
    let idx = model
        .candidates()
        .iter()
        .position(|c| c.name == hidden.effect)?;
    let candidate = &model.candidates()[idx];
    let values = (candidate.parameters.iter().zip(&candidate.starts[0]))
        .map(|(p, start)| {
            hidden
                .physical
                .get(p.name.as_str())
                .copied()
                .unwrap_or(*start)
                .clamp(p.lower, p.upper)
        })
        .collect();
    Some((idx, values))
}

fn beat(p: &Prediction, n: usize) -> (Beat, (Vec<f64>, Vec<f64>)) {
    let each_ms = |trace: &[f64]| (0..n).map(|t| p.at(trace, t as f64)).collect::<Vec<f64>>();
    // Of the aorta only the extremes are known.
    let mut aortic_pressure = vec![p.diastolic_mmhg; n];
    aortic_pressure[0] = p.systolic_mmhg;
    let beat = Beat {
        pressure: each_ms(&p.true_pressure_mmhg),
        volume: each_ms(&p.true_volume_ml),
        aortic_pressure,
        atrial_pressure: Vec::new(),
        aortic_flow: each_ms(&p.aortic_flow_ml_per_s),
        mitral_flow: each_ms(&p.mitral_flow_ml_per_s),
        forward_ml: p.forward_stroke_volume_ml,
        drift: 0.0,
    };
    (beat, (each_ms(&p.pressure_mmhg), each_ms(&p.volume_ml)))
}

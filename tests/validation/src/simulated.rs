//! Beats of hearts that another program simulates, such as the finite-element ventricle: they are
//! measured like the hearts of this crate.

use crate::circulation::Beat;
use crate::hidden::{self, Hidden, Instruments};
use crate::measure::{Case, instruments_on};
use crate::plan::PlannedCase;
use crate::random::Random;
use serde::{Deserialize, Serialize};

/// A simulated beat of a planned case, without what instruments do to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulatedBeat {
    /// Name of the planned case.
    pub case: String,
    /// Seed of the planned case.
    pub seed: u64,
    /// Number of implausible hearts that were drawn before this one.
    pub attempt: u64,
    /// Pressure of the left ventricle each millisecond \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Volume of the left ventricle each millisecond \[mL\].
    pub volume_ml: Vec<f64>,
    /// Pressure of the aorta each millisecond \[mmHg\].
    pub aortic_pressure_mmhg: Vec<f64>,
    /// Net volume into the aorta \[mL\].
    pub forward_ml: f64,
    /// Volume of the wall \[mL\].
    pub wall_ml: f64,
}

impl SimulatedBeat {
    /// The beat as beats of this crate are; flows and the atrium's pressure are not known.
    #[must_use]
    pub fn beat(&self) -> Beat {
        Beat {
            pressure: self.pressure_mmhg.clone(),
            volume: self.volume_ml.clone(),
            aortic_pressure: self.aortic_pressure_mmhg.clone(),
            forward_ml: self.forward_ml,
            ..Beat::default()
        }
    }
}

/// Beats of a text with one JSON object a line, and the length of the whole lines: a last line that
/// was cut off is left out.
///
/// # Errors
/// A message with the line.
pub fn parse(text: &str) -> Result<(Vec<SimulatedBeat>, usize), String> {
    let end = text.rfind('\n').map_or(0, |end| end + 1);
    let beats = (text[..end].lines().enumerate())
        .map(|(i, line)| serde_json::from_str(line).map_err(|e| format!("line {}: {e}", i + 1)))
        .collect::<Result<_, _>>()?;
    Ok((beats, end))
}

impl PlannedCase {
    /// Random numbers of the heart that is simulated for this case at an attempt.
    #[must_use]
    pub fn random(&self, attempt: u64) -> Random {
        Random::new(self.seed(), 2 * attempt)
    }

    /// Hidden effects of the case at an attempt, with the values of the catalogue.
    #[must_use]
    pub fn hidden(&self, attempt: u64) -> Vec<Hidden> {
        let mut random = Random::new(self.seed(), 200_000 + 2 * attempt);
        (self.effects.iter())
            .map(|(name, level)| hidden::draw(name, *level, &mut random))
            .collect()
    }

    /// Measures a simulated beat of this case, with the case's instruments and noise.
    #[must_use]
    pub fn measure(&self, simulated: &SimulatedBeat) -> Case {
        let hidden = self.hidden(simulated.attempt);
        let mut instruments = Instruments::default();
        hidden.iter().for_each(|h| h.add_to(&mut instruments));
        let beat = simulated.beat();
        let traces = instruments_on(&beat, &instruments);
        let mut random = Random::new(self.seed(), 2 * simulated.attempt + 1);
        let case = Case::observe(&beat, traces, simulated.wall_ml, self.noise, &mut random);
        Case {
            hidden,
            n_refused: simulated.attempt as usize,
            ..case
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::{Hearts, circulation};

    /// A beat of this crate's own loop, written and read as another program's, is measured like one.
    #[test]
    fn a_simulated_beat_is_measured_with_the_instruments_of_its_case() {
        let cases = Plan::Singles.cases(16, 5, Hearts::Elastance);
        let offset = cases
            .iter()
            .find(|case| case.effects[0].0 == "pressure_offset");
        let case = offset.expect("the first round has every effect");
        let heart = Hearts::Elastance.draw(&mut case.random(0));
        let circulation::Beat {
            pressure,
            volume,
            aortic_pressure,
            forward_ml,
            ..
        } = heart.beat().expect("a steady beat");
        let beat = SimulatedBeat {
            case: case.id.clone(),
            seed: case.seed(),
            attempt: 0,
            pressure_mmhg: pressure.clone(),
            volume_ml: volume,
            aortic_pressure_mmhg: aortic_pressure,
            forward_ml,
            wall_ml: 100.0,
        };
        let line = serde_json::to_string(&beat).expect("numbers are JSON");
        let (read, end) = parse(&format!("{line}\n{{\"cut")).expect("one whole line");
        assert_eq!(read, std::slice::from_ref(&beat));
        assert_eq!(end, line.len() + 1);
        let measured = case.measure(&beat);
        let offset = measured.hidden[0].physical["offset_mmHg"];
        assert!(offset.abs() > 1.0);
        for (clean, own) in measured.clean_pressure_mmhg.iter().zip(&pressure) {
            assert!((clean - own - offset).abs() < 1e-9);
        }
    }
}

//! What the parts of a closed loop hold, by their names, so that another run can start from it.

use super::circuit::Circulation;
use super::{CirculationError, TimeStep};
use cardiotwin_units::Ml;
use cardiotwin_vocabulary::circulation::LoopContents;

impl Circulation {
    /// Contents of the loop; `None` for an open circuit.
    #[must_use]
    pub fn contents(&self) -> Option<LoopContents> {
        self.volume()?;
        let volumes = self.compartments.iter().enumerate();
        let flows = self.inertial.iter();
        Some(LoopContents {
            volumes_ml: volumes
                .map(|(idx, c)| (c.name().to_owned(), self.now.states[self.first_state[idx]]))
                .collect(),
            flows_ml_per_s: flows
                .map(|idx| {
                    let name = self.path(*idx).name().to_owned();
                    (name, self.now.flows_ml_per_s[*idx])
                })
                .collect(),
        })
    }

    /// Starts a beat at time zero from these contents. Pressures are those of the volumes, unlike after
    /// [`Self::restore`], since no step has solved them.
    ///
    /// # Errors
    /// [`CirculationError::ForeignContents`] if they are those of other compartments or paths.
    pub fn begin_with(&mut self, contents: &LoopContents) -> Result<(), CirculationError> {
        let (volumes, flows) = (&contents.volumes_ml, &contents.flows_ml_per_s);
        let foreign = || CirculationError::ForeignContents {
            found: volumes.keys().chain(flows.keys()).cloned().collect(),
            expected: (self.compartments.iter().map(|c| c.name().to_owned()))
                .chain(
                    self.inertial
                        .iter()
                        .map(|idx| self.path(*idx).name().to_owned()),
                )
                .collect(),
        };
        let of_parts = self.volume().is_some()
            && volumes.len() == self.compartments.len()
            && flows.len() == self.inertial.len();
        let state: Option<Vec<f64>> = (self.compartments.iter())
            .map(|c| volumes.get(c.name()).copied())
            .chain(
                self.inertial
                    .iter()
                    .map(|idx| flows.get(self.path(*idx).name()).copied()),
            )
            .collect();
        let Some(state) = state.filter(|_| of_parts) else {
            return Err(foreign());
        };
        self.begin_beat(&state);
        let still = TimeStep {
            end_ms: 0.0,
            dt_ms: 0.0,
        };
        for (idx, compartment) in self.compartments.iter_mut().enumerate() {
            compartment.prepare(still);
            let states = self.first_state[idx]..self.first_state[idx + 1];
            let (pressure, _) = compartment.pressure(&self.now.states[states], 0.0, still);
            self.now.pressures_mmhg[idx] = pressure;
        }
        self.roll_back();
        Ok(())
    }

    /// Adds blood to the compartment of this name, or takes it where `more` is negative. Returns whether
    /// there is such a compartment.
    pub fn add_blood(&mut self, compartment: &str, more: Ml) -> bool {
        let Some(mut contents) = self.contents() else {
            return false;
        };
        let Some(volume_ml) = contents.volumes_ml.get_mut(compartment) else {
            return false;
        };
        *volume_ml += more.0;
        self.begin_with(&contents).is_ok()
    }
}

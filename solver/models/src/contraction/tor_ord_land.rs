//! ToR-ORd-Land: Land 2017 driven by the calcium of its own human cell, in which its troponin is the buffer.
//!
//! The cell is paced at the patient's cycle length, held at the stretch of end-diastole, until its calcium repeats
//! ([`crate::tor_ord`]). In the organ every point takes this calcium, and Land's model follows the point's stretch: what the
//! organ's shortening would release from troponin does not reach the calcium.

use std::sync::Arc;

use cardiotwin_units::Ms;
use cardiotwin_vocabulary::cell::constant_of_cell;

use super::declaration::{ContractionModel, ModelParameter};
use super::{
    ActiveStress, Contraction, ContractionError, EachStep, Land2017, Land2017Parameters, NodeStep,
    OwnCell, UniformStep,
};
use crate::calcium::SampledCalcium;
use crate::parameter::Domain;
use crate::tor_ord::{CellType, Factors, Outside, SAMPLE_MS, TorOrd, Troponin};

/// Parameters of the cell before those of Land's model: factors and bath.
const N_FACTORS: usize = Factors::TABLE.len();
const N_OF_CELL: usize = N_FACTORS + 3;
const N_PARAMETERS: usize = N_OF_CELL + Land2017Parameters::TABLE.len();

/// Margara's changes of Land's defaults: blocking that is slower and less cooperative.
const CHANGED: [(&str, f64); 2] = [("k_U_per_ms", 0.021), ("n_Tm", 2.036)];

const fn parameter(
    name: &'static str,
    meaning: &'static str,
    default: f64,
    domain: Domain,
) -> ModelParameter {
    ModelParameter {
        name,
        meaning,
        default,
        domain,
    }
}

static PARAMETERS: [ModelParameter; N_PARAMETERS] = {
    let mut all = [parameter("", "", 0.0, Domain::Finite); N_PARAMETERS];
    let mut idx = 0;
    while idx < N_FACTORS {
        let (name, meaning) = Factors::TABLE[idx];
        all[idx] = parameter(name, meaning, 1.0, Domain::NotNegative);
        idx += 1;
    }
    let bath = Outside::PAPER;
    all[idx] = parameter(
        "Na_o_mM",
        "sodium of the bath",
        bath.na_mm,
        Domain::Positive,
    );
    all[idx + 1] = parameter(
        "Ca_o_mM",
        "calcium of the bath",
        bath.ca_mm,
        Domain::Positive,
    );
    all[idx + 2] = parameter(
        "K_o_mM",
        "potassium of the bath",
        bath.k_mm,
        Domain::Positive,
    );
    idx = 0;
    while idx < Land2017Parameters::TABLE.len() {
        let of_land = Land2017Parameters::TABLE[idx];
        let in_files = constant_of_cell(of_land.name);
        all[N_OF_CELL + idx] = parameter(
            of_land.name,
            in_files.label.meaning,
            changed(of_land.name, in_files.default),
            of_land.domain,
        );
        idx += 1;
    }
    all
};

/// The default of a parameter of Land's model, here.
const fn changed(name: &str, of_land: f64) -> f64 {
    let mut idx = 0;
    while idx < CHANGED.len() {
        if is_same(CHANGED[idx].0, name) {
            return CHANGED[idx].1;
        }
        idx += 1;
    }
    of_land
}

const fn is_same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut idx = 0;
    while idx < a.len() && idx < b.len() && a[idx] == b[idx] {
        idx += 1;
    }
    idx == a.len() && idx == b.len()
}

/// Declares the catalogue's entry for one type of cell.
macro_rules! entry {
    ($(#[$doc:meta])* $module:ident, $name:literal, $place:literal, $cell_type:ident) => {
        $(#[$doc])*
        pub mod $module {
            use super::*;

            /// Catalogue entry.
            pub const MODEL: ContractionModel = ContractionModel {
                name: $name,
                meaning: concat!(
                    "Land 2017 driven by the calcium of a human ",
                    $place,
                    " cell (ToR-ORd) at the patient's cycle length."
                ),
                equation: "those of ToR-ORd, with dCa_i/dt = β (fluxes − 0.07 mM dCaTRPN/dt), and of Land 2017",
                source: "Tomek et al. 2019, eLife 8:e48890; Margara et al. 2021, Prog Biophys Mol Biol 159:58",
                parameters: &PARAMETERS,
                build: |values| Ok(Box::new(TorOrdLand::new(CellType::$cell_type, values)?)),
            };
        }
    };
}

entry!(
    /// A cell below the inner surface.
    endocardial, "tor-ord-land", "endocardial", Endocardial
);
entry!(
    /// A cell below the outer surface.
    epicardial, "tor-ord-land-epi", "epicardial", Epicardial
);
entry!(
    /// A cell between the two.
    mid_myocardial, "tor-ord-land-mid", "mid-myocardial", MidMyocardial
);

/// Land's model with the cell that gives it calcium.
#[derive(Debug, Clone, Copy)]
struct TorOrdLand {
    land: Land2017,
    cell_type: CellType,
    factors: Factors,
    outside: Outside,
}

impl TorOrdLand {
    /// - `values`: in the order of [`PARAMETERS`]
    fn new(cell_type: CellType, values: &[f64]) -> Result<Self, ContractionError> {
        let (of_cell, of_land) = values.split_at(N_OF_CELL);
        let land = Land2017::new(Land2017Parameters {
            cap_unblocking: true,
            ..Land2017Parameters::from_values(std::array::from_fn(|k| of_land[k]))
        })?;
        Ok(Self {
            land,
            cell_type,
            factors: Factors::from_values(std::array::from_fn(|k| of_cell[k])),
            outside: Outside {
                na_mm: of_cell[N_FACTORS],
                ca_mm: of_cell[N_FACTORS + 1],
                k_mm: of_cell[N_FACTORS + 2],
            },
        })
    }
}

impl Contraction for TorOrdLand {
    fn n_states(&self) -> usize {
        self.land.n_states()
    }

    fn needs_calcium(&self) -> bool {
        true
    }

    fn rest(&self, state: &mut [f64]) {
        self.land.rest(state);
    }

    fn own_cell(
        &self,
        cycle_length_ms: f64,
        end_diastolic_stretch: f64,
    ) -> Result<Option<OwnCell>, ContractionError> {
        let cell = TorOrd::new(
            self.cell_type,
            self.factors,
            self.outside,
            Troponin::Land,
            self.land.equations(),
            end_diastolic_stretch,
        );
        let beat = cell.periodic(cycle_length_ms)?;
        let start = beat.start.land().to_vec();
        let calcium = SampledCalcium::new(Ms(SAMPLE_MS), beat.ca_um)?;
        Ok(Some(OwnCell {
            calcium: Arc::new(calcium),
            start,
        }))
    }

    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        self.land.try_step(step, state, trial)
    }

    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        self.land.try_step_uniform(step, states, trials, stress)
    }

    fn try_step_each(
        &self,
        step: &EachStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        self.land.try_step_each(step, states, trials, stress)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn defaults_are_margaras() {
        let default = |name: &str| PARAMETERS.iter().find(|p| p.name == name).unwrap().default;
        assert_eq!([default("k_U_per_ms"), default("n_Tm")], [0.021, 2.036]);
        let of_land = Land2017Parameters::default();
        for (of_land, value) in Land2017Parameters::TABLE.iter().zip(of_land.values()) {
            if CHANGED.iter().all(|(name, _)| *name != of_land.name) {
                assert_eq!(default(of_land.name), value, "{}", of_land.name);
            }
        }
    }

    /// Troponin holds calcium back: with a sensitive one the peak of free calcium is lower, and the cell is stronger.
    #[test]
    fn troponin_takes_calcium_from_the_cell() {
        let with = |ca50_um: f64| {
            let parameters: BTreeMap<_, _> = [("Ca50_ref_uM".to_owned(), ca50_um)].into();
            let model = endocardial::MODEL.with(&parameters).unwrap();
            let own = model.own_cell(1000.0, 1.0).unwrap().unwrap();
            let peak_um = (0..1000)
                .map(|ms| own.calcium.concentration_um(f64::from(ms)))
                .fold(0.0, f64::max);
            (peak_um, own.start[0])
        };
        let ((usual, bound), (sensitive, more_bound)) = (with(0.805), with(0.6));
        assert!(sensitive < 0.9 * usual, "{sensitive} {usual}");
        assert!(more_bound > 1.2 * bound, "{more_bound} {bound}");
    }

    #[test]
    fn a_cell_without_a_periodic_beat_is_an_error() {
        let model = endocardial::MODEL.with(&BTreeMap::new()).unwrap();
        let error = model.own_cell(250.0, 1.0).unwrap_err();
        assert!(matches!(error, ContractionError::Pacing(_)), "{error}");
    }

    #[test]
    fn rates_that_do_not_go_together_are_refused() {
        let of = |name: &str, value: f64| (name.to_owned(), value);
        let error = endocardial::MODEL
            .with(&[of("r_W", 0.9), of("k_UW_per_ms", 0.05)].into())
            .unwrap_err();
        assert!(
            matches!(error, ContractionError::NegativeKwu { .. }),
            "{error}"
        );
    }
}

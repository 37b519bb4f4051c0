//! Catalogue of contraction models that a beat takes by name.
//!
//! Step 1 fits [`Tanh`](super::Tanh) and step 2 fits [`Land2017`](super::Land2017); both have their own place in a beat's
//! specification. Every other model is one file with its declaration ([`ContractionModel`]) and one line of [`CATALOGUE`].

use super::ContractionError;
use super::declaration::ContractionModel;

/// Declares [`CATALOGUE`] from the modules of the models.
macro_rules! catalogue {
    ($($($model:ident)::+;)*) => {
        /// All models, in the order of tables.
        pub const CATALOGUE: &[&ContractionModel] = &[$(&super::$($model)::+::MODEL),*];
    };
}

catalogue! {
    bestel_clement_sorine;
    tor_ord_land::endocardial;
    tor_ord_land::epicardial;
    tor_ord_land::mid_myocardial;
}

/// Finds a model by its name.
///
/// # Errors
/// [`ContractionError::UnknownModel`] with the names in the catalogue.
pub fn find(name: &str) -> Result<&'static ContractionModel, ContractionError> {
    CATALOGUE
        .iter()
        .copied()
        .find(|model| model.name == name)
        .ok_or_else(|| {
            let names: Vec<_> = CATALOGUE.iter().map(|model| model.name).collect();
            ContractionError::UnknownModel {
                found: name.to_owned(),
                expected: names.join(", "),
            }
        })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::{Contraction, NodeStep};
    use super::*;
    use crate::parameter::Domain;

    /// Stresses \[kPa\] of a beat of 800 ms, one a millisecond, while the stretch falls from 1.1 to 0.94 and rises again;
    /// calcium is that of the model's own cell, or constant.
    fn beat(model: &dyn Contraction) -> Vec<f64> {
        let mut state = vec![0.0; model.n_states()];
        model.rest(&mut state);
        let stretch = |ms: i32| 1.02 + 0.08 * (std::f64::consts::TAU * f64::from(ms) / 600.0).cos();
        let own = model.own_cell(800.0, stretch(0)).unwrap();
        if let Some(own) = &own {
            state.copy_from_slice(&own.start);
        }
        let ca_um = |ms: i32| {
            own.as_ref()
                .map_or(0.2, |own| own.calcium.concentration_um(f64::from(ms)))
        };
        let mut trial = state.clone();
        (1..=800)
            .map(|ms| {
                let step = NodeStep {
                    since_activation_ms: f64::from(ms),
                    dt_ms: 1.0,
                    ca_start_um: ca_um(ms - 1),
                    ca_end_um: ca_um(ms),
                    lambda_prev: stretch(ms - 1),
                    lambda: stretch(ms),
                };
                let stress = model.try_step(&step, &state, &mut trial).unwrap();
                state.copy_from_slice(&trial);
                stress.sa_kpa
            })
            .collect()
    }

    #[test]
    fn every_model_is_found_and_gives_a_finite_beat() {
        for entry in CATALOGUE {
            assert_eq!(find(entry.name).unwrap().name, entry.name);
            let stresses = beat(&*entry.with(&BTreeMap::new()).unwrap());
            assert!(
                stresses.iter().all(|s| s.is_finite() && *s >= 0.0),
                "{}",
                entry.name
            );
            assert!(
                stresses.iter().copied().fold(0.0, f64::max) > 1.0,
                "{} never contracts",
                entry.name
            );
            assert!(!entry.source.is_empty() && !entry.equation.is_empty());
        }
    }

    #[test]
    fn every_parameter_moves_the_beat() {
        for (k, entry) in CATALOGUE.iter().enumerate() {
            // Types of one cell share equations and parameters, and take seconds each.
            let is_shared =
                |earlier: &&ContractionModel| std::ptr::eq(earlier.parameters, entry.parameters);
            if CATALOGUE[..k].iter().any(is_shared) {
                continue;
            }
            let of_defaults = beat(&*entry.with(&BTreeMap::new()).unwrap());
            for parameter in entry.parameters {
                let value = match parameter.domain {
                    Domain::Fraction => 0.5 * (1.0 + parameter.default),
                    _ => 1.2 * parameter.default + 1e-3,
                };
                let moved = entry
                    .with(&[(parameter.name.to_owned(), value)].into())
                    .unwrap();
                let largest = beat(&*moved)
                    .iter()
                    .zip(&of_defaults)
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f64::max);
                assert!(largest > 1e-6, "{} of {}", parameter.name, entry.name);
            }
        }
    }

    #[test]
    fn unknown_names_and_values_outside_the_domain_are_refused() {
        let error = find("bestel").unwrap_err().to_string();
        assert!(error.contains("bestel-clement-sorine"), "{error}");
        let entry = find("bestel-clement-sorine").unwrap();
        let with = |name: &str, value: f64| entry.with(&[(name.to_owned(), value)].into());
        assert!(matches!(
            with("sigma", 1.0),
            Err(ContractionError::UnknownParameter { .. })
        ));
        assert!(matches!(
            with("sigma_0_kPa", -1.0),
            Err(ContractionError::Parameter {
                name: "sigma_0_kPa",
                ..
            })
        ));
    }
}

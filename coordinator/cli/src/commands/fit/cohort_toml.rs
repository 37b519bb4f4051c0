//! Fitted calcium as tables of `cohort.toml`.

use cardiotwin_calibrate::calcium_fit::{CalciumFit, Estimate};
use cardiotwin_schemas::fit::CohortDefaults;
use cardiotwin_schemas::settings::CellFitSettings;

/// Rice's parameters by their names in step 2, with their estimates.
fn by_name(fit: &CalciumFit) -> [(&'static str, &Estimate); 4] {
    [
        ("Ca_res_uM", &fit.ca_res_um),
        ("Ca_max_uM", &fit.ca_max_um),
        ("tau_CR_ms", &fit.tau_cr_ms),
        ("tau_CD_ms", &fit.tau_cd_ms),
    ]
}

/// Both ways to use the fit in a cohort. `trace` is the name of the fitted file.
#[must_use]
pub fn cohort_defaults(fit: &CalciumFit, trace: &str) -> CohortDefaults {
    CohortDefaults {
        frozen: frozen(fit, trace),
        bounds: bounds(fit, trace),
    }
}

fn frozen(fit: &CalciumFit, trace: &str) -> String {
    let fitted = CellFitSettings::default().parameters;
    let others: Vec<String> = fitted
        .into_iter()
        .filter(|name| by_name(fit).iter().all(|(calcium, _)| calcium != name))
        .map(|name| format!("\"{name}\""))
        .collect();
    let mut text = format!(
        "{}[step2]\nparameters = [{}]\n\n[step2.frozen]\n",
        comment(
            "Calcium is frozen at the values that `cardiotwin fit calcium` found in",
            trace
        ),
        others.join(", ")
    );
    for (name, estimate) in by_name(fit) {
        text.push_str(&format!("{name} = {}\n", rounded(estimate.value)));
    }
    text
}

fn bounds(fit: &CalciumFit, trace: &str) -> String {
    let defaults = CellFitSettings::default().bounds;
    let mut text = comment(
        "Calcium is fitted within the intervals that `cardiotwin fit calcium` found in",
        trace,
    );
    text.push_str("[step2.bounds]\n");
    for (
        name,
        Estimate {
            value,
            lower,
            upper,
            ..
        },
    ) in by_name(fit)
    {
        // If the trace leaves an end of the interval open, the default bound is taken, provided
        // that the value lies inside it.
        let usual = defaults
            .get(name)
            .copied()
            .unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
        let lower = lower.unwrap_or_else(|| {
            if usual[0] < *value {
                usual[0]
            } else {
                0.5 * value
            }
        });
        let upper = upper.unwrap_or_else(|| {
            if usual[1] > *value {
                usual[1]
            } else {
                2.0 * value
            }
        });
        // The interval of an exact trace can be narrower than the digits written here.
        let (lower, upper) = (
            lower.min(value * (1.0 - 1e-4)),
            upper.max(value * (1.0 + 1e-4)),
        );
        text.push_str(&format!(
            "{name} = [{}, {}]\n",
            rounded(lower),
            rounded(upper)
        ));
    }
    text
}

fn comment(words: &str, trace: &str) -> String {
    // A line feed in a file's name would end the comment.
    let name: String = trace
        .chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    format!("# {words} {name}.\n")
}

/// The value with six significant digits, as TOML writes a float.
fn rounded(value: f64) -> String {
    let value: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    format!("{value:?}")
}

#[cfg(test)]
mod tests {
    use cardiotwin_calibrate::calcium_fit::{CalciumFitSettings, Rice2008Parameters, fit_calcium};
    use cardiotwin_input::{Options, Report, load};

    use super::*;

    fn fit(tau_cr_ms: f64, tau_cd_ms: f64, n: u32) -> CalciumFit {
        let times: Vec<f64> = (0..n).map(|i| 10.0 * f64::from(i)).collect();
        let rice = Rice2008Parameters {
            ca_res_um: 0.15,
            ca_max_um: 0.6,
            tau_cr_ms,
            tau_cd_ms,
        };
        // Noise that needs no random generator.
        let noise = |i: usize| 0.01 * (i as f64 * 2.3).sin();
        let trace: Vec<f64> = rice
            .transient_um(&times)
            .iter()
            .enumerate()
            .map(|(i, c)| c + noise(i))
            .collect();
        fit_calcium(&times, &trace, CalciumFitSettings::default()).unwrap()
    }

    /// For each trace `check` has no findings in either text, and step 2's settings contain the
    /// fitted values.
    #[test]
    fn both_texts_are_sound_settings() {
        let folder = tempfile::tempdir().unwrap();
        let patients = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/coa-seven/patients"
        );
        for fit in [
            fit(150.0, 60.0, 100),
            fit(129.0, 128.0, 100),
            fit(400.0, 20.0, 30),
            fit(150.0, 60.0, 22),
        ] {
            let CohortDefaults { frozen, bounds } = cohort_defaults(&fit, "a\nb.csv");
            for text in [&frozen, &bounds] {
                let file = format!("name = \"x\"\npatients = {patients:?}\n{text}");
                std::fs::write(folder.path().join("cohort.toml"), file).unwrap();
                let mut report = Report::default();
                let cohort = load(folder.path(), &Options::default(), &mut report).unwrap();
                assert_eq!(report.findings(), [], "{text}");
                let step2 = cohort.plans().remove(0).settings.step2.clone();
                for (name, estimate) in by_name(&fit) {
                    let held = step2
                        .frozen
                        .get(name)
                        .map(|held| [held * 0.9999, held * 1.0001]);
                    let [low, high] = held.unwrap_or(step2.bounds[name]);
                    assert!(
                        low < estimate.value && estimate.value < high,
                        "{name} in\n{text}"
                    );
                    assert_eq!(
                        step2.parameters.iter().any(|fitted| fitted == name),
                        held.is_none()
                    );
                }
            }
        }
    }

    #[test]
    fn numbers_are_floats_of_six_digits() {
        assert_eq!(
            [rounded(150.0), rounded(0.123_456_789), rounded(1e-7)],
            ["150.0", "0.123457", "1e-7"]
        );
    }
}

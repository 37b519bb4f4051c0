//! Checks of settings: numbers outside the ranges that their types state, settings that contradict
//! each other, and unknown names of parameters.

use cardiotwin_schemas::biomarkers::{Biomarker, CELL_BIOMARKERS};
use std::collections::BTreeMap;
use std::sync::LazyLock;

use cardiotwin_schemas::notices::NoticeSettings;
use cardiotwin_schemas::organ::CELL_PARAMETERS;
use cardiotwin_schemas::organ::is_parameter;
use cardiotwin_schemas::ranges::Ranges;
use cardiotwin_schemas::settings::{
    CellFitSettings, ExecutorSettings, Settings, SolverSettings, Step1Settings,
};
use cardiotwin_schemas::step1::Step1Parameter;
use cardiotwin_schemas::step3::Step3Settings;

use super::complaint::Complaint;
use super::external;
use super::nearest::nearest;

static RANGES: LazyLock<Ranges> = LazyLock::new(Ranges::of::<Settings>);

/// All problems of the values of `settings`.
#[must_use]
pub fn complaints(settings: &Settings) -> Vec<Complaint> {
    let outside = RANGES.outside(settings).into_iter();
    let mut list = List(
        outside
            .map(|number| Complaint {
                key: number.key,
                against: None,
                found: number.value.to_string(),
                expected: number.expected,
                remedy: "give a value in this range".to_owned(),
            })
            .collect(),
    );
    list.solver(&settings.solver);
    list.step1(&settings.step1);
    list.step2(&settings.step2);
    list.step3(&settings.step3);
    let executor = &settings.executor;
    list.notices(&executor.notices);
    list.subdomains(settings.solver.finite_element.subdomains, executor);
    if let Some(umask) = executor.umask.as_ref().filter(|text| !is_mask(text)) {
        let expected = "three or four octal digits with a 0 for the owner, such as \"0077\" or \
                        \"0027\"";
        list.add(
            "executor.umask",
            umask.clone(),
            expected,
            "remove the owner's bits: they would keep the run from reading its own files",
        );
    }
    list.0.extend(external::complaints(settings));
    list.0
}

/// Whether the text is an octal mask that leaves the owner all permissions.
fn is_mask(text: &str) -> bool {
    (3..=4).contains(&text.len())
        && u32::from_str_radix(text, 8).is_ok_and(|mask| mask & 0o7700 == 0)
}

struct List(Vec<Complaint>);

impl List {
    fn add(
        &mut self,
        key: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.0.push(Complaint {
            key: key.into(),
            against: None,
            found: found.into(),
            expected: expected.into(),
            remedy: remedy.into(),
        });
    }

    /// Marks the last complaint as a conflict with `key`.
    fn against(&mut self, key: String) {
        if let Some(last) = self.0.last_mut() {
            last.against = Some(key);
        }
    }

    fn notices(&mut self, notices: &NoticeSettings) {
        for address in notices
            .mail
            .iter()
            .filter(|a| !a.contains('@') || a.contains(char::is_whitespace) || a.contains(','))
        {
            self.add(
                "executor.notices.mail",
                address.clone(),
                "addresses of the form name@host",
                "write each address as a separate string",
            );
        }
        if !notices.mail.is_empty() && notices.sendmail.is_empty() {
            self.add(
                "executor.notices.sendmail",
                "none",
                "a program that sends mail",
                "name it, or remove executor.notices.mail",
            );
        }
    }

    fn name(&mut self, key: &str, name: &str, known: &[&str]) -> bool {
        if known.contains(&name) {
            return true;
        }
        let remedy = nearest(name, known.iter().copied())
            .map_or("use one of these".to_owned(), |meant| {
                format!("did you mean `{meant}`?")
            });
        let expected = format!("a parameter among {}", known.join(", "));
        self.add(
            key,
            format!("the unknown parameter `{name}`"),
            expected,
            remedy,
        );
        false
    }

    fn bounds(&mut self, key: &str, bounds: &BTreeMap<String, [f64; 2]>, known: &[&str]) {
        for (name, [low, high]) in bounds {
            let key = format!("{key}.{name}");
            if self.name(&key, name, known) && low >= high {
                let found = format!("[{low}, {high}]");
                self.add(
                    key,
                    found,
                    "lower bound < upper bound",
                    "swap them, or freeze the parameter at one value",
                );
            }
        }
    }

    /// Ranks that do not share the parts of the mesh equally.
    fn subdomains(&mut self, parts: u32, executor: &ExecutorSettings) {
        let ranks = executor.threads;
        if parts > 0 && ranks > 0 && !executor.launcher.is_empty() && !parts.is_multiple_of(ranks) {
            self.add(
                "solver.finite_element.subdomains",
                format!("{parts} parts for {ranks} MPI ranks"),
                "0, or a multiple of executor.threads",
                "each rank computes as many parts as any other",
            );
            self.against("executor.threads".to_owned());
        }
    }

    fn solver(&mut self, solver: &SolverSettings) {
        if solver.time_step_ms > 0.0 && solver.shortest_step_ms > solver.time_step_ms {
            let found = format!(
                "{} ms, longer than a step of {} ms",
                solver.shortest_step_ms, solver.time_step_ms
            );
            let remedy = "a step is halved from solver.time_step_ms down to this value";
            self.add(
                "solver.shortest_step_ms",
                found,
                "at most solver.time_step_ms",
                remedy,
            );
            self.against("solver.time_step_ms".to_owned());
        }
        // JSON has no such numbers: an optional setting becomes null, which its stated range cannot
        // refuse.
        let optional = [
            ("activation.onset_ms", solver.activation.onset_ms),
            (
                "finite_element.wall.pointwise_share",
                solver.finite_element.wall.pointwise_share,
            ),
        ];
        for (name, value) in optional {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                self.add(
                    format!("solver.{name}"),
                    value.to_string(),
                    "a finite number",
                    "give a number, or remove the setting",
                );
            }
        }
    }

    fn step3(&mut self, step3: &Step3Settings) {
        for name in step3.uncertainty_percent.keys() {
            if !Biomarker::ORGAN_KEYS.contains(&name.as_str()) {
                let expected = format!("one of {}", Biomarker::ORGAN_KEYS.join(", "));
                self.add(
                    "step3.uncertainty_percent",
                    name.clone(),
                    &expected,
                    "name one of the organ's biomarkers",
                );
            }
        }
        for name in &step3.parameters {
            if !is_parameter(name) {
                let expected = "a parameter of the cell (but a_p_kPa) or of a valve";
                self.add(
                    "step3.parameters",
                    name.clone(),
                    expected,
                    "docs/step3.md lists them",
                );
            } else if !step3.bounds.contains_key(name) {
                let key = format!("step3.bounds.{name}");
                self.add(
                    &key,
                    "no bounds".to_owned(),
                    "[lower, upper]",
                    "give the parameter bounds, or remove it",
                );
            }
        }
        for (name, [lower, upper]) in &step3.bounds {
            let makes_sense =
                lower < upper && lower * upper > 0.0 && lower.is_finite() && upper.is_finite();
            if !makes_sense {
                let found = format!("[{lower}, {upper}]");
                let expected = "two numbers of one sign, the lower one first";
                self.add(
                    format!("step3.bounds.{name}"),
                    found,
                    expected,
                    "swap or widen the bounds",
                );
            }
        }
    }

    fn step1(&mut self, step1: &Step1Settings) {
        for name in &step1.frozen {
            self.name("step1.frozen", name, &Step1Parameter::KEYS);
        }
        self.bounds("step1.bounds", &step1.bounds, &Step1Parameter::KEYS);
        for name in step1.weights.keys() {
            self.name("step1.weights", name, &Biomarker::ORGAN_KEYS);
        }
        self.initial_inside_bounds(step1);
    }

    fn initial_inside_bounds(&mut self, step1: &Step1Settings) {
        let start = step1.start();
        for parameter in Step1Parameter::ALL {
            let (name, value) = (parameter.key(), start.get(parameter));
            let Some([low, high]) = step1.bounds.get(name) else {
                continue;
            };
            if *low < 0.0 {
                let remedy = "step 1 multiplies parameters by ratios, which keep their sign: give a \
                              bound above 0";
                self.add(
                    format!("step1.bounds.{name}"),
                    low.to_string(),
                    "a lower bound of 0 or more",
                    remedy,
                );
            }
            if low < high && !(*low..=*high).contains(&value) {
                let table = if name.starts_with("R_") {
                    "valves"
                } else {
                    "initial"
                };
                let expected = format!("a value within step1.bounds.{name} = [{low}, {high}]");
                let remedy = "move the first guess inside or widen the bounds";
                self.add(
                    format!("step1.{table}.{name}"),
                    value.to_string(),
                    expected,
                    remedy,
                );
                self.against(format!("step1.bounds.{name}"));
            }
        }
    }

    fn step2(&mut self, step2: &CellFitSettings) {
        let [low, high] = step2.mutation;
        if !(0.0 <= low && low <= high && high < 2.0) {
            let remedy = "give [smallest, largest] mutation factor; equal values switch the dither \
                          off";
            self.add(
                "step2.mutation",
                format!("[{low}, {high}]"),
                "0 ≤ smallest ≤ largest < 2",
                remedy,
            );
        }
        self.bounds("step2.bounds", &step2.bounds, &CELL_PARAMETERS);
        if step2.parameters.is_empty() {
            let remedy = "name at least one; docs/models.md lists the ten defaults";
            self.add(
                "step2.parameters",
                "an empty list",
                "parameters to fit",
                remedy,
            );
        } else if step2.fitted().is_empty() {
            let remedy = "name at least one other parameter: Rice's four have no effect if calcium \
                          is a fixed input";
            self.add(
                "step2.parameters",
                "only parameters of calcium",
                "parameters to fit",
                remedy,
            );
            self.against("step2.calcium".to_owned());
        }
        let mut seen = Vec::new();
        for name in &step2.parameters {
            if !self.name("step2.parameters", name, &CELL_PARAMETERS) {
                continue;
            }
            if seen.contains(&name) {
                let found = format!("`{name}` twice");
                self.add(
                    "step2.parameters",
                    found,
                    "each parameter once",
                    "remove one of them",
                );
            } else if !step2.bounds.contains_key(name) {
                let remedy = format!("add `{name} = [lower, upper]` to [step2.bounds]");
                self.add(
                    "step2.parameters",
                    format!("`{name}` without bounds"),
                    "bounds of every parameter",
                    remedy,
                );
                self.against(format!("step2.bounds.{name}"));
            }
            if step2.frozen.contains_key(name) {
                let remedy = "remove it from step2.parameters or from step2.frozen";
                let key = format!("step2.frozen.{name}");
                self.add(
                    key,
                    "a parameter that is also fitted",
                    "fitted or frozen, not both",
                    remedy,
                );
                self.against("step2.parameters".to_owned());
            }
            seen.push(name);
        }
        self.initial_guess(step2);
        for name in step2.frozen.keys() {
            self.name(&format!("step2.frozen.{name}"), name, &CELL_PARAMETERS);
        }
        let targets = CELL_BIOMARKERS.map(|label| label.key);
        for name in step2.weights.keys() {
            self.name(&format!("step2.weights.{name}"), name, &targets);
        }
        if !step2.weights.values().any(|weight| *weight > 0.0) {
            let remedy = "give at least one biomarker a positive weight";
            self.add(
                "step2.weights",
                "no positive weight",
                "at least one positive weight",
                remedy,
            );
        }
    }

    /// Checks the guesses of fitted parameters. Guesses of Rice's parameters have no effect if
    /// calcium is a fixed input, and are allowed.
    fn initial_guess(&mut self, step2: &CellFitSettings) {
        for (name, value) in &step2.initial {
            let key = format!("step2.initial.{name}");
            if !self.name(&key, name, &CELL_PARAMETERS) {
                continue;
            }
            if !step2.parameters.contains(name) {
                let remedy = "name it in step2.parameters, too, or freeze it in step2.frozen";
                self.add(
                    key,
                    "a parameter that is not fitted",
                    "a parameter of step2.parameters",
                    remedy,
                );
                self.against("step2.parameters".to_owned());
            } else if !value.is_finite() {
                self.add(
                    key,
                    value.to_string(),
                    "a finite number",
                    "give a number in the parameter's unit",
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::finite_element::{SurfaceSpring, WallSettings};
    use cardiotwin_schemas::muscle::PassiveTissueSettings;

    use super::*;

    /// Numbers without a range of their own: pairs that are compared with each
    /// other, seeds, settings of a site, and the number of pilots, of which a large one means all
    /// patients.
    const FREE: [&str; 10] = [
        "step1.bounds",
        "step2.bounds",
        "step2.frozen",
        "step2.initial",
        "step2.mutation",
        "step2.seed",
        "step3.bounds",
        "workflow.pilots",
        "executor.slurm",
        "solver.external",
    ];

    #[test]
    fn every_number_among_the_settings_states_its_range() {
        assert_eq!(RANGES.unstated(&FREE), Vec::<String>::new());
    }

    #[test]
    fn a_value_outside_its_range_is_told_with_the_range() {
        let mut settings = Settings::default();
        settings.step1.damping = 1.5;
        settings.step1.max_iterations = 0;
        settings.solver.slack_stretch = f64::NAN;
        settings.step1.weights.insert("SV_mL".into(), -1.0);
        let told: Vec<String> = complaints(&settings)
            .into_iter()
            .map(|c| format!("{}: {} is not {}", c.key, c.found, c.expected))
            .collect();
        assert_eq!(
            told,
            [
                "solver.slack_stretch: NaN is not a number from 0.8 to 1.3",
                "step1.damping: 1.5 is not a number above 0, up to 1",
                "step1.max_iterations: 0 is not an integer from 1 to 10000",
                "step1.weights.SV_mL: -1 is not a number from 0 to 1000000",
            ]
        );
    }

    fn keys(change: impl FnOnce(&mut Settings)) -> Vec<String> {
        let mut settings = Settings::default();
        change(&mut settings);
        complaints(&settings).into_iter().map(|c| c.key).collect()
    }

    #[test]
    fn defaults_have_nothing_to_complain_about() {
        assert_eq!(keys(|_| {}), Vec::<String>::new());
    }

    #[test]
    fn numbers_out_of_range_are_named_by_key() {
        assert_eq!(keys(|s| s.step1.tolerance = -0.1), ["step1.tolerance"]);
        assert_eq!(keys(|s| s.step1.damping = 1.5), ["step1.damping"]);
        assert_eq!(
            keys(|s| s.step1.max_iterations = 0),
            ["step1.max_iterations"]
        );
        assert_eq!(
            keys(|s| s.solver.time_step_ms = 0.0),
            ["solver.time_step_ms"]
        );
        assert_eq!(
            keys(|s| s.solver.time_step_ms = 0.01),
            ["solver.shortest_step_ms"]
        );
        assert_eq!(
            keys(|s| s.step2.recombination = 1.1),
            ["step2.recombination"]
        );
        assert_eq!(keys(|s| s.step2.mutation = [1.0, 0.5]), ["step2.mutation"]);
        assert_eq!(keys(|s| s.executor.threads = 20_000), ["executor.threads"]);
        let of_wall =
            |change: fn(&mut WallSettings)| keys(|s| change(&mut s.solver.finite_element.wall));
        let wall = |name: &str| [format!("solver.finite_element.wall.{name}")];
        assert_eq!(
            of_wall(|w| w.cross_fibre_share = 1.2),
            wall("cross_fibre_share")
        );
        assert_eq!(
            of_wall(|w| w.holzapfel_ogden.a_kpa = 0.0),
            wall("holzapfel_ogden.a_kPa")
        );
        assert_eq!(
            of_wall(|w| w.holzapfel_ogden.a_f_kpa = -1.0),
            wall("holzapfel_ogden.a_f_kPa")
        );
        assert_eq!(
            of_wall(|w| w.neo_hookean_mu_kpa = f64::NAN),
            wall("neo_hookean_mu_kPa")
        );
        let soft = PassiveTissueSettings {
            mu_kpa: 0.0,
            kappa_kpa: 100.0,
        };
        let passive = keys(|s| _ = s.solver.finite_element.wall.passive.insert(3, soft));
        assert_eq!(passive, wall("passive.3.mu_kPa"));
        let pulling = SurfaceSpring {
            spring_kpa_per_mm: -1.0,
            ..SurfaceSpring::default()
        };
        assert_eq!(
            keys(|s| _ = s
                .solver
                .finite_element
                .wall
                .surface
                .insert("lung".to_owned(), pulling)),
            wall("surface.lung.spring_kPa_per_mm")
        );
        let on_ranks = |ranks| {
            move |s: &mut Settings| {
                s.solver.finite_element.subdomains = 8;
                s.executor.threads = ranks;
                s.executor.launcher = vec!["mpirun".to_owned()];
            }
        };
        assert_eq!(keys(on_ranks(3)), ["solver.finite_element.subdomains"]);
        assert!(keys(on_ranks(4)).is_empty() && keys(on_ranks(0)).is_empty());
        let newton = keys(|s| s.solver.finite_element.newton.smallest_volume_ratio = 1.0);
        assert_eq!(
            newton,
            ["solver.finite_element.newton.smallest_volume_ratio"]
        );
    }

    #[test]
    fn bounds_reversed_unknown_or_missing_the_first_guess() {
        let reversed = keys(|s| {
            s.step1.bounds.insert("t_CR_ms".into(), [600.0, 500.0]);
        });
        assert_eq!(reversed, ["step1.bounds.t_CR_ms"]);
        let outside = keys(|s| {
            s.step1.bounds.insert("t_CR_ms".into(), [100.0, 500.0]);
        });
        assert_eq!(outside, ["step1.initial.t_CR_ms"]);
        let valve = keys(|s| s.step1.valves.r_av_f_mmhg_s_per_ml = 5.0);
        assert_eq!(valve, ["step1.valves.R_AV_f_mmHg_s_per_mL"]);
        let unknown = keys(|s| {
            s.step2.bounds.insert("tau_cr".into(), [0.0, 1.0]);
        });
        assert_eq!(unknown, ["step2.bounds.tau_cr"]);
    }

    #[test]
    fn without_rices_parameters_something_must_be_left_to_fit() {
        let only_calcium = |s: &mut Settings| {
            s.step2.parameters = vec!["Ca_max_uM".into()];
            s.step2.calcium = cardiotwin_schemas::settings::CalciumSource::MedianTrace;
        };
        assert_eq!(keys(only_calcium), ["step2.parameters"]);
    }

    #[test]
    fn parameter_names_are_checked_wherever_they_stand() {
        let mut settings = Settings::default();
        settings.step1.frozen = vec!["Smax_ref".into()];
        let complaint = complaints(&settings).remove(0);
        assert!(complaint.remedy.contains("Smax_ref_kPa"), "{complaint:?}");
        assert_eq!(
            keys(|s| s.step2.parameters.push("n_TRPN".into())),
            ["step2.parameters"]
        );
        assert_eq!(
            keys(|s| s.step2.parameters.push("r_W".into())),
            ["step2.parameters"],
            "without bounds"
        );
        assert_eq!(
            keys(|s| {
                s.step2.frozen.insert("n_TRPN".into(), 2.0);
            }),
            ["step2.frozen.n_TRPN"]
        );
        assert_eq!(
            keys(|s| {
                s.step2.weights.insert("STD40_ms".into(), 2.0);
            }),
            ["step2.weights.STD40_ms"]
        );
        assert_eq!(keys(|s| s.step2.weights.clear()), ["step2.weights"]);
        assert_eq!(
            keys(|s| s.step2.initial = [("n_Tm".into(), 99.0)].into()),
            Vec::<String>::new(),
            "cut to the bounds"
        );
        assert_eq!(
            keys(|s| s.step2.initial = [("r_W".into(), 0.5)].into()),
            ["step2.initial.r_W"]
        );
        assert_eq!(
            keys(|s| s.step2.initial = [("nTm".into(), 5.0)].into()),
            ["step2.initial.nTm"]
        );
    }
}

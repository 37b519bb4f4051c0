//! Data that contradict each other or physiology: one table of rules, for patient's files and for what
//! is prepared from recordings.
//!
//! The bounds are ours and wide: they find a wrong unit, number or clock, not an unusual heart. Each
//! rule has a name by which `accept` in `[measured]` or in `prepare.toml` overrides it.

use super::clipped;
use crate::{Problem, Trace};
use cardiotwin_vocabulary::circulation::WindkesselParameters;
use std::path::Path;

/// Numbers that must agree with each other; `None` for those that nobody measured.
#[derive(Debug, Clone, Copy, Default)]
pub struct Facts<'a> {
    /// Length of the beat \[ms\].
    pub cycle_ms: f64,
    /// Pressure of the left ventricle over one beat \[mmHg\].
    pub pressure: Option<&'a Trace>,
    /// Volume of the left ventricle over one beat \[mL\].
    pub volume: Option<&'a Trace>,
    /// Systolic and diastolic pressure of the aorta \[mmHg\].
    pub aorta: Option<[f64; 2]>,
    /// Pressure of the aorta over one beat \[mmHg\].
    pub aortic_pressure: Option<&'a Trace>,
    /// Stated largest pressure of the left ventricle \[mmHg\].
    pub stated_p_max: Option<f64>,
    /// Stated end-diastolic volume \[mL\].
    pub stated_edv: Option<f64>,
    /// Stated end-systolic volume \[mL\].
    pub stated_esv: Option<f64>,
    /// Stated stroke volume \[mL\].
    pub stated_sv: Option<f64>,
    /// Stated end-diastolic pressure \[mmHg\].
    pub stated_edp: Option<f64>,
    /// Volume at diastasis \[mL\].
    pub diastasis_ml: Option<f64>,
    /// Net forward volume of a beat \[mL\].
    pub forward_ml: Option<f64>,
    /// Parameters of the Windkessel.
    pub windkessel: Option<WindkesselParameters>,
    /// Calcium of a cell over one beat \[µM\].
    pub calcium: Option<&'a Trace>,
}

/// A rule of the table.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    /// Name, with which `accept` overrides it.
    pub name: &'static str,
    /// What must hold.
    pub expected: &'static str,
    /// What to do.
    pub remedy: &'static str,
    /// Key in `patient.toml` at which it is told.
    pub key: &'static str,
    test: fn(&Facts<'_>) -> Verdict,
}

pub(super) enum Verdict {
    Holds,
    Doubtful(String),
    Broken(String),
}

use Verdict::{Broken, Doubtful, Holds};

/// Pressure by which a ventricle's peak may lie below the aorta's systolic one \[mmHg\]: amplification of
/// the pulse towards the arm, and the error of a cuff.
const BELOW_AORTA_MMHG: f64 = 15.0;
/// Pressure by which a ventricle's peak may lie above the aorta's systolic one \[mmHg\]. A larger gradient
/// is a stenosis, or a wrong unit or zero.
const ABOVE_AORTA_MMHG: f64 = 20.0;
/// Relative difference of two volumes of the same beat that is doubtful, and that is an error.
const VOLUMES: [f64; 2] = [0.1, 0.3];
/// Relative difference of two largest pressures that is doubtful, and that is an error.
const PEAKS: [f64; 2] = [0.06, 0.2];
/// Time from the beginning of the beat to half of the pressure's rise, as a share of the cycle: above
/// the first it is doubtful that the beat begins at end-diastole, above the second it does not. From
/// the R wave it takes some 60 ms, through a long fluid-filled line up to 120 ms.
const RISE: [f64; 2] = [0.25, 0.4];
/// Factor between the resistance of the Windkessel and mean pressure over mean flow that is doubtful,
/// and that is an error. The mean is estimated from two pressures, and venous pressure is neglected.
const RESISTANCE: [f64; 2] = [1.8, 4.0];
/// The same of the compliance and stroke volume over pulse pressure, which lies above it by up to 3.
const COMPLIANCE: [f64; 2] = [5.0, 20.0];

/// Mean pressure of the aorta over the ventricle's largest pressure, where the aorta's was not measured;
/// it is 0.78 for 120 over 80 mmHg, and 0.45 to 0.9 with a stenosis or a stiff aorta.
const MEAN_OVER_PEAK: f64 = 0.75;
/// Pulse pressure of the aorta over the ventricle's largest pressure, where the aorta's was not
/// measured; 0.33 for 120 over 80 mmHg.
const PULSE_OVER_PEAK: f64 = 0.35;

/// Peaks of a calcium transient that are doubtful outside, and that are an error outside \[µM\]. Usual
/// ones reach 0.3 to 3 µM; a thousandth or a thousandfold of that is another unit.
const CALCIUM_PEAK_UM: [[f64; 2]; 2] = [[0.1, 10.0], [0.02, 20.0]];
/// Resting calcium above which a transient may be a ratio of fluorescence, which begins at 1 \[µM\].
/// Measured ones are some 0.1 µM.
const CALCIUM_REST_UM: f64 = 0.6;

/// All rules.
pub const RULES: [Rule; 14] = [
    Rule {
        name: "ventricle-below-aorta",
        expected: "a ventricle that reaches the aorta's pressure in systole",
        remedy: "one of the two has a wrong unit, scale or zero, or is of another time",
        key: "measured.aortic_pressure",
        test: ventricle_below_aorta,
    },
    Rule {
        name: "aorta-below-filling",
        expected: "an aorta whose diastolic pressure lies above the ventricle's at the beat's begin",
        remedy: "the closed aortic valve needs it: one of the two has a wrong unit, scale or zero, or the beat begins in systole",
        key: "measured.aortic_pressure",
        test: aorta_below_filling,
    },
    Rule {
        name: "ventricle-above-aorta",
        expected: "a ventricle whose largest pressure is near the aorta's in systole",
        remedy: "check the unit, scale and zero of both; a stenosis of the valve or of the aorta makes such a gradient",
        key: "measured.aortic_pressure",
        test: ventricle_above_aorta,
    },
    Rule {
        name: "clipped",
        expected: "a rounded peak and trough",
        remedy: "the amplifier's range was too small, so that the trace is cut: record again, or give the largest pressure by other means",
        key: "measured.pressure",
        test: clipped::clipped,
    },
    Rule {
        name: "beat-begin",
        expected: "a pressure that rises within the first quarter of the beat",
        remedy: "roll the traces so that time 0 is the R wave or the end of diastole, and move the other times with them",
        key: "measured.pressure",
        test: beat_begin,
    },
    Rule {
        name: "largest-pressure",
        expected: "the largest pressure of the trace",
        remedy: "correct or remove the stated one: with a trace it is not needed",
        key: "measured.biomarkers.P_max_mmHg",
        test: largest_pressure,
    },
    Rule {
        name: "volumes-sum",
        expected: "end-diastolic minus end-systolic volume as the stroke volume",
        remedy: "correct one of the three, or state only two",
        key: "measured.biomarkers.SV_mL",
        test: volumes_sum,
    },
    Rule {
        name: "end-diastolic-volume",
        expected: "the largest volume of the trace",
        remedy: "correct or remove the stated one, or check the scale of the trace",
        key: "measured.end_diastolic_volume_mL",
        test: |facts| {
            volumes(
                facts.stated_edv,
                facts.volume.map(|v| extremes(v)[1]),
                "EDV",
            )
        },
    },
    Rule {
        name: "end-systolic-volume",
        expected: "the smallest volume of the trace",
        remedy: "correct or remove the stated one, or check the scale of the trace",
        key: "measured.biomarkers.ESV_mL",
        test: |facts| {
            volumes(
                facts.stated_esv,
                facts.volume.map(|v| extremes(v)[0]),
                "ESV",
            )
        },
    },
    Rule {
        name: "stroke-volume",
        expected: "the stroke volume of the trace",
        remedy: "correct or remove the stated one, or check the scale of the trace",
        key: "measured.biomarkers.SV_mL",
        test: |facts| volumes(facts.stated_sv, stroke_of_trace(facts), "SV"),
    },
    Rule {
        name: "diastasis-volume",
        expected: "a volume of diastasis between end-systole and end-diastole",
        remedy: "correct the volume or its unit, or check the scale of the trace",
        key: "measured.diastasis",
        test: diastasis_volume,
    },
    Rule {
        name: "resistance",
        expected: "R1 + R2 near mean aortic pressure over mean flow",
        remedy: "check the units: mmHg s/mL is 1333 dyn s/cm5, kPa s/mL is 7.5 of it, and flow is mL/s, not L/min",
        key: "afterload",
        test: resistance,
    },
    Rule {
        name: "compliance",
        expected: "a compliance near stroke volume over pulse pressure",
        remedy: "check the unit of the compliance, mL/mmHg",
        key: "afterload.compliance_mL_per_mmHg",
        test: compliance,
    },
    Rule {
        name: "calcium-range",
        expected: "a calcium transient in µM: some 0.1 µM at rest, with a peak of 0.3 to 3 µM",
        remedy: "give concentrations in µM (1 µM = 1000 nM = 0.001 mM), not in another unit or as a ratio of fluorescence",
        key: "measured.calcium",
        test: calcium_range,
    },
];

/// Names with which the comparisons of [`super::check`] are accepted.
pub const COMPARISONS: [&str; 3] = ["end-diastolic-pressure", "forward-volume", "ejection"];

/// All rules that the facts break, as problems of `file`, but for those that are accepted. A name in
/// `accepted` that no rule has is an error.
#[must_use]
pub fn contradictions(facts: &Facts<'_>, accepted: &[String], file: &Path) -> Vec<Problem> {
    let mut problems = Vec::new();
    for name in accepted {
        let names: Vec<&str> = (RULES.iter().map(|rule| rule.name))
            .chain(COMPARISONS)
            .collect();
        if !names.contains(&name.as_str()) {
            let problem = Problem::error(
                file,
                format!("{name:?}"),
                format!("names of rules: {}", names.join(", ")),
                "correct or remove the name",
            );
            problems.push(problem.at_key("accept"));
        }
    }
    for rule in RULES
        .iter()
        .filter(|rule| !accepted.iter().any(|name| name == rule.name))
    {
        let remedy = format!(
            "{}; if it is right, accept = [{:?}]",
            rule.remedy, rule.name
        );
        let problem = match (rule.test)(facts) {
            Holds => continue,
            Doubtful(found) => Problem::warning(file, found, rule.expected, remedy),
            Broken(found) => Problem::error(file, found, rule.expected, remedy),
        };
        problems.push(problem.at_key(rule.key));
    }
    problems
}

/// Least and largest value.
pub(super) fn extremes(trace: &Trace) -> [f64; 2] {
    trace
        .values()
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
            [low.min(*v), high.max(*v)]
        })
}

fn stroke_of_trace(facts: &Facts<'_>) -> Option<f64> {
    let [low, high] = extremes(facts.volume?);
    Some(high - low)
}

/// Verdict on a relative difference.
fn graded(share: f64, [doubtful, broken]: [f64; 2], found: String) -> Verdict {
    if share > broken {
        Broken(found)
    } else if share > doubtful {
        Doubtful(found)
    } else {
        Holds
    }
}

fn ventricle_below_aorta(facts: &Facts<'_>) -> Verdict {
    let most = facts
        .pressure
        .map(|p| extremes(p)[1])
        .or(facts.stated_p_max);
    let (Some(most), Some([systolic, diastolic])) = (most, facts.aorta) else {
        return Holds;
    };
    let found = format!(
        "a largest ventricular pressure of {most:.1} mmHg, and an aorta of {systolic:.1} over {diastolic:.1} mmHg"
    );
    if most < diastolic || most < systolic - BELOW_AORTA_MMHG {
        Broken(found)
    } else {
        Holds
    }
}

fn aorta_below_filling(facts: &Facts<'_>) -> Verdict {
    let begin = facts.stated_edp.or(facts.pressure.map(|p| p.at(0.0)));
    let (Some(begin), Some([_, diastolic])) = (begin, facts.aorta) else {
        return Holds;
    };
    if begin < diastolic {
        return Holds;
    }
    Broken(format!(
        "{begin:.1} mmHg in the ventricle at the beat's begin, and {diastolic:.1} mmHg in the aorta in diastole"
    ))
}

fn ventricle_above_aorta(facts: &Facts<'_>) -> Verdict {
    let most = facts
        .pressure
        .map(|p| extremes(p)[1])
        .or(facts.stated_p_max);
    match (most, facts.aorta) {
        (Some(most), Some([systolic, _])) if most > systolic + ABOVE_AORTA_MMHG => {
            Doubtful(format!(
                "a largest ventricular pressure of {most:.1} mmHg, {:.1} mmHg above the aorta's",
                most - systolic
            ))
        }
        _ => Holds,
    }
}

fn beat_begin(facts: &Facts<'_>) -> Verdict {
    let Some(pressure) = facts.pressure else {
        return Holds;
    };
    let [low, high] = extremes(pressure);
    let half = 0.5 * (low + high);
    let (times, values) = (pressure.time_ms(), pressure.values());
    // From the last sample below half before the longest stretch above it: noise may cross twice.
    let Some(top) = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])) else {
        return Holds;
    };
    let Some(before) = values[..top].iter().rposition(|v| *v < half) else {
        return Broken(format!(
            "a pressure of {:.1} mmHg at time 0, above half of its rise",
            values[0]
        ));
    };
    let rise = times[before];
    graded(
        rise / facts.cycle_ms,
        RISE,
        format!(
            "a pressure that rises {rise:.0} ms after the beat's begin, in a cycle of {:.0} ms",
            facts.cycle_ms
        ),
    )
}

fn largest_pressure(facts: &Facts<'_>) -> Verdict {
    let (Some(stated), Some(pressure)) = (facts.stated_p_max, facts.pressure) else {
        return Holds;
    };
    let most = extremes(pressure)[1];
    graded(
        (stated / most - 1.0).abs(),
        PEAKS,
        format!("{stated:.1} mmHg, and {most:.1} mmHg in the trace"),
    )
}

fn volumes_sum(facts: &Facts<'_>) -> Verdict {
    let (Some(edv), Some(esv)) = (facts.stated_edv, facts.stated_esv) else {
        if let (Some(edv), Some(sv)) = (facts.stated_edv, facts.stated_sv)
            && sv >= edv
        {
            return Broken(format!(
                "a stroke volume of {sv:.1} mL of {edv:.1} mL at end-diastole"
            ));
        }
        return Holds;
    };
    if esv >= edv {
        return Broken(format!(
            "{esv:.1} mL at end-systole, and {edv:.1} mL at end-diastole"
        ));
    }
    let Some(sv) = facts.stated_sv else {
        return Holds;
    };
    graded(
        (edv - esv - sv).abs() / sv.max(1e-9),
        VOLUMES,
        format!(
            "{edv:.1} mL − {esv:.1} mL = {:.1} mL, and a stroke volume of {sv:.1} mL",
            edv - esv
        ),
    )
}

fn volumes(stated: Option<f64>, seen: Option<f64>, name: &str) -> Verdict {
    let (Some(stated), Some(seen)) = (stated, seen) else {
        return Holds;
    };
    graded(
        (stated / seen - 1.0).abs(),
        VOLUMES,
        format!("{name} {stated:.1} mL, and {seen:.1} mL by the trace"),
    )
}

fn diastasis_volume(facts: &Facts<'_>) -> Verdict {
    let trace = facts.volume.map(extremes);
    let most = trace.map(|[_, high]| high).or(facts.stated_edv);
    let least = trace.map(|[low, _]| low).or(facts.stated_esv);
    let Some(volume) = facts.diastasis_ml else {
        return Holds;
    };
    let above = most.map_or(0.0, |most| volume / most - 1.0);
    let below = least.map_or(0.0, |least| 1.0 - volume / least);
    let ml = |volume: Option<f64>| volume.map_or("?".to_owned(), |volume| format!("{volume:.1}"));
    graded(
        above.max(below),
        VOLUMES,
        format!(
            "{volume:.1} mL at diastasis, and {} to {} mL over the beat",
            ml(least),
            ml(most)
        ),
    )
}

/// Mean and pulse pressure of the aorta \[mmHg\]: measured, or else estimated from the ventricle's largest
/// pressure, and from what they come.
fn aortic_pressures(facts: &Facts<'_>) -> Option<(f64, f64, &'static str)> {
    if let Some([systolic, diastolic]) = facts.aorta {
        let pulse = systolic - diastolic;
        return Some((diastolic + pulse / 3.0, pulse, ""));
    }
    let most = facts
        .pressure
        .map(|p| extremes(p)[1])
        .or(facts.stated_p_max)?;
    let origin = " (estimated from the ventricle's largest pressure)";
    Some((MEAN_OVER_PEAK * most, PULSE_OVER_PEAK * most, origin))
}

/// The volume that a beat ejects, from what is known best.
fn ejected(facts: &Facts<'_>) -> Option<f64> {
    facts
        .forward_ml
        .or(facts.stated_sv)
        .or(stroke_of_trace(facts))
}

fn resistance(facts: &Facts<'_>) -> Verdict {
    let (Some(load), Some((mean, _, origin)), Some(sv)) =
        (facts.windkessel, aortic_pressures(facts), ejected(facts))
    else {
        return Holds;
    };
    let flow = sv / (1e-3 * facts.cycle_ms);
    if flow <= 0.0 {
        return Broken(format!("a mean flow of {flow:.1} mL/s"));
    }
    let stated =
        load.characteristic_resistance_mmhg_s_per_ml + load.peripheral_resistance_mmhg_s_per_ml;
    let expected = mean / flow;
    graded(
        (stated / expected).max(expected / stated),
        RESISTANCE,
        format!(
            "R1 + R2 = {stated:.3} mmHg s/mL, where {mean:.0} mmHg over {flow:.0} mL/s are {expected:.3}{origin}"
        ),
    )
}

fn compliance(facts: &Facts<'_>) -> Verdict {
    let (Some(load), Some((_, pulse, origin)), Some(sv)) =
        (facts.windkessel, aortic_pressures(facts), ejected(facts))
    else {
        return Holds;
    };
    let c = load.compliance_ml_per_mmhg;
    let expected = sv / pulse.max(1.0);
    graded(
        (c / expected).max(expected / c),
        COMPLIANCE,
        format!(
            "C = {c:.3} mL/mmHg, where {sv:.0} mL over {pulse:.0} mmHg are {expected:.3}{origin}"
        ),
    )
}

fn calcium_range(facts: &Facts<'_>) -> Verdict {
    let Some(calcium) = facts.calcium else {
        return Holds;
    };
    let [rest, peak] = extremes(calcium);
    let [doubtful, broken] = CALCIUM_PEAK_UM;
    let inside = |[low, high]: [f64; 2]| (low..=high).contains(&peak);
    let of = |factor: f64, unit: &str| {
        let peak = peak * factor;
        inside_usual(peak).then(|| {
            format!(
                ", which would be {peak:.2} µM if the numbers are in {unit}: multiply by {factor}"
            )
        })
    };
    let unit = of(1e-3, "nM")
        .or_else(|| of(1e3, "mM"))
        .or_else(|| of(1e6, "M"))
        .unwrap_or_default();
    let found = format!("calcium from {} to {} µM{unit}", digits(rest), digits(peak));
    if !inside(broken) {
        Broken(found)
    } else if !inside(doubtful) {
        Doubtful(found)
    } else if rest > CALCIUM_REST_UM {
        Doubtful(format!("a resting calcium of {rest:.2} µM"))
    } else {
        Holds
    }
}

/// A number with about three digits, whatever its size.
fn digits(value: f64) -> String {
    match value.abs() {
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 0.01 => format!("{value:.3}"),
        _ => format!("{value:e}"),
    }
}

/// Whether a peak is a usual one, in µM.
fn inside_usual(peak_um: f64) -> bool {
    let [[low, high], _] = CALCIUM_PEAK_UM;
    (low..=high).contains(&peak_um)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quantity;

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
        let volume = volume();
        let [in_um, in_nm, in_mm, ratio] =
            [[0.1, 0.6], [100.0, 600.0], [1e-4, 6e-4], [1.0, 2.5]].map(transient);
        let facts = Facts {
            calcium: Some(&in_um),
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
        };
        assert_eq!(told(&facts, &[]), Vec::<String>::new());
        let no_aorta = Facts {
            aorta: None,
            ..facts
        };
        assert_eq!(told(&no_aorta, &[]), Vec::<String>::new());
        assert_eq!(told(&facts, &COMPARISONS), Vec::<String>::new());
        for (name, broken, severity) in [
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
}

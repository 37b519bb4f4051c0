//! Data that contradict each other or physiology: one table of rules, for patient's files and for what
//! is prepared from recordings.
//!
//! The bounds are ours and wide: they find a wrong unit, number or clock, not an unusual heart. Each
//! rule has a name by which `accept` in `[measured]` or in `prepare.toml` overrides it.

use super::aortic_means;
use super::clipped;
pub use super::facts::Facts;
use super::facts::Verdict::{self, Broken, Doubtful, Holds};
use super::facts::extremes;
use super::lone_volume::{VOLUME_KEY, lone_volume};
use crate::{Problem, Trace};
use std::path::Path;

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

/// Pressure by which a ventricle's peak may lie below the aorta's systolic one \[mmHg\]: amplification of
/// the pulse towards the arm, and the error of a cuff.
const BELOW_AORTA_MMHG: f64 = 15.0;
/// Pressure by which a ventricle's peak may lie above the aorta's systolic one \[mmHg\]. A larger gradient
/// is a stenosis, or a wrong unit or zero.
const ABOVE_AORTA_MMHG: f64 = 20.0;
/// Time from half of the ventricle's rise to half of the aorta's \[ms\]: some 40 ms in the root, and more in a
/// distant artery or through a long fluid-filled line.
const APART_MS: std::ops::RangeInclusive<f64> = -30.0..=150.0;
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
pub const RULES: [Rule; 18] = [
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
        name: "aorta-apart",
        expected: "an aorta that rises with the ventricle, or up to 150 ms later through a long line",
        remedy: "one of the two is of another time: move it, or record both with one clock",
        key: "measured.aortic_pressure",
        test: aorta_apart,
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
        name: "lone-volume",
        expected: "volumes that lie near those before and after",
        remedy: "correct the contour or the number, or leave the sample out",
        key: VOLUME_KEY,
        test: lone_volume,
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
        name: "aortic-mean-pressure",
        expected: "a mean aortic pressure of 25 to 200 mmHg",
        remedy: "is it in mmHg? 1 kPa is 7.5 mmHg",
        key: "measured.aortic_pressure",
        test: aortic_means::pressure,
    },
    Rule {
        name: "aortic-mean-flow",
        expected: "a mean aortic flow of 12 to 400 mL/s, positive out of the heart",
        remedy: "is it in mL/s? 1 L/min is 16.7 mL/s; a negative one needs the other sign, or a corrected zero",
        key: "measured.aortic_flow",
        test: aortic_means::flow,
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

/// Time of the last sample below half of a pressure's rise before its largest value \[ms\]; `None` where it
/// begins above.
fn half_of_rise_ms(pressure: &Trace) -> Option<f64> {
    let [low, high] = extremes(pressure);
    let values = pressure.values();
    // From the last sample below half before the longest stretch above it: noise may cross twice.
    let top = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b]))?;
    let half = 0.5 * (low + high);
    let before = values[..top].iter().rposition(|v| *v < half)?;
    Some(pressure.time_ms()[before])
}

fn aorta_apart(facts: &Facts<'_>) -> Verdict {
    let (Some(ventricle), Some(aorta)) = (facts.pressure, facts.aortic_pressure) else {
        return Holds;
    };
    let Some(rise) = half_of_rise_ms(ventricle) else {
        return Holds;
    };
    let Some(of_aorta) = half_of_rise_ms(aorta) else {
        return Doubtful(format!(
            "an aorta that is above half of its rise as the beat begins, {rise:.0} ms before the ventricle rises"
        ));
    };
    if APART_MS.contains(&(of_aorta - rise)) {
        return Holds;
    }
    Doubtful(format!(
        "an aorta that rises {:.0} ms after the ventricle",
        of_aorta - rise
    ))
}

fn beat_begin(facts: &Facts<'_>) -> Verdict {
    let Some(pressure) = facts.pressure else {
        return Holds;
    };
    let Some(rise) = half_of_rise_ms(pressure) else {
        return Broken(format!(
            "a pressure of {:.1} mmHg at time 0, above half of its rise",
            pressure.values()[0]
        ));
    };
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
#[path = "consistency_tests.rs"]
mod tests;

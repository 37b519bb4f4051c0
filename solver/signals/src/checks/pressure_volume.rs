//! Do pressure, volume and the single numbers of the patient's file belong together?

use cardiotwin_units::MMHG_PER_KPA;

use super::consistency::COMPARISONS;
use super::measured::{Measured, Source, extremes};
use crate::{BeatBiomarkers, Continuation, Problem};

/// Names with which a patient's file accepts what the comparisons find.
const EDP: &str = COMPARISONS[0];
const FORWARD: &str = COMPARISONS[1];
const EJECTION: &str = COMPARISONS[2];
/// End-diastolic pressure may differ from the trace at time zero by so much, mmHg, and more is an error.
const EDP_MMHG: [f64; 2] = [4.0, 20.0];
/// Delay of ejection after the rise of pressure to half its amplitude, ms, outside which the two look misaligned.
const EJECTION_DELAY_MS: std::ops::RangeInclusive<f64> = -15.0..=130.0;
/// Stroke volume over forward stroke volume, dimensionless, outside which one of the two has a wrong unit.
const STROKE_RATIO: std::ops::RangeInclusive<f64> = 0.33..=4.0;
/// Relative uncertainty of a stroke volume from cine frames, dimensionless, that no difference below is worth a word.
const STROKE_SD: f64 = 0.08;

/// Checks that need both traces, or a trace's time zero.
pub(super) fn check(measured: &Measured, problems: &mut Vec<Problem>) {
    let periodic = Continuation::periodic(measured.cycle_length);
    if measured
        .pressure
        .is_some_and(|p| !begins_in_diastole(measured, p, problems))
    {
        return;
    }
    let (Some(p), Some(v)) = (measured.pressure, measured.volume) else {
        return;
    };
    // A trace that cannot be resampled was reported by the checks of times.
    let Ok(b) = BeatBiomarkers::of(Some(p.trace), Some(v.trace), periodic) else {
        return;
    };
    order(measured, &b, p, v, problems);
}

/// Checks of the single numbers against each other and against the traces' values.
pub(super) fn check_numbers(measured: &Measured, problems: &mut Vec<Problem>) {
    if let (Some(edp), Some(p)) = (measured.end_diastolic_pressure, measured.pressure) {
        let at_zero = p.trace.at(0.0);
        let difference = (edp.0 - at_zero).abs();
        if difference > EDP_MMHG[0] {
            let found = format!(
                "{} mmHg, and {at_zero:.1} mmHg at time 0 of {}",
                edp.0,
                p.file.display()
            );
            let expected = format!("the same to {} mmHg", EDP_MMHG[0]);
            let remedy = "check where the beat begins, and whether an offset was removed from one of the two";
            let problem = if difference > EDP_MMHG[1] {
                Problem::error(measured.patient_file, found, expected, remedy)
            } else {
                Problem::warning(measured.patient_file, found, expected, remedy)
            };
            let problem = problem.at_key("measured.end_diastolic_pressure_mmHg");
            measured.tell(EDP, problem, problems);
        }
    }
    atrial_pressure(measured, problems);
    stroke_volume(measured, problems);
}

/// A mean atrial pressure below this share of the end-diastolic pressure is named, where the latter is more than a wrong zero.
const LEAST_FILLING_SHARE: f64 = 0.25;
const PLAUSIBLE_EDP_MMHG: std::ops::Range<f64> = 4.0..30.0;

fn atrial_pressure(measured: &Measured, problems: &mut Vec<Problem>) {
    let edp = measured
        .end_diastolic_pressure
        .map(|edp| (edp.0, "the end-diastolic pressure"))
        .or_else(|| {
            measured
                .pressure
                .map(|p| (p.trace.at(0.0), "the pressure at time 0"))
        });
    let (Some(atrial), Some((edp, name))) = (measured.left_atrial_pressure, edp) else {
        return;
    };
    // A high end-diastolic pressure is itself in doubt, and other rules name it.
    if atrial.0 > 0.0 && PLAUSIBLE_EDP_MMHG.contains(&edp) && atrial.0 < LEAST_FILLING_SHARE * edp {
        let in_mmhg = atrial.0 * MMHG_PER_KPA;
        let remedy = if (0.4..1.5).contains(&(in_mmhg / edp)) {
            format!(
                "if it is in kPa, {in_mmhg:.1} mmHg; else correct the value, or remove the key to have it estimated"
            )
        } else {
            "correct the value, or remove the key to have it estimated".to_owned()
        };
        let problem = Problem::warning(
            measured.patient_file,
            format!("{} mmHg, far below {name} of {edp:.1} mmHg", atrial.0),
            format!("usually {:.0} to {edp:.0} mmHg", 0.5 * edp),
            remedy,
        );
        problems.push(problem.at_key("preload.left_atrial_pressure_mmHg"));
    }
    if atrial.0 > edp {
        let problem = Problem::warning(
            measured.patient_file,
            format!("{} mmHg, above {name} of {edp:.1} mmHg", atrial.0),
            format!("usually at most {edp:.1} mmHg"),
            "the mitral valve is open as the beat begins, and filling goes on until the pressure rises: right for an atrium of so high a mean pressure; else correct the value, or remove the key to have it estimated",
        );
        problems.push(problem.at_key("preload.left_atrial_pressure_mmHg"));
    }
}

fn stroke_volume(measured: &Measured, problems: &mut Vec<Problem>) {
    let (Some(forward), Some(v)) = (measured.forward_stroke_volume, measured.volume) else {
        return;
    };
    let key = "measured.forward_stroke_volume";
    if forward.volume.0.is_nan() || forward.volume.0 <= 0.0 {
        let found = format!("{} mL", forward.volume.0);
        let remedy = "give the net forward volume of a beat in mL, or remove the table";
        problems.push(
            Problem::error(measured.patient_file, found, "a positive volume", remedy).at_key(key),
        );
        return;
    }
    let (max, min) = extremes(v.trace);
    let stroke = max - min;
    let found = format!(
        "{:.1} mL, and a stroke volume of {stroke:.1} mL in {}",
        forward.volume.0,
        v.file.display()
    );
    if !STROKE_RATIO.contains(&(stroke / forward.volume.0)) {
        let expected = "two volumes of the same beat";
        let remedy = "one of the two has a wrong unit or belongs to another patient";
        let problem = Problem::error(measured.patient_file, found, expected, remedy).at_key(key);
        measured.tell(FORWARD, problem, problems);
        return;
    }
    let uncertainty = 2.0 * (forward.sd.0.powi(2) + (STROKE_SD * stroke).powi(2)).sqrt();
    if (stroke - forward.volume.0).abs() > uncertainty {
        let expected = format!("the same to {uncertainty:.1} mL");
        let remedy = if stroke > forward.volume.0 {
            "a leak (regurgitation, septal defect) or a wrong scale of the volumes: `discover` can tell"
        } else {
            "no ventricle ejects less than flows in its aorta: check the scale of the volumes"
        };
        let problem = Problem::warning(measured.patient_file, found, expected, remedy).at_key(key);
        measured.tell(FORWARD, problem, problems);
    }
}

fn begins_in_diastole(measured: &Measured, source: Source, problems: &mut Vec<Problem>) -> bool {
    let (max, min) = extremes(source.trace);
    let at_zero = source.trace.at(0.0);
    let in_diastole = at_zero <= min + 0.5 * (max - min);
    if !in_diastole {
        let problem = Problem::error(
            source.file,
            format!("{at_zero:.1} mmHg at time 0, between {min:.1} and {max:.1} mmHg"),
            "a beat that begins in diastole, before the pressure rises",
            "shift the trace so that time 0 is the R wave, some 30 ms before the pressure rises",
        );
        measured.tell("beat-begin", problem.at_key("time_ms"), problems);
    }
    in_diastole
}

/// Ejection must follow the pressure's rise. Half of the amplitude stands for rise and fall: the 10 % level may lie below
/// the end-diastolic pressure, and then is crossed somewhere in diastole.
fn order(
    measured: &Measured,
    b: &BeatBiomarkers,
    p: Source,
    v: Source,
    problems: &mut Vec<Problem>,
) {
    let cycle_length = measured.cycle_length.0;
    let (max, min) = extremes(p.trace);
    let high = |v: &f64| *v > 0.5 * (min + max);
    let (times, values) = (p.trace.time_ms(), p.trace.values());
    let (Some(rise), Some(fall)) = (values.iter().position(high), values.iter().rposition(high))
    else {
        return;
    };
    let Some(t5) = b.time_points.t5_ms else {
        return;
    };
    let (rise, fall) = (times[rise], times[fall]);
    let volume_at = |t: f64| v.trace.at(t.rem_euclid(cycle_length));
    let (before, after) = (volume_at(rise), volume_at(fall));
    let stroke = b.values.sv_ml.unwrap_or(0.0);
    if after > before - 0.25 * stroke {
        let problem = Problem::error(
            v.file,
            format!(
                "{before:.1} mL as the pressure in {} rises, and {after:.1} mL as it falls",
                p.file.display()
            ),
            "a volume that is ejected in between",
            "pressure and volume are shifted against each other, or do not belong together: synchronise them by the R wave",
        );
        measured.tell(EJECTION, problem, problems);
        return;
    }
    let Some(begin) = ejection_begin(b, v, t5, cycle_length) else {
        return;
    };
    let delay = (begin - rise + 0.5 * cycle_length).rem_euclid(cycle_length) - 0.5 * cycle_length;
    if !EJECTION_DELAY_MS.contains(&delay) {
        let problem = Problem::warning(
            v.file,
            format!(
                "a tenth of the stroke volume ejected {delay:.0} ms after the rise of pressure to half its amplitude"
            ),
            format!(
                "{} to {} ms",
                EJECTION_DELAY_MS.start(),
                EJECTION_DELAY_MS.end()
            ),
            "pressure and volume look shifted against each other: synchronise them by the R wave",
        );
        measured.tell(EJECTION, problem, problems);
    }
}

/// Last time before the minimum at which nine tenths of the stroke volume are still inside, ms.
fn ejection_begin(b: &BeatBiomarkers, v: Source, t5: f64, cycle_length: f64) -> Option<f64> {
    let level = b.values.esv_ml? + 0.9 * b.values.sv_ml?;
    let step = 1.0;
    let mut t = t5;
    while t > t5 - cycle_length {
        if v.trace.at(t.rem_euclid(cycle_length)) >= level {
            return Some(t);
        }
        t -= step;
    }
    None
}

//! Step 0: computes from the measurements the input shared by all simulations of a patient. Missing
//! data are estimated and marked as such.

mod corrections;
pub(crate) mod estimates;
mod finite_element;
mod measurements;
mod onset;
mod own_mesh;
mod passive_tags;
mod perturbation;

use std::collections::BTreeMap;

use cardiotwin_models::ventricle::{
    DiastasisPoint, OneFibrePassive, PassiveLaw as _, PassiveStateInput, PassiveStateMode,
};
use cardiotwin_schemas::organ::{ActivationSpec, CirculationSpec, OrganSpec};
use cardiotwin_schemas::outcome::{Estimate, PassiveStateResult, TaskResult};
use cardiotwin_schemas::samples::BeatSamples;
use cardiotwin_schemas::settings::{ActivationSettings, StartMode};
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_signals::NoiseWindows;
use cardiotwin_units::{Ml, Mmhg};

use self::measurements::{EndDiastole, Measurements};
use self::onset::onset_ms;
use crate::context::Context;
use crate::error::TaskError;
use crate::tasks::organ_beat::samples;

/// Fits the passive state and collects loads and measured biomarkers.
///
/// # Errors
/// [`TaskError`] when files are not the planned ones, or when the measurements do not determine a
/// beat.
pub fn run(spec: &PassiveStateSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let mut estimates = Vec::new();
    let mut measured = Measurements::read(spec)?;
    let mut remarks = measured.read.remarks();
    remarks.extend(corrections::remark(&spec.corrections));
    remarks.extend(noise_remarks(measured.windows));
    let mut end_diastole = measured.end_diastole(spec, &mut estimates)?;
    measured.biomarkers.edv_ml = Some(end_diastole.volume_ml);
    measured.biomarkers.edp_mmhg = Some(end_diastole.pressure_mmhg);

    let accepted = spec.passive_law.as_ref();
    let wall_volume_ml = accepted
        .map(|law| law.wall_volume_ml)
        .or(spec.wall_volume_ml);
    // A patient's own mesh has a wall: an estimate would be used nowhere.
    let is_meshed = spec.own_mesh.is_some() && spec.finite_element.is_some();
    let wall_volume_ml = wall_volume_ml.unwrap_or_else(|| match is_meshed {
        true => estimates::wall_volume(end_diastole, &mut Vec::new()),
        false => estimates::wall_volume(end_diastole, &mut estimates),
    });
    let accepted = accepted
        .map(|law| accepted_law(law, end_diastole))
        .transpose()?;
    if let Some(law) = &accepted {
        end_diastole.pressure_mmhg = law.end_diastolic_pressure_mmhg;
    }
    let made = match &spec.finite_element {
        None => reduced(
            spec,
            &measured,
            end_diastole,
            accepted,
            wall_volume_ml,
            &mut estimates,
            &mut remarks,
        )?,
        Some(anatomy) => {
            if accepted.is_some() {
                remarks.push(
                    "the end-diastolic pressure is that of the passive law that was accepted"
                        .to_owned(),
                );
            }
            let made = finite_element::make(
                spec,
                anatomy,
                &measured,
                end_diastole,
                wall_volume_ml,
                &mut estimates,
                context,
            )?;
            remarks.extend(made.remarks);
            let organ = OrganSpec::FiniteElement(Box::new(made.organ));
            MadeOrgan {
                organ,
                diastasis_volume_error_ml: None,
                counters: made.counters,
            }
        }
    };
    let circulation = circulation(spec, &measured, end_diastole, &mut estimates)?;
    if !spec.corrections.is_empty() {
        context.artefacts.write(
            "measured",
            "measured.csv",
            &corrections::csv(&measured.pressure, &measured.volume),
        )?;
    }
    // Comes last, so that everything above depends on the unperturbed data alone.
    let biomarker_factors = perturbation::apply(&spec.biomarker_factors, &mut measured.biomarkers)?;
    remarks.extend(perturbation::remark(&biomarker_factors));
    Ok(TaskResult::PassiveState(PassiveStateResult {
        organ: made.organ,
        circulation,
        measured: measured.biomarkers,
        biomarker_factors,
        noise_windows: measured.windows,
        time_points: measured.read.time_points,
        samples: BeatSamples {
            pressure_mmhg: measured
                .pressure
                .as_ref()
                .map_or_else(Vec::new, |p| samples(p, spec.cycle_length_ms)),
            volume_ml: measured
                .volume
                .as_ref()
                .map_or_else(Vec::new, |v| samples(v, spec.cycle_length_ms)),
        },
        estimates,
        diastasis_volume_error_ml: made.diastasis_volume_error_ml,
        remarks,
        counters: made.counters,
    }))
}

/// The organ, the error of the fitted law in the diastasis volume, and the costs.
struct MadeOrgan {
    organ: OrganSpec,
    diastasis_volume_error_ml: Option<f64>,
    counters: BTreeMap<String, f64>,
}

/// The reduced ventricle. Its law is the accepted one if any, otherwise the law through the
/// measured points.
fn reduced(
    spec: &PassiveStateSpec,
    measured: &Measurements,
    end_diastole: EndDiastole,
    accepted: Option<OneFibrePassive>,
    wall_volume_ml: f64,
    estimates: &mut Vec<Estimate>,
    remarks: &mut Vec<String>,
) -> Result<MadeOrgan, TaskError> {
    let (law, diastasis) = match accepted {
        Some(law) => {
            remarks.push(
                "the passive law is the one that was accepted with the patient's effects"
                    .to_owned(),
            );
            (law, None)
        }
        None => passive_law(spec, measured, end_diastole, wall_volume_ml, remarks)?,
    };
    let ActivationSettings {
        spread_ms, groups, ..
    } = spec.activation;
    let activation = ActivationSpec {
        spread_ms,
        groups,
        onset_ms: onset_ms(spec, measured, spread_ms, estimates),
    };
    let diastasis_volume_error_ml = diastasis
        .and_then(|point| volume_at(&law, point.pressure).map(|volume| volume - point.volume.0));
    let organ = OrganSpec::Reduced {
        passive: law,
        activation,
    };
    Ok(MadeOrgan {
        organ,
        diastasis_volume_error_ml,
        counters: BTreeMap::new(),
    })
}

/// Remarks about the windows over which noisy traces are read.
fn noise_remarks(windows: NoiseWindows) -> Vec<String> {
    let said = |trace: &str, window_ms: Option<f64>, what: &str| {
        window_ms.map(|window_ms| {
            format!("the measured {trace} is noisy: {what}, measured and simulated, are read over {window_ms:.0} ms")
        })
    };
    let pressure = said(
        "pressure",
        windows.pressure_ms,
        "its largest value and its rates",
    );
    pressure
        .into_iter()
        .chain(said("volume", windows.volume_ms, "its biomarkers"))
        .collect()
}

/// The accepted law, with the active stretch relative to the measured end-diastolic volume.
fn accepted_law(
    law: &OneFibrePassive,
    end_diastole: EndDiastole,
) -> Result<OneFibrePassive, TaskError> {
    let volume = Ml(end_diastole.volume_ml);
    let through = OneFibrePassive::through(
        Ml(law.unloaded_volume_ml),
        volume,
        law.pressure(volume),
        Ml(law.wall_volume_ml),
        law.exponent,
    )
    .map_err(TaskError::PassiveState)?;
    Ok(OneFibrePassive {
        end_diastolic_pressure_mmhg: through.pressure(volume).0,
        ..through
    })
}

/// The law through the measured points, and the diastasis point if there is one. Adds a remark if
/// the law misses this point.
fn passive_law(
    spec: &PassiveStateSpec,
    measured: &Measurements,
    end_diastole: EndDiastole,
    wall_volume_ml: f64,
    remarks: &mut Vec<String>,
) -> Result<(OneFibrePassive, Option<DiastasisPoint>), TaskError> {
    let pressure = measured
        .pressure
        .as_ref()
        .zip(spec.diastasis_time_ms)
        .map(|(trace, time)| trace.at(time));
    let known = spec.diastasis_volume_ml.zip(pressure);
    let mut diastasis = known.map(|(volume, pressure)| DiastasisPoint {
        volume: Ml(volume),
        pressure: Mmhg(pressure),
    });
    let mode = match spec.start {
        StartMode::EndDiastole => PassiveStateMode::EndDiastole,
        StartMode::Diastasis => {
            // This start only needs the volume of the image, whose pressure is then the
            // end-diastolic one.
            diastasis = diastasis.or(spec.diastasis_volume_ml.map(|volume| DiastasisPoint {
                volume: Ml(volume),
                pressure: Mmhg(end_diastole.pressure_mmhg),
            }));
            PassiveStateMode::Diastasis
        }
    };
    let (mut law, fitted) = OneFibrePassive::fit(&PassiveStateInput {
        end_diastolic_volume: Ml(end_diastole.volume_ml),
        end_diastolic_pressure: Mmhg(end_diastole.pressure_mmhg),
        diastasis,
        wall_volume: Ml(wall_volume_ml),
        mode,
    })
    .map_err(TaskError::PassiveState)?;
    if let Some(exponent) = spec.passive_exponent {
        law.exponent = exponent;
        // Pressure is proportional to stiffness, so that one evaluation puts the law through the
        // end-diastolic point.
        law.stiffness_kpa *=
            end_diastole.pressure_mmhg / law.pressure(Ml(law.end_diastolic_volume_ml)).0;
    } else if diastasis.is_some() && !fitted && spec.start != StartMode::Diastasis {
        remarks.push(
            "no passive law passes through the diastasis point: the exponent is the default"
                .to_owned(),
        );
    }
    Ok((law, diastasis))
}

/// Volume at which the law has this pressure; `None` outside the law's range.
fn volume_at(law: &OneFibrePassive, pressure: Mmhg) -> Option<f64> {
    let (mut lower, mut upper) = (law.unloaded_volume_ml, 1.5 * law.end_diastolic_volume_ml);
    if !(pressure.0 >= 0.0 && law.pressure(Ml(upper)).0 >= pressure.0) {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (lower + upper);
        if law.pressure(Ml(middle)).0 < pressure.0 {
            lower = middle
        } else {
            upper = middle
        }
    }
    Some(0.5 * (lower + upper))
}

fn circulation(
    spec: &PassiveStateSpec,
    measured: &Measurements,
    end_diastole: EndDiastole,
    estimates: &mut Vec<Estimate>,
) -> Result<CirculationSpec, TaskError> {
    let loads = estimates::Loads::new(spec, measured, end_diastole);
    let afterload = match spec.afterload {
        Some(afterload) => afterload,
        None => loads.afterload(estimates)?,
    };
    let left_atrial_pressure_mmhg = match spec.left_atrial_pressure_mmhg {
        Some(pressure) => pressure,
        None => loads.left_atrial_pressure(estimates)?,
    };
    let initial_windkessel_pressure_mmhg = spec
        .aortic_diastolic_mmhg
        .unwrap_or_else(|| loads.periodic_windkessel_pressure(&afterload));
    Ok(CirculationSpec {
        afterload,
        initial_windkessel_pressure_mmhg,
        left_atrial_pressure_mmhg,
        effects: Vec::new(),
        closed: None,
    })
}

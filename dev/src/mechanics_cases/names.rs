//! Conversion of the file's names to the solver's types.

use std::path::Path;

use cardiotwin_dev_solver::prescribed::Schedule;
use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::material::Tissue;
use cardiotwin_mechanics::organ::ElementKind;

use cardiotwin_schemas::finite_element::WallSettings;
use cardiotwin_schemas::muscle::{HolzapfelOgden, MuscleLaw};

use super::error::CaseError;
use super::file::{Axis, Degree, ElementTable, PassiveTable, TimeTable, TissueTable, VolumeName};
use cardiotwin_worker::finite_element::wall;

/// Index of the axis.
pub(super) fn axis(axis: Axis) -> usize {
    match axis {
        Axis::X => 0,
        Axis::Y => 1,
        Axis::Z => 2,
    }
}

pub(super) fn element(file: &Path, table: &ElementTable) -> Result<ElementKind, CaseError> {
    let ElementTable {
        kind,
        degree,
        volume,
        pointwise_share,
    } = *table;
    if let Some(kind) = kind {
        if degree.is_some() || volume.is_some() || pointwise_share.is_some() {
            let expected =
                "element.kind alone, or element.degree, element.volume and element.pointwise_share";
            return Err(CaseError::key(
                file,
                "element.kind",
                "other keys of [element] beside it",
                expected,
            ));
        }
        return Ok(wall::element(kind, None));
    }
    let share = pointwise_share.unwrap_or(0.0);
    if !(0.0..=1.0).contains(&share) {
        return Err(CaseError::key(
            file,
            "element.pointwise_share",
            share.to_string(),
            "a share from 0 to 1",
        ));
    }
    let volume = match volume {
        Some(VolumeName::Pointwise) => VolumeChange::Pointwise,
        Some(VolumeName::Nodal) | None => VolumeChange::Nodal {
            pointwise_share: share,
        },
    };
    Ok(ElementKind {
        quadratic: degree != Some(Degree::Linear),
        volume,
    })
}

/// Makes laws and conventions by the functions that make a cohort's.
pub(super) fn tissue(table: &TissueTable) -> Tissue {
    let wall = WallSettings::default();
    let wall = match table.passive {
        PassiveTable::Guccione {
            c_kpa: guccione_c_kpa,
            b_f,
            b_t,
            b_fs,
        } => WallSettings {
            muscle_law: MuscleLaw::Guccione,
            guccione_c_kpa,
            b_f,
            b_t,
            b_fs,
            ..wall
        },
        PassiveTable::NeoHookean {
            mu_kpa: neo_hookean_mu_kpa,
        } => WallSettings {
            muscle_law: MuscleLaw::NeoHookean,
            neo_hookean_mu_kpa,
            ..wall
        },
        PassiveTable::HolzapfelOgden {
            a_kpa,
            b,
            a_f_kpa,
            b_f,
            a_s_kpa,
            b_s,
            a_fs_kpa,
            b_fs,
            switch,
        } => WallSettings {
            muscle_law: MuscleLaw::HolzapfelOgden,
            holzapfel_ogden: HolzapfelOgden {
                a_kpa,
                b,
                a_f_kpa,
                b_f,
                a_s_kpa,
                b_s,
                a_fs_kpa,
                b_fs,
                switch,
            },
            ..wall
        },
    };
    Tissue {
        law: wall::muscle(&wall),
        volumetric: table.volumetric,
        active: table
            .active
            .as_ref()
            .map(|a| wall::active(a.convention, a.cross_fibre)),
        density: table.density_mg_per_mm3,
    }
}

/// End of the time courses \[ms\].
pub(super) fn end_ms(time: &TimeTable) -> f64 {
    match time {
        TimeTable::Dynamic { end_ms, .. } => *end_ms,
        TimeTable::Static { at_ms, .. } => *at_ms,
    }
}

/// Time steps and output times of a dynamic problem.
pub(super) fn schedule(file: &Path, time: &TimeTable) -> Result<Schedule, CaseError> {
    let TimeTable::Dynamic {
        dt_ms,
        end_ms,
        output_every_ms,
        ..
    } = *time
    else {
        return Err(CaseError::key(file, "time.mode", "static", "dynamic"));
    };
    for (key, value) in [
        ("time.dt_ms", dt_ms),
        ("time.end_ms", end_ms),
        ("time.output_every_ms", output_every_ms),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(CaseError::key(
                file,
                key,
                value.to_string(),
                "more than zero",
            ));
        }
    }
    for (key, value) in [
        ("time.end_ms", end_ms),
        ("time.output_every_ms", output_every_ms),
    ] {
        let steps = value / dt_ms;
        if (steps - steps.round()).abs() > 1e-6 {
            let expected = format!("a whole number of steps of time.dt_ms = {dt_ms}");
            return Err(CaseError::key(file, key, value.to_string(), expected));
        }
    }
    Ok(Schedule {
        dt_ms,
        end_ms,
        sample_every: (output_every_ms / dt_ms).round() as usize,
        max_halvings: 6,
    })
}

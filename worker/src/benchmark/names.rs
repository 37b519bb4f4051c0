//! Names of the file to the solver's types.

use std::path::Path;

use cardiotwin_mechanics::boundary::RobinDirection;
use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::material::{
    ActiveConvention, ActiveLaw, Guccione, HolzapfelOgden, Law, NeoHookean, Tissue, Volumetric, VolumetricLaw,
};
use cardiotwin_mechanics::newton::LinearSolver;
use cardiotwin_mechanics::organ::ElementKind;
use cardiotwin_mechanics::prescribed::{Schedule, TimeCourse};

use super::error::BenchmarkError;
use super::file::{
    Axis, ConventionName, CourseTable, Degree, DirectionName, ElementTable, LinearName, PassiveTable, TimeTable,
    TissueTable, VolumeName, VolumetricName,
};

/// 0, 1 or 2.
pub(super) fn axis(axis: Axis) -> usize {
    match axis {
        Axis::X => 0,
        Axis::Y => 1,
        Axis::Z => 2,
    }
}

pub(super) fn element(file: &Path, table: &ElementTable) -> Result<ElementKind, BenchmarkError> {
    let share = table.pointwise_share;
    if !(0.0..=1.0).contains(&share) {
        return Err(BenchmarkError::key(file, "element.pointwise_share", share.to_string(), "a share from 0 to 1"));
    }
    let volume = match table.volume {
        VolumeName::Pointwise => VolumeChange::Pointwise,
        VolumeName::Nodal => VolumeChange::Nodal { pointwise_share: share },
    };
    Ok(ElementKind { quadratic: table.degree == Degree::Quadratic, volume })
}

pub(super) fn direction(name: DirectionName) -> RobinDirection {
    match name {
        DirectionName::Normal => RobinDirection::Normal,
        DirectionName::All => RobinDirection::All,
    }
}

pub(super) fn linear(name: LinearName) -> LinearSolver {
    match name {
        LinearName::BlockJacobi => LinearSolver::BlockJacobi,
        LinearName::SymmetricSweep => LinearSolver::SymmetricSweep,
        LinearName::Direct => LinearSolver::Direct,
    }
}

pub(super) fn tissue(table: &TissueTable) -> Tissue {
    let law = match table.passive {
        PassiveTable::Guccione { c_kpa, b_f, b_t, b_fs } => Law::Guccione(Guccione { c_kpa, b_f, b_t, b_fs }),
        PassiveTable::NeoHookean { mu_kpa } => Law::NeoHookean(NeoHookean { mu_kpa }),
        PassiveTable::HolzapfelOgden { a_kpa, b, a_f_kpa, b_f, a_s_kpa, b_s, a_fs_kpa, b_fs, switch } => {
            Law::HolzapfelOgden(HolzapfelOgden { a_kpa, b, a_f_kpa, b_f, a_s_kpa, b_s, a_fs_kpa, b_fs, switch })
        }
    };
    let volumetric = match table.volumetric.law {
        VolumetricName::LnSquared => VolumetricLaw::LnSquared,
        VolumetricName::Quadratic => VolumetricLaw::Quadratic,
        VolumetricName::QuadraticLn => VolumetricLaw::QuadraticLn,
    };
    let active = table.active.as_ref().map(|a| ActiveLaw {
        convention: match a.convention {
            ConventionName::SecondPiola => ActiveConvention::SecondPiola,
            ConventionName::FirstPiola => ActiveConvention::FirstPiola,
            ConventionName::PerSquaredStretch => ActiveConvention::PerSquaredStretch,
        },
        cross_fibre: a.cross_fibre,
        sheet_normal: 0.0,
    });
    let volumetric = Volumetric { law: volumetric, kappa_kpa: table.volumetric.kappa_kpa };
    Tissue { law, volumetric, active, density: table.density_mg_per_mm3 }
}

pub(super) fn course(table: &CourseTable) -> TimeCourse {
    match table.clone() {
        CourseTable::Constant { value_kpa } => TimeCourse::Constant { value_kpa },
        CourseTable::Ramp { value_kpa, until_s } => TimeCourse::Ramp { value_kpa, until_s },
        CourseTable::Table { t_s, value_kpa } => TimeCourse::Table { t_s, value_kpa },
        CourseTable::Activation { contractility_kpa, rise_per_s, fall_per_s, on_s, off_s, switch_s } => {
            TimeCourse::Activation { contractility_kpa, rise_per_s, fall_per_s, on_s, off_s, switch_s }
        }
        CourseTable::ChamberPressure {
            systolic_kpa,
            filling_kpa_per_s,
            filling_per_s,
            middle_per_s,
            rise_per_s,
            fall_per_s,
            on_s,
            off_s,
            switch_s,
        } => TimeCourse::ChamberPressure {
            systolic_kpa,
            filling_kpa_per_s,
            filling_per_s,
            middle_per_s,
            rise_per_s,
            fall_per_s,
            on_s,
            off_s,
            switch_s,
        },
    }
}

/// End of the time courses \[ms\].
pub(super) fn end_ms(time: &TimeTable) -> f64 {
    match time {
        TimeTable::Dynamic { end_ms, .. } => *end_ms,
        TimeTable::Static { at_ms, .. } => *at_ms,
    }
}

/// Steps and output of a dynamic problem.
pub(super) fn schedule(file: &Path, time: &TimeTable) -> Result<Schedule, BenchmarkError> {
    let TimeTable::Dynamic { dt_ms, end_ms, output_every_ms, .. } = *time else {
        return Err(BenchmarkError::key(file, "time.mode", "static", "dynamic"));
    };
    for (key, value) in [("time.dt_ms", dt_ms), ("time.end_ms", end_ms), ("time.output_every_ms", output_every_ms)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(BenchmarkError::key(file, key, value.to_string(), "more than zero"));
        }
    }
    for (key, value) in [("time.end_ms", end_ms), ("time.output_every_ms", output_every_ms)] {
        let steps = value / dt_ms;
        if (steps - steps.round()).abs() > 1e-6 {
            let expected = format!("a whole number of steps of time.dt_ms = {dt_ms}");
            return Err(BenchmarkError::key(file, key, value.to_string(), expected));
        }
    }
    Ok(Schedule { dt_ms, end_ms, sample_every: (output_every_ms / dt_ms).round() as usize, max_halvings: 6 })
}

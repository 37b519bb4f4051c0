//! Tables of the findings of several patients next to each other.

use cardiotwin_schemas::discover::DiscoverCases;

use crate::results::discovery::faults;
use crate::results::discovery::finite_element::{change, rms_of};
use crate::results::discovery::pool::{accepted_in, pool};
use crate::results::discovery::words::{missing, probability};
use crate::table::{Cell, Column, Kind, Table, cells};

fn names(key: &'static str) -> Column {
    Column::new(key, Kind::Names)
}

/// Missing effects and gaps, a row for each patient.
#[must_use]
pub fn patients(cases: &DiscoverCases) -> Table {
    let columns = [
        Column::words("patient"),
        names("missing"),
        Column::figures("probability"),
        Column::fixed("gap", 2),
        Column::fixed("after", 2),
        Column::fixed("heldout", 2).label("held out"),
        Column::fixed("heldout_after", 2).label("after"),
        names("indistinguishable_from").label("hard to tell from"),
    ];
    let mut table = Table::new("patients", "Patients", columns);
    for case in cases.values() {
        let found = &case.found.findings;
        let first = found.effects.first().filter(|_| !found.none);
        table.rows.push(cells![
            case.case.as_str(),
            missing(&case.found, str::to_owned),
            first.map_or_else(String::new, |effect| probability(effect.probability, 2)),
            found.gap_before,
            found.gap_after,
            found.gap_heldout_before,
            found.gap_heldout_after,
            found.confusable.join(", ")
        ]);
    }
    table
}

/// The evidence pooled over all patients.
#[must_use]
pub fn pooled(cases: &DiscoverCases) -> Table {
    let columns = [
        names("effect"),
        Column::figures("accepted_in").label("named in"),
        Column::numbers("pooled_evidence"),
        Column::words("attributed_to"),
        Column::words("dominated_by"),
    ];
    let mut table = Table::new("pooled", "All patients together", columns);
    for pooled in pool(cases.values().map(|c| (c.case.as_str(), &c.found))) {
        let fault = match (pooled.of_the_model, pooled.accepted_in) {
            (true, _) => "the organ's model",
            (false, 0) => "",
            (false, _) => "single patients",
        };
        table.rows.push(cells![
            pooled.name.as_str(),
            accepted_in(&pooled, cases.len()),
            pooled.log_evidence,
            fault,
            pooled.dominated_by.unwrap_or_default()
        ]);
    }
    table
}

/// The misses of the cohort's run, and whether the organ's model or the cell causes them. Without
/// rows if the run personalised no patient.
#[must_use]
pub fn run_misses(cases: &DiscoverCases) -> Table {
    let columns = [
        Column::words("patient"),
        Column::words("trace"),
        Column::fixed("step_1", 1),
        Column::fixed("verification", 1),
        Column::fixed("twin", 1),
        Column::fixed("organ", 1).label("organ's model"),
        Column::fixed("cell", 1),
        Column::words("mostly_attributed_to"),
    ];
    let title = "Misfit of the run's beats to the measured traces, rms";
    let mut table = Table::new("run-misses", title, columns);
    for case in cases.values() {
        for (name, unit, misses) in case.run.iter().flat_map(faults::traces) {
            table.rows.push(cells![
                case.case.as_str(),
                format!("{name}, {unit}"),
                misses.step1,
                misses.verification,
                misses.twin,
                misses.of_organ(),
                misses.of_cell(),
                faults::whose(&misses)
            ]);
        }
    }
    table
}

/// The whole beat's misfit on the finite-element ventricles; without rows if none was simulated.
#[must_use]
pub fn finite_elements(cases: &DiscoverCases) -> Table {
    let columns = [
        Column::words("patient"),
        names("effects"),
        Column::words("trace").label("trace in 3D"),
        Column::fixed("before", 1),
        Column::fixed("after", 1),
        Column::figures("change"),
    ];
    let title = "Misfit of the finite-element ventricle over the whole beat, rms";
    let mut table = Table::new("finite-elements", title, columns);
    for case in cases.values() {
        for (name, before, after) in case.finite_element.iter().flat_map(rms_of) {
            table.rows.push(cells![
                case.case.as_str(),
                missing(&case.found, str::to_owned),
                name,
                before,
                after,
                change(before, after)
            ]);
        }
    }
    table
}

/// End-diastolic volumes at the filling pressure of the patient's file; without rows if no file
/// states one.
#[must_use]
pub fn filling(cases: &DiscoverCases) -> Table {
    let columns = [
        Column::words("patient"),
        Column::fixed("edv", 1).label("EDV").unit("mL"),
        Column::fixed("error_before", 1),
        Column::fixed("error_after", 1).label("after"),
        Column::fixed("late_filling_rms_before", 1),
        Column::fixed("late_filling_rms_after", 1).label("after"),
    ];
    let title = "End-diastolic volume and late filling of the periodic beat with the file's filling pressure (mL)";
    let mut table = Table::new("filling", title, columns);
    for case in cases.values() {
        let Some(filling) = &case.found.stated_filling else {
            continue;
        };
        let error = |volume: Option<f64>| Cell::from(volume.map(|v| v - filling.measured_ml));
        table.rows.push(cells![
            case.case.as_str(),
            filling.measured_ml,
            error(filling.before_ml),
            error(filling.after_ml),
            filling.late_filling_before_ml,
            filling.late_filling_after_ml
        ]);
    }
    table
}

//! Parameters of a patient's twin: those of step 3, which has the last word on cell and valves.

use std::collections::BTreeMap;

use cardiotwin_models::calcium::Rice2008Parameters;
use cardiotwin_schemas::organ::cell_default;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::CalciumSource;

/// Parameters of cell and valves that were searched in the organ, by name, in the unit of the name:
/// those of step 3's result, or of the verification beat while step 3 has none. `None` where the twin's
/// cell is the one of step 2's fit.
#[must_use]
pub fn moved_in_the_organ(patient: &PatientRecord) -> Option<&BTreeMap<String, f64>> {
    let of_step3 = patient.step3.as_ref().map(|step3| &step3.parameters);
    let of_law = || patient.organ_fit.as_ref().map(|fit| &fit.result.parameters);
    of_step3.or_else(of_law).filter(|moved| !moved.is_empty())
}

/// Calcium of the twin's cell over the time since its activation: ms and µM, every millisecond of the
/// cycle (Rice's transient, Jung et al. 2022, eq. A16). `None` where the twin's cell is the one of step
/// 2's fit, and for a transient that no parameter moves.
#[must_use]
pub fn calcium(patient: &PatientRecord) -> Option<Vec<(f64, f64)>> {
    if patient.plan.settings.step2.calcium != CalciumSource::Rice {
        return None;
    }
    let moved = moved_in_the_organ(patient)?;
    let fit = &patient.cell_fit.as_ref()?.result.parameters;
    let value = |name: &str| {
        let fitted = || fit.iter().find(|p| p.name == name).map(|p| p.value);
        moved
            .get(name)
            .copied()
            .or_else(fitted)
            .or_else(|| cell_default(name))
    };
    let rice = Rice2008Parameters {
        ca_res_um: value("Ca_res_uM")?,
        ca_max_um: value("Ca_max_uM")?,
        tau_cr_ms: value("tau_CR_ms")?,
        tau_cd_ms: value("tau_CD_ms")?,
    };
    let n = patient.plan.step0.cycle_length_ms.floor() as u32;
    let times: Vec<f64> = (0..=n).map(f64::from).collect();
    let values = rice.transient_um(&times);
    Some(std::iter::zip(times, values).collect())
}

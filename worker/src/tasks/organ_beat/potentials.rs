//! Transmembrane potentials of a finite-element ventricle over a cycle: eikonal activation,
//! diffusion, and the Luo-Rudy membrane model.
//!
//! Artefacts: `vm.igb` (`potentials`), the potentials of all nodes in millivolts, one frame per
//! millisecond in openCARP's format, not-a-number in tissue that does not conduct; `vm.csv`
//! (`potential-traces`), their median and quartiles.

use std::fmt::Write as _;

use cardiotwin_electrophysiology::luo_rudy1991::paced::rest;
use cardiotwin_electrophysiology::{ReactionEikonal, Settings, Tissue};
use cardiotwin_mesh::eikonal::Speeds;
use cardiotwin_mesh::tags;
use cardiotwin_schemas::finite_element::ConductionSettings;

use crate::context::Context;
use crate::error::TaskError;
use crate::finite_element::{FiniteElementError, StoredVentricle};
use crate::igb::header_mv;

/// Computes and writes the potentials of one cycle.
///
/// # Errors
/// [`TaskError`] when the model fails, files cannot be written, or a stop is requested.
pub(super) fn write(
    stored: &StoredVentricle,
    conduction: &ConductionSettings,
    cycle_length_ms: f64,
    context: &mut Context,
) -> Result<(), TaskError> {
    let failed = |error| TaskError::FiniteElement(FiniteElementError::Potentials(error));
    let across = conduction.across_m_per_s;
    let tissue = Tissue::matching(&Speeds {
        fibre: conduction.along_m_per_s,
        sheet: across,
        normal: across,
    });
    let settings = Settings::default();
    let start = rest(&settings.membrane);
    let muscle = [tags::LEFT_VENTRICLE];
    let mut model = ReactionEikonal::new(
        &stored.mesh,
        &muscle,
        &stored.activation_ms,
        &tissue,
        &start,
        &settings,
    )
    .map_err(failed)?;
    let n_frames = cycle_length_ms.floor() as usize + 1;
    let mut igb = header_mv(stored.mesh.n_nodes(), n_frames, cycle_length_ms.floor());
    let mut csv = "time_ms,median_mV,lower_quartile_mV,upper_quartile_mV\n".to_owned();
    for frame in 0..n_frames {
        context.check_stop()?;
        let t_ms = frame as f64;
        model.advance_to(t_ms).map_err(failed)?;
        let potential = model.potential_mv();
        igb.extend(potential.iter().flat_map(|v| (*v as f32).to_le_bytes()));
        let mut sorted: Vec<f64> = potential.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
        let _ = writeln!(csv, "{t_ms},{:.3},{:.3},{:.3}", at(0.5), at(0.25), at(0.75));
        context
            .progress
            .report("potentials", t_ms, Some(cycle_length_ms), || {
                format!("{t_ms:.0} ms")
            });
    }
    context
        .artefacts
        .write_bytes("potentials", "vm.igb", &igb)?;
    context.artefacts.write("potential-traces", "vm.csv", &csv)
}

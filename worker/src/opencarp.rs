//! Exports a personalised model to the file formats of openCARP and related programs: parameters of
//! the active stress, mesh, activation times, calcium.
//!
//! Parameters have the names of openCARP's `Stress_Niederer` (carpentry: `TanhStress`) and
//! `Stress_Land17`. The latter is the model of Land et al. 2017 with two differences that users
//! must know. Its rates to and from the weakly bound state are given as multiples (`nu`, `mu`) of
//! the rates of skinned muscle, and its length dependence is max(0.87, min(1.2, λ)) instead of
//! Land's h(λ). It takes calcium from the ionic model; the personalised transient is exported next
//! to it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use cardiotwin_mesh::files::carp;
use cardiotwin_mesh::tags;
use cardiotwin_models::calcium::{Calcium as _, Rice2008};
use cardiotwin_models::cell0d::{CalciumInput, CellError};
use cardiotwin_schemas::organ::{ContractionSpec, OrganSpec};
use cardiotwin_schemas::task::OrganBeatSpec;

use crate::calcium;
use crate::cell_parameters::NamedCell;
use crate::error::TaskError;
use crate::files::write_atomic;
use crate::finite_element::StoredVentricle;

/// Stem of the mesh's files.
const MESH: &str = "heart";
/// File of the activation times.
const ACTIVATION: &str = "activation.dat";
/// Rates k_UW and k_WS of skinned muscle \[1/ms\], which `nu` and `mu` of `Stress_Land17` multiply
/// (Land et al. 2017, Table 1).
const SKINNED_PER_MS: [f64; 2] = [0.026, 0.004];
/// openCARP's activation time of nodes that are never activated.
const NEVER_MS: f64 = -1.0;

/// A plugin for the active stress, with its parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plugin {
    /// Name of the plugin, a value of openCARP's `imp_region[].plugins`.
    pub name: &'static str,
    /// Parameters as `name=value` with commas, a value of openCARP's `imp_region[].plug_param`.
    pub parameters: String,
    /// Name of the parameter file that an export writes.
    file: &'static str,
    /// Comment at the beginning of this file.
    comment: &'static str,
}

/// Plugin for a model of active stress, with its parameters in kPa, ms and µM.
///
/// # Errors
/// [`TaskError::UnknownParameter`] for a name that the cell does not have, [`TaskError::NoPlugin`] for a model of the
/// catalogue.
pub fn plugin(contraction: &ContractionSpec) -> Result<Plugin, TaskError> {
    let listed = |pairs: &[(&str, f64)]| {
        pairs
            .iter()
            .map(|(name, value)| format!("{name}={value}"))
            .collect::<Vec<_>>()
            .join(",")
    };
    match contraction {
        ContractionSpec::Catalogue { name, .. } => Err(TaskError::NoPlugin {
            model: name.clone(),
        }),
        ContractionSpec::Tanh { parameters: p } => Ok(Plugin {
            name: "Stress_Niederer",
            parameters: listed(&[
                ("t_emd", p.t_emd_ms),
                ("Tpeak", p.smax_ref_kpa),
                ("tau_c0", p.tau_sr_ref_ms),
                ("tau_r", p.tau_sd_ms),
                ("t_dur", p.t_cr_ms),
                ("lambda_0", p.a7),
                ("ld", p.a6),
                ("ld_up", p.a4_ms),
                ("ldOn", 1.0),
            ]),
            file: "tanh.par",
            comment: "# Tanh model of step 1 (Jung et al. 2022, eqs. A1-A3). carpentry calls the plugin TanhStress.\n",
        }),
        ContractionSpec::Land2017Rice { parameters, .. }
        | ContractionSpec::Land2017Trace { parameters, .. } => {
            // Cycle length and initial stretch are not parameters of the model.
            let cell = NamedCell::new(1000.0, 1.0).with(parameters)?;
            let [k_uw, k_ws] = [cell.value("k_UW_per_ms")?, cell.value("k_WS_per_ms")?];
            Ok(Plugin {
                name: "Stress_Land17",
                parameters: listed(&[
                    ("Tref", cell.value("Smax_ref_kPa")?),
                    ("ca50", cell.value("Ca50_ref_uM")?),
                    ("perm50", cell.value("TRPN50")?),
                    ("TRPN_n", cell.value("n_TRPN")?),
                    ("koff", cell.value("k_TRPN_per_ms")?),
                    ("nperm", cell.value("n_Tm")?),
                    ("ktm_unblock", cell.value("k_U_per_ms")?),
                    ("nu", k_uw / SKINNED_PER_MS[0]),
                    ("mu", k_ws / SKINNED_PER_MS[1]),
                    ("dr", cell.value("r_S")?),
                    ("wfrac", cell.value("r_W")?),
                    ("gamma", cell.value("gamma_S_per_ms")?),
                    ("gamma_wu", cell.value("gamma_W_per_ms")?),
                    ("phi", cell.value("phi")?),
                    ("TOT_A", cell.value("A_eff")?),
                    ("beta_0", cell.value("beta_0")?),
                    ("beta_1", cell.value("beta_1_uM")?),
                ]),
                file: "land17.par",
                comment: "# Land 2017 of the twin, or of step 2 where there is no twin. Calcium is to be that of calcium.csv (clamp Cai to it); the plugin scales tension\n\
                          # with max(0.87, min(1.2, lambda)) where Land et al. 2017 have h(lambda): set that right in a copy of the plugin.\n",
            })
        }
    }
}

/// Exports the models of one patient's simulations, and the mesh of the first simulation that has
/// one.
///
/// - `specs`: simulations, each with its own model of active stress
/// - `out`: an existing folder; it receives `tanh.par`, `land17.par`, `calcium.csv` (`time_ms` from
///   activation on, `Ca_uM`), `heart.pts` (µm, the image), `heart.unloaded.pts`, `heart.elem`,
///   `heart.lon`, `heart.SURFACE.surf`, `activation.dat` (ms)
///
/// # Errors
/// [`TaskError`] when an input file changed after the task was planned, or when a file cannot be
/// written.
pub fn write(specs: &[OrganBeatSpec], out: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let organ = specs.iter().find_map(|spec| match &spec.organ {
        OrganSpec::FiniteElement(organ) => Some(organ),
        OrganSpec::Reduced { .. } | OrganSpec::External(_) => None,
    });
    let mut meshed = false;
    if let Some(organ) = organ {
        let stored = StoredVentricle::read(&organ.ventricle)?;
        files.extend(mesh(&stored, out)?);
        meshed = true;
    }
    for spec in specs {
        let (name, text) = parameter_file(spec, meshed)?;
        let path = out.join(name);
        write_text(&path, &text)?;
        files.push(path);
        if let Some(text) = transient(spec)? {
            let path = out.join("calcium.csv");
            write_text(&path, &text)?;
            files.push(path);
        }
    }
    Ok(files)
}

fn write_text(path: &Path, text: &str) -> Result<(), TaskError> {
    write_atomic(path, text.as_bytes()).map_err(|source| TaskError::Write {
        file: path.to_owned(),
        source,
    })
}

/// Exports mesh and activation times.
fn mesh(stored: &StoredVentricle, out: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let stem = out.join(MESH);
    carp::write(&stored.mesh, &stem)?;
    let mut files: Vec<PathBuf> = ["pts", "elem", "lon"]
        .map(|end| stem.with_extension(end))
        .into();
    files.extend(
        stored
            .mesh
            .surfaces
            .iter()
            .map(|surface| stem.with_extension(format!("{}.surf", surface.name))),
    );
    // The same nodes at their unloaded positions.
    let unloaded = out.join(format!("{MESH}.unloaded.pts"));
    carp::write_pts(&stored.unloaded[..stored.mesh.n_nodes()], &unloaded)?;
    files.push(unloaded);
    let mut text = String::new();
    for time in &stored.activation_ms {
        let _ = writeln!(text, "{}", if time.is_finite() { *time } else { NEVER_MS });
    }
    let activation = out.join(ACTIVATION);
    write_text(&activation, &text)?;
    files.push(activation);
    Ok(files)
}

fn parameter_file(spec: &OrganBeatSpec, meshed: bool) -> Result<(&'static str, String), TaskError> {
    let plugin = plugin(&spec.contraction)?;
    let mut text = format!(
        "# A personalised model of active stress, written by cardiotwin {}; kPa, ms, uM.\n",
        env!("CARGO_PKG_VERSION")
    );
    text.push_str(plugin.comment);
    let _ = writeln!(text, "tend = {}", spec.cycle_length_ms);
    if meshed {
        let _ = write!(
            text,
            "meshname = {MESH}\n\
             # Activation is prescribed, nothing propagates.\n\
             diffusionOn = 0\n\
             num_stim = 1\n\
             stimulus[0].stimtype = 8\n\
             stimulus[0].data_file = {ACTIVATION}\n"
        );
    }
    text.push_str("num_imp_regions = 1\nimp_region[0].name = muscle\n");
    if meshed {
        let _ = write!(
            text,
            "imp_region[0].num_IDs = 1\nimp_region[0].ID[0] = {}\n",
            tags::LEFT_VENTRICLE
        );
    }
    let _ = write!(
        text,
        "imp_region[0].plugins = \"{}\"\nimp_region[0].plug_param = \"{}\"\n",
        plugin.name, plugin.parameters
    );
    Ok((plugin.file, text))
}

/// Calcium that drives the model, one sample per millisecond; `None` for a model without calcium.
fn transient(spec: &OrganBeatSpec) -> Result<Option<String>, TaskError> {
    let samples: Vec<f64> = match &spec.contraction {
        ContractionSpec::Tanh { .. } | ContractionSpec::Catalogue { .. } => return Ok(None),
        ContractionSpec::Land2017Rice {
            parameters,
            lambda_0,
        } => {
            let cell = NamedCell::new(spec.cycle_length_ms, *lambda_0)
                .with(parameters)?
                .parameters();
            let CalciumInput::Rice(rice) = cell.calcium else {
                return Ok(None);
            };
            let rice = Rice2008::new(rice).map_err(CellError::Calcium)?;
            let n = spec.cycle_length_ms.floor() as usize + 1;
            (0..n)
                .map(|k| rice.concentration_um(k as f64 * calcium::INTERVAL_MS))
                .collect()
        }
        ContractionSpec::Land2017Trace { calcium: file, .. } => {
            calcium::samples(file, spec.cycle_length_ms)?
        }
    };
    let mut text = "time_ms,Ca_uM\n".to_owned();
    for (k, value) in samples.iter().enumerate() {
        let _ = writeln!(text, "{},{value}", k as f64 * calcium::INTERVAL_MS);
    }
    Ok(Some(text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::organ::TanhParameters;
    use std::collections::BTreeMap;

    #[test]
    fn parameters_carry_the_names_of_the_plugins() {
        let tanh = TanhParameters {
            smax_ref_kpa: 91.5,
            ..TanhParameters::default()
        };
        let found = plugin(&ContractionSpec::Tanh { parameters: tanh }).unwrap();
        assert_eq!(found.name, "Stress_Niederer");
        let expected =
            "t_emd=15,Tpeak=91.5,tau_c0=40,tau_r=110,t_dur=550,lambda_0=0.7,ld=5,ld_up=500,ldOn=1";
        assert_eq!(found.parameters, expected);
        let fitted = BTreeMap::from([("n_Tm".to_owned(), 4.5), ("k_UW_per_ms".to_owned(), 0.052)]);
        let found = plugin(&ContractionSpec::Land2017Rice {
            parameters: fitted,
            lambda_0: 1.0,
        })
        .unwrap();
        assert_eq!(found.name, "Stress_Land17");
        // Land's whole-organ defaults are 7 and 3 times the rates of skinned muscle.
        assert!(
            found
                .parameters
                .contains("nperm=4.5,ktm_unblock=1,nu=2,mu=3,"),
            "{}",
            found.parameters
        );
        assert!(
            plugin(&ContractionSpec::Land2017Rice {
                parameters: BTreeMap::from([("x".to_owned(), 1.0)]),
                lambda_0: 1.0
            })
            .is_err()
        );
    }
}

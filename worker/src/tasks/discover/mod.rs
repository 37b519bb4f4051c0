//! What the reduced ventricle lacks in a patient's traces: the search, told in the form of files.

mod found;
mod measured;
mod model;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use cardiotwin_discover::forward::{Candidate, Forward, Prediction, Request};
use cardiotwin_discover::parameter::Parameter;
use cardiotwin_discover::{Reduced, Settings, discover};
use cardiotwin_models::periodic::Orbit;
use cardiotwin_schemas::discover::DiscoverSpec;
use cardiotwin_schemas::outcome::TaskResult;

use crate::context::Context;
use crate::error::TaskError;
use crate::stop::StopFlag;

/// How often is looked whether to stop, and how far the search is.
const LOOK: Duration = Duration::from_millis(200);

/// Searches.
///
/// # Errors
/// [`TaskError`] when files are not as planned, the data cannot be used, or stopping was asked for.
pub fn run(spec: &DiscoverSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let measured = measured::read(spec)?;
    let settings = Settings {
        seed: spec.seed,
        effects: spec.effects.clone(),
        ..Settings::default()
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(context.threads.max(1) as usize)
        .build();
    let pool = pool.map_err(TaskError::Threads)?;
    let model = Reduced::new(&measured.data);
    let watched = Watched {
        model: model.clone(),
        n: Arc::default(),
        stop: StopFlag::default(),
    };
    let (n, abandon) = (Arc::clone(&watched.n), watched.stop.clone());
    let (data, search) = (measured.data.clone(), settings.clone());
    let (send, answer) = channel();
    pool.spawn(move || {
        // Nobody listens once stopping was asked for.
        let _ = send.send(discover(&data, &watched, &search));
    });
    let found = loop {
        match answer.recv_timeout(LOOK) {
            Ok(found) => break found?,
            Err(RecvTimeoutError::Timeout) => {
                context.check_stop().inspect_err(|_| abandon.raise())?;
                let beats = n.load(Ordering::Relaxed);
                context.progress.report("search", beats as f64, None, || {
                    format!("{beats} periodic beats simulated")
                });
            }
            Err(RecvTimeoutError::Disconnected) => return Err(TaskError::SearchEnded),
        }
    };
    context.check_stop()?;
    let result = found::result(spec, &measured, &model, &settings, &found)?;
    Ok(TaskResult::Discover(Box::new(result)))
}

/// A model that counts its beats, and has no answer any more once the search is abandoned, so that its threads end soon.
struct Watched {
    model: Reduced,
    n: Arc<AtomicU64>,
    stop: StopFlag,
}

impl Forward for Watched {
    fn base(&self) -> &[Parameter] {
        self.model.base()
    }

    fn base_starts(&self) -> Vec<Vec<f64>> {
        self.model.base_starts()
    }

    fn candidates(&self) -> &[Candidate] {
        self.model.candidates()
    }

    fn predict(&self, request: &Request<'_>, warm: Option<&Orbit>) -> Option<Prediction> {
        if self.stop.is_raised() {
            return None;
        }
        self.n.fetch_add(1, Ordering::Relaxed);
        self.model.predict(request, warm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::discover::Discovered;
    use cardiotwin_schemas::hash::sha256_hex;
    use cardiotwin_schemas::patient::PatientFile;
    use cardiotwin_schemas::task::InputFile;
    use std::path::Path;

    /// A case made by another model than the one that is fitted, with part of the catalogue for speed.
    fn spec() -> DiscoverSpec {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../solver/discover/tests/cases/patients/dev-013");
        let file: PatientFile =
            toml::from_str(&std::fs::read_to_string(folder.join("patient.toml")).unwrap()).unwrap();
        let input = |name: &str| {
            let path = folder.join(format!("{name}.csv"));
            let sha256 = sha256_hex(&std::fs::read(&path).unwrap());
            InputFile {
                name: name.to_owned(),
                path,
                sha256,
            }
        };
        DiscoverSpec {
            cycle_length_ms: file.cycle_length_ms,
            pressure: input("pressure"),
            volume: input("volume"),
            noise: file.measured.noise.unwrap_or_default(),
            aortic_pressure: file.measured.aortic_pressure,
            forward_stroke_volume: file.measured.forward_stroke_volume,
            diastasis: file.measured.diastasis,
            wall_volume_ml: file.anatomy.wall_volume_ml,
            left_atrial_pressure_mmhg: Some(8.0),
            afterload: None,
            effects: vec!["pv_misalignment".to_owned(), "pressure_offset".to_owned()],
            seed: 1,
        }
    }

    fn found(spec: &DiscoverSpec) -> Discovered {
        let folder = tempfile::tempdir().unwrap();
        let TaskResult::Discover(found) = run(spec, &mut Context::plain(folder.path(), 2)).unwrap()
        else {
            panic!("a search's result")
        };
        *found
    }

    #[test]
    fn the_answer_is_whole_and_survives_json() {
        let found = found(&spec());
        assert_eq!(
            (found.none, &found.accepted[..]),
            (false, &["pv_misalignment".to_owned()][..])
        );
        assert!(
            found.gap_after < found.gap_before
                && found.gap_heldout_after < found.gap_heldout_before
        );
        // An artefact corrects the data and adds nothing to the heart.
        assert!(
            found.model.effects.is_empty() && found.model.corrections[0].name == "pv_misalignment"
        );
        let delay = found.model.corrections[0].parameters["volume_delay_ms"];
        assert_eq!(delay, found.effects[0].strength["volume_delay_ms"]);
        assert_eq!(
            found.settings.effects,
            ["pv_misalignment", "pressure_offset"]
        );
        let whole = found
            .gaps
            .iter()
            .filter(|g| g.phase == "beat")
            .map(|g| g.n as usize)
            .collect::<Vec<_>>();
        assert_eq!(
            whole,
            [
                found.series.pressure.time_ms.len(),
                found.series.volume.time_ms.len()
            ]
        );
        let share: f64 = found.places.iter().map(|p| p.share).sum();
        assert!((share - 1.0).abs() < 1e-9 && found.places.len() == found.where_after.len());
        assert!(
            found
                .biomarkers
                .iter()
                .any(|b| b.name == "EDV_mL" && b.before.is_some() && b.after.is_some())
        );
        let filling = found.stated_filling.as_ref().unwrap();
        assert!(filling.before_ml.unwrap() > 50.0 && filling.late_filling_after_ml.unwrap() > 0.0);
        let text = serde_json::to_string(&found).unwrap();
        assert_eq!(serde_json::from_str::<Discovered>(&text).unwrap(), found);
    }

    #[test]
    fn a_stop_ends_the_search_and_an_unknown_effect_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut context = Context::plain(folder.path(), 1);
        context.stop.raise();
        assert!(matches!(
            run(&spec(), &mut context),
            Err(TaskError::Cancelled)
        ));
        let kick = DiscoverSpec {
            effects: vec!["kick".to_owned()],
            ..spec()
        };
        let refused = run(&kick, &mut Context::plain(folder.path(), 1)).unwrap_err();
        let said = crate::error::chain(&refused);
        assert!(
            said.contains("no effect kick") && said.contains("atrial_kick"),
            "{said}"
        );
    }
}

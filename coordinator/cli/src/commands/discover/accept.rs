//! `--accept` and `--revert`: findings become part of the patient's model, or are taken out again.

use cardiotwin_engine::clock;
use cardiotwin_report::results::discovery::words;
use cardiotwin_schemas::discover::DiscoverCases;
use cardiotwin_sweep::discovery::overlay::{self, Change, OverlayError};

use super::args::DiscoverArgs;
use super::source::Source;
use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Refuses to change a whole cohort unless `--all` or `--patient` was given.
///
/// # Errors
/// [`CliError::Usage`] if neither was given.
pub fn whose(args: &DiscoverArgs, source: &Source) -> Result<(), CliError> {
    if source.is_cohort() && !args.all && args.patients.is_empty() {
        let message =
            "--accept and --revert change patients: add --all, or name patients with --patient"
                .to_owned();
        return Err(CliError::Usage(message));
    }
    Ok(())
}

/// Accepts the findings of each patient, but for those that held-out data do not confirm, unless
/// `--unconfirmed` asks for them, too. Returns the number of patients whose findings were left out.
///
/// # Errors
/// [`CliError::Overlay`] if a patient's `model.toml` cannot be changed.
pub fn accept(
    args: &DiscoverArgs,
    source: &Source,
    cases: &DiscoverCases,
    talk: &Talk,
) -> Result<usize, CliError> {
    let (mut n_written, mut n_left_out) = (0, 0);
    for searched in &source.patients {
        let patient = &searched.patient;
        let Some(case) = cases.get(&patient.id) else {
            continue;
        };
        let file = patient.folder.join("model.toml");
        let names = case.found.findings.accepted.join(", ");
        let unconfirmed = case.found.findings.unconfirmed();
        if let Some(why) = unconfirmed.filter(|_| !args.unconfirmed) {
            n_left_out += 1;
            talk.say(&format!(
                "{}: not accepted: {names}; {why}. --accept --unconfirmed writes it all the same",
                patient.id
            ));
            continue;
        }
        let mark = words::unconfirmed(&case.found);
        let said = match overlay::accept(&patient.folder, case, &clock::now_utc())? {
            Change::Written(version) => {
                n_written += 1;
                format!(
                    "accepted: {names}{mark}; version {version} of {}",
                    file.display()
                )
            }
            Change::Same(version) => format!(
                "already accepted: {names}{mark}; version {version} of {}",
                file.display()
            ),
            Change::Nothing | Change::Removed => "nothing to accept".to_owned(),
        };
        talk.say(&format!("{}: {said}", patient.id));
    }
    if n_written > 0 {
        let cohort = source.cohort_folder();
        let place = cohort.map_or("the cohort".to_owned(), |folder| {
            folder.display().to_string()
        });
        talk.hint(&format!(
            "`cardiotwin run {place}` personalises with the accepted effects; --revert undoes the \
             acceptance"
        ));
    }
    Ok(n_left_out)
}

/// Undoes the last acceptance of each patient.
///
/// # Errors
/// [`CliError::Overlay`]; for a single patient also if nothing was accepted before.
pub fn revert(source: &Source, talk: &Talk) -> Result<Exit, CliError> {
    for searched in &source.patients {
        let patient = &searched.patient;
        let said = match overlay::revert(&patient.folder, &clock::now_utc()) {
            Ok(Change::Written(version)) => {
                format!(
                    "restored the state before the last acceptance; version {version} of \
                         model.toml"
                )
            }
            Ok(_) => "removed model.toml, so that no effect is accepted; its versions are kept"
                .to_owned(),
            Err(OverlayError::NothingAccepted { .. }) if source.is_cohort() => {
                "nothing was accepted".to_owned()
            }
            Err(error) => return Err(error.into()),
        };
        talk.say(&format!("{}: {said}", patient.id));
    }
    Ok(Exit::Ok)
}

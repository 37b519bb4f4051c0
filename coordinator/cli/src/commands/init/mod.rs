//! `cardiotwin init`: a cohort folder to fill in, or one from the user's own traces. The command never
//! overwrites a file.

mod own;
mod said;
mod template;
mod twin;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;
use template::{COHORT, PATIENT, toml_text};

pub use template::is_untouched;

/// Create a cohort folder: from your own pressure and volume traces, with two example patients, or with
/// one patient to fill in
#[derive(Debug, Args)]
#[command(
    after_help = "--from reads two columns, pressure and volume, with or without a time, one beat or many. \
                  What the file does not tell is found from the numbers and said: columns, units, beats, \
                  cycle, end-diastole. docs/own-traces.md has an example."
)]
pub struct InitArgs {
    /// Folder to create
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Name of the cohort [default: the folder's name]
    #[arg(long)]
    name: Option<String>,
    /// Add two patients with aortic coarctation, ready to run, instead of one to fill in
    #[arg(long)]
    example: bool,
    #[command(flatten)]
    own: own::FromArgs,
}

/// Files of a patient of the bundled cohort: name and text.
macro_rules! bundled {
    ($id:literal, $($name:literal),+) => {
        ($id, &[$(($name, include_str!(concat!(
            "../../../../../examples/coa-seven/patients/", $id, "/", $name
        )))),+])
    };
}

/// A patient's folder: its name, and its files with their texts.
type Folder = (&'static str, &'static [(&'static str, &'static str)]);

/// Patients of `--example`: one that converges, and one whose step 1 stalls.
const EXAMPLE: [Folder; 2] = [
    bundled!("01-CoA", "patient.toml", "pressure.csv", "volume.csv"),
    bundled!("04-CoA", "patient.toml", "pressure.csv", "volume.csv"),
];
/// The patient to fill in.
const TEMPLATE: [Folder; 1] = [("P001", &[("patient.toml", PATIENT)])];

/// Makes the folder and prints the next steps.
///
/// # Errors
/// [`CliError::Usage`] if one of the files exists already, [`CliError::File`] if the folder cannot
/// be written.
pub fn execute(args: &InitArgs, talk: &Talk) -> Result<Exit, CliError> {
    let absolute = std::path::absolute(&args.folder).unwrap_or_else(|_| args.folder.clone());
    let folder_name = absolute
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    let name = args
        .name
        .clone()
        .or(folder_name)
        .unwrap_or_else(|| "cohort".to_owned());
    if let Some(from) = &args.own.from {
        return own::execute((&args.folder, &name), &args.own, from, talk);
    }
    let patients: &[Folder] = if args.example { &EXAMPLE } else { &TEMPLATE };
    let cohort = COHORT.replace("{name}", &toml_text(&name));
    let mut files = vec![(args.folder.join("cohort.toml"), cohort)];
    for (id, texts) in patients {
        let folder = args.folder.join("patients").join(id);
        files.extend(
            texts
                .iter()
                .map(|(name, text)| (folder.join(name), (*text).to_owned())),
        );
    }
    if let Some((there, _)) = files.iter().find(|(path, _)| path.exists()) {
        let message = format!(
            "{} already exists; nothing was written: name another folder",
            there.display()
        );
        return Err(CliError::Usage(message));
    }
    for (path, text) in &files {
        let folder = path.parent().unwrap_or(&args.folder);
        std::fs::create_dir_all(folder).map_err(CliError::file("create", folder))?;
        write_new(path, text)?;
        talk.data(&format!("{}\n", path.display()))?;
    }
    let folder = args.folder.display();
    talk.hint(&if args.example {
        format!("`cardiotwin check {folder}`, then `cardiotwin run {folder}`")
    } else {
        format!(
            "put pressure.csv and volume.csv into {folder}/patients/P001, fill in patient.toml, then `cardiotwin \
             check {folder}` and `cardiotwin run {folder}`"
        )
    });
    Ok(Exit::Ok)
}

/// Writes a file and fails if it exists already.
fn write_new(path: &Path, text: &str) -> Result<(), CliError> {
    let mut file = std::fs::File::create_new(path).map_err(CliError::file("create", path))?;
    file.write_all(text.as_bytes())
        .map_err(CliError::file("write", path))
}

#[cfg(test)]
mod tests {
    use cardiotwin_input::{Options, Report, load};

    use super::*;

    const QUIET: Talk = Talk {
        colour_out: false,
        colour_err: false,
        quiet: true,
        bars: false,
    };

    #[test]
    fn the_template_lacks_nothing_but_the_traces() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("my \"cohort\"");
        execute(
            &InitArgs {
                folder: folder.clone(),
                name: None,
                example: false,
                own: own::FromArgs::default(),
            },
            &QUIET,
        )
        .unwrap();
        let mut report = Report::default();
        let cohort = load(&folder, &Options::default(), &mut report).unwrap();
        assert_eq!(cohort.name, "my \"cohort\"");
        let keys: Vec<_> = report
            .findings()
            .iter()
            .map(|f| f.problem.key.clone().unwrap_or_default())
            .collect();
        assert_eq!(
            keys,
            ["measured.pressure", "measured.volume"],
            "{:#?}",
            report.findings()
        );
    }

    #[test]
    fn the_example_is_without_errors() {
        let parent = tempfile::tempdir().unwrap();
        let args = InitArgs {
            folder: parent.path().join("my-cohort"),
            name: None,
            example: true,
            own: own::FromArgs::default(),
        };
        execute(&args, &QUIET).unwrap();
        let mut report = Report::default();
        let cohort = load(&args.folder, &Options::default(), &mut report).unwrap();
        assert_eq!(cohort.plans().len(), EXAMPLE.len());
        assert_eq!(report.n_errors(), 0, "{:#?}", report.findings());
    }

    #[test]
    fn what_is_there_is_left_alone() {
        let parent = tempfile::tempdir().unwrap();
        let args = InitArgs {
            folder: parent.path().to_owned(),
            name: Some("x".into()),
            example: true,
            own: own::FromArgs::default(),
        };
        std::fs::write(parent.path().join("cohort.toml"), "mine").unwrap();
        assert!(matches!(execute(&args, &QUIET), Err(CliError::Usage(_))));
        assert_eq!(
            std::fs::read_to_string(parent.path().join("cohort.toml")).unwrap(),
            "mine"
        );
        assert!(!parent.path().join("patients").exists());
    }

    #[test]
    fn commented_settings_of_the_template_are_the_defaults() {
        let settings: String = COHORT
            .lines()
            .map(|line| {
                line.strip_prefix("# ")
                    .filter(|rest| rest.contains('=') || rest.starts_with('['))
                    .unwrap_or(line)
            })
            .map(|line| format!("{line}\n"))
            .collect();
        let parent = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(parent.path().join("patients")).unwrap();
        std::fs::write(
            parent.path().join("cohort.toml"),
            settings.replace("{name}", "\"x\""),
        )
        .unwrap();
        let mut report = Report::default();
        let cohort = load(parent.path(), &Options::default(), &mut report).unwrap();
        assert_eq!(
            cohort.settings.settings,
            cardiotwin_schemas::shared::Shared::default()
        );
        let others: Vec<_> = report
            .findings()
            .iter()
            .filter(|f| f.problem.key.as_deref() != Some("patients"))
            .collect();
        assert!(others.is_empty(), "{others:#?}");
    }
}

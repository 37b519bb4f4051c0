//! `cardiotwin schemas`: JSON Schemas of all file formats, for editors and other programs.

use std::path::PathBuf;

use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Print or write the JSON Schemas of all file formats
#[derive(Debug, Args)]
pub struct SchemasArgs {
    /// Write one file per schema into this folder instead of one object to stdout
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the schemas, or writes them into a folder.
///
/// # Errors
/// [`CliError::File`] if the folder cannot be written.
pub fn execute(args: &SchemasArgs, talk: &Talk) -> Result<Exit, CliError> {
    let all = cardiotwin_schemas::json_schemas::all();
    let Some(folder) = &args.out else {
        let object: serde_json::Map<String, serde_json::Value> = all
            .into_iter()
            .map(|(name, schema)| (name.to_owned(), schema.to_value()))
            .collect();
        talk.json(&object)?;
        return Ok(Exit::Ok);
    };
    std::fs::create_dir_all(folder).map_err(CliError::file("create", folder))?;
    for (name, schema) in all {
        let path = folder.join(name);
        std::fs::write(&path, cardiotwin_schemas::json_schemas::text(&schema))
            .map_err(CliError::file("write", &path))?;
        talk.data(&format!("{}\n", path.display()))?;
    }
    Ok(Exit::Ok)
}

//! Printed outcome of a request to a run.

use cardiotwin_engine::Answer;

use super::error::CliError;
use super::place::Folders;
use super::talk::Talk;

/// Prints the outcome. `go_on` names the run if `run` has to follow.
///
/// # Errors
/// Stdout cannot be written.
pub fn tell(answer: &Answer, go_on: Option<&Folders>, talk: &Talk) -> Result<(), CliError> {
    match answer {
        Answer::Applied { changes, refused } => {
            changes
                .iter()
                .try_for_each(|change| talk.data(&format!("{change}\n")))?;
            refused.iter().for_each(|reason| talk.insist(reason));
            if let Some(folders) = go_on {
                talk.hint(&format!("continue with {}", folders.run_command()));
            }
        }
        Answer::Asked { holder } => talk.say(&format!(
            "sent the request to the running coordinator ({holder}); `status` shows when it is done"
        )),
    }
    Ok(())
}

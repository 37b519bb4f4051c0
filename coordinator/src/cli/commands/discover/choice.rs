//! Options of a search that its run keeps, so that the next search goes on with them.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use super::args::DiscoverArgs;
use crate::cli::error::CliError;
use crate::cli::kept;
use crate::cli::redone;
use crate::cli::talk::Talk;
use crate::discovery::FOLDER;
use crate::engine::{self, Chosen};

/// Names of the kept options, as on the command line.
const EFFECTS: &str = "effects";
const SEED: &str = "seed";
const MESH_NODES: &str = "mesh-nodes";
/// Seed of the bootstrap without an option.
const DEFAULT_SEED: u64 = 1;

/// Choice of candidates, seed and mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Names of the candidate effects; empty for the whole catalogue.
    pub effects: Vec<String>,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Approximate number of nodes of the finite-element mesh; `None` for the cohort's setting.
    pub mesh_nodes: Option<u32>,
    /// Choice of the last search in this run.
    before: Option<Chosen>,
    set: BTreeMap<String, String>,
}

impl Choice {
    /// Options of the command over those that the run keeps; says which kept ones apply.
    ///
    /// # Errors
    /// [`CliError::Usage`] for `--unset` of an option that the run does not keep; errors of the
    /// store.
    pub async fn of(args: &DiscoverArgs, talk: &Talk) -> Result<Self, CliError> {
        let run_dir = args.run_dir.clone();
        let run_dir = run_dir.unwrap_or_else(|| args.folder.join(FOLDER));
        let before = kept::chosen(&run_dir).await?;
        let stored = before
            .as_ref()
            .map_or_else(Default::default, |c| c.set.clone());
        let (stored, given) = (kept::without(stored, &args.unset)?, given(args));
        kept::say(&stored, &given, talk);
        Ok(Self::from(kept::with(stored, &given), before))
    }

    fn from(set: BTreeMap<String, String>, before: Option<Chosen>) -> Self {
        let effects = set.get(EFFECTS).map_or("", String::as_str).split(',');
        Self {
            effects: effects
                .map(str::trim)
                .filter(|name| !name.is_empty())
                .map(str::to_owned)
                .collect(),
            seed: number(&set, SEED).unwrap_or(DEFAULT_SEED),
            mesh_nodes: number(&set, MESH_NODES),
            before,
            set,
        }
    }

    /// The choice, for the run to keep.
    #[must_use]
    pub fn chosen(&self) -> Chosen {
        Chosen {
            set: self.set.clone(),
            settings: self.searched(),
        }
    }

    /// Options on which the findings depend.
    fn searched(&self) -> Value {
        let effects = match self.effects[..] {
            [] => "the whole catalogue".to_owned(),
            _ => self.effects.join(","),
        };
        json!({ EFFECTS: effects, SEED: self.seed })
    }

    /// Lines about the options that differ from those of the last search.
    #[must_use]
    pub fn changes(&self) -> Vec<String> {
        let before = self.before.as_ref().map(|chosen| &chosen.settings);
        let Some(before) = before.filter(|before| before.is_object()) else {
            return Vec::new();
        };
        let changes = engine::leaf_changes(before, &self.searched());
        changes
            .iter()
            .map(|c| format!("  --{}", c.words()))
            .collect()
    }

    /// Says which finished searches would be done again, and asks for consent.
    ///
    /// # Errors
    /// As [`redone::consent`]; errors of the store.
    pub async fn ask(
        &self,
        run_dir: &Path,
        members: &[cardiotwin_schemas::plan::ResolvedPatient],
        (yes, talk): (bool, &Talk),
    ) -> Result<(), CliError> {
        match redone::told(run_dir, members, &[], &self.changes()).await? {
            Some(told) => redone::consent(&told, yes, talk),
            None => Ok(()),
        }
    }
}

fn number<N: std::str::FromStr>(set: &BTreeMap<String, String>, key: &str) -> Option<N> {
    set.get(key)?.parse().ok()
}

/// Options of the command line as assignments.
fn given(args: &DiscoverArgs) -> Vec<String> {
    let effects =
        (!args.effects.is_empty()).then(|| format!("{EFFECTS}={}", args.effects.join(",")));
    let seed = args.seed.map(|seed| format!("{SEED}={seed}"));
    let mesh_nodes = args.mesh_nodes.map(|n| format!("{MESH_NODES}={n}"));
    effects.into_iter().chain(seed).chain(mesh_nodes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kept_choice_is_read_back_and_a_change_is_told() {
        let set = |pairs: &[(&str, &str)]| -> BTreeMap<String, String> {
            let pairs = pairs.iter();
            pairs
                .map(|(k, v)| ((*k).to_owned(), (*v).to_owned()))
                .collect()
        };
        let first = Choice::from(
            set(&[(EFFECTS, "atrial_kick,viscoelasticity"), (SEED, "7")]),
            None,
        );
        assert_eq!(first.effects, ["atrial_kick", "viscoelasticity"]);
        assert_eq!((first.seed, first.mesh_nodes), (7, None));
        assert!(first.changes().is_empty());
        let again = Choice::from(first.chosen().set, Some(first.chosen()));
        assert!(again.changes().is_empty());
        let plain = Choice::from(BTreeMap::new(), Some(first.chosen()));
        assert_eq!(
            plain.changes(),
            [
                "  --effects: \"atrial_kick,viscoelasticity\" -> \"the whole catalogue\"",
                "  --seed: 7 -> 1",
            ]
        );
    }
}

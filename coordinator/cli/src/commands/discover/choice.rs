//! Options of a search that its run keeps, so that the next search continues with them.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_engine::Chosen;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_sweep::discovery::FOLDER;
use serde_json::{Value, json};

use super::args::DiscoverArgs;
use crate::error::CliError;
use crate::kept;
use crate::redone;
use crate::talk::Talk;

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
    options: kept::Choice,
}

impl Choice {
    /// Options of the command over those that the run keeps; says which kept ones apply.
    ///
    /// # Errors
    /// [`CliError::Usage`] for `--unset` of an option that the run does not keep; errors of the
    /// store.
    pub async fn of(args: &DiscoverArgs, talk: &Talk) -> Result<Self, CliError> {
        let run_dir = args.run_dir.clone();
        let run_dir = match run_dir {
            Some(run_dir) => run_dir,
            None => args.folder()?.join(FOLDER),
        };
        let options = kept::choose(&run_dir, &args.unset, &given(args), talk).await?;
        Ok(Self::from(options))
    }

    fn from(options: kept::Choice) -> Self {
        let set = &options.set;
        let effects = set.get(EFFECTS).map_or("", String::as_str).split(',');
        Self {
            effects: effects
                .map(str::trim)
                .filter(|name| !name.is_empty())
                .map(str::to_owned)
                .collect(),
            seed: number(set, SEED).unwrap_or(DEFAULT_SEED),
            mesh_nodes: number(set, MESH_NODES),
            options,
        }
    }

    /// The choice, for the run to keep.
    #[must_use]
    pub fn chosen(&self) -> Chosen {
        Chosen {
            set: self.options.set.clone(),
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
        let changes = redone::leaves(self.options.before.as_ref(), &self.searched());
        let lines = changes.iter().map(|c| format!("  --{}", c.words()));
        lines.collect()
    }

    /// Says which finished searches would be done again, and asks for consent.
    ///
    /// # Errors
    /// As [`redone::consent`]; errors of the store.
    pub async fn ask(
        &self,
        run_dir: &Path,
        members: &[ResolvedPatient],
        (yes, talk): (bool, &Talk),
    ) -> Result<(), CliError> {
        match redone::told(run_dir, || members.to_vec(), &[], &self.changes()).await? {
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
        let of = |set, before| {
            Choice::from(kept::Choice {
                before,
                set,
                ..kept::Choice::default()
            })
        };
        let first = of(
            set(&[(EFFECTS, "atrial_kick,viscoelasticity"), (SEED, "7")]),
            None,
        );
        assert_eq!(first.effects, ["atrial_kick", "viscoelasticity"]);
        assert_eq!((first.seed, first.mesh_nodes), (7, None));
        assert!(first.changes().is_empty());
        let again = of(first.chosen().set, Some(first.chosen()));
        assert!(again.changes().is_empty());
        let plain = of(BTreeMap::new(), Some(first.chosen()));
        assert_eq!(
            plain.changes(),
            [
                "  --effects: \"atrial_kick,viscoelasticity\" -> \"the whole catalogue\"",
                "  --seed: 7 -> 1",
            ]
        );
    }
}

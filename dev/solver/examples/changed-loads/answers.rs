//! Answers of `cardiotwin predict` for the twins of a cohort, beside the true ones.

use crate::changes::{CHANGES, Change};
use crate::folder;
use cardiotwin_calibrate::formulations::{ChangeOf, Discrepancies, Table, beyond};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What is asked for.
pub struct Asked {
    /// Program `cardiotwin`.
    pub program: PathBuf,
    /// Circuits to compare.
    pub circuits: Vec<String>,
    /// Whether to predict bands.
    pub bands: bool,
    /// Whether the answers that a former call stored in the folder are read instead.
    pub kept: bool,
    /// Whether twins that are not personalised count.
    pub counts_all: bool,
    /// Whether changes of a size from which nothing is learnt are asked for, too.
    pub other_sizes: bool,
    /// Number of hearts, in the order of their numbers.
    pub n_twins: usize,
}

/// A predicted change of an index beside the true one. Changes are relative.
pub struct Judged {
    /// Name of the change.
    pub change: &'static Change,
    /// Name of the index.
    pub index: String,
    /// Change of the heart.
    pub truth: f64,
    /// Change of the twin.
    pub predicted: f64,
    /// Band of the change, with the discrepancy between formulations; without bands in the answer that discrepancy alone.
    pub band: Option<[f64; 2]>,
    /// Band within the model; without bands in the answer none wide.
    pub band_within_model: [f64; 2],
    /// What the answer says about the change: `size`, `direction`, `neither`.
    pub known: Option<String>,
}

/// All judged changes of a cohort in one circuit.
pub struct Answers {
    /// Seed of the hearts, and their number.
    pub cohort: (u64, usize),
    /// Ventricle of the twins.
    pub ventricle: String,
    /// Circuit.
    pub circuit: String,
    /// Names of the twins that count.
    pub twins: Vec<String>,
    /// Judged changes.
    pub judged: Vec<Judged>,
    /// How many predictions there are, in the asked circuit, periodic, of personalised twins.
    pub counts: [usize; 4],
}

/// Reads the true answers of a cohort.
pub fn truth(of: &Path) -> Result<Value, String> {
    let path = of.join("truth.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| e.to_string())
}

/// The answers for a cohort in a circuit.
pub fn answers(of: &Path, circuit: &str, asked: &Asked) -> Result<Answers, String> {
    let truth = truth(of)?;
    let answer = match asked.kept {
        true => kept(of, circuit)?,
        false => ask(of, asked, &truth, circuit)?,
    };
    let all: Vec<&Value> = list(&answer["predictions"]).collect();
    let ventricle = (all.first()).and_then(|one| one["ventricle"].as_str());
    let (learnt, name) = (Discrepancies::learnt(), ventricle.unwrap_or_default());
    let count = |is: &dyn Fn(&Value) -> bool| all.iter().filter(|one| is(one)).count();
    let counts = [
        all.len(),
        count(&|one| one["circulation"] == circuit),
        count(&|one| one["periodic"] == true),
        count(&|one| one["personalised"] == true),
    ];
    let mut twins = Vec::new();
    let mut judged = Vec::new();
    for one in &all {
        // A twin that is not predicted in the asked circuit says nothing about it.
        let counts = asked.counts_all || one["personalised"] == true;
        if !counts || one["circulation"] != circuit || one["periodic"] != true {
            continue;
        }
        let patient = one["patient"].as_str().unwrap_or_default();
        if !twins.contains(&patient.to_owned()) {
            twins.push(patient.to_owned());
        }
        let of_heart = &truth["hearts"][patient];
        for change in &CHANGES {
            if one["scenario"] != change.scenario {
                continue;
            }
            let found = list(&one["indices"])
                .filter_map(|index| judge(change, index, of_heart, learnt.of(name, circuit)));
            judged.extend(found);
        }
    }
    Ok(Answers {
        cohort: (
            truth["seed"].as_u64().ok_or("truth.json has no seed")?,
            truth["hearts"].as_object().map_or(0, serde_json::Map::len),
        ),
        ventricle: ventricle.ok_or("no twin was predicted")?.to_owned(),
        circuit: circuit.to_owned(),
        twins,
        judged,
        counts,
    })
}

fn list(of: &Value) -> impl Iterator<Item = &Value> {
    of.as_array().into_iter().flatten()
}

fn judge(
    change: &'static Change,
    index: &Value,
    of_heart: &Value,
    learnt: Option<&Table>,
) -> Option<Judged> {
    let name = index["name"].as_str()?;
    let twin = index["twin"].as_f64()?;
    let band = |key: &str| {
        let ends = [0, 1].map(|end| index[key][end].as_f64().map(|v| v / twin - 1.0));
        let [Some(a), Some(b)] = ends else {
            return None;
        };
        Some([a.min(b), a.max(b)])
    };
    let predicted = index["relative_change"].as_f64()?;
    let made = [ChangeOf {
        quantity: change.quantity,
        factor: change.factor,
    }];
    let alone = || {
        let half_width = learnt?.discrepancy(&made, name)?.half_width;
        Some([predicted - half_width, predicted + half_width])
    };
    Some(Judged {
        change,
        index: name.to_owned(),
        truth: of_heart[change.name][name].as_f64()?,
        predicted,
        band: band("band").or_else(alone),
        band_within_model: band("band_within_model").unwrap_or([predicted; 2]),
        known: index["known"].as_str().map(str::to_owned),
    })
}

impl Judged {
    /// Predicted less true change.
    pub fn error(&self) -> f64 {
        self.predicted - self.truth
    }

    /// Whether the band holds the true change; `None` without a band.
    ///
    /// - `scale`: what its discrepancy between formulations is multiplied by
    pub fn is_held(&self, scale: f64) -> Option<bool> {
        let (whole, within) = (self.half_width(self.band?), self.within());
        let discrepancy = scale * beyond(whole, within);
        // An end at the truth holds it, whatever the rounding.
        Some(self.error().abs() <= within.hypot(discrepancy) + 1e-9)
    }

    /// Half width of a band on the side of the truth.
    fn half_width(&self, [low, high]: [f64; 2]) -> f64 {
        match self.truth < self.predicted {
            true => self.predicted - low,
            false => high - self.predicted,
        }
    }

    /// Half width of the band within the model on the side of the truth.
    pub fn within(&self) -> f64 {
        self.half_width(self.band_within_model)
    }

    /// Whether the prediction has the direction of the truth.
    pub fn is_right_direction(&self) -> bool {
        self.predicted * self.truth > 0.0
    }
}

fn stored(of: &Path, circuit: &str) -> PathBuf {
    of.join(format!("{circuit}.json"))
}

fn kept(of: &Path, circuit: &str) -> Result<Value, String> {
    let path = stored(of, circuit);
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Asks for all scenarios in a circuit, and stores the answer.
fn ask(of: &Path, asked: &Asked, truth: &Value, circuit: &str) -> Result<Value, String> {
    let number = |id: &str| id.rsplit('-').next().map(str::to_owned);
    let hearts = truth["hearts"].as_object();
    let mut ids: Vec<&String> = hearts.into_iter().flat_map(|all| all.keys()).collect();
    ids.sort_by_key(|id| number(id));
    let mut scenarios = String::new();
    let is_asked = |one: &&Change| one.is_learnt || asked.other_sizes;
    let scenarios_of = CHANGES.iter().filter(|one| one.name == one.scenario);
    for change in scenarios_of.filter(is_asked) {
        let Change {
            name,
            quantity,
            amount,
            ..
        } = change;
        let _ = write!(scenarios, "[{name}]\nset = [\"{quantity}={amount}\"]\n");
        // Without a list every twin of the run is asked for, and hearts that have none are left out.
        if asked.n_twins < ids.len() {
            let _ = writeln!(scenarios, "patients = {:?}", &ids[..asked.n_twins]);
        }
    }
    let file = of.join("scenarios.toml");
    folder::put(&file, &scenarios)?;
    let program = &asked.program;
    let output = Command::new(program)
        .arg("predict")
        .args(["--json", "--circulation", circuit, "--scenarios"])
        .args([file.as_os_str(), "--cohort".as_ref(), of.as_os_str()])
        .args((!asked.bands).then_some("--no-band"))
        .output()
        .map_err(|e| format!("{}: {e}", program.display()))?;
    // Twins that are not personalised end the program with an exit code, after the answer.
    let said = String::from_utf8_lossy(&output.stderr);
    let text = String::from_utf8_lossy(&output.stdout);
    let answer =
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}\n{said}", program.display()))?;
    folder::put(&stored(of, circuit), &text)?;
    Ok(answer)
}

//! Draws results of `evaluate --out` on labelled sets: the confusion matrix, power curves, the
//! curve of thresholds, and the reliability of probabilities, as SVG. It prints the scores as text and writes one line per case to `discover-evaluation.csv`.
//!
//! `figures OUT_FOLDER NAME=CASES_DIR=RESULTS_FILE ...`

#[path = "../evaluate/classes.rs"]
mod classes;
mod confusion;
mod frame;
mod power;
mod rate;
mod reliability;
mod svg;
mod thresholds;

use serde_json::Value;
use std::path::Path;
use std::process::ExitCode;

/// One case that was searched.
pub struct Case {
    /// Name of the case.
    pub id: String,
    /// Hidden effects of the catalogue: name, and magnitude in multiples of the smallest meaningful
    /// one.
    pub hidden: Vec<(String, f64)>,
    /// Whether the case has a gap outside the catalogue.
    pub off_catalogue: bool,
    /// Whether the data can hardly resolve the effects.
    pub hard: bool,
    /// Factor of the usual noise.
    pub noise: f64,
    /// Fall of the misfit by the right effect, if it was computed.
    pub visibility: Option<f64>,
    /// Named effects, the most certain first.
    pub named: Vec<String>,
    /// Whether a gap without a name was reported.
    pub unexplained: bool,
    /// Ranked effects, the named ones first.
    pub ranked: Vec<Ranked>,
}

/// An effect of the ranking.
pub struct Ranked {
    /// Name of the effect.
    pub name: String,
    /// Stated probability.
    pub probability: f64,
    /// Evidence without competitors.
    pub evidence: f64,
    /// Evidence with the best competitor on either side.
    pub robust: f64,
    /// Whether its strength may be named.
    pub plausible: bool,
}

impl Case {
    /// The hidden effect, if it is the only one.
    pub fn single(&self) -> Option<&(String, f64)> {
        (self.hidden.len() == 1).then(|| &self.hidden[0])
    }

    /// Whether nothing is missing.
    pub fn is_null(&self) -> bool {
        self.hidden.is_empty() && !self.off_catalogue
    }
}

/// A set of cases, with its name in the figures.
pub struct Set {
    /// Name of the set in legends and titles.
    pub name: String,
    /// Cases that were searched.
    pub cases: Vec<Case>,
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let usage = "usage: figures OUT_FOLDER NAME=CASES_DIR=RESULTS_FILE ...";
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (out, sets) = arguments
        .split_first()
        .filter(|(_, sets)| !sets.is_empty())
        .ok_or(usage)?;
    let sets: Vec<Set> = sets
        .iter()
        .map(|text| read(text))
        .collect::<Result<_, String>>()?;
    let files = [
        ("discover-confusion.svg", confusion::draw(&sets)),
        ("discover-power.svg", power::draw(&sets)),
        ("discover-thresholds.svg", thresholds::draw(&sets)),
        ("discover-reliability.svg", reliability::draw(&sets)),
        ("discover-evaluation.csv", lines(&sets)),
    ];
    for (file, text) in files {
        let path = Path::new(out).join(file);
        std::fs::write(&path, text).map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    }
    print!("{}", power::table(&sets));
    print!("{}", thresholds::table(&sets));
    print!("{}", reliability::table(&sets));
    Ok(())
}

/// One CSV line per case.
fn lines(sets: &[Set]) -> String {
    let mut out = "set,case,hidden,strength,noise,visibility,named,unexplained\n".to_owned();
    for set in sets {
        for c in &set.cases {
            let join = |words: Vec<String>| words.join("+");
            let hidden = if c.off_catalogue {
                "off catalogue".to_owned()
            } else {
                join(c.hidden.iter().map(|h| h.0.clone()).collect())
            };
            let strength = join(c.hidden.iter().map(|h| format!("{:.2}", h.1)).collect());
            let seen = c.visibility.map_or(String::new(), |v| format!("{v:.1}"));
            out += &format!(
                "{},{},{hidden},{strength},{},{seen},{},{}\n",
                set.name,
                c.id,
                c.noise,
                c.named.join("+"),
                c.unexplained
            );
        }
    }
    out
}

fn ranked(effect: &Value) -> Option<Ranked> {
    Some(Ranked {
        name: effect["name"].as_str()?.to_owned(),
        probability: effect["probability"].as_f64()?,
        evidence: effect["log_evidence"].as_f64()?,
        robust: effect["robust_evidence"].as_f64()?,
        plausible: effect["plausible"].as_bool()?,
    })
}

fn read(text: &str) -> Result<Set, String> {
    let parts: Vec<&str> = text.splitn(3, '=').collect();
    let [name, folder, results] = parts[..] else {
        return Err(format!("{text}: expected NAME=CASES_DIR=RESULTS_FILE"));
    };
    let open = |path: &Path| {
        std::fs::read_to_string(path).map_err(|e| format!("cannot read {}: {e}", path.display()))
    };
    let path = Path::new(folder).join("labels.json");
    let labels: Value =
        serde_json::from_str(&open(&path)?).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut cases = Vec::new();
    for (idx, line) in open(Path::new(results))?.lines().enumerate() {
        let found: Value =
            serde_json::from_str(line).map_err(|e| format!("{results}:{}: {e}", idx + 1))?;
        let id = found["case"]
            .as_str()
            .ok_or(format!("{results}:{}: the line names no case", idx + 1))?;
        let label = labels["cases"]
            .get(id)
            .ok_or(format!("{}: no case {id}", path.display()))?;
        let flag = |key: &str| label[key].as_bool().unwrap_or(false);
        let hidden = label["effects"].as_array().into_iter().flatten();
        cases.push(Case {
            id: id.to_owned(),
            hidden: hidden
                .filter_map(|e| {
                    Some((
                        e["effect"].as_str()?.to_owned(),
                        e["strength"].as_f64().unwrap_or(0.0),
                    ))
                })
                .collect(),
            off_catalogue: flag("off_catalogue"),
            hard: flag("hard"),
            noise: label["noise"].as_f64().unwrap_or(1.0),
            visibility: label["visibility"]["delta_chi2"].as_f64(),
            named: found["accepted"]
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(|n| Some(n.as_str()?.to_owned()))
                .collect(),
            unexplained: !found["unexplained"].is_null(),
            ranked: (found["effects"].as_array().into_iter().flatten())
                .filter_map(ranked)
                .collect(),
        });
    }
    Ok(Set {
        name: name.to_owned(),
        cases,
    })
}

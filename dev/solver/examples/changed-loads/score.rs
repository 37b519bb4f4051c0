//! Predictions of a finished run against the true answers.

use crate::{CHANGES, INDICES, folder};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// What is asked for.
pub struct Asked<'a> {
    /// Program `cardiotwin`.
    pub program: &'a Path,
    /// Circuits to compare.
    pub circuits: &'a [&'a str],
    /// Whether to predict bands.
    pub bands: bool,
    /// Whether twins that are not personalised count.
    pub counts_all: bool,
    /// Number of hearts, in the order of their numbers.
    pub n_twins: usize,
}

/// Errors of an index after a change over the twins, in percentage points, and bands.
#[derive(Default)]
struct Errors {
    signed: Vec<f64>,
    in_band: usize,
    bands: usize,
}

impl Errors {
    fn enter(&mut self, truth: f64, index: &Value) -> Option<()> {
        let predicted = index["relative_change"].as_f64()?;
        self.signed.push(100.0 * (predicted - truth));
        let twin = index["twin"].as_f64()?;
        if let [Some(low), Some(high)] = [0, 1].map(|end| index["band"][end].as_f64()) {
            let (a, b) = (low / twin - 1.0, high / twin - 1.0);
            self.in_band += usize::from((a.min(b)..=a.max(b)).contains(&truth));
            self.bands += 1;
        }
        Some(())
    }

    /// Mean absolute and mean error, and coverage.
    fn cells(&self) -> String {
        let n = self.signed.len().max(1) as f64;
        let absolute = self.signed.iter().map(|e| e.abs()).sum::<f64>() / n;
        let mean = self.signed.iter().sum::<f64>() / n;
        let (inside, bands) = (self.in_band, self.bands);
        format!("{absolute:5.1} {mean:+6.1} {inside:3}/{bands:<3}")
    }
}

/// The answer of `cardiotwin predict` for all scenarios in a circuit.
fn predictions(
    of: &Path,
    asked: &Asked<'_>,
    truth: &Value,
    circuit: &str,
) -> Result<Value, String> {
    let number = |id: &str| id.rsplit('-').next().map(str::to_owned);
    let hearts = truth["hearts"].as_object();
    let mut ids: Vec<&String> = hearts.into_iter().flat_map(|all| all.keys()).collect();
    ids.sort_by_key(|id| number(id));
    ids.truncate(asked.n_twins);
    let mut scenarios = String::new();
    for (name, set) in CHANGES.iter().filter(|(name, _)| *name != "rate-alone") {
        let _ = write!(
            scenarios,
            "[{name}]\nset = [\"{set}\"]\npatients = {ids:?}\n"
        );
    }
    let file = of.join("scenarios.toml");
    folder::put(&file, &scenarios)?;
    let program = asked.program;
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
    folder::put(&of.join(format!("{circuit}.json")), &text)?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}\n{said}", program.display()))
}

/// Prints the table of errors.
pub fn score(of: &Path, asked: &Asked<'_>) -> Result<(), String> {
    let circuits = asked.circuits;
    let path = of.join("truth.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let truth: Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    let answers = (circuits.iter())
        .map(|circuit| predictions(of, asked, &truth, circuit))
        .collect::<Result<Vec<_>, _>>()?;
    let mut heading = format!("{:14} {:22}   true", "change", "index");
    circuits
        .iter()
        .for_each(|circuit| heading += &format!("   {circuit:20}"));
    println!(
        "{heading}\n{:45}   |e|   mean  in band, percentage points",
        ""
    );
    for (change, set) in CHANGES {
        for index in INDICES {
            let mut trues = Vec::new();
            let mut row = String::new();
            for answer in &answers {
                let mut errors = Errors::default();
                let first = CHANGES.iter().find(|(_, other)| *other == set);
                let scenario = first.map_or(change, |(name, _)| name);
                let all = answer["predictions"].as_array().into_iter().flatten();
                trues.clear();
                for one in all.filter(|one| one["scenario"] == scenario) {
                    if !(asked.counts_all || one["personalised"] == true) {
                        continue;
                    }
                    let of_heart = &truth["hearts"][one["patient"].as_str().unwrap_or("")];
                    let Some(true_change) = of_heart[change][index].as_f64() else {
                        continue;
                    };
                    let indices = one["indices"].as_array().into_iter().flatten();
                    let Some(found) = indices.into_iter().find(|i| i["name"] == index) else {
                        continue;
                    };
                    if errors.enter(true_change, found).is_some() {
                        trues.push(100.0 * true_change);
                    }
                }
                row += &format!("   {:20}", errors.cells());
            }
            let mean = trues.iter().sum::<f64>() / trues.len().max(1) as f64;
            println!("{change:14} {index:22} {mean:+6.1}{row}");
        }
    }
    for (circuit, answer) in circuits.iter().zip(&answers) {
        let all: Vec<&Value> = answer["predictions"]
            .as_array()
            .into_iter()
            .flatten()
            .collect();
        let count = |is: &dyn Fn(&Value) -> bool| all.iter().filter(|one| is(one)).count();
        println!(
            "{circuit}: {} predictions, {} in the asked circuit, {} periodic, {} of personalised twins",
            all.len(),
            count(&|one| one["circulation"] == *circuit),
            count(&|one| one["periodic"] == true),
            count(&|one| one["personalised"] == true),
        );
    }
    Ok(())
}

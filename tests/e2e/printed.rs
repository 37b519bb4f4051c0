//! Output that pages show below `$ cardiotwin …` is what the command prints.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use crate::pictures::assert_drawn;
use crate::support::{cardiotwin, command};

const COHORT: &str = r#"name = "my-cohort"
solver.fidelity = "reduced"
step2.seed = 3
step2.popsize = 3
step2.max_generations = 4
step2.polish = false
step3.max_iterations = 1
posterior.draws = 40
step1.max_iterations = 12
"#;

/// A command of a page, and the output shown below it.
struct Shown {
    page: String,
    line: usize,
    command: String,
    output: Vec<String>,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All pages: the README, and those in `docs`, `examples` and below.
fn pages() -> Vec<PathBuf> {
    let mut folders = vec![root().join("docs"), root().join("examples")];
    let mut pages = vec![root().join("README.md"), root().join("CONTRIBUTING.md")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                pages.push(path);
            }
        }
    }
    pages.sort();
    pages
}

/// All blocks whose first line begins with `$ cardiotwin`. A block without a language is output, and
/// has such a line; anything else (a formula, a folder's listing) has `text`.
fn shown() -> Vec<Shown> {
    let mut all = Vec::new();
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        let mut lines = text.lines().enumerate();
        while let Some((_, fence)) = lines.next() {
            if !fence.starts_with("```") {
                continue;
            }
            let block: Vec<(usize, &str)> = lines
                .by_ref()
                .take_while(|(_, line)| *line != "```")
                .collect();
            let Some(((line, first), rest)) = block.split_first() else {
                continue;
            };
            // Port and token of the dashboard differ each time: it has a comparison of its own.
            let is_known = first.starts_with("$ cardiotwin ") || page.ends_with("dashboard.md");
            assert!(
                fence != "```" || is_known,
                "{}:{}: output without its command; begin with `$ cardiotwin …`, or write ```text",
                page.display(),
                line + 1
            );
            if let Some(command) = first.strip_prefix("$ cardiotwin ") {
                all.push(Shown {
                    page: page.display().to_string(),
                    line: line + 1,
                    command: command.to_owned(),
                    output: rest.iter().map(|(_, line)| (*line).to_owned()).collect(),
                });
            }
        }
    }
    all
}

/// A line without the widths of its columns, which rows that a page leaves out would change.
fn words(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The first shown line that the output lacks below the one before; `…` stands for any lines.
fn first_missing<'a>(shown: &'a [String], printed: &str) -> Option<&'a str> {
    let mut printed = printed.lines().map(words);
    shown
        .iter()
        .filter(|line| words(line) != "…")
        .find(|line| !printed.any(|found| found == words(line)))
        .map(String::as_str)
}

#[test]
fn output_on_pages_is_what_the_commands_print() {
    let folder = tempfile::tempdir().unwrap();
    let copied = std::process::Command::new("cp")
        .arg("-r")
        .arg(root().join("examples"))
        .arg(folder.path())
        .status();
    assert!(copied.unwrap().success());
    std::fs::create_dir_all(folder.path().join("docs/images")).unwrap();
    // What the pages' commands need: a cohort with a run, a setting in line 9, and a rerun.
    let cohort = folder.path().join("my-cohort");
    let patient = cohort.join("patients/04-CoA");
    std::fs::create_dir_all(&patient).unwrap();
    for name in ["patient.toml", "pressure.csv", "volume.csv"] {
        let from = folder.path().join("examples/coa-seven/patients/04-CoA");
        std::fs::copy(from.join(name), patient.join(name)).unwrap();
    }
    std::fs::write(cohort.join("cohort.toml"), COHORT).unwrap();
    cardiotwin(folder.path(), &["run", "my-cohort", "--no-report"]).expect(0);
    let rerun = "rerun 04-CoA --from step1 --damping 0.5 --cohort my-cohort";
    cardiotwin(folder.path(), &rerun.split(' ').collect::<Vec<_>>()).expect(0);
    the_dashboard_prints_what_its_page_shows(folder.path());
    let misspelt = folder.path().join("misspelt/patients/04-CoA");
    std::fs::create_dir_all(&misspelt).unwrap();
    for name in [
        "cohort.toml",
        "patients/04-CoA/pressure.csv",
        "patients/04-CoA/volume.csv",
    ] {
        std::fs::copy(cohort.join(name), folder.path().join("misspelt").join(name)).unwrap();
    }
    let patient = std::fs::read_to_string(patient.join("patient.toml")).unwrap();
    let patient = patient.replace("wall_volume_mL", "wall_volum_mL");
    std::fs::write(misspelt.join("patient.toml"), patient).unwrap();
    make_the_papers_run(folder.path());
    let shown = shown();
    assert!(shown.len() >= 9, "{}", shown.len());
    for block in shown {
        let words: Vec<String> = (block.command.split_whitespace())
            .map(|word| word.trim_matches('\'').to_owned())
            .collect();
        let arguments: Vec<&str> = words.iter().map(String::as_str).collect();
        let output = command(folder.path(), &arguments).output().unwrap();
        let printed = String::from_utf8_lossy(&output.stdout);
        let missing = first_missing(&block.output, &printed);
        assert_eq!(
            missing,
            None,
            "{}:{}: not printed; the command printed\n{printed}\n{}",
            block.page,
            block.line,
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let recordings = ["prepare", "examples/recordings/P001-raw", "P001"];
    cardiotwin(folder.path(), &recordings).expect(0);
    let understood = "my-traces/patients/traces/prepared/understood.svg";
    for (shown, drawn) in [
        ("afterload-human.svg", "docs/images/afterload-human.svg"),
        ("calcium-fit.svg", "docs/images/calcium-fit.svg"),
        ("own-traces.svg", understood),
        ("prepare-beats.svg", "P001/prepared/beats.svg"),
        ("prepare-volume.svg", "P001/prepared/volume.svg"),
    ] {
        let shown = root().join("docs/images").join(shown);
        assert_drawn(&shown, &folder.path().join(drawn));
    }
}

/// What docs/slurm.md does before it plans: each patient gets the paper's number of nodes.
fn make_the_papers_run(folder: &Path) {
    let page = std::fs::read_to_string(root().join("docs/slurm.md")).unwrap();
    let script = (page.split("```"))
        .find(|block| block.contains("cp -r examples/coa-seven paper-run"))
        .expect("the lines that make paper-run");
    let (_, script) = script.split_once('\n').unwrap();
    let made = std::process::Command::new("bash")
        .args(["-euo", "pipefail", "-c", script])
        .current_dir(folder)
        .status();
    assert!(made.unwrap().success());
}

/// The dashboard continues until Ctrl-C, so its words are read while it runs. Port and token differ each time.
fn the_dashboard_prints_what_its_page_shows(folder: &Path) {
    let page = std::fs::read_to_string(root().join("docs/dashboard.md")).unwrap();
    let mut shown = page
        .lines()
        .skip_while(|line| !line.starts_with("http://127.0.0.1:"))
        .take_while(|line| *line != "```");
    let (address, hint) = (shown.next().unwrap(), shown.next().unwrap());
    let mut dashboard = command(folder, &["dashboard", "my-cohort"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let first = |stream: &mut dyn Read| {
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    };
    let printed = first(dashboard.stdout.as_mut().unwrap());
    let said = first(dashboard.stderr.as_mut().unwrap());
    dashboard.kill().unwrap();
    dashboard.wait().unwrap();
    let kind = |address: &str| {
        let (host, token) = address.split_once("/?token=").expect("a token");
        (
            host.rsplit_once(':').map(|(host, _)| host.to_owned()),
            token.is_empty(),
        )
    };
    assert_eq!(kind(&printed), kind(address), "{printed}");
    assert_eq!(said, hint);
}

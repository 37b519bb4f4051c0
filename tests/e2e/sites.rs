//! Settings of a cluster in a cohort, without a cluster: what the pages show, and what is refused.

use crate::support::{Cohort, cardiotwin};

/// The first TOML block of the page about Slurm.
fn lines_of_the_page() -> String {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/slurm.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let block = page.split("```toml\n").nth(1).expect("a block");
    block.split("```").next().expect("its end").to_owned()
}

#[test]
fn the_lines_for_a_cluster_are_valid_in_a_new_cohort() {
    let folder = tempfile::tempdir().unwrap();
    cardiotwin(folder.path(), &["init", "new", "--example"]).expect(0);
    let file = folder.path().join("new/cohort.toml");
    let template = std::fs::read_to_string(&file).unwrap();
    let lines = lines_of_the_page();
    std::fs::write(&file, format!("{template}\n{lines}")).unwrap();
    cardiotwin(folder.path(), &["check", "new"]).expect(0);
    let plan = cardiotwin(folder.path(), &["plan", "new"]).expect(0);
    assert!(plan.out.contains("archer2: "), "{}", plan.out);
    // The site of the cohort is examined, although no Slurm answers here.
    let doctor = cardiotwin(folder.path(), &["doctor", "new"]);
    assert!(doctor.out.contains("taskfarm"), "{}", doctor.out);

    std::fs::write(&file, format!("{template}\n{lines}\n{lines}")).unwrap();
    let said = cardiotwin(folder.path(), &["check", "new"]).expect(1).out;
    for part in ["duplicate key `executor`", "can stand only once"] {
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn a_walltime_without_time_for_work_names_both_settings() {
    let cohort = Cohort::quick();
    let check = |walltime: &str| {
        let walltime = format!("executor.slurm.walltime=\"{walltime}\"");
        cohort.call(&["plan", "--set", &walltime])
    };
    check("00:06:00").complains_of(&[
        "executor.slurm.walltime is `00:06:00`",
        "360 s",
        "lower executor.slurm.warning_s (120)",
    ]);
    check("00:07:00").expect(0);
}

#[test]
fn directives_stand_in_the_script_unless_a_setting_decides_them() {
    let cohort = Cohort::quick();
    let plan = |directive: &str| {
        let directives = format!("executor.slurm.directives=[\"{directive}\"]");
        cohort.call(&["plan", "--script", "--set", &directives])
    };
    let script = plan("--reservation=heart").expect(0).out;
    assert!(script.contains("#SBATCH --reservation=heart\n"), "{script}");
    plan("--time=01:00:00").complains_of(&["change executor.slurm.walltime instead"]);
    plan("-p fast").complains_of(&["expected an option such as --reservation=NAME"]);
}

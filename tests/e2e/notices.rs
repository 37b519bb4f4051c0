//! Notices: a hook and mail are sent once, whatever happens to the coordinator, and never harm the
//! run.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::support::{Cohort, binary, published};

/// A script in the cohort's folder.
fn script(cohort: &Cohort, name: &str, body: &str) -> PathBuf {
    let path = cohort.path().join(name);
    fs::write(&path, format!("#!/bin/sh\n{body}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// Appends `[executor.notices]` to the cohort's file.
fn notify(cohort: &Cohort, lines: &str) {
    let path = cohort.path().join("cohort.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, format!("{text}\n[executor.notices]\n{lines}\n")).unwrap();
}

/// The objects that a hook wrote, in their order.
fn heard(path: &Path) -> Vec<Value> {
    let text = fs::read_to_string(path).unwrap_or_default();
    serde_json::Deserializer::from_str(&text)
        .into_iter()
        .map(Result::unwrap)
        .collect()
}

/// Arguments for a worker that dies in every verification beat, the only beat of a run with Land's
/// cell.
fn without_verification(cohort: &Cohort) -> [String; 4] {
    let real = binary("cardiotwin-worker");
    let body = format!(
        "for folder; do :; done\ngrep -q '\"n_TRPN\":[0-9]' \"$folder/spec.json\" 2>/dev/null && exit 9\nexec '{}' \"$@\"",
        real.display()
    );
    let worker = script(cohort, "worker", &body).display().to_string();
    [
        "--worker".into(),
        worker,
        "--set".into(),
        "executor.site_retries=0".into(),
    ]
}

fn events(heard: &[Value]) -> Vec<&str> {
    heard
        .iter()
        .map(|notice| notice["event"].as_str().unwrap())
        .collect()
}

#[test]
fn a_hook_and_mail_are_told_once_of_everything() {
    let cohort = Cohort::quick_of("04-CoA");
    let (hook_heard, mail_heard) = (cohort.path().join("heard"), cohort.path().join("mail"));
    let hook = script(
        &cohort,
        "hook",
        &format!("cat >> '{}'", hook_heard.display()),
    );
    let sendmail = script(
        &cohort,
        "sendmail",
        &format!("cat >> '{}'", mail_heard.display()),
    );
    notify(
        &cohort,
        &format!(
            "command = [{:?}]\nmail = [\"operator@example.org\"]\nsendmail = [{:?}]\nleast_free_GB = 1e6",
            hook.display(),
            sendmail.display()
        ),
    );
    let worker = without_verification(&cohort);
    let run = ["run", "--no-report"]
        .into_iter()
        .chain(worker.iter().map(String::as_str))
        .collect::<Vec<_>>();
    cohort.call(&run).expect(1);
    let first = heard(&hook_heard);
    let mut told = events(&first);
    told.sort_unstable();
    assert_eq!(
        told,
        ["done", "failed", "quota-low", "stalled"],
        "{first:?}"
    );
    let stalled = first
        .iter()
        .find(|notice| notice["event"] == "stalled")
        .unwrap();
    assert_eq!(
        (&stalled["patient"], &stalled["cohort"]),
        (&"04-CoA".into(), &"two".into())
    );
    let mail = fs::read_to_string(&mail_heard).unwrap();
    assert_eq!(
        mail.matches("To: operator@example.org").count(),
        4,
        "{mail}"
    );
    assert!(
        mail.contains("Subject: cardiotwin two: stalled 04-CoA"),
        "{mail}"
    );
    let folder = cohort.path().display().to_string();
    assert!(
        !mail.contains(&folder) && !fs::read_to_string(&hook_heard).unwrap().contains(&folder),
        "no paths are told"
    );
    // Another run without changes sends nothing.
    cohort.call(&run);
    assert_eq!(heard(&hook_heard).len(), 4);
    assert_eq!(fs::read_to_string(&mail_heard).unwrap(), mail);
}

/// The hook itself kills the coordinator with SIGKILL: nothing is sent twice, and the next
/// coordinator sends the rest.
#[test]
fn each_is_told_once_though_the_coordinator_is_killed_in_the_act() {
    let cohort = Cohort::quick_of("04-CoA");
    let at = cohort.path().join("heard");
    let hook = script(
        &cohort,
        "hook",
        &format!("cat >> '{}'; kill -9 $PPID", at.display()),
    );
    notify(
        &cohort,
        &format!("command = [{:?}]\nleast_free_GB = 1e6", hook.display()),
    );
    let worker = without_verification(&cohort);
    let run = ["run", "--no-report"]
        .into_iter()
        .chain(worker.iter().map(String::as_str))
        .collect::<Vec<_>>();
    let mut killed = 0;
    for _ in 0..8 {
        if cohort.call(&run).code != -1 {
            break;
        }
        killed += 1;
    }
    let all = heard(&at);
    let mut told = events(&all);
    told.sort_unstable();
    assert_eq!(
        told,
        ["done", "failed", "quota-low", "stalled"],
        "each once, after {killed} kills"
    );
    assert_eq!(killed, 4, "each notice took a coordinator with it");
    let twice = Cohort::quick_of("04-CoA");
    twice.call(&run).expect(1);
    let told = published(&twice.patient("04-CoA"));
    assert_eq!(
        published(&cohort.patient("04-CoA")),
        told,
        "the run is as it is without notices"
    );
}

#[test]
fn a_hook_that_fails_hangs_or_is_not_there_leaves_the_run_as_it_is() {
    for (body, word) in [
        (Some("exit 7"), "ended with 7"),
        (Some("sleep 1000"), "killed after"),
        (None, "could not be started"),
    ] {
        let cohort = Cohort::quick_of("01-CoA");
        let hook = body.map_or_else(
            || cohort.path().join("nowhere"),
            |body| script(&cohort, "hook", body),
        );
        notify(
            &cohort,
            &format!(
                "command = [{:?}]\nevents = [\"done\"]\ntime_limit_s = 0.5",
                hook.display()
            ),
        );
        cohort
            .call(&["run", "--no-report"])
            .expect(0)
            .complains_of(&[word, "the run goes on"]);
        cohort.call(&["run", "--no-report"]).expect(0);
    }
}

#[test]
fn settings_that_make_no_sense_are_refused_with_file_and_key() {
    let cohort = Cohort::quick_of("01-CoA");
    notify(&cohort, "mail = [\"nobody\"]\ntime_limit_s = 0");
    cohort.call(&["check"]).expect(1);
    let said = cohort.call(&["run", "--no-report"]).expect(3);
    said.complains_of(&[
        "executor.notices.mail",
        "executor.notices.time_limit_s",
        "name@host",
    ]);
}

//! The page in headless Chromium: clicks, updates, two readers, the end of a run.

use cardiotwin_chromium::{Browser, Look, Page};
use rustix::process::Signal;

use crate::server::Dashboard;
use crate::support::{Cohort, PATIENTS};

const WIDE: Look = Look {
    width: 1300,
    height: 900,
    dark: false,
};
const LAPTOP: Look = Look {
    width: 1000,
    height: 700,
    dark: true,
};

/// The browser, unless none is installed. With `CI` set to `true` there must be one.
fn browser() -> Option<Browser> {
    let found = Browser::find();
    if found.is_none() {
        cardiotwin_not_tested::not_tested(
            "browser",
            "no Chromium in PATH; `make deps` installs it",
        );
    }
    found
}

/// Keeps a picture where `CARDIOTWIN_PICTURES` names a folder.
fn picture(page: &mut Page, name: &str) {
    if let Some(folder) = std::env::var_os("CARDIOTWIN_PICTURES") {
        let file = std::path::Path::new(&folder).join(format!("{name}.png"));
        page.photograph(&file).unwrap();
    }
}

/// Expression for the text of a column in a patient's row.
fn cell(patient: &str, column: &str) -> String {
    format!(
        "document.querySelector('.row[data-name=\"{patient}\"]:not([hidden]) .{column}')?.textContent"
    )
}

#[track_caller]
fn no_complaints(page: &mut Page) {
    let complaints = page.complaints().unwrap();
    assert!(complaints.is_empty(), "{complaints:#?}");
}

/// Whether nothing is wider than the window, and whether heads and cells of the table lie side by side.
const FITS: &str = "(() => { \
    const cells = [...document.querySelectorAll('.row:not([hidden])')].map((row) => [...row.querySelectorAll('.c')] \
      .map((c) => c.getBoundingClientRect()).filter((r) => r.width > 0)); \
    const apart = cells.every((row) => row.every((r, k) => r.right <= innerWidth && (k === 0 || row[k - 1].right <= r.left + 0.5))); \
    return [document.documentElement.scrollWidth <= innerWidth, document.getElementById('page').scrollWidth <= innerWidth, apart]; })()";

/// The page is opened before the run begins, on a phone.
#[test]
fn a_run_that_has_not_begun_is_waited_for_on_a_phone() {
    let Some(browser) = browser() else { return };
    let cohort = Cohort::quick_of("01-CoA");
    let dashboard = Dashboard::start(cohort.path(), &[]);
    let phone = Look {
        width: 390,
        height: 844,
        dark: true,
    };
    let mut page = browser.open(&dashboard.url, phone).unwrap();
    page.wait_for("document.getElementById('coordinator').textContent.includes('has not begun')")
        .unwrap();
    assert_eq!(
        page.value("document.getElementById('trouble').hidden")
            .unwrap(),
        true
    );
    picture(&mut page, "waiting-dark-390");
    cohort.call(&["run"]).expect(0);
    page.wait_for("document.getElementById('coordinator').textContent.startsWith('■ ended')")
        .unwrap();
    page.wait_for(&cell("01-CoA", "state")).unwrap();
    let fits = serde_json::json!([true, true, true]);
    assert_eq!(page.value(FITS).unwrap(), fits);
    picture(&mut page, "ended-dark-390");
    page.click(".row[data-name='01-CoA']").unwrap();
    page.wait_for("document.querySelectorAll('.results svg.plot').length > 5")
        .unwrap();
    assert_eq!(page.value(FITS).unwrap(), fits);
    picture(&mut page, "patient-dark-390");
    no_complaints(&mut page);
}

#[test]
fn a_run_is_followed_to_its_end_by_two_readers() {
    let Some(browser) = browser() else { return };
    let cohort = Cohort::slow();
    let run = cohort.start(&["--workers", "2"]);
    cohort.wait_for_run("run", "two patients", |status| {
        status["patients"]
            .as_array()
            .is_some_and(|all| all.len() == 2)
    });
    let dashboard = Dashboard::start(cohort.path(), &[]);
    let mut one = browser.open(&dashboard.url, WIDE).unwrap();
    let mut other = browser.open(&dashboard.url, LAPTOP).unwrap();
    assert_eq!(
        one.value("location.search").unwrap(),
        "",
        "the token has left the address"
    );
    for page in [&mut one, &mut other] {
        page.wait_for("document.getElementById('coordinator').textContent === '● running'")
            .unwrap();
        for patient in PATIENTS {
            page.wait_for(&cell(patient, "state")).unwrap();
        }
    }

    // Both see the same changes, which come while they look: step 1 takes a second.
    for page in [&mut one, &mut other] {
        for patient in PATIENTS {
            page.wait_for(&format!("{} === 'step-2'", cell(patient, "step")))
                .unwrap();
            page.wait_for(&format!("{} === 'running'", cell(patient, "state")))
                .unwrap();
        }
    }
    picture(&mut one, "running-light-1300");
    picture(&mut other, "running-dark-1000");

    // A click opens a patient: plots of what there is so far, and a log that grows.
    one.click(".row[data-name='01-CoA']").unwrap();
    one.wait_for("document.querySelectorAll('.results svg.plot').length > 5")
        .unwrap();
    assert_eq!(one.value("location.hash").unwrap(), "#/patient/01-CoA");
    // An element that is not there yet has an empty text.
    let now = "(document.querySelector('.now')?.textContent ?? '')";
    let line = one
        .wait_for(&format!(
            "{now}.includes('step-2 at work') && {now}.includes('generation') && {now}"
        ))
        .unwrap();
    one.wait_for(&format!("{now} !== {line}")).unwrap();
    picture(&mut one, "patient-light-1300");
    one.click(".tabs a[href$='/logs']").unwrap();
    let log = "(document.querySelector('.log')?.textContent ?? '')";
    let seen = one.wait_for(log).unwrap();
    one.wait_for(&format!("{log} !== {seen} && {log}.includes('==> step-2')"))
        .unwrap();
    picture(&mut one, "logs-light-1300");

    // The run is stopped while both look, and continues to its end with other settings.
    run.signal(Signal::INT);
    run.signal(Signal::INT);
    run.end().expect(130);
    for page in [&mut one, &mut other] {
        page.wait_for(
            "document.getElementById('coordinator').textContent.includes('no coordinator')",
        )
        .unwrap();
    }
    cohort.edit(
        "cohort.toml",
        "max_generations = 1000000",
        "max_generations = 2",
    );
    cohort.edit("cohort.toml", "popsize = 500", "popsize = 3");
    cohort.edit(
        "cohort.toml",
        "[step2]",
        "workflow.until = \"step2-verification\"\n[step2]",
    );
    cohort.call(&["run", "--yes"]).expect(0);
    for page in [&mut one, &mut other] {
        page.wait_for("document.getElementById('coordinator').textContent === '■ ended, 2 off'")
            .unwrap();
        for patient in PATIENTS {
            assert!(
                page.value(&cell(patient, "patient"))
                    .unwrap()
                    .as_str()
                    .unwrap()
                    .starts_with('▲')
            );
        }
        page.wait_for("document.querySelector('[data-state=off]').textContent === '▲ 2 off'")
            .unwrap();
        no_complaints(page);
    }
    picture(&mut other, "ended-dark-1000");
    assert_eq!(dashboard.interrupt(), 0);
    one.wait_for("document.getElementById('coordinator').textContent.includes('does not answer')")
        .unwrap();
}

#[test]
fn a_patient_beats_and_two_runs_are_compared() {
    let Some(browser) = browser() else { return };
    let cohort = Cohort::quick();
    cohort.call(&["run"]).expect(0);
    cohort
        .call(&["run", "--run-dir", "other", "--set", "step2.seed=4"])
        .expect(0);
    let dashboard = Dashboard::start(cohort.path(), &["--compare", "other"]);
    let mut page = browser.open(&dashboard.url, WIDE).unwrap();

    // Filter, sort, keys.
    page.wait_for(&cell("02-CoA", "state")).unwrap();
    page.press("/").unwrap();
    page.write("02-c").unwrap();
    page.wait_for("document.querySelectorAll('.row:not([hidden])').length === 1")
        .unwrap();
    page.value("(() => { const f = document.getElementById('filter'); f.value = ''; f.dispatchEvent(new Event('input')); f.blur(); })()").unwrap();
    page.click(".c.patient button").unwrap();
    page.click(".c.patient button").unwrap();
    page.wait_for("document.querySelector('.row[aria-rowindex=\"2\"]').dataset.name === '02-CoA'")
        .unwrap();

    // The slider moves a line through the plots over time and a point along the loop.
    page.press("j").unwrap();
    page.wait_for("document.querySelectorAll('.results svg.plot .at circle').length > 4")
        .unwrap();
    page.wait_for("location.hash === '#/patient/02-CoA'")
        .unwrap();
    let at_slider = |page: &mut Page, time: u32| {
        page.value(&format!(
            "(() => {{ const s = document.querySelector('.beat input'); s.value = {time}; s.dispatchEvent(new Event('input')); }})()"
        )).unwrap();
        let loop_point = "(() => { const p = [...document.querySelectorAll('svg.plot')].find((p) => p.dataset.read === 'near').querySelector('.at circle'); \
             return [Number(p.getAttribute('cx')), Number(p.getAttribute('cy'))]; })()";
        page.value(loop_point).unwrap()
    };
    let diastole = at_slider(&mut page, 5);
    let systole = at_slider(&mut page, 250);
    assert!(
        systole[1].as_f64().unwrap() < diastole[1].as_f64().unwrap() - 20.0,
        "the pressure rises: {diastole} {systole}"
    );
    let told = page
        .value("document.querySelector('.told').textContent")
        .unwrap();
    assert!(
        told.as_str().unwrap().starts_with("250 ms") && told.as_str().unwrap().contains("mmHg"),
        "{told}"
    );
    page.click(".play").unwrap();
    page.wait_for("Number(document.querySelector('.beat input').value) !== 250")
        .unwrap();
    page.click(".play").unwrap();
    picture(&mut page, "beat-light-1300");
    page.look(LAPTOP).unwrap();
    picture(&mut page, "beat-dark-1000");
    page.press("Escape").unwrap();
    page.wait_for("document.body.dataset.page === 'cohort'")
        .unwrap();

    // Another seed of step 2 gives another cell.
    page.click("[data-page=compare]").unwrap();
    page.wait_for("document.querySelector('#page .row:not([hidden]) .quantity')?.textContent")
        .unwrap();
    let told = page
        .value("document.querySelector('#page [role=status]').textContent")
        .unwrap();
    assert!(
        told.as_str().unwrap().contains("quantities differ"),
        "{told}"
    );
    let quantities = page.value("[...document.querySelectorAll('#page .row:not([hidden]) .quantity')].map((q) => q.textContent)").unwrap();
    let quantities = quantities.as_array().unwrap();
    assert!(
        quantities
            .iter()
            .all(|q| !q.as_str().unwrap().starts_with("step-1")),
        "{quantities:?}"
    );
    picture(&mut page, "compare-dark-1000");
    no_complaints(&mut page);
}

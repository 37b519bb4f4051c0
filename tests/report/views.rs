//! One view at a time: the cohort or a part of a patient, chosen by the address, each a few screens
//! high; everything without scripts and on paper.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_report::html::preparation::{BeatLines, RecordingLines, preparation_page};
use cardiotwin_report::html::{Pages, write_report};
use cardiotwin_schemas::preparation::{BeatsFound, Preparation};
use cardiotwin_schemas::record::{RunRecord, Step3Ending, Step3Summary};
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::{fixture, html, in_3d, seven, words};

/// Width of the window in which heights are measured, and its height, px.
const DESK: (u32, u32) = (1280, 900);
const PHONE: (u32, u32) = (390, 844);
/// Largest height of a view, px.
const HIGHEST: f64 = 4000.0;
/// Largest height of the cohort's view with seven patients: about three screens, px.
const COHORT: f64 = 3000.0;

/// Two patients with everything that a 3D patient can show, and a step 3 that moved the cell.
fn full(folder: &Path) -> RunRecord {
    let mut run = in_3d::run(folder);
    for patient in &mut run.patients {
        let moved = [
            ("Ca_res_uM", 0.1),
            ("Ca_max_uM", 0.62),
            ("tau_CR_ms", 80.0),
            ("tau_CD_ms", 90.0),
            ("TRPN50", 0.5),
            ("R_AV_f_mmHg_s_per_mL", 0.01),
        ];
        patient.step3 = Some(Step3Summary {
            ending: Step3Ending::NoPromise,
            best_iteration: 0,
            misfit: 12.5,
            parameters: moved.map(|(name, value)| (name.to_owned(), value)).into(),
        });
    }
    run
}

fn written(run: &RunRecord, folder: &Path) -> PathBuf {
    let out = folder.join("report.html");
    write_report(run, None, Pages::All, &out).unwrap();
    out
}

/// Script that goes to every view and every part, and returns the address, height and width of each.
const HEIGHTS: &str = r##"
const found = [];
const all = ["#top", ...[...document.querySelectorAll(".parts a")].map((a) => a.hash)];
for (const address of all) {
  const came = new Promise((done) => addEventListener("hashchange", () => setTimeout(done, 20), { once: true }));
  location.hash = address;
  await came;
  const shown = [...document.querySelectorAll("main > .view")].filter((v) => !v.hidden);
  const page = document.documentElement;
  found.push({ address, shown: shown.map((v) => v.id), parts: document.querySelectorAll(".view:not([hidden]) > .part:not([hidden])").length,
    height: page.scrollHeight, wide: page.scrollWidth - innerWidth });
}
return found;
"##;

#[test]
fn every_view_is_a_few_screens_high() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let many = written(&fixture::cohort(folder.path()), folder.path());
    let seven = browser.measure(&many, "#01-CoA/step-1", DESK, HEIGHTS);
    let other = tempfile::tempdir().unwrap();
    let full = written(&full(other.path()), other.path());
    let full = browser.measure(&full, "#01-CoA/step-1", DESK, HEIGHTS);
    for (n, found) in [(7, seven), (2, full)] {
        let found = found.as_array().unwrap().clone();
        assert!(found.len() > 4 * n, "{found:?}");
        for view in &found {
            let height = view["height"].as_f64().unwrap();
            let address = view["address"].as_str().unwrap();
            eprintln!("{height} px  {address}");
            let is_cohort = address == "#top";
            assert!(height <= if is_cohort { COHORT } else { HIGHEST }, "{view}");
            assert_eq!(view["wide"], 0, "{view}");
            let expected = if is_cohort { "cohort" } else { &address[1..7] };
            assert_eq!(view["shown"], json!([expected]));
            assert_eq!(view["parts"], u64::from(!is_cohort), "{view}");
        }
    }
}

/// Functions for the scripts below.
const WHERE: &str = r##"
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
const moved = () => Promise.race([wait(3000), new Promise((done) => addEventListener("hashchange", () => setTimeout(done, 30), { once: true }))]);
const at = () => [[...document.querySelectorAll("main > .view:not([hidden])")].map((v) => v.id).join(),
  document.querySelector(".view:not([hidden]) > .part:not([hidden])")?.dataset.part ?? "", Math.round(scrollY)];
const here = () => [...document.querySelectorAll('[aria-current="page"]')].map((a) => a.textContent.trim());
"##;

fn look(browser: &Browser, file: &Path, fragment: &str, script: &str) -> Value {
    browser.measure(file, fragment, DESK, &format!("{WHERE}{script}"))
}

#[test]
fn the_address_chooses_the_view_and_the_way_back_leads_to_the_same_place() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    for (fragment, view, part) in [
        ("", "cohort", ""),
        ("#patients", "cohort", ""),
        ("#nothing-of-this-name", "cohort", ""),
        ("#02-CoA", "02-CoA", "beat"),
        ("#p-02-CoA", "02-CoA", "beat"),
        ("#03-CoA/numbers", "03-CoA", "numbers"),
    ] {
        let found = look(&browser, &out, fragment, "return at();");
        assert_eq!(
            (&found[0], &found[1]),
            (&json!(view), &json!(part)),
            "{fragment}: {found}"
        );
        assert_eq!(
            found[2] == 0,
            fragment != "#patients",
            "{fragment}: {found}"
        );
    }
    let found = look(
        &browser,
        &out,
        "",
        r##"
        scrollTo({ top: 700, behavior: "instant" });
        const link = document.querySelector('table.cohort a[href="#02-CoA"]');
        let came = moved(); link.click(); await came; const patient = [at(), here(), document.title];
        came = moved(); document.querySelector('.view:not([hidden]) .parts a[data-part="numbers"]').click(); await came; const part = at();
        came = moved(); history.back(); await came; const back = at();
        came = moved(); history.back(); await came; const cohort = [at(), document.title];
        came = moved(); history.forward(); await came; const forward = at();
        const press = async (key) => { came = moved(); document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true })); await came; return at()[0]; };
        const keys = [await press("j"), await press("k"), await press("k"), await press("k"), await press("Escape")];
        return { patient, part, back, cohort, forward, keys };
        "##,
    );
    assert_eq!(
        found["patient"],
        json!([
            ["02-CoA", "beat", 0],
            ["▲ 02-CoA", "Beat"],
            "02-CoA · coa-seven · cardiotwin"
        ]),
        "{found}"
    );
    assert_eq!(found["part"], json!(["02-CoA", "numbers", 0]));
    assert_eq!(found["back"], json!(["02-CoA", "beat", 0]));
    assert_eq!(
        found["cohort"],
        json!([["cohort", "", 700], "coa-seven · cardiotwin"])
    );
    assert_eq!(found["forward"], json!(["02-CoA", "beat", 0]));
    assert_eq!(
        found["keys"],
        json!(["03-CoA", "02-CoA", "01-CoA", "01-CoA", "cohort"])
    );
}

/// A keyboard reaches the parts and opens one, and then the next key continues from the view.
#[test]
fn a_keyboard_opens_a_part() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    let mut page = browser.open(&out, "#02-CoA", DESK);
    page.value("document.querySelector('[id=\"02-CoA\"] .parts a[data-part=\"step-2\"]').focus()")
        .unwrap();
    for kind in ["rawKeyDown", "char", "keyUp"] {
        let key = json!({"type": kind, "key": "Enter", "code": "Enter", "text": "\r", "windowsVirtualKeyCode": 13});
        page.call("Input.dispatchKeyEvent", key).unwrap();
    }
    page.wait_for("!document.getElementById('02-CoA/step-2').hidden")
        .unwrap();
    assert_eq!(page.complaints().unwrap(), [""; 0]);
}

#[test]
fn without_scripts_and_on_paper_every_view_is_there() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (folder, out) = seven();
    let count = "return document.querySelectorAll('.view[hidden], .part[hidden]').length;";
    assert!(look(&browser, &out, "", count).as_u64().unwrap() > 7 * 3);
    assert_eq!(look(&browser, &out, "#all", count), 0);
    let pdf = |name: &str| folder.path().join(name);
    let whole = browser.printed(&out, "#all", &pdf("all.pdf"));
    assert!(whole > 2 * 7, "{whole} sheets");
    for fragment in ["", "#03-CoA", "#03-CoA/numbers"] {
        assert_eq!(
            browser.printed(&out, fragment, &pdf("view.pdf")),
            whole,
            "{fragment}"
        );
    }
    // The markup itself hides nothing, so that a browser without scripts shows everything.
    let page = html(&out);
    let without = page.replace("<script", "<script type=\"text/plain\"");
    std::fs::write(&out, without).unwrap();
    let plain = look(&browser, &out, "", count);
    assert_eq!(plain, 0);
    let height = look(
        &browser,
        &out,
        "",
        "return document.documentElement.scrollHeight;",
    );
    assert!(height.as_u64().unwrap() > 15_000, "{height}");
}

/// Script that returns the height of the letters of every plot and picture in px, the smallest first,
/// and the labels that overlap. Subscripts are smaller, as in print.
const LETTERS: &str = r##"
const [letters, touching] = [[], []];
for (const svg of document.querySelectorAll("svg.plot, svg.heart")) {
  const texts = [...svg.querySelectorAll("text")].filter((text) => text.textContent.trim());
  const boxes = texts.map((text) => text.getBoundingClientRect());
  texts.forEach((text, k) => {
    const at = text.getScreenCTM(), a = boxes[k], name = svg.getAttribute("aria-label");
    letters.push([Math.round(10 * parseFloat(getComputedStyle(text).fontSize) * Math.hypot(at.a, at.b)) / 10, text.textContent, name]);
    // A box is higher than its letters.
    boxes.slice(k + 1).forEach((b, m) => {
      if (a.right > b.left + 1 && b.right > a.left + 1 && a.bottom > b.top + 3 && b.bottom > a.top + 3) touching.push([text.textContent, texts[k + 1 + m].textContent, name]);
    });
  });
}
return { letters: letters.sort((a, b) => a[0] - b[0]), touching };
"##;

fn assert_legible(browser: &Browser, file: &Path, at_least: usize) {
    let phone = browser.measure(file, "#all", PHONE, LETTERS);
    let letters = phone["letters"].as_array().unwrap();
    assert!(letters.len() > at_least, "{}", letters.len());
    assert!(letters[0][0].as_f64().unwrap() >= 10.0, "{}", letters[0]);
    assert_eq!(phone["touching"], json!([]), "on a phone");
    let desk = browser.measure(file, "#all", DESK, LETTERS);
    assert_eq!(desk["touching"], json!([]), "on a desk");
}

#[test]
fn letters_of_plots_are_at_least_ten_pixels_high_on_a_phone_and_apart() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    for run in [full(folder.path()), fixture::cohort(folder.path())] {
        assert_legible(&browser, &written(&run, folder.path()), 300);
    }
}

/// The page of a preparation, with valves that move within a few milliseconds of each other.
#[test]
fn the_page_of_a_preparation_is_legible_too() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let answer = Preparation {
        schema_version: 1,
        id: "P001".into(),
        files: vec![],
        cycle_length_ms: 600.0,
        beats: BeatsFound {
            source: "R wave".into(),
            found: 1,
            kept: 1,
            left_out: vec![],
        },
        steps: vec![],
        warnings: vec![],
        written: vec![],
        patient_toml: String::new(),
    };
    let mean: Vec<(f64, f64)> = (0..=600)
        .map(|t| (f64::from(t), 60.0 + 55.0 * (f64::from(t) / 95.0).sin()))
        .collect();
    let beats = BeatLines {
        kept: vec![mean.clone()],
        mean: mean.clone(),
        band: [mean.clone(), mean.clone()],
        events: vec![
            ("aortic valve opens", 372.0),
            ("aortic valve closes", 380.0),
            ("mitral valve opens", 391.0),
        ],
        ..BeatLines::default()
    };
    let recording = RecordingLines {
        kept: vec![mean.iter().map(|(t, p)| (1e-3 * t, *p)).collect()],
        ..RecordingLines::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("prepare.html");
    std::fs::write(&out, preparation_page(&answer, &recording, &beats, None)).unwrap();
    assert_legible(&browser, &out, 30);
    let wide = "return document.documentElement.scrollWidth - innerWidth;";
    assert_eq!(browser.measure(&out, "", PHONE, wide), 0);
}

/// The edge behind which a table continues is shaded; the shade goes where the table ends.
#[test]
fn a_wide_table_shows_that_it_scrolls() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (folder, out) = seven();
    let mut page = browser.open(&out, "#patients", PHONE);
    let room = "document.querySelector('table.cohort').closest('.scroll')";
    // A place next to the last row, in which the table has no text of its own.
    let place = format!(
        "(() => {{ const room = {room}; room.scrollIntoView({{ block: 'center', behavior: 'instant' }}); room.style.paddingBottom = '20px'; \
         const r = room.getBoundingClientRect(); return [r.right - 2, r.bottom - 10, room.scrollWidth > room.clientWidth]; }})()"
    );
    let at = page.value(&place).unwrap();
    assert_eq!(at[2], true);
    let colour = |page: &mut cardiotwin_chromium::Page, name: &str| {
        let png = folder.path().join(name);
        page.photograph(&png).unwrap();
        pixel(&browser, folder.path(), &png, &at)
    };
    let before = colour(&mut page, "before.png");
    page.value(&format!("{room}.scrollLeft = 1e5")).unwrap();
    page.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        .unwrap();
    let after = colour(&mut page, "after.png");
    assert!(before < 235.0, "no shade: {before}");
    assert!(after > 250.0, "a shade at the table's end: {after}");
}

/// Brightness of a pixel of a picture, 0 to 255.
fn pixel(browser: &Browser, folder: &Path, png: &Path, at: &Value) -> f64 {
    use base64::Engine as _;
    let image = base64::engine::general_purpose::STANDARD.encode(std::fs::read(png).unwrap());
    let page = folder.join("pixel.html");
    std::fs::write(
        &page,
        format!("<!doctype html><body><img src='data:image/png;base64,{image}'></body>"),
    )
    .unwrap();
    let script = format!(
        r##"const image = document.querySelector("img");
        if (!image.complete) await new Promise((done) => image.addEventListener("load", done));
        const canvas = document.createElement("canvas");
        [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
        const context = canvas.getContext("2d");
        context.drawImage(image, 0, 0);
        const [r, g, b] = context.getImageData(Math.round({}), Math.round({}), 1, 1).data;
        return (r + g + b) / 3;"##,
        at[0], at[1]
    );
    browser
        .measure(&page, "", (400, 300), &script)
        .as_f64()
        .unwrap()
}

/// What stays in sight while the page scrolls lies one below the other, and heads of columns do not
/// touch.
#[test]
fn heads_do_not_collide() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let out = written(&full(folder.path()), folder.path());
    let script = r##"
      const boxes = (e) => { const range = document.createRange(); range.selectNodeContents(e); return [...range.getClientRects()]; };
      const wait = (ms) => new Promise((done) => setTimeout(done, ms));
      scrollTo({ top: 500, behavior: "instant" });
      await wait(100);
      const view = document.querySelector(".view:not([hidden])");
      const nav = document.querySelector("body > nav").getBoundingClientRect();
      const stuck = [[...view.querySelectorAll(".parts, .player")].map((e) => e.getBoundingClientRect())].flat();
      const tops = stuck.map((r) => [Math.round(r.top), Math.round(r.bottom)]);
      const touching = [];
      for (const row of document.querySelectorAll("thead tr")) {
        const heads = [...row.cells].map((cell) => [cell.textContent, boxes(cell)]);
        heads.forEach(([name, own], k) => heads.slice(k + 1).forEach(([other, theirs]) => {
          for (const a of own) for (const b of theirs) {
            if (a.width && b.width && a.right > b.left + 0.5 && b.right > a.left + 0.5 && a.bottom > b.top + 0.5 && b.bottom > a.top + 0.5) touching.push([name, other]);
          }
        }));
      }
      return { nav: innerWidth > 960 ? 0 : Math.round(nav.bottom), tops, touching };"##;
    for window in [DESK, PHONE] {
        let beat = browser.measure(&out, "#01-CoA", window, script);
        let tops = beat["tops"].as_array().unwrap();
        assert_eq!(tops.len(), 2, "{beat}");
        assert!(
            tops[0][0].as_i64() >= beat["nav"].as_i64(),
            "{window:?}: {beat}"
        );
        assert!(
            tops[1][0].as_i64() >= tops[0][1].as_i64(),
            "{window:?}: {beat}"
        );
        let all = browser.measure(&out, "#all", window, script);
        assert_eq!(all["touching"], json!([]), "{window:?}");
    }
}

#[test]
fn calcium_and_bounds_are_the_twins() {
    let folder = tempfile::tempdir().unwrap();
    let run = full(folder.path());
    let page = html(&written(&run, folder.path()));
    let text = words(&page);
    for expected in [
        "Twin: Land and Rice models, valves , 2 of 12 on a bound",
        "twin's cell",
        "Calcium : the twin has the solid line",
        // The twin's value and the bounds of its search, which are step 3's.
        "TRPN 50 – 0.5000 0.200 0.500 on the upper bound",
        "R AV,f mmHg·s/mL – 0.01000 0.00100 0.100",
    ] {
        assert!(text.contains(expected), "missing: {expected}");
    }
    let calcium = cardiotwin_report::results::twin::calcium(&run.patients[0]).unwrap();
    let peak = calcium.iter().map(|p| p.1).fold(0.0, f64::max);
    assert!(
        (calcium[0].1 - 0.1).abs() < 1e-12 && (peak - 0.62).abs() < 1e-4,
        "{peak}"
    );
    // Without step 3 the cell is step 2's.
    let mut plain = run;
    plain.patients[0].step3 = None;
    plain.patients[0].organ_fit = None;
    plain.patients.truncate(1);
    assert_eq!(
        cardiotwin_report::results::twin::calcium(&plain.patients[0]),
        None
    );
    let text = words(&html(&written(&plain, folder.path())));
    assert!(text.contains("Step 2: Land and Rice models") && !text.contains("twin's cell"));
}

#[test]
fn the_heart_is_the_twins_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = in_3d::run(folder.path());
    let name = |run: &RunRecord| {
        let page = html(&written(run, folder.path()));
        let rest = page.split("class=\"heart-data\"").nth(1).unwrap();
        let rest = rest.split("data-name=\"").nth(1).unwrap();
        rest.split('"').next().unwrap().to_owned()
    };
    // The verification beat of this patient left no surface.
    assert!(
        name(&run).starts_with("step 1, iteration "),
        "{}",
        name(&run)
    );
    let patient = &mut run.patients[0];
    let with_heart = patient.iterations[0].run.clone().unwrap();
    let verification = patient.verification.as_mut().unwrap();
    verification.artefacts.extend(with_heart.artefacts.clone());
    verification.directory = with_heart.directory.clone();
    assert_eq!(name(&run), "the twin: step 2's verification beat");
    let beat = cardiotwin_schemas::record::Step3IterationRecord {
        number: 1,
        parameters: BTreeMap::new(),
        proposal: None,
        run: Some(with_heart),
        failure: None,
        misfit: Some(1.0),
        verdict: None,
    };
    run.patients[0].step3_iterations = vec![beat];
    run.patients[0].step3 = Some(Step3Summary {
        ending: Step3Ending::NoPromise,
        best_iteration: 1,
        misfit: 1.0,
        parameters: BTreeMap::new(),
    });
    assert_eq!(name(&run), "the twin: step 3, beat 1");
}

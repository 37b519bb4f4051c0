//! The report's scripts in headless Chromium: the heart that beats, the time slider, sorting and
//! filtering of tables, downloads, and the printed summary.

use cardiotwin_report::html::{ONE_FILE, Pages, write_report};
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::{fixture, in_3d, seven};
use cardiotwin_schemas::record::{RunRecord, Step3Ending, Step3Summary};

const WINDOW: (u32, u32) = (1300, 4000);

/// Functions for the scripts below.
const TOOLS: &str = r#"
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
const section = document.querySelector("section.patient");
const slide = (ms) => {
  const slider = section.querySelector(".player input");
  slider.value = ms;
  slider.dispatchEvent(new Event("input"));
};
const saved = async (button) => {
  let blob = null, name = null;
  const [create, click] = [URL.createObjectURL, HTMLAnchorElement.prototype.click];
  URL.createObjectURL = (given) => { blob = given; return create.call(URL, given); };
  HTMLAnchorElement.prototype.click = function () { name = this.download; };
  button.click();
  [URL.createObjectURL, HTMLAnchorElement.prototype.click] = [create, click];
  return { name, type: blob.type, text: await blob.text() };
};
"#;

fn measure(browser: &Browser, file: &std::path::Path, script: &str) -> Value {
    browser.measure(file, "#01-CoA", WINDOW, &format!("{TOOLS}{script}"))
}

/// The run with a step 3 that kept the verification beat, so that all columns are filled.
fn with_step3(mut run: RunRecord) -> RunRecord {
    for patient in run.patients.iter_mut().filter(|p| p.verification.is_some()) {
        patient.step3 = Some(Step3Summary {
            ending: Step3Ending::NoPromise,
            best_iteration: 0,
            misfit: 12.5,
            parameters: std::collections::BTreeMap::new(),
        });
    }
    run
}

#[test]
fn the_heart_beats_turns_and_changes_its_colours() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = in_3d::written();
    assert_eq!(browser.complaints(&out, "#01-CoA dark", WINDOW), [""; 0]);
    let found = measure(
        &browser,
        &out,
        r#"
        const canvas = section.querySelector(".moving canvas");
        if (!canvas) return "no canvas";
        const gl = canvas.getContext("webgl");
        const pixels = () => {
          const all = new Uint8Array(4 * canvas.width * canvas.height);
          gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, all);
          return all;
        };
        const differ = (a, b) => { let n = 0; for (let k = 0; k < a.length; k += 4) n += a[k] !== b[k] || a[k + 3] !== b[k + 3]; return n; };
        slide(0); const relaxed = pixels();
        slide(300); const contracted = pixels();
        slide(0); const again = pixels();
        canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" })); const turned = pixels();
        canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "Home" })); const reset = pixels();
        const select = section.querySelector(".moving select");
        slide(300); select.value = "lambda"; select.dispatchEvent(new Event("change")); const stretched = pixels();
        const count = (all) => { let n = 0; for (let k = 3; k < all.length; k += 4) n += all[k] > 0; return n; };
        const at = Number(section.querySelector(".player input").value);
        section.querySelector(".player .play").click(); for (let k = 0; k < 4; k++) await wait(100);
        return { drawn: count(relaxed), smaller: count(contracted), of: relaxed.length / 4, beat: differ(relaxed, contracted),
          again: differ(relaxed, again), turned: differ(relaxed, turned), reset: differ(relaxed, reset), coloured: differ(contracted, stretched),
          at, later: Number(section.querySelector(".player input").value), pictures: section.querySelectorAll("svg.heart").length };
        "#,
    );
    let n = |key: &str| {
        found[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key} in {found}"))
    };
    let area = n("of");
    assert!(
        n("drawn") > 0.08 * area && n("drawn") < 0.8 * area,
        "{found}"
    );
    assert!(n("smaller") < 0.97 * n("drawn"), "{found}");
    assert!(
        n("beat") > 0.02 * area && n("turned") > 0.02 * area && n("coloured") > 0.02 * area,
        "{found}"
    );
    assert!(
        n("again") < 0.01 * area && n("reset") < 0.01 * area && n("pictures") == 4.0,
        "{found}"
    );
    assert!(n("at") == 300.0 && n("later") != 300.0, "{found}");
}

#[test]
fn without_webgl_the_pictures_stay_and_the_slider_works() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = in_3d::written();
    let page = std::fs::read_to_string(&out).unwrap();
    let without = "<script>HTMLCanvasElement.prototype.getContext = () => null;</script></head>";
    std::fs::write(&out, page.replacen("</head>", without, 1)).unwrap();
    let found = measure(
        &browser,
        &out,
        r#"slide(120);
        return { canvases: document.querySelectorAll("canvas").length, pictures: document.querySelectorAll("svg.heart").length,
          dots: section.querySelectorAll('svg.plot[data-role="loop"] .now circle').length };"#,
    );
    assert_eq!(found["canvases"], 0, "{found}");
    assert_eq!(found["pictures"], 4, "{found}");
    assert!(found["dots"].as_u64().unwrap() >= 2, "{found}");
}

/// The dots on traces and loop are where the traces have these values.
#[test]
fn the_slider_moves_dots_on_traces_and_loop() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    let found = measure(
        &browser,
        &out,
        r#"
        const dot = (role, kind) => { const d = section.querySelector(`svg.plot[data-role="${role}"] .now circle.${kind}`); return [Number(d.getAttribute("cx")), Number(d.getAttribute("cy"))]; };
        const ends = (role, axis) => section.querySelector(`svg.plot[data-role="${role}"]`).dataset[axis].split(",").slice(0, 2).map(Number);
        const area = (role) => section.querySelector(`svg.plot[data-role="${role}"]`).dataset.area.split(",").map(Number);
        const y = (role, py) => { const [lo, hi] = ends(role, "y"), [, , y0, y1] = area(role); return lo + (hi - lo) * (y1 - py) / (y1 - y0); };
        const x = (role, px) => { const [lo, hi] = ends(role, "x"), [x0, x1] = area(role); return lo + (hi - lo) * (px - x0) / (x1 - x0); };
        return [100, 250].map((ms) => { slide(ms);
          return { ms, time: x("pressure", dot("pressure", "step1")[0]), pressure: y("pressure", dot("pressure", "step1")[1]), volume: y("volume", dot("volume", "step1")[1]),
            loop: [x("loop", dot("loop", "step1")[0]), y("loop", dot("loop", "step1")[1])], words: section.querySelector(".player output").textContent }; });
        "#,
    );
    let all = found.as_array().unwrap_or_else(|| panic!("{found}"));
    for at in all {
        let n = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{found}"));
        assert!((n(&at["time"]) - n(&at["ms"])).abs() < 2.0, "{at}");
        assert!((n(&at["pressure"]) - n(&at["loop"][1])).abs() < 2.5, "{at}");
        assert!((n(&at["volume"]) - n(&at["loop"][0])).abs() < 2.5, "{at}");
        let words = at["words"].as_str().unwrap();
        assert!(
            words.starts_with(&format!("{} ms · measured ", at["ms"])),
            "{words}"
        );
        assert!(
            words.contains("step 1") && words.contains("mmHg") && words.contains("mL"),
            "{words}"
        );
    }
    assert_ne!(all[0]["loop"], all[1]["loop"]);
}

#[test]
fn columns_sort_with_missing_values_last_and_patients_are_filtered() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let mut run = fixture::cohort(folder.path());
    run.patients[2].step1 = None;
    write_report(&run, None, Pages::All, &out).unwrap();
    let found = measure(
        &browser,
        &out,
        r#"
        const table = document.querySelector("table.cohort");
        const head = [...table.tHead.rows[1].cells].find((cell) => cell.textContent === "cost");
        const ids = () => [...table.tBodies[0].rows].filter((row) => !row.hidden).map((row) => row.cells[0].textContent);
        const costs = () => [...table.tBodies[0].rows].map((row) => row.cells[3].dataset.value);
        const before = ids();
        const press = () => { head.querySelector("button").click(); return { aria: head.getAttribute("aria-sort"), ids: ids(), costs: costs() }; };
        const [up, down, none] = [press(), press(), press()];
        const box = document.querySelector(".filter input");
        const type = (text) => { box.value = text; box.dispatchEvent(new Event("input")); return ids(); };
        return { before, up, down, none, one: type("05"), nobody: type("nobody"), said: document.querySelector(".filter [role=status]").textContent, all: type("") };
        "#,
    );
    let costs = |which: &str| -> Vec<Option<f64>> {
        let all = found[which]["costs"]
            .as_array()
            .unwrap_or_else(|| panic!("{found}"));
        all.iter()
            .map(|c| c.as_str().unwrap().parse().ok())
            .collect()
    };
    let (up, down) = (costs("up"), costs("down"));
    assert_eq!(
        (up.last(), down.last()),
        (Some(&None), Some(&None)),
        "{found}"
    );
    assert!(up[..6].windows(2).all(|pair| pair[0] <= pair[1]), "{up:?}");
    assert!(
        down[..6].windows(2).all(|pair| pair[0] >= pair[1]),
        "{down:?}"
    );
    assert_eq!(found["up"]["aria"], "ascending");
    assert_eq!(found["down"]["aria"], "descending");
    assert_eq!(
        (&found["none"]["aria"], &found["none"]["ids"]),
        (&Value::Null, &found["before"])
    );
    assert_eq!(found["one"], json!(["05-CoA"]));
    assert_eq!(found["nobody"], json!([]));
    assert!(found["said"].as_str().unwrap().starts_with("0 of 7"));
    assert_eq!(found["all"], found["before"]);
}

#[test]
fn tables_and_plots_are_saved_with_their_values_and_styles() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    let found = measure(
        &browser,
        &out,
        r#"
        const counts = { tables: document.querySelectorAll("main table").length, csv: [...document.querySelectorAll("button.save")].filter((b) => b.textContent === "CSV").length,
          plots: document.querySelectorAll("figure > svg.plot").length, svg: [...document.querySelectorAll("button.save")].filter((b) => b.textContent === "SVG").length };
        return { counts, table: await saved(document.querySelector("table.cohort button.save")), plot: await saved(section.querySelector("figure button.save")) };
        "#,
    );
    let counts = &found["counts"];
    assert!(
        counts["csv"].as_u64() > Some(20) && counts["svg"].as_u64() > Some(20),
        "{counts}"
    );
    assert_eq!(
        (&counts["tables"], &counts["plots"]),
        (&counts["csv"], &counts["svg"])
    );
    let table = found["table"]["text"].as_str().unwrap();
    let mut rows = csv_rows(table);
    let heads = rows.remove(0);
    assert_eq!(
        heads[..4],
        ["patient", "state", "step 1 iterations", "step 1 cost"],
        "{table}"
    );
    assert!(rows.iter().all(|row| row.len() == heads.len()), "{table}");
    assert_eq!(rows.len(), 7 + 3, "{table}");
    assert_eq!((rows[0][0].as_str(), rows[0][2].as_str()), ("01-CoA", "2"));
    let cost: f64 = rows[0][3].parse().unwrap();
    assert!((cost - 0.151_804_050_326).abs() < 1e-9, "unrounded: {cost}");
    assert!(
        !table.contains('\u{2212}') && !table.contains('▲'),
        "{table}"
    );
    assert_eq!(found["table"]["type"], "text/csv;charset=utf-8");

    let plot = found["plot"]["text"].as_str().unwrap();
    assert!(found["plot"]["name"].as_str().unwrap().ends_with(".svg"));
    let document = roxmltree::Document::parse(plot).unwrap();
    let root = document.root_element();
    assert_eq!(
        (root.tag_name().name(), root.attribute("width")),
        ("svg", Some("440"))
    );
    let line = document
        .descendants()
        .find(|node| node.attribute("class") == Some("line step1"))
        .unwrap();
    let style = line.attribute("style").unwrap();
    assert!(
        style.contains("stroke:rgb(0, 114, 178)") && style.contains("fill:none"),
        "{style}"
    );
    assert!(
        !plot.contains("class=\"now\"") && !plot.contains("var(--"),
        "{plot}"
    );
}

/// Rows of a CSV text with quoted cells.
fn csv_rows(text: &str) -> Vec<Vec<String>> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .from_reader(text.as_bytes());
    let row = |row: Result<csv::StringRecord, csv::Error>| {
        row.unwrap().iter().map(str::to_owned).collect()
    };
    reader.records().map(row).collect()
}

#[test]
fn the_summary_prints_on_two_sheets() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    for (name, run) in [
        ("seven", with_step3(fixture::cohort(folder.path()))),
        ("troubled", fixture::troubled(folder.path())),
        ("full", with_step3(fixture::many(folder.path(), ONE_FILE))),
    ] {
        write_report(&run, None, Pages::All, &out).unwrap();
        let sheets = browser.printed(&out, "#summary", &folder.path().join("summary.pdf"));
        assert_eq!(sheets, 2, "{name}");
        let all = browser.printed(&out, "", &folder.path().join("all.pdf"));
        assert!(all > 2, "{name}: {all} sheets");
    }
}

/// At 1300 px, the cohort's tables need no scroll bar.
#[test]
fn all_columns_of_the_cohort_are_visible_at_1300_pixels() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    for run in [
        with_step3(fixture::cohort(folder.path())),
        fixture::troubled(folder.path()),
        in_3d::run(folder.path()),
    ] {
        write_report(&run, None, Pages::All, &out).unwrap();
        let found = browser.measure(
            &out,
            "#all",
            WINDOW,
            r#"const page = document.documentElement;
            const wide = [...document.querySelectorAll(".scroll")].filter((room) => room.closest("details") === null && room.scrollWidth > room.clientWidth);
            return { beyond: page.scrollWidth - innerWidth, wide: wide.map((room) => [room.textContent.slice(0, 60), room.scrollWidth, room.clientWidth]) };"#,
        );
        assert_eq!(found["wide"], json!([]), "{}", run.cohort);
        assert!(
            found["beyond"].as_f64().unwrap() <= 0.0,
            "{}: {found}",
            run.cohort
        );
    }
}

//! The report and the export of a finished run: as files, and in headless Chromium if it is
//! installed.

mod browser;
mod export;
mod fixture;
mod in_3d;
mod interactive;
mod organ_law;
mod traces;
mod views;

use std::path::{Path, PathBuf};

use base64::Engine as _;
use browser::Browser;
use cardiotwin_report::html::{ONE_FILE, Pages, shows, write_report};
use regex::Regex;
use serde_json::Value;

/// Largest size of a patient in the report, plots included. Measured: about 75 kB.
const BYTES_PER_PATIENT: usize = 120_000;

const WIDE: (u32, u32) = (1400, 4200);
const NARROW: (u32, u32) = (500, 3000);

/// Script that returns the box of each plot, and whether its lines have data inside its own area.
const PLOTS: &str = r#"
return [...document.querySelectorAll("svg.plot")].map((svg) => {
  const box = svg.getBoundingClientRect();
  const [x0, x1, y0, y1] = svg.dataset.area.split(",").map(Number);
  const drawn = [...svg.querySelectorAll("path.line, circle.mark, path.cross")].map((e) => {
    const b = e.getBBox();
    return { inside: b.x >= x0 - 5 && b.x + b.width <= x1 + 5 && b.y >= y0 - 5 && b.y + b.height <= y1 + 5,
      length: e.getTotalLength(), visible: getComputedStyle(e).stroke !== "none" || getComputedStyle(e).fill !== "none" };
  });
  const cut = [...svg.querySelectorAll("text")].filter((t) => {
    const r = t.getBoundingClientRect();
    return r.left < box.left - 3 || r.right > box.right + 3 || r.top < box.top - 3 || r.bottom > box.bottom + 3;
  }).map((t) => t.textContent);
  return { alt: svg.getAttribute("aria-label"), x: box.x, y: box.y + scrollY, w: box.width, h: box.height, drawn, cut,
    titles: svg.querySelectorAll("title").length, lines: svg.querySelectorAll("path.line").length };
});
"#;

fn html(path: &Path) -> String {
    std::fs::read_to_string(path).expect("the report was just written")
}

/// Text of the page as a reader sees it, without scripts, styles and tags.
fn words(html: &str) -> String {
    let text = Regex::new(r"(?s)<(script|style)[^>]*>.*?</(script|style)>|<[^>]*>")
        .unwrap()
        .replace_all(html, " ")
        .into_owned();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn seven() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    write_report(&fixture::cohort(folder.path()), None, Pages::All, &out).unwrap();
    (folder, out)
}

fn assert_self_contained(html: &str) {
    let outward = Regex::new(r#"(?i)(src|href|action|data|poster|srcset)\s*=\s*["']?\s*(https?:)?//|url\(\s*["']?\s*(https?:)?//|@import|\bfetch\(|XMLHttpRequest"#).unwrap();
    assert!(
        outward.find(html).is_none(),
        "the page reaches outward: {:?}",
        outward.find(html)
    );
    assert!(
        !html.contains("NaN") && !html.contains(">inf<"),
        "a number that is none"
    );
}

#[test]
fn seven_patients_are_one_self_contained_file_of_bounded_size() {
    let (_folder, out) = seven();
    let page = html(&out);
    assert_self_contained(&page);
    let per_patient = page.len() / 7;
    eprintln!("report: {} bytes, {per_patient} a patient", page.len());
    assert!(
        per_patient < BYTES_PER_PATIENT,
        "{per_patient} bytes a patient"
    );
    for k in 1..=7 {
        assert!(
            page.contains(&format!("id=\"0{k}-CoA\""))
                && page.contains(&format!("href=\"#0{k}-CoA\"")),
            "{k}"
        );
    }
}

#[test]
fn the_report_says_what_happened() {
    let (_folder, out) = seven();
    let text = words(&html(&out));
    for expected in [
        "7 patients: step 1 converged for 6, stalled for 1: 04-CoA (iteration 9 selected); step 2 is verified in the organ for 7, and 0 of these are personalised, with targets that the cell cannot reach for 1.",
        "stalled: best iteration 9",
        "Step 1 stalled, because a simulation failed; iteration 9 of 10 was selected",
        "step 1, iteration 10 failed: the beat diverged at t = 43 ms: volume below zero",
        "step 2, target not reachable: Sa_max 92.6 kPa",
        "estimated: afterload.compliance_mL_per_mmHg = 2.026, fitted to the flow",
        "on the lower bound",
        "on the upper bound",
    ] {
        assert!(text.contains(expected), "missing: {expected}");
    }
}

/// The player marks each line of a beat in the line's colour; without a rule of its own a mark is black,
/// which nobody sees on a dark page.
#[test]
fn each_line_of_a_beat_has_a_colour_for_its_moving_mark() {
    let (_folder, out) = seven();
    let page = html(&out);
    let mut kinds = std::collections::BTreeSet::new();
    for role in ["pressure", "volume", "flow", "loop"] {
        let start = page.find(&format!("data-role=\"{role}\"")).expect(role);
        let svg = &page[start..start + page[start..].find("</svg>").unwrap()];
        for line in svg.split("<path class=\"line ").skip(1) {
            kinds.insert(line.split(['"', ' ']).next().unwrap().to_owned());
        }
    }
    assert!(
        kinds.contains("measured") && kinds.contains("aortic"),
        "{kinds:?}"
    );
    for kind in kinds {
        let rule = format!(".mark.{kind} {{ fill: var(--{kind}); }}");
        assert!(page.contains(&rule), "{rule}");
    }
}

/// Numbers of a row in the table of mean errors.
fn means(text: &str, row: &str) -> Vec<f64> {
    let rest = text
        .split("Mean ± SD of the errors, %")
        .nth(1)
        .expect("the table is there");
    let rest = rest
        .split(row)
        .nth(1)
        .unwrap_or_else(|| panic!("no row {row}"));
    let number = Regex::new(r"(\d+\.\d)( ± \d+\.\d)?").unwrap();
    number
        .captures_iter(rest)
        .take(6)
        .map(|c| c[1].parse().unwrap())
        .collect()
}

#[test]
fn the_papers_patients_have_the_papers_mean_errors() {
    let (_folder, out) = seven();
    let text = words(&html(&out)).replace('\u{2212}', "-");
    // Table 2 prints rounded biomarkers: a rate of 1.2 mmHg/ms has a rounding error of up to 4 %.
    let rows = [
        ("P max", 0.4),
        ("dP/dt max", 1.5),
        ("dP/dt min", 1.5),
        ("PTD 90", 0.2),
        ("SV", 0.6),
    ];
    for (row, rounding) in rows {
        let found = means(&text, row);
        assert!(
            (found[0] - found[3]).abs() <= rounding,
            "step 1, {row}: {found:?}"
        );
        assert!(
            (found[4] - found[5]).abs() <= rounding,
            "step 2, {row}: {found:?}"
        );
    }
}

#[test]
fn patients_in_trouble_say_what_is_missing_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    write_report(&fixture::troubled(folder.path()), None, Pages::All, &out).unwrap();
    let page = html(&out);
    assert_self_contained(&page);
    assert!(page.contains("troubled &lt;&amp;&gt; &quot;quoted&quot;"));
    let text = words(&page);
    for expected in [
        "Only pressure was measured: without a measured volume the valves stay at their first guess",
        "No simulation: no-passive-state failed before step 1 (the unloaded volume 131 mL is larger than the diastasis volume 124 mL)",
        "Remedy: check measured.diastasis in patient.toml",
        "No simulation of this patient succeeded: the beat diverged at t = 81 ms",
        "Step 1 has not finished.",
        "Step 2 has not run yet.",
        "Step 2 did not run because the patient failed earlier.",
        "The verification beat wrote no traces.",
        "has no usable columns `evaluations` and `best_cost`",
        "not-begun ○ waiting",
    ] {
        assert!(text.contains(expected), "missing: {expected}");
    }
    // A patient that has not begun has no step and no time.
    assert!(!text.contains("-0 ms") && !text.contains("-: waiting"));
}

#[test]
fn an_empty_run_is_a_page_too() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = fixture::troubled(folder.path());
    run.patients.clear();
    let out = folder.path().join("report.html");
    write_report(&run, None, Pages::All, &out).unwrap();
    assert!(words(&html(&out)).contains("This run has no patients."));
}

/// A run with nothing to do makes only pages whose patients, or whose neighbours' states, changed.
#[test]
fn pages_are_made_only_where_something_changed() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let mut run = fixture::many(folder.path(), ONE_FILE + 50);
    let paths = write_report(&run, None, Pages::Changed, &out).unwrap();
    let mark = |path: &std::path::PathBuf| {
        let text = std::fs::read_to_string(path).unwrap();
        std::fs::write(path, format!("{text}<!-- kept -->")).unwrap();
    };
    let n_kept = || {
        let is_kept = |path: &&std::path::PathBuf| {
            std::fs::read_to_string(path)
                .unwrap()
                .ends_with("<!-- kept -->")
        };
        paths.patients.iter().filter(is_kept).count()
    };
    let n = run.patients.len();
    assert!(shows(&out, &run.revision, None, n));
    assert!(!shows(&out, "another revision", None, n));
    paths.patients.iter().for_each(mark);
    for patient in &mut run.patients {
        patient.status.for_s += 60.0; // The time since then is no result.
    }
    write_report(&run, None, Pages::Changed, &out).unwrap();
    assert_eq!(n_kept(), run.patients.len());
    run.patients[20].status.note.push_str("changed");
    write_report(&run, None, Pages::Changed, &out).unwrap();
    assert!(
        !std::fs::read_to_string(&paths.patients[20])
            .unwrap()
            .ends_with("<!-- kept -->")
    );
    assert!(n_kept() >= run.patients.len() - 25, "{}", n_kept());
    write_report(&run, None, Pages::All, &out).unwrap();
    assert_eq!(n_kept(), 0);
    std::fs::remove_file(&paths.patients[3]).unwrap();
    assert!(!shows(&out, &run.revision, None, n), "a page is missing");
}

#[test]
fn beyond_fifty_patients_each_has_a_page_and_the_index_leads_there() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let run = fixture::many(folder.path(), ONE_FILE + 1);
    let paths = write_report(&run, None, Pages::All, &out).unwrap();
    assert_eq!(
        (paths.main.as_path(), paths.patients.len()),
        (out.as_path(), ONE_FILE + 1)
    );
    let link = Regex::new(r##"href="([^"#]+\.html)""##).unwrap();
    for page in std::iter::once(&out).chain(&paths.patients) {
        let text = html(page);
        assert_self_contained(&text);
        let folder = page.parent().unwrap();
        assert!(
            link.captures_iter(&text)
                .all(|c| folder.join(&c[1]).is_file()),
            "a link of {} leads nowhere",
            page.display()
        );
    }
    let index = html(&out);
    assert!(paths.patients.iter().all(|p| index.contains(&format!(
        "href=\"report-patients/{}\"",
        p.file_name().unwrap().to_string_lossy()
    ))));
    assert!(!index.contains("<section class=\"patient\""));
}

#[test]
fn every_plot_is_drawn_inside_its_area_and_nothing_complains() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    for fragment in ["", "#dark"] {
        assert_eq!(browser.complaints(&out, fragment, WIDE), [""; 0]);
    }
    for window in [WIDE, NARROW] {
        let plots = browser.measure(&out, "#all", window, PLOTS);
        let plots = plots.as_array().unwrap();
        // 2 plots of the cohort and 7 small ones; per patient 4 of the beat, 7 of step 1 and 4 of
        // the cell.
        assert_eq!(plots.len(), 2 + 7 + 7 * 15);
        for plot in plots {
            let drawn = plot["drawn"].as_array().unwrap();
            assert!(!drawn.is_empty(), "nothing drawn: {}", plot["alt"]);
            let fine = |d: &Value| {
                d["inside"] == true && d["visible"] == true && d["length"].as_f64().unwrap() > 5.0
            };
            assert!(drawn.iter().all(fine), "{plot}");
            assert!(
                plot["w"].as_f64().unwrap() > 150.0 && plot["h"].as_f64().unwrap() > 90.0,
                "{plot}"
            );
            assert_eq!(
                plot["cut"].as_array().unwrap().len(),
                0,
                "text leaves its plot: {plot}"
            );
            assert!(
                plot["titles"].as_u64() >= plot["lines"].as_u64(),
                "a line without a name: {plot}"
            );
        }
    }
}

#[test]
fn a_screenshot_shows_every_line_in_both_themes() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (folder, out) = seven();
    // Colours of the style sheet: measured, step 1, step 2.
    let light = [[0x1c, 0x21, 0x27], [0x00, 0x72, 0xb2], [0xd5, 0x5e, 0x00]];
    let dark = [[0xf2, 0xf4, 0xf6], [0x56, 0xb4, 0xe9], [0xff, 0x9d, 0x4d]];
    for (theme, background, colours) in [
        ("#all", [255, 255, 255], light),
        ("#all dark", [0x15, 0x18, 0x1c], dark),
    ] {
        let png = folder.path().join("screen.png");
        let mut page = browser.open(&out, theme, WIDE);
        page.photograph(&png).unwrap();
        let plots = browser.measure(&out, theme, WIDE, PLOTS);
        let seen = colours_in(&browser, folder.path(), &png, &plots, background, &colours);
        let traces: Vec<&Value> = seen
            .iter()
            .filter(|p| p["alt"].as_str().unwrap().contains("01-CoA"))
            .collect();
        // The last plot with such a name is the patient's own, the first is the small one of the
        // overview.
        for part in ["pressure of", "volume of", "pressure-volume loop of"] {
            let plot = traces
                .iter()
                .rfind(|p| p["alt"].as_str().unwrap().starts_with(part))
                .unwrap_or_else(|| panic!("{part}: {seen:?}"));
            let found: Vec<u64> = plot["found"]
                .as_array()
                .unwrap()
                .iter()
                .map(|n| n.as_u64().unwrap())
                .collect();
            assert!(
                found.iter().all(|n| *n > 60),
                "{theme} {part}: pixels of measured, step 1, step 2: {found:?}"
            );
        }
        for plot in &seen {
            assert!(
                plot["distinct"].as_u64().unwrap() > 20,
                "{theme}: an empty plot: {plot}"
            );
            assert!(
                plot["background"].as_f64().unwrap() > 0.4,
                "{theme}: the page's background is missing: {plot}"
            );
        }
        assert!(seen.len() > 12, "{}", seen.len());
    }
}

/// Counts colours in the plots' boxes of a screenshot. The browser itself decodes the image.
fn colours_in(
    browser: &Browser,
    folder: &Path,
    png: &Path,
    plots: &Value,
    background: [u8; 3],
    colours: &[[u8; 3]; 3],
) -> Vec<Value> {
    let page = folder.join("colours.html");
    let image = base64::engine::general_purpose::STANDARD.encode(std::fs::read(png).unwrap());
    std::fs::write(
        &page,
        format!("<!doctype html><meta charset=utf-8><body><img src='data:image/png;base64,{image}'></body>"),
    )
    .unwrap();
    let script = format!(
        r#"const image = document.querySelector("img");
        if (!image.complete) await new Promise((done) => image.addEventListener("load", done));
        const canvas = document.createElement("canvas");
        const [width, height] = [canvas.width = image.naturalWidth, canvas.height = image.naturalHeight];
        const context = canvas.getContext("2d", {{ willReadFrequently: true }});
        context.drawImage(image, 0, 0);
        const {{ data }} = context.getImageData(0, 0, width, height);
        const near = (i, c) => Math.abs(data[i] - c[0]) < 24 && Math.abs(data[i + 1] - c[1]) < 24 && Math.abs(data[i + 2] - c[2]) < 24;
        return {plots}.filter((p) => p.y + p.h < height).map((p) => {{
          const found = [0, 0, 0], distinct = new Set();
          let background = 0, all = 0;
          for (let y = Math.ceil(p.y); y < p.y + p.h; y++) for (let x = Math.ceil(p.x); x < p.x + p.w; x++) {{
            const i = 4 * (y * width + x);
            all++;
            if (near(i, {background:?})) {{ background++; continue; }}
            distinct.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
            {colours:?}.forEach((c, k) => {{ if (near(i, c)) found[k]++; }});
          }}
          return {{ alt: p.alt, found, distinct: distinct.size, background: background / all }};
        }});"#
    );
    let found = browser.measure(&page, "", (400, 300), &script);
    found
        .as_array()
        .unwrap_or_else(|| panic!("the screenshot cannot be read: {found}"))
        .clone()
}

#[test]
fn nothing_but_tables_is_wider_than_a_narrow_screen() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    let script = r#"return { inner: innerWidth, page: document.documentElement.scrollWidth,
      scrolling: [...document.querySelectorAll(".scroll")].filter((e) => e.scrollWidth > e.clientWidth).length };"#;
    let found = browser.measure(&out, "#all", NARROW, script);
    assert!(
        found["page"].as_u64().unwrap() <= found["inner"].as_u64().unwrap(),
        "{found}"
    );
    assert!(
        found["scrolling"].as_u64().unwrap() > 0,
        "the cohort table does not fit, so it has to scroll: {found}"
    );
}

#[test]
fn values_are_read_off_under_the_pointer_and_the_theme_switches() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = seven();
    let script = r#"
      const svg = [...document.querySelectorAll("svg.plot")].find((s) => s.getAttribute("aria-label") === "pressure of 01-CoA over time");
      svg.scrollIntoView({ behavior: "instant" });
      const r = svg.getBoundingClientRect();
      svg.dispatchEvent(new PointerEvent("pointermove", { clientX: r.x + r.width / 2, clientY: r.y + r.height / 2 }));
      const text = document.getElementById("readout").innerText;
      const background = () => getComputedStyle(document.body).backgroundColor;
      const before = background();
      document.querySelector(".theme").click();
      return { text, hidden: document.getElementById("readout").hidden, before, after: background() };"#;
    let found = browser.measure(&out, "#01-CoA", WIDE, script);
    let text = found["text"].as_str().unwrap();
    assert_eq!(found["hidden"], false);
    assert!(
        text.contains(" ms")
            && text.contains("measured: ")
            && text.contains("step 1, iteration 2: ")
            && text.contains("mmHg"),
        "{text}"
    );
    assert_eq!(
        (&found["before"], &found["after"]),
        (
            &Value::from("rgb(255, 255, 255)"),
            &Value::from("rgb(21, 24, 28)")
        )
    );
}

//! The page around the content: head, style, navigation, script; its file.

use std::path::Path;

use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::cohort::Link;
use super::organ_3d;
use super::patient::badge;
use crate::results::{WriteError, atomic};

const CSS: &str = include_str!("report.css");
/// Script of all pages.
pub const JS: &str = include_str!("report.js");
/// Scripts that add to it: one view at a time, sorting and downloads, time slider. They stand alone, so
/// that one that fails leaves the others.
const VIEWS_JS: &str = include_str!("views.js");
const TABLES_JS: &str = include_str!("tables.js");
const PLAYER_JS: &str = include_str!("player.js");
/// Viewer of the beating heart, which defines `cardiotwinHeart`.
pub const HEART_JS: &str = include_str!("heart.js");
/// Script that sets the theme before anything is drawn, so that a dark page never flashes white.
/// `#dark` and `#light` in the address override the stored theme.
const THEME_JS: &str = "(function(){var h=location.hash.slice(1),t=h==='dark'||h==='light'?h:null;\
try{t=t||localStorage.getItem('cardiotwin-theme')}catch(e){}if(t)document.documentElement.dataset.theme=t})()";

/// Script that keeps the page empty until it is known which view is shown, so that no other one flashes.
const LOADING_JS: &str = "document.documentElement.dataset.views='loading';\
addEventListener('DOMContentLoaded',function(){delete document.documentElement.dataset.views})";

/// The style sheet of a page.
fn style(content: &Markup) -> String {
    // The colours of the heart are only needed by pages with a picture of it.
    sheet(content.0.contains("class=\"heart\""))
}

/// The style sheet, with the colours of the heart or without. Its dark colours are in two rules: one
/// for the system's preference and one for the reader's choice.
#[must_use]
pub fn sheet(with_heart: bool) -> String {
    let mark = ("/* dark colours */", "/* end */");
    let dark = CSS
        .split(mark.0)
        .nth(1)
        .and_then(|rest| rest.split(mark.1).next())
        .unwrap_or_default();
    let by_system = format!(
        "@media screen and (prefers-color-scheme: dark) {{ :root:not([data-theme=\"light\"]) {{{dark}}} }}"
    );
    let hearts = if with_heart {
        organ_3d::css()
    } else {
        String::new()
    };
    format!("{CSS}\n{by_system}\n{hearts}")
}

/// A whole page with navigation and content.
#[must_use]
pub fn page(title: &str, nav: &Markup, content: &Markup) -> Markup {
    let has_views = content.0.contains("class=\"view") || content.0.contains(" view\"");
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                link rel="icon" href="data:,";
                style { (PreEscaped(style(content))) }
                script { (PreEscaped(THEME_JS)) }
                @if has_views { script { (PreEscaped(LOADING_JS)) } }
            }
            body {
                (nav)
                main { (content) }
                @if has_views { script { (PreEscaped(VIEWS_JS)) } }
                script { (PreEscaped(JS)) }
                script { (PreEscaped(TABLES_JS)) }
                @if content.0.contains("class=\"heart-data\"") { script { (PreEscaped(HEART_JS)) } }
                @if content.0.contains("class=\"player\"") { script { (PreEscaped(PLAYER_JS)) } }
            }
        }
    }
}

/// Navigation that stays in sight: the cohort with its sections, followed by the patients with a sign
/// for their state.
///
/// - `sections`: anchor and title of each section of the cohort's view, shown while that view is
#[must_use]
pub fn nav(
    run: &RunRecord,
    home: &str,
    sections: &[(&str, &str)],
    patients: &[PatientRecord],
    link: Link,
) -> Markup {
    html! {
        nav aria-label="patients" {
            div.navhead {
                a.home href=(home) { (run.cohort) }
                button.theme type="button" title="light or dark" aria-label="switch between light and dark" { "◐" }
            }
            @if !sections.is_empty() {
                ol.sections { @for (anchor, title) in sections { li { a href={ "#" (anchor) } { (title) } } } }
            }
            ol {
                @for p in patients {
                    @let (class, sign, words) = badge(p);
                    li { a href=(link(p)) title=(words) { span class={ "sign " (class) } aria-hidden="true" { (sign) } " " (p.plan.id) } }
                }
            }
            @if !sections.is_empty() { a.everything href="#all" title="all views on one page, to search or to print" { "everything" } }
        }
    }
}

/// Writes a page, whole or not at all.
pub(super) fn write(file: &Path, page: &Markup) -> Result<(), WriteError> {
    atomic::replace(file, |out| out.write_all(page.0.as_bytes())).map_err(WriteError::file(file))
}

//! Parts of a search's findings that only a page shows.

use cardiotwin_schemas::discover::DiscoverCase;
use maud::{Markup, html};

use crate::results::discovery::words::{missing, plain, split_unit};
use crate::table::{Column, Kind, Table, cells};

/// The findings in a few words.
#[must_use]
pub fn verdict(case: &DiscoverCase) -> String {
    match missing(&case.found, plain).as_str() {
        "none" => "nothing is missing".to_owned(),
        words => words.to_owned(),
    }
}

/// Measured biomarkers and those before and after.
#[must_use]
pub fn biomarkers(case: &DiscoverCase) -> Table {
    let numbers = ["measured", "before", "after"].map(Column::numbers);
    let columns = std::iter::once(Column::new("biomarker", Kind::Keys)).chain(numbers);
    let mut table = Table::new("biomarkers", "Biomarkers", columns);
    for row in &case.found.biomarkers {
        let cells = cells![row.name.as_str(), row.measured, row.before, row.after];
        table.rows.push(cells);
    }
    table
}

/// Indices of heart and vessels before and after; without rows if no effect is accepted.
#[must_use]
pub fn indices(case: &DiscoverCase) -> Table {
    let columns = [
        Column::words("index"),
        Column::words("unit"),
        Column::numbers("before"),
        Column::numbers("after"),
    ];
    let mut table = Table::new("indices", "Indices of the fitted heart", columns);
    let rows = case.found.indices.iter();
    for row in rows.filter(|_| !case.found.findings.none) {
        let (label, unit) = split_unit(&row.name);
        let cells = cells![plain(label), unit, row.before, row.after];
        table.rows.push(cells);
    }
    table
}

/// List of effects that cannot be told apart, measurements that would decide, effects that these
/// data cannot show, and variables on which an unexplained gap depends.
#[must_use]
pub fn lists(case: &DiscoverCase) -> Markup {
    let found = &case.found;
    let names = |list: &[String]| {
        list.iter()
            .map(|name| plain(name))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let without = |name: &String| {
        let entry = found
            .findings
            .not_identifiable_without
            .iter()
            .find(|n| n.name == *name);
        let data = entry.map_or(String::new(), |n| n.would_show.join("; "));
        if data.is_empty() {
            plain(name)
        } else {
            format!("{} ({data})", plain(name))
        }
    };
    let mut rows = vec![
        (
            "Hard to tell from, though preferred",
            names(&found.findings.confusable),
        ),
        (
            "Deciding measurement",
            found.findings.deciding_measurement.join("; "),
        ),
        (
            "Not identifiable from these data",
            found
                .findings
                .not_identifiable
                .iter()
                .map(without)
                .collect::<Vec<_>>()
                .join(", "),
        ),
    ];
    for class in &found.findings.classes {
        rows.push(("Not told apart by these data", names(&class.effects)));
    }
    if let Some(gap) = (found.findings.unexplained.as_ref()).or(found.findings.remaining.as_ref()) {
        let depends = gap.depends_on.iter().map(|d| {
            format!(
                "{} on {} ({:.0} %)",
                d.signal,
                plain(&d.variable),
                100.0 * d.share
            )
        });
        rows.push((
            "Dependence of the gap that no effect explains",
            depends.collect::<Vec<_>>().join(", "),
        ));
    }
    for effect in found
        .findings
        .effects
        .iter()
        .filter(|effect| found.findings.accepted.contains(&effect.name))
    {
        rows.extend(effect.remedy.clone().map(|remedy| ("To do", remedy)));
    }
    rows.retain(|(_, text)| !text.is_empty());
    html! { @if !rows.is_empty() { ul.notes { @for (label, text) in &rows { li { span { b { (label) ": " } (text) } } } } } }
}

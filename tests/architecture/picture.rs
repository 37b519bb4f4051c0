//! The picture of the house in `docs/architecture.md`: crates in storeys, made from the table of crates.

use std::collections::BTreeMap;

/// Crates in storeys, the highest first: each crate imports only crates of storeys below its own.
pub fn storeys(table: &[(String, Vec<String>)]) -> String {
    let rows: BTreeMap<&str, &[String]> = table
        .iter()
        .map(|(who, may)| (who.as_str(), may.as_slice()))
        .collect();
    let heights: Vec<usize> = table.iter().map(|(who, _)| height(who, &rows)).collect();
    let highest = heights.iter().copied().max().unwrap_or(0);
    let row = |storey| {
        let crates = table.iter().zip(&heights).filter(|(_, at)| **at == storey);
        let names: Vec<&str> = crates.map(|((who, _), _)| who.as_str()).collect();
        format!("{storey} │ {}\n", names.join("   "))
    };
    (0..=highest).rev().map(row).collect()
}

/// One more than the highest crate that `who` imports; Cargo refuses circles.
fn height(who: &str, rows: &BTreeMap<&str, &[String]>) -> usize {
    let may = rows
        .get(who)
        .unwrap_or_else(|| panic!("no row for crate {who}"));
    may.iter()
        .map(|other| 1 + height(other, rows))
        .max()
        .unwrap_or(0)
}

//! The picture of the house in `docs/architecture.md`: crates in storeys, made from the table of rules.

use std::collections::BTreeMap;

use crate::table::Rule;

/// Crates in storeys, the highest first: each crate imports only crates of storeys below its own.
pub fn storeys(crates: &[Rule]) -> String {
    let mut height = BTreeMap::new();
    for rule in crates {
        height_of(rule.who, crates, &mut height);
    }
    let highest = height.values().copied().max().unwrap_or(0);
    (0..=highest)
        .rev()
        .map(|storey| {
            let of_storey: Vec<&str> = crates
                .iter()
                .map(|rule| rule.who)
                .filter(|who| height[who] == storey)
                .collect();
            format!("{storey} │ {}\n", of_storey.join("   "))
        })
        .collect()
}

/// One more than the highest crate that `who` may import; a circle would not end.
fn height_of(
    who: &'static str,
    crates: &[Rule],
    height: &mut BTreeMap<&'static str, usize>,
) -> usize {
    if let Some(known) = height.get(who) {
        return *known;
    }
    let rule = crates
        .iter()
        .find(|rule| rule.who == who)
        .unwrap_or_else(|| panic!("no row for crate {who}"));
    let found = rule
        .may
        .iter()
        .map(|other| 1 + height_of(other, crates, height))
        .max()
        .unwrap_or(0);
    height.insert(who, found);
    found
}

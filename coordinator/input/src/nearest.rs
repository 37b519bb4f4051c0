//! Search for the known word nearest to an unknown one.

/// The nearest of `known`; `None` if none is similar enough to be meant.
#[must_use]
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |text: &str| text.to_lowercase().replace(['-', '_'], "");
    let wanted = plain(word);
    known
        .into_iter()
        .map(|candidate| {
            let candidate_plain = plain(candidate);
            // Most often the unit is missing from a name: `P_max` for `P_max_mmHg`.
            let distance = if wanted.len() >= 3 && candidate_plain.starts_with(&wanted) {
                1
            } else {
                edit_distance(&wanted, &candidate_plain)
            };
            (distance, candidate)
        })
        .min()
        .filter(|(distance, _)| *distance <= 1 + wanted.chars().count() / 4)
        .map(|(_, candidate)| candidate)
}

/// Number of insertions, deletions, substitutions and swaps of neighbours between `a` and `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    let a: Vec<char> = a.chars().collect();
    let b: Vec<char> = b.chars().collect();
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in rows.iter_mut().enumerate() {
        row[0] = i;
    }
    for (j, cell) in rows[0].iter_mut().enumerate() {
        *cell = j;
    }
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let substitute = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = substitute.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = best;
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_find_the_key_and_strangers_do_not() {
        let known = ["tolerance", "damping", "max_iterations", "P_max_mmHg"];
        assert_eq!(nearest("toleranse", known), Some("tolerance"));
        assert_eq!(nearest("max-iteration", known), Some("max_iterations"));
        assert_eq!(nearest("dampnig", known), Some("damping"));
        assert_eq!(nearest("p_max", known), Some("P_max_mmHg"));
        assert_eq!(nearest("colour", known), None);
    }
}

//! Search for the known word nearest to an unknown one.

use strsim::osa_distance;

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
                osa_distance(&wanted, &candidate_plain)
            };
            (distance, candidate)
        })
        .min()
        .filter(|(distance, _)| *distance <= 1 + wanted.chars().count() / 4)
        .map(|(_, candidate)| candidate)
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

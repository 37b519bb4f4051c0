//! Tags of passive tissues that have moduli of their own.

use std::collections::BTreeSet;

use cardiotwin_mesh::tags;
use cardiotwin_schemas::muscle::PassiveTissues;

use crate::finite_element::FiniteElementError;

/// Tag of the first of these tissues in our mesh, whose other tags are all smaller.
const FIRST: i32 = 1000;

/// Checks that all named tags exist.
///
/// - `passive`: tags of the mesh's passive tissue, possibly repeated
///
/// # Errors
/// [`FiniteElementError::PassiveTag`] for the first tag that does not exist.
pub(super) fn check(
    named: &PassiveTissues,
    passive: impl Iterator<Item = i32>,
) -> Result<(), FiniteElementError> {
    let mut passive: Vec<i32> = passive.collect();
    passive.sort_unstable();
    passive.dedup();
    match named.keys().find(|tag| !passive.contains(tag)) {
        Some(&tag) => Err(FiniteElementError::PassiveTag { tag, passive }),
        None => Ok(()),
    }
}

/// Our tag for passive tissue with the tag `tag` in a patient's own mesh.
///
/// - `beside`: tags of tissue that does not belong to the left ventricle's base, see
///   [`tags::BESIDE`]
pub(super) fn ours(named: &PassiveTissues, beside: &BTreeSet<i32>, tag: i32) -> i32 {
    let place = named.keys().zip(FIRST..).find(|(named, _)| **named == tag);
    match (place, beside.contains(&tag)) {
        (None, false) => tags::AORTIC_ROOT,
        (None, true) => tags::BESIDE,
        (Some((_, ours)), false) => ours,
        (Some((_, ours)), true) => tags::BESIDE + ours,
    }
}

/// The named tissues by our tags.
pub(super) fn renamed(named: &PassiveTissues, beside: &BTreeSet<i32>) -> PassiveTissues {
    named
        .iter()
        .map(|(tag, tissue)| (ours(named, beside, *tag), *tissue))
        .collect()
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::muscle::PassiveTissueSettings;

    use super::*;

    #[test]
    fn tags_are_checked_and_made_ours() {
        let tissue = |mu_kpa| PassiveTissueSettings {
            mu_kpa,
            kappa_kpa: 100.0,
        };
        let named = PassiveTissues::from([(1, tissue(3.0)), (7, tissue(9.0))]);
        assert!(check(&named, [7, 1, 9, 7].into_iter()).is_ok());
        let missing = check(&named, [9, 1, 9].into_iter()).unwrap_err();
        assert_eq!(
            missing.to_string(),
            "solver.finite_element.wall.passive.7: the mesh has no passive tissue with this tag, expected one of 1, 9"
        );
        // A passive tag of the file may equal our tag of muscle.
        let none = BTreeSet::new();
        assert_eq!(
            [1, 7, 9].map(|tag| ours(&named, &none, tag)),
            [1000, 1001, tags::AORTIC_ROOT]
        );
        assert_eq!(
            renamed(&named, &none),
            PassiveTissues::from([(1000, tissue(3.0)), (1001, tissue(9.0))])
        );
        // Tissue of the right ventricle stays distinct from tissue of the base, with or without
        // moduli of its own.
        let beside = BTreeSet::from([7, 9]);
        let apart = [1, 7, 9, 11].map(|tag| ours(&named, &beside, tag));
        assert_eq!(
            apart,
            [1000, tags::BESIDE + 1001, tags::BESIDE, tags::AORTIC_ROOT]
        );
        assert_eq!(renamed(&named, &beside)[&apart[1]], tissue(9.0));
    }
}

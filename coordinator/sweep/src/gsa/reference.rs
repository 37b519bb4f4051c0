//! Results of others for the published settings: the paper's nine parameters, and an independent
//! reference.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use cardiotwin_schemas::sensitivity::{PaperRank, ReferenceRank};
use serde::Deserialize;

/// Content of `reference.json`, which also names its source.
#[derive(Debug, Clone, Deserialize)]
struct Reference {
    /// The paper's nine parameters; with a rank if section 3.1 states it.
    paper_ranks: BTreeMap<String, Option<u32>>,
    /// Sum of total indices by parameter.
    sums_of_totals: BTreeMap<String, f64>,
}

static REFERENCE: LazyLock<Reference> = LazyLock::new(|| {
    serde_json::from_str(include_str!("reference.json")).expect("the committed reference is JSON")
});

/// Rank of a parameter in the independent reference; `None` if it was not swept there.
#[must_use]
pub fn rank(name: &str) -> Option<ReferenceRank> {
    let sums = &REFERENCE.sums_of_totals;
    let sum_of_totals = *sums.get(name)?;
    let rank = 1 + sums
        .values()
        .filter(|other| **other > sum_of_totals)
        .count() as u32;
    Some(ReferenceRank {
        rank,
        sum_of_totals,
    })
}

/// Rank of a parameter in the paper.
#[must_use]
pub fn paper(name: &str) -> PaperRank {
    let rank = REFERENCE.paper_ranks.get(name);
    PaperRank {
        among_first_nine: rank.is_some(),
        rank: rank.copied().flatten(),
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::cell::cell_intervals;

    use super::*;

    #[test]
    fn every_swept_parameter_has_a_reference_and_nine_are_the_paper_s() {
        let mut ranks: Vec<u32> = cell_intervals()
            .map(|(name, _)| rank(name).unwrap().rank)
            .collect();
        ranks.sort_unstable();
        assert_eq!(ranks, (1..=21).collect::<Vec<_>>());
        assert_eq!(
            cell_intervals()
                .filter(|(name, _)| paper(name).among_first_nine)
                .count(),
            9
        );
        assert_eq!(
            (rank("Ca50_ref_uM").unwrap().rank, paper("Ca50_ref_uM").rank),
            (1, Some(1))
        );
        assert_eq!(
            (paper("beta_1_uM").rank, paper("phi").among_first_nine),
            (None, false)
        );
        assert_eq!(rank("a_p_kPa"), None);
    }
}

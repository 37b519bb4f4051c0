//! Values that the paper prints for its patient 02-CoA (Tables 3 to 10).

use std::collections::BTreeMap;
use std::sync::LazyLock;

use cardiotwin_schemas::robustness::PaperSpread;
use serde::Deserialize;

/// Means and spreads that the paper prints, by table and column.
#[derive(Debug, Deserialize)]
pub struct Paper {
    /// Id of the patient to whom the tables belong.
    pub patient: String,
    tables: BTreeMap<String, Table>,
}

#[derive(Debug, Deserialize)]
struct Table {
    quantities: BTreeMap<String, PaperSpread>,
}

/// The tables, parsed once.
pub static PAPER: LazyLock<Paper> = LazyLock::new(|| {
    serde_json::from_str(include_str!("paper_tables.json")).expect("the printed tables are JSON")
});

impl Paper {
    /// A printed column; `None` if the table has no column of that name.
    #[must_use]
    pub fn column(&self, table: u32, quantity: &str) -> Option<&PaperSpread> {
        self.tables
            .get(&table.to_string())?
            .quantities
            .get(quantity)
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::robustness::{TableKind, Uncertainty};
    use cardiotwin_schemas::settings::CellFitSettings;
    use cardiotwin_schemas::step1::Step1Parameter;

    use super::*;

    #[test]
    fn every_printed_column_has_our_name() {
        for over in [Uncertainty::Data, Uncertainty::Guess] {
            let table = |kind: TableKind| kind.paper(over);
            for name in Step1Parameter::KEYS {
                assert!(
                    PAPER
                        .column(table(TableKind::Step1Parameters), name)
                        .is_some(),
                    "{name}"
                );
            }
            for biomarker in cardiotwin_schemas::biomarkers::Biomarker::TABLE_2 {
                for kind in [TableKind::Step1Biomarkers, TableKind::Step2Biomarkers] {
                    assert!(
                        PAPER.column(table(kind), biomarker.key()).is_some(),
                        "{}",
                        biomarker.key()
                    );
                }
            }
            // The paper prints all fitted parameters except a_p.
            for name in CellFitSettings::default()
                .parameters
                .iter()
                .filter(|name| *name != "a_p_kPa")
            {
                assert!(
                    PAPER
                        .column(table(TableKind::Step2Parameters), name)
                        .is_some(),
                    "{name}"
                );
            }
        }
        let columns: usize = PAPER.tables.values().map(|t| t.quantities.len()).sum();
        assert_eq!((PAPER.tables.len(), columns), (8, 2 * (6 + 5 + 9 + 5)));
    }
}

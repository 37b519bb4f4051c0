//! One table for all media: columns are declared once, cells hold values, and each medium renders them.
//!
//! A terminal's renderer is in `cli`, which knows widths and colours; [`html()`] makes a page's table,
//! [`csv()`] a file, and a [`Table`] serialises as an array of objects.

mod csv;
mod digits;
mod html;
mod model;

pub use csv::csv;
pub use digits::{Digits, duration, number, optional, percent};
pub use html::{html, sign_of};
pub use model::{Cell, Column, Kind, Table, Tone, cells};

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// A small table of everything: keys, words, differences, a missing value, a tone, a foot.
    fn small() -> Table {
        let columns = [
            Column::new("biomarker", Kind::Keys),
            Column::new("meaning", Kind::Data),
            Column::numbers("measured"),
            Column::numbers("step1_difference")
                .label("difference")
                .digits(Digits::Difference),
            Column::words("note"),
        ];
        let mut table = Table::new("small", "A <small> table", columns);
        let bad = Cell::from("a, \"b\" & <c>").toned(Tone::Bad);
        table.rows = vec![
            cells!["P_max_mmHg", "peak pressure", 104.05, -0.302, bad],
            cells!["SV_mL", "stroke volume", None::<f64>, 0.12, ""],
        ];
        let mean = Cell::from(0.211).digits(Digits::Share);
        table.foot = vec![cells!["mean", "", "", mean, ""]];
        table
    }

    #[test]
    fn a_page_has_symbols_units_signs_and_unrounded_values() {
        let page = html(&small()).into_string();
        for part in [
            "<table class=\"small\"><caption>A &lt;small&gt; table</caption>",
            "<th class=\"unit\" scope=\"col\">unit</th>",
            "<th scope=\"col\" data-value=\"difference (%)\">difference, %</th>",
            "<td class=\"unit\">mmHg</td>",
            "<td class=\"num\" data-value=\"104.05\">104.0</td>",
            "<td class=\"num diff far\" data-value=\"-30.2\">\u{2212}30.2</td>",
            "<td class=\"num\" data-value=\"\">\u{2013}</td>",
            "<span class=\"bad\">✕</span> a, &quot;b&quot; &amp; &lt;c&gt;",
            "<tfoot>",
            ">21.1<",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("peak pressure</td>"), "{page}");
    }

    #[test]
    fn csv_has_keys_unrounded_numbers_and_blanks() {
        let mut table = small();
        table.foot.clear();
        assert_eq!(
            csv(&table),
            "biomarker,meaning,measured,step1_difference,note\n\
             P_max_mmHg,peak pressure,104.05,-0.302,\"a, \"\"b\"\" & <c>\"\n\
             SV_mL,stroke volume,,0.12,\n"
        );
    }

    #[test]
    fn json_is_an_array_of_rows_in_the_order_of_columns() {
        let text = serde_json::to_string(&small()).unwrap();
        assert_eq!(
            text,
            r#"[{"biomarker":"P_max_mmHg","meaning":"peak pressure","measured":104.05,"step1_difference":-0.302,"note":"a, \"b\" & <c>"},{"biomarker":"SV_mL","meaning":"stroke volume","measured":null,"step1_difference":0.12,"note":""}]"#
        );
    }

    #[test]
    fn groups_stand_above_their_columns_and_a_last_row_spans_names() {
        let group = |column: Column| Column {
            group: "step 1",
            ..column
        };
        let columns = [
            Column::words("patient"),
            Column::words("state"),
            group(Column::numbers("cost")),
            group(Column::numbers("gap").unit("mL")),
            Column::numbers("time").digits(Digits::Duration),
        ];
        let mut table = Table::new("cohort", "", columns);
        table.rows = vec![cells!["P1", "done", 0.1, 2.5, 83.0]];
        table.foot = vec![cells!["mean", "", 0.1, 2.5, ""]];
        let page = html(&table.linked(|k, name| format!("#{k}-{name}"))).into_string();
        for part in [
            "<th class=\"unit\" scope=\"col\" rowspan=\"2\">state</th>",
            "<th class=\"group\" colspan=\"2\" scope=\"colgroup\">step 1</th>",
            "<th class=\"group\" colspan=\"1\" scope=\"colgroup\"></th>",
            "<a href=\"#0-P1\">P1</a>",
            "<td class=\"num group\" data-value=\"0.1\">0.1000</td>",
            "<td class=\"num group\" data-value=\"83\">00:01:23</td>",
            "<th scope=\"row\" colspan=\"2\">mean</th>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
    }

    #[test]
    fn rows_with_json_fill_the_columns_of_their_keys() {
        let rows = [json!({"patient": "P1", "before": 1.5, "unseen": true})];
        let columns = [
            Column::words("patient"),
            Column::numbers("before"),
            Column::numbers("after"),
        ];
        let table = Table::of("t", columns, &rows);
        assert_eq!(table.rows, [cells!["P1", 1.5, None::<f64>]]);
        let left = table.without(|column| column.key == "before");
        assert_eq!(left.rows, [cells!["P1", None::<f64>]]);
        assert!(left.without_empty_rows().rows.is_empty());
    }
}

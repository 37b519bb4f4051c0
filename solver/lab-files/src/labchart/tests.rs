//! LabChart exports that are read or refused.

use super::*;
use crate::text::decode;

const HEADER: &str = "Interval=\t0.5 s\nExcelDateTime=\t4.5352e+04\t01/03/2024 10:00:00.000\n\
    TimeFormat=\tStartOfBlock\nDateFormat=\t\nChannelTitle=\tLVP\tECG\nRange=\t10.000 V\t2.0 mV\n\
    UnitName=\tmmHg\t*\n";

fn read(text: &str, block: Option<usize>) -> TableReading {
    let wanted = [
        Wanted::required("time"),
        Wanted::new("lv_pressure"),
        Wanted::new("ecg"),
    ];
    parse(
        &decode(text.as_bytes()).unwrap(),
        Path::new("raw/catheter.txt"),
        &wanted,
        block,
    )
}

#[test]
fn channels_units_and_comments_are_read() {
    let reading = read(
        &format!(
            "{HEADER}0\t98.1\t1.20\n0.5\t98.3\t1.21\t#* Drug added\n1\tNaN\t1.25\t#2 second\n"
        ),
        None,
    );
    assert_eq!(reading.problems, []);
    let table = reading.table.unwrap();
    assert_eq!(table.columns["time"], [0.0, 500.0, 1000.0]);
    assert_eq!(table.columns["lv_pressure"][..2], [98.1, 98.3]);
    assert!(table.columns["lv_pressure"][2].is_nan());
    assert_eq!(table.columns["ecg"], [1.2, 1.21, 1.25]);
    assert_eq!(table.line(1), 9);
    let said = table.said.join("\n");
    assert!(
        said.contains("`Drug added` (line 9), `second` (line 10)"),
        "{said}"
    );
    assert!(
        said.contains("left-ventricular pressure from column `LVP (mmHg)`"),
        "{said}"
    );
}

#[test]
fn blocks_are_joined_by_their_dates_or_chosen() {
    let second = HEADER.replace("4.5352e+04", &format!("{:.12}", 45352.0 + 10.0 / 86400.0));
    let text = format!("{HEADER}0\t1\t0\n0.5\t2\t0\n{second}0\t3\t0\n0.5\t4\t0\n");
    let table = read(&text, None).table.unwrap();
    let expected = [0.0, 500.0, 10_000.0, 10_500.0];
    assert!(
        table.columns["time"]
            .iter()
            .zip(expected)
            .all(|(a, b)| (a - b).abs() < 0.01),
        "{:?}",
        table.columns
    );
    assert_eq!(table.line(2), 17);
    assert_eq!(
        read(&text, Some(2)).table.unwrap().columns["lv_pressure"],
        [3.0, 4.0]
    );
    let told = read(&text, Some(3)).problems[0].to_string();
    assert!(
        told.contains("block 3") && told.contains("1 to 2"),
        "{told}"
    );
    let other = format!(
        "{HEADER}0\t1\t0\n0.5\t2\t0\n{}0\t3\t0\n0.5\t4\t0\n",
        second.replace("0.5 s", "0.1 s")
    );
    let told = read(&other, None).problems[0].to_string();
    assert!(
        told.contains("catheter.txt:10") && told.contains("another interval"),
        "{told}"
    );
}

#[test]
fn a_decimal_comma_and_an_export_without_times_are_read() {
    let text = HEADER
        .replace("0.5 s", "0,5 s")
        .replace("4.5352e+04", "4,5352e+04");
    let table = read(&format!("{text}0,0\t98,1\t1,2\n0,5\t98,3\t1,2\n"), None)
        .table
        .unwrap();
    assert_eq!(table.columns["lv_pressure"], [98.1, 98.3]);
    let table = read(&format!("{HEADER}98.1\t1.2\n98.3\t1.2\n"), None)
        .table
        .unwrap();
    assert_eq!(table.columns["time"], [0.0, 500.0]);
    assert!(table.said[1].contains("from the interval"));
    let table = read(
        &format!("{HEADER}0:01:00.5\t98.1\t1.2\n0:01:01\t98.3\t1.2\n"),
        None,
    )
    .table
    .unwrap();
    assert_eq!(table.columns["time"], [60_500.0, 61_000.0]);
}

#[test]
fn damage_is_told_with_its_line() {
    for (text, parts) in [
        (
            format!("{HEADER}0\t98.1\t1.2\n0.5\t98.3\n"),
            ["catheter.txt:9", "2 fields"],
        ),
        (
            format!("{HEADER}0\t98.1\t1.2\n0.5\tx\t1\n"),
            ["catheter.txt:9: LVP", "`x`"],
        ),
        (
            format!("{HEADER}0\t98.1\t1.2\nb\t1\t1\n"),
            ["catheter.txt:9", "`b`"],
        ),
        (
            format!("{HEADER}0.0\t98.1\t1.2\n0.0\t1\t1\n"),
            ["catheter.txt:9", "0 ms after 0 ms"],
        ),
        (HEADER.to_owned(), ["no samples", "below the header"]),
        (
            HEADER.replace("0.5 s", "fast"),
            ["catheter.txt:1", "Interval=fast"],
        ),
        (
            format!(
                "{}0\t1\t1\n1\t1\t1\n",
                HEADER.replace("UnitName=\tmmHg\t*\n", "")
            ),
            ["`LVP (V)`", "calibrated"],
        ),
    ] {
        let told: Vec<String> = read(&text, None)
            .problems
            .iter()
            .map(ToString::to_string)
            .collect();
        let told = told.join("\n");
        assert!(parts.iter().all(|part| told.contains(part)), "{told}");
    }
}

#[test]
fn an_empty_channel_shifts_nothing() {
    // The last channel is empty at first, everywhere, and without times; a tab may end each row.
    for (rows, n_time) in [
        ("0\t98.1\t\n0.5\t98.3\t\n1\t98.5\t1.2\n", true),
        ("0\t98.1\t\n0.5\t98.3\t\n1\t98.5\t\n", true),
        ("98.1\t\n98.3\t\n98.5\t\n", false),
        (
            "0\t98.1\t1.2\t\t#* a comment\n0.5\t98.3\t1.2\n1\t98.5\t1.2\n",
            true,
        ),
        ("0\t98.1\t1.2\t\n0.5\t98.3\t1.2\t\n1\t98.5\t1.2\t\n", true),
    ] {
        let reading = read(&format!("{HEADER}{rows}"), None);
        let table = reading
            .table
            .unwrap_or_else(|| panic!("{:#?}", reading.problems));
        assert_eq!(table.columns["time"], [0.0, 500.0, 1000.0], "{rows}");
        assert_eq!(table.columns["lv_pressure"], [98.1, 98.3, 98.5], "{rows}");
        let by_interval = table.said.join("\n").contains("from the interval");
        assert_eq!(by_interval, !n_time, "{rows}");
    }
}

#[test]
fn times_of_day_pass_midnight_and_have_halves_and_dates() {
    for times in [
        ["23:59:59.5", "0:00:00.0", "0:00:00.5"],
        ["11:59:59.5 PM", "12:00:00.0 AM", "12:00:00.5 AM"],
        [
            "2/3/2026\t23:59:59.5",
            "3/3/2026\t0:00:00.0",
            "3/3/2026\t0:00:00.5",
        ],
    ] {
        let rows: String = times.iter().map(|t| format!("{t}\t98.1\t1.2\n")).collect();
        let text = HEADER.replace("StartOfBlock", "TimeOfDay");
        let reading = read(&format!("{text}{rows}"), None);
        let table = reading
            .table
            .unwrap_or_else(|| panic!("{:#?}", reading.problems));
        let time = &table.columns["time"];
        assert!(
            (time[1] - time[0] - 500.0).abs() < 1e-6 && (time[2] - time[1] - 500.0).abs() < 1e-6,
            "{time:?}"
        );
    }
}

#[test]
fn rounded_times_give_way_to_the_stated_interval() {
    let text = HEADER.replace("0.5 s", "0.004 s");
    let rows: String = (0..50)
        .map(|i| format!("{:.2}\t98.1\t1.2\n", 0.004 * f64::from(i)))
        .collect();
    let table = read(&format!("{text}{rows}"), None).table.unwrap();
    assert!((table.columns["time"][49] - 196.0).abs() < 1e-9);
    assert!(table.said.join("\n").contains("rounded times"));
    // A lost second is no rounding.
    let lost = format!("{text}{rows}1.20\t98.1\t1.2\n1.20\t98.1\t1.2\n");
    assert!(read(&lost, None).table.is_none());
}

#[test]
fn a_unit_in_the_title_goes_before_that_of_the_amplifier() {
    let text = HEADER
        .replace("UnitName=\tmmHg\t*\n", "")
        .replace("\tLVP\tECG", "\tLVP (mmHg)\tECG (mV)");
    let table = read(&format!("{text}0\t98.1\t1.2\n0.5\t98.3\t1.2\n"), None)
        .table
        .unwrap();
    assert_eq!(table.columns["lv_pressure"], [98.1, 98.3]);
}

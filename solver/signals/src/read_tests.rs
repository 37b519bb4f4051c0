use super::*;
use crate::told::MAX_TOLD;
use proptest::prelude::*;

fn parse(text: &str) -> Reading {
    parse_trace(
        text.as_bytes(),
        Path::new("pressure.csv"),
        Quantity::Pressure,
    )
}

#[track_caller]
fn only(text: &str) -> Problem {
    let reading = parse(text);
    assert_eq!(reading.problems.len(), 1, "{:#?}", reading.problems);
    assert_eq!(reading.trace.is_none(), reading.problems[0].is_error());
    reading.problems.into_iter().next().unwrap()
}

const SOUND: &str = "time_ms,pressure_mmHg\n0,8\n1,8.5\n2,9\n3,8.5\n";

#[test]
fn a_sound_file_is_read() {
    for text in [
        SOUND.to_owned(),
        format!("\u{feff}{SOUND}"),
        SOUND.replace('\n', "\r\n"),
        SOUND.replace(',', ", "),
    ] {
        let reading = parse(&text);
        assert_eq!(reading.problems, []);
        let trace = reading.trace.unwrap();
        assert_eq!(
            (trace.time_ms(), trace.values()),
            (&[0.0, 1.0, 2.0, 3.0][..], &[8.0, 8.5, 9.0, 8.5][..])
        );
    }
    let swapped_order = "pressure_mmHg,time_ms\n8,0\n9,1\n8,2\n";
    assert_eq!(
        parse(swapped_order).trace.unwrap().values(),
        [8.0, 9.0, 8.0]
    );
}

#[test]
fn a_column_without_its_unit_is_refused() {
    let p = only("time_ms,pressure\n0,8\n1,9\n");
    assert_eq!((p.line, p.key.as_deref()), (Some(1), Some("pressure_mmHg")));
    assert!(
        p.found.contains("`pressure`") && p.remedy.contains("units are never guessed"),
        "{p}"
    );
    assert!(
        only("time_ms,pressure_kPa\n0,1\n1,2\n")
            .remedy
            .contains("1 kPa = 7.50062 mmHg")
    );
    assert!(
        only("time_s,pressure_mmHg\n0,1\n0.001,2\n")
            .remedy
            .contains("1 s = 1000 ms")
    );
}

#[test]
fn both_columns_wrong_are_two_problems() {
    let reading = parse("t,p\n0,8\n1,9\n");
    assert_eq!(reading.problems.len(), 2, "{:#?}", reading.problems);
}

#[test]
fn a_calcium_transient_has_its_own_rules() {
    let parse_from = |origin, text: &str| {
        parse_trace_from(
            origin,
            text.as_bytes(),
            Path::new("calcium.csv"),
            Quantity::Calcium,
        )
    };
    let parse = |text: &str| parse_from(Origin::CommandLine, text);
    let only = |text: &str| {
        let reading = parse(text);
        assert!(
            reading.trace.is_none() && reading.problems.len() == 1,
            "{:#?}",
            reading.problems
        );
        reading.problems.into_iter().next().unwrap()
    };
    // Samples of any spacing: nothing is resampled.
    let sound = parse("# made by hand\ntime_ms,calcium_uM\n0,0.1\n1,0.2\n2,0.5\n300,0.1\n");
    assert!(
        sound.problems.is_empty() && sound.trace.is_some(),
        "{:#?}",
        sound.problems
    );
    let p = only("time_ms,calcium_uM\n0,0.1\n1,-0.2\n2,0.5\n");
    assert_eq!((p.line, p.key.as_deref()), (Some(3), Some("calcium_uM")));
    assert!(
        p.found == "`-0.2`" && p.expected.contains("µM, 0 or more"),
        "{p}"
    );
    assert!(
        only("time_ms,calcium_nM\n0,100\n1,200\n")
            .remedy
            .contains("1000 nM = 1 µM")
    );
    assert!(
        only("time_ms,pressure_mmHg\n0,1\n1,2\n")
            .remedy
            .contains("rename it to `calcium_uM`")
    );
    assert!(!only("").remedy.contains("patient.toml"));
    // Either name of the column will do; of a patient's trace gaps count.
    let gap = "time_ms,Ca_uM\n0,0.1\n1,0.2\n2,0.5\n300,0.1\n";
    assert!(parse(gap).problems.is_empty() && parse(gap).trace.is_some());
    let of_patient = parse_from(Origin::Patient, gap);
    assert_eq!(of_patient.problems.len(), 1, "{:#?}", of_patient.problems);
    let p = parse_from(Origin::Patient, "time_ms,calcium\n0,1\n1,2\n")
        .problems
        .remove(0);
    assert_eq!(p.key.as_deref(), Some("Ca_uM"));
}

#[test]
fn lines_are_those_of_the_file() {
    let text = "# one\n# two\n\ntime_ms,pressure_mmHg\n0,8\n# three\n1,x\n\n2,9\n3,NaN";
    for text in [text.to_owned(), text.replace('\n', "\r\n")] {
        let lines: Vec<_> = parse(&text).problems.iter().map(|p| p.line).collect();
        assert_eq!(lines, [Some(7), Some(10)], "{text:?}");
        let header = parse(&text.replace("_mmHg", ""));
        assert_eq!(header.problems[0].line, Some(4), "{text:?}");
    }
}

#[test]
fn a_missing_header_is_named() {
    let p = only("0,8\n1,9\n");
    assert!(
        p.found.contains("no header") && p.expected.contains("time_ms,pressure_mmHg"),
        "{p}"
    );
    assert_eq!(only("").found, "an empty file");
    assert_eq!(only("time_ms,pressure_mmHg\n").found, "0 samples");
    assert!(
        only("time_ms;pressure_mmHg\n0;8\n")
            .remedy
            .contains("commas")
    );
    assert!(
        only("time_ms,pressure_mmHg,pressure_mmHg\n0,8,8\n")
            .found
            .contains("2 columns")
    );
}

#[test]
fn a_file_of_the_other_quantity_is_recognised() {
    let p = only("time_ms,volume_mL\n0,80\n1,81\n");
    assert!(p.remedy.contains("swapped in patient.toml"), "{p}");
}

#[test]
fn swapped_columns_are_recognised() {
    let p = only("time_ms,pressure_mmHg\n8,0\n9,1\n8.5,2\n8,3\n");
    assert!(p.remedy.contains("look swapped"), "{p}");
}

#[test]
fn cells_without_a_finite_number_are_all_told() {
    let reading = parse("time_ms,pressure_mmHg\n0,8\n1,NaN\n2,\n3,abc\n4,inf\n5,8,5\n,8\n");
    let told: Vec<(Option<usize>, &str)> = reading
        .problems
        .iter()
        .map(|p| (p.line, p.found.as_str()))
        .collect();
    assert_eq!(
        told,
        [
            (Some(3), "`NaN`"),
            (Some(4), "an empty cell"),
            (Some(5), "`abc`"),
            (Some(6), "`inf`"),
            (Some(7), "3 fields in `5,8,5`"),
            (Some(8), "an empty cell"),
        ]
    );
    assert_eq!(reading.problems[5].key.as_deref(), Some("time_ms"));
    assert_eq!(reading.trace, None);
}

#[test]
fn doubled_and_backward_times_are_told_by_line() {
    let reading = parse("time_ms,pressure_mmHg\n0,8\n1,9\n1,9\n3,8\n2,8\n4,8\n");
    let told: Vec<(Option<usize>, &str)> = reading
        .problems
        .iter()
        .map(|p| (p.line, p.found.as_str()))
        .collect();
    assert_eq!(
        told,
        [
            (Some(4), "1 ms a second time"),
            (Some(6), "2 ms after 3 ms")
        ]
    );
}

#[test]
fn gaps_are_bridged_or_refused() {
    let with_gap = |from: usize, to: usize| {
        let rows: String = (0..300)
            .filter(|i| *i <= from || *i >= to)
            .map(|i| format!("{i},{}\n", 8 + i % 7))
            .collect();
        only_keeps(&format!("time_ms,pressure_mmHg\n{rows}"))
    };
    let (small, trace) = with_gap(100, 103);
    assert!(!small.is_error() && trace, "{small}");
    assert_eq!(small.found, "no sample between 100 and 103 ms");
    let (large, _) = with_gap(100, 160);
    assert!(large.is_error(), "{large}");
    assert_eq!(large.line, Some(103));
}

fn only_keeps(text: &str) -> (Problem, bool) {
    let reading = parse(text);
    assert_eq!(reading.problems.len(), 1, "{:#?}", reading.problems);
    (reading.problems[0].clone(), reading.trace.is_some())
}

#[test]
fn many_lines_of_one_kind_are_counted() {
    let rows: String = (0..100).map(|i| format!("{i},NaN\n")).collect();
    let reading = parse(&format!("time_ms,pressure_mmHg\n{rows}"));
    assert_eq!(reading.problems.len(), MAX_TOLD + 1);
    assert!(
        reading.problems[MAX_TOLD]
            .found
            .starts_with("95 more lines"),
        "{}",
        reading.problems[MAX_TOLD]
    );
}

#[test]
fn further_columns_are_not_read_and_said_so() {
    let (p, trace) = only_keeps("time_ms,pressure_mmHg,ecg_mV\n0,8,1\n1,9,2\n2,8,3\n");
    assert!(!p.is_error() && trace && p.found.contains("ecg_mV"), "{p}");
}

#[test]
fn a_file_that_is_not_there_is_a_problem() {
    let folder = tempfile::tempdir().unwrap();
    let reading = read_trace(&folder.path().join("none.csv"), Quantity::Pressure);
    assert!(
        reading.problems[0].found.contains("no readable file"),
        "{}",
        reading.problems[0]
    );
    let file = folder.path().join("pressure.csv");
    std::fs::write(&file, SOUND).unwrap();
    assert!(read_trace(&file, Quantity::Pressure).trace.is_some());
}

proptest! {
    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let reading = parse_trace(&bytes, Path::new("x.csv"), Quantity::Volume);
        prop_assert!(reading.trace.is_some() || reading.problems.iter().any(Problem::is_error));
        let with_header = [b"time_ms,volume_mL\n".as_slice(), &bytes].concat();
        let reading = parse_trace(&with_header, Path::new("x.csv"), Quantity::Volume);
        prop_assert!(reading.trace.is_some() || reading.problems.iter().any(Problem::is_error));
    }
}

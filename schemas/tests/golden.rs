//! A small file of every format, as its version of today was written: read, and written alike.
//!
//! A later version of the programs must read each. When a format's version is raised, its file here stays, and one of the new
//! version comes next to it.

use std::path::{Path, PathBuf};

use cardiotwin_schemas::formats::{self, ALL, Format};
use cardiotwin_schemas::{
    afterload, allocation, discover, external, fit, heart, notices, outcome, overlay, plan,
    preparation, progress, record, robustness, sensitivity, status, sweep, task,
};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn text(format: &Format) -> String {
    std::fs::read_to_string(root().join(format.golden))
        .unwrap_or_else(|error| panic!("{}: {error}", format.golden))
}

fn round<T: DeserializeOwned + Serialize>(format: &Format, text: &str) {
    let read: T = format
        .read(&format.golden, text.as_bytes())
        .unwrap_or_else(|error| panic!("{}", error.in_full()));
    let again = serde_json::to_value(&read).unwrap();
    assert_eq!(
        again,
        serde_json::from_str::<Value>(text).unwrap(),
        "{}",
        format.golden
    );
}

#[test]
fn every_format_has_its_file() {
    // Where these are of another version, step 0 or the beat is computed again.
    let computed_anew = [formats::VENTRICLE, formats::BEAT_CHECKPOINT];
    for format in ALL.iter().filter(|format| !computed_anew.contains(format)) {
        assert!(
            root().join(format.golden).is_file(),
            "{} has no {}",
            format.name,
            format.golden
        );
    }
}

#[test]
fn every_file_is_read_and_written_alike() {
    for format in ALL
        .iter()
        .filter(|format| format.golden.starts_with("schemas/"))
    {
        let text = text(format);
        match *format {
            formats::SPEC => round::<task::AttemptSpec>(format, &text),
            formats::CLAIM => round::<progress::Claim>(format, &text),
            formats::PROGRESS => {
                assert!(text.lines().count() > 1);
                text.lines()
                    .for_each(|line| round::<progress::Progress>(format, line));
            }
            formats::OUTCOME => round::<outcome::TaskOutcome>(format, &text),
            formats::REVOCATION => round::<outcome::RevokedAttempt>(format, &text),
            formats::ALLOCATION => round::<allocation::AttemptAllocation>(format, &text),
            formats::HEART => round::<heart::HeartSurface>(format, &text),
            formats::EXTERNAL_PARAMETERS => round::<external::ExternalParameters>(format, &text),
            formats::JOB_ORDER => round::<allocation::JobOrder>(format, &text),
            formats::DRIVER_CLAIM => round::<allocation::DriverClaim>(format, &text),
            formats::DRIVER_END => round::<allocation::DriverEnd>(format, &text),
            formats::PLAN => round::<plan::ResolvedPatient>(format, &text),
            formats::SWEEP => round::<sweep::SweepFile>(format, &text),
            formats::SENSITIVITY => round::<sensitivity::SensitivityRecord>(format, &text),
            formats::ROBUSTNESS => round::<robustness::RobustnessResult>(format, &text),
            formats::DISCOVER_CASE => round::<discover::DiscoverCase>(format, &text),
            formats::MODEL => {
                let read: overlay::ModelOverlay = toml::from_str(&text).unwrap();
                let again = toml::Table::try_from(&read).unwrap();
                assert_eq!(
                    again,
                    text.parse::<toml::Table>().unwrap(),
                    "{}",
                    format.golden
                );
            }
            formats::LAW => round::<cardiotwin_schemas::organ_law::LawFile>(format, &text),
            formats::PREPARATION => round::<preparation::Preparation>(format, &text),
            formats::NOTICE => round::<notices::Notice>(format, &text),
            formats::STATUS => round::<status::Status>(format, &text),
            formats::RUN_RECORD => round::<record::RunRecord>(format, &text),
            formats::CALCIUM_FIT => round::<fit::CalciumFitAnswer>(format, &text),
            formats::AFTERLOAD_FIT => round::<afterload::AfterloadFitAnswer>(format, &text),
            formats::CUFF_FIT => round::<afterload::CuffFitAnswer>(format, &text),
            formats::AFTERLOAD_DISCOVERY => round::<afterload::AfterloadDiscovery>(format, &text),
            _ => panic!("nothing here reads {}", format.golden),
        }
    }
}

/// A key of a later version of the same format is left out of account wherever it stands, but in an order.
#[test]
fn additions_do_not_break_readers() {
    fn with_additions(value: &mut Value) {
        match value {
            Value::Object(table) => {
                table.values_mut().for_each(with_additions);
            }
            Value::Array(items) => items.iter_mut().for_each(with_additions),
            _ => {}
        }
        // Maps by name take any key; only tables of numbers and texts side by side are structs for certain.
        if let Value::Object(table) = value
            && table.values().any(Value::is_string)
            && table.values().any(|value| !value.is_string())
        {
            table.insert("of_tomorrow".into(), true.into());
        }
    }
    let check = |format: &Format, reads: fn(&[u8]) -> Result<(), String>| {
        let mut value: Value = serde_json::from_str(&text(format)).unwrap();
        with_additions(&mut value);
        assert!(value.to_string().contains("of_tomorrow"), "{}", format.name);
        reads(value.to_string().as_bytes())
            .unwrap_or_else(|error| panic!("{}: {error}", format.name));
    };
    fn reads<T: DeserializeOwned>(json: &[u8]) -> Result<(), String> {
        serde_json::from_slice::<T>(json)
            .map(|_| ())
            .map_err(|error| error.to_string())
    }
    check(&formats::CLAIM, reads::<progress::Claim>);
    check(&formats::OUTCOME, reads::<outcome::TaskOutcome>);
    check(&formats::REVOCATION, reads::<outcome::RevokedAttempt>);
    check(&formats::ALLOCATION, reads::<allocation::AttemptAllocation>);
    check(&formats::DRIVER_CLAIM, reads::<allocation::DriverClaim>);
    check(&formats::DRIVER_END, reads::<allocation::DriverEnd>);
    check(&formats::PLAN, reads::<plan::ResolvedPatient>);
    check(&formats::HEART, reads::<heart::HeartSurface>);
    check(
        &formats::SENSITIVITY,
        reads::<sensitivity::SensitivityRecord>,
    );
    check(&formats::DISCOVER_CASE, reads::<discover::DiscoverCase>);
}

#[test]
fn calcium_fits_of_version_1_are_read_with_their_other_names() {
    let file = root().join("schemas/tests/golden/calcium-fit.json");
    let earlier: fit::CalciumFitAnswer =
        serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let now: fit::CalciumFitAnswer = serde_json::from_str(&text(&formats::CALCIUM_FIT)).unwrap();
    assert_eq!(
        now,
        fit::CalciumFitAnswer {
            schema_version: 2,
            ..earlier
        }
    );
}

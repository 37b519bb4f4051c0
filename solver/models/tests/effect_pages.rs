//! `docs/effects` agrees with the declarations of the catalogue. To update it, run
//! `cargo run --release -p cardiotwin-models --example effect_pages`.

#[path = "../examples/effect_pages/pages.rs"]
mod pages;

use std::collections::BTreeSet;
use std::path::Path;

/// Largest difference between two numbers in a picture, since other mathematics libraries round
/// curves differently.
const PIXELS: f64 = 0.5;

/// Splits a text into the text between numbers and the numbers.
fn split(text: &str) -> (String, Vec<f64>) {
    let (mut between, mut numbers, mut number) = (String::new(), Vec::new(), String::new());
    for letter in text.chars().chain(['\n']) {
        if letter.is_ascii_digit() || letter == '.' || (letter == '-' && number.is_empty()) {
            number.push(letter);
            continue;
        }
        if !number.is_empty() {
            match number.parse() {
                Ok(value) => {
                    numbers.push(value);
                    between.push('#');
                }
                Err(_) => between.push_str(&number),
            }
            number.clear();
        }
        between.push(letter);
    }
    (between, numbers)
}

#[test]
fn committed_pages_are_current() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects");
    let files = pages::all();
    for (name, text) in &files {
        let found =
            std::fs::read_to_string(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        if name.ends_with(".svg") {
            let ((shape, numbers), (expected_shape, expected)) = (split(&found), split(text));
            assert!(
                shape == expected_shape && numbers.len() == expected.len(),
                "{name} is out of date"
            );
            let near = numbers
                .iter()
                .zip(&expected)
                .all(|(a, b)| (a - b).abs() <= PIXELS);
            assert!(near, "{name} is out of date");
        } else {
            assert!(found == *text, "{name} is out of date");
        }
    }
    let present: BTreeSet<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    let wanted: BTreeSet<String> = files.into_iter().map(|(name, _)| name).collect();
    assert_eq!(present, wanted);
}

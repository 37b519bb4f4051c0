//! Pictures on pages are those that their commands draw.

use std::path::Path;

/// Largest distance of the same point in two pictures, px. Processors round the fits differently.
const TOLERANCE_PX: f64 = 0.5;

/// Asserts that an SVG file that a command drew is the one that a page shows.
pub fn assert_drawn(shown: &Path, drawn: &Path) {
    let read = |path: &Path| {
        std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    let difference = difference(&read(shown), &read(drawn));
    assert_eq!(
        difference,
        None,
        "{} is not what its command draws; the command drew {}",
        shown.display(),
        drawn.display()
    );
}

/// The first words or numbers in which two pictures differ.
fn difference(shown: &str, drawn: &str) -> Option<(String, String)> {
    let (shown, drawn) = (parts(shown), parts(drawn));
    let differ = |a: &str, b: &str| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() > TOLERANCE_PX,
        _ => a != b,
    };
    let longest = shown.len().max(drawn.len());
    (0..longest)
        .map(|i| [&shown, &drawn].map(|all| all.get(i).copied().unwrap_or("nothing")))
        .find(|[a, b]| differ(a, b))
        .map(|[a, b]| (a.to_owned(), b.to_owned()))
}

/// Numbers of a text, and what is between them.
fn parts(text: &str) -> Vec<&str> {
    let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let mut parts = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let number = is_number(first);
        let end = rest.find(|c| is_number(c) != number).unwrap_or(rest.len());
        parts.push(&rest[..end]);
        rest = &rest[end..];
    }
    parts
}

#[test]
fn a_moved_line_and_another_word_are_differences() {
    let picture = "<path d=\"M10.0 20.5L30 -4\"/>";
    let moved = |to: &str| difference(picture, &picture.replace("20.5", to));
    assert_eq!(moved("20.6"), None);
    assert_eq!(moved("22.5"), Some(("20.5".into(), "22.5".into())));
    assert!(difference(picture, &picture.replace("path", "line")).is_some());
    assert!(difference(picture, &picture[..20]).is_some());
}

//! Numbered lines of a text file, and the numbers in them.

use super::error::MeshFileError;
use std::path::Path;
use std::str::FromStr;

/// Largest number of characters of a line that a message quotes.
const SHOWN: usize = 60;

/// Iterator over the lines that are not blank.
pub struct Lines<'a> {
    file: &'a Path,
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    last: usize,
}

/// A line with its number.
#[derive(Clone, Copy)]
pub struct Line<'a> {
    pub file: &'a Path,
    pub number: usize,
    pub text: &'a str,
}

impl<'a> Lines<'a> {
    pub fn new(text: &'a str, file: &'a Path) -> Self {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        Self {
            file,
            lines: text.lines().enumerate(),
            last: 0,
        }
    }

    /// The next line that is not blank.
    pub fn next(&mut self) -> Option<Line<'a>> {
        for (index, text) in self.lines.by_ref() {
            self.last = index + 1;
            if !text.trim().is_empty() {
                return Some(Line {
                    file: self.file,
                    number: index + 1,
                    text: text.trim(),
                });
            }
        }
        None
    }

    /// The next line; an error at the end of the file.
    pub fn expect(&mut self, expected: &str) -> Result<Line<'a>, MeshFileError> {
        let last = self.last;
        self.next().ok_or_else(|| {
            MeshFileError::line(self.file, last + 1, "the end of the file", expected)
        })
    }
}

impl<'a> Line<'a> {
    pub fn error(&self, expected: impl Into<String>) -> MeshFileError {
        let mut shown: String = self.text.chars().take(SHOWN).collect();
        if shown.len() < self.text.len() {
            shown.push('…');
        }
        MeshFileError::line(self.file, self.number, format!("`{shown}`"), expected)
    }

    /// Words of the line.
    pub fn words(&self) -> Vec<&'a str> {
        self.text.split_ascii_whitespace().collect()
    }

    /// Parses a word as a number.
    pub fn number<T: FromStr>(&self, word: &str, expected: &str) -> Result<T, MeshFileError> {
        word.parse().map_err(|_| self.error(expected))
    }

    /// Parses the first word of the line as a count.
    pub fn count(&self, expected: &str) -> Result<usize, MeshFileError> {
        let word = self
            .text
            .split_ascii_whitespace()
            .next()
            .unwrap_or_default();
        self.number(word, expected)
    }

    /// Parses all words of the line, which must be `N` finite numbers.
    pub fn floats<const N: usize>(&self, expected: &str) -> Result<[f64; N], MeshFileError> {
        let mut values = [0.0f64; N];
        let mut words = self.text.split_ascii_whitespace();
        for value in &mut values {
            *value = words
                .next()
                .and_then(|word| word.parse().ok())
                .ok_or_else(|| self.error(expected))?;
            if !value.is_finite() {
                return Err(self.error(format!("{expected}, finite")));
            }
        }
        if words.next().is_some() {
            Err(self.error(expected))
        } else {
            Ok(values)
        }
    }

    /// Parses words as node numbers below `n_nodes`.
    pub fn nodes<const N: usize>(
        &self,
        words: &[&str],
        n_nodes: usize,
        expected: &str,
    ) -> Result<[u32; N], MeshFileError> {
        let mut nodes = [0; N];
        if words.len() < N {
            return Err(self.error(expected));
        }
        for (node, word) in nodes.iter_mut().zip(words) {
            let number: i64 = self.number(word, expected)?;
            if number < 0 || number as u64 >= n_nodes as u64 {
                return Err(MeshFileError::NodeOutOfRange {
                    file: self.file.to_owned(),
                    line: self.number,
                    node: number,
                    n_nodes,
                });
            }
            *node = number as u32;
        }
        Ok(nodes)
    }
}

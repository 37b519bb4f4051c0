//! Lists of numbers in one message.

/// A message under way: lists one after the other, each behind its length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MessageWriter {
    /// What is sent.
    pub numbers: Vec<f64>,
}

impl MessageWriter {
    /// Adds numbers.
    pub fn numbers(&mut self, values: &[f64]) -> &mut Self {
        self.numbers.push(values.len() as f64);
        self.numbers.extend_from_slice(values);
        self
    }

    /// Adds indices.
    pub fn indices(&mut self, values: &[u32]) -> &mut Self {
        self.numbers.push(values.len() as f64);
        self.numbers.extend(values.iter().map(|k| f64::from(*k)));
        self
    }

    /// Adds flags.
    pub fn flags(&mut self, values: &[bool]) -> &mut Self {
        self.numbers.push(values.len() as f64);
        self.numbers
            .extend(values.iter().map(|flag| f64::from(u8::from(*flag))));
        self
    }
}

/// A message that arrived: lists are taken in the order in which they were added.
#[derive(Debug, Clone, PartialEq)]
pub struct MessageReader<'a> {
    rest: &'a [f64],
}

impl<'a> MessageReader<'a> {
    /// The lists of [`MessageWriter::numbers`].
    #[must_use]
    pub fn new(numbers: &'a [f64]) -> Self {
        Self { rest: numbers }
    }

    /// The next list.
    ///
    /// # Panics
    /// Where there is none.
    pub fn numbers(&mut self) -> &'a [f64] {
        let (list, rest) = self.rest[1..].split_at(self.rest[0] as usize);
        self.rest = rest;
        list
    }

    /// The same of indices.
    ///
    /// # Panics
    /// Where there is none.
    pub fn indices(&mut self) -> Vec<u32> {
        self.numbers().iter().map(|k| *k as u32).collect()
    }

    /// The same of flags.
    ///
    /// # Panics
    /// Where there is none.
    pub fn flags(&mut self) -> Vec<bool> {
        self.numbers().iter().map(|flag| *flag != 0.0).collect()
    }
}

//! Messages that contain several lists of numbers.

/// A message under construction: lists one after the other, each preceded by its length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MessageWriter {
    /// Content of the message.
    pub numbers: Vec<f64>,
}

impl MessageWriter {
    /// Appends a list of numbers.
    pub fn numbers(&mut self, values: &[f64]) -> &mut Self {
        self.numbers.push(values.len() as f64);
        self.numbers.extend_from_slice(values);
        self
    }

    /// Appends a list of indices.
    pub fn indices(&mut self, values: &[u32]) -> &mut Self {
        self.numbers.push(values.len() as f64);
        self.numbers.extend(values.iter().map(|k| f64::from(*k)));
        self
    }

    /// Appends a list of flags.
    pub fn flags(&mut self, values: &[bool]) -> &mut Self {
        self.numbers.push(values.len() as f64);
        self.numbers
            .extend(values.iter().map(|flag| f64::from(u8::from(*flag))));
        self
    }
}

/// A received message, from which lists are read in the order in which they were appended.
#[derive(Debug, Clone, PartialEq)]
pub struct MessageReader<'a> {
    rest: &'a [f64],
}

impl<'a> MessageReader<'a> {
    /// Reader for the content of [`MessageWriter::numbers`].
    #[must_use]
    pub fn new(numbers: &'a [f64]) -> Self {
        Self { rest: numbers }
    }

    /// Reads the next list of numbers.
    ///
    /// # Panics
    /// If there is no further list.
    pub fn numbers(&mut self) -> &'a [f64] {
        let (list, rest) = self.rest[1..].split_at(self.rest[0] as usize);
        self.rest = rest;
        list
    }

    /// Reads the next list of indices.
    ///
    /// # Panics
    /// If there is no further list.
    pub fn indices(&mut self) -> Vec<u32> {
        self.numbers().iter().map(|k| *k as u32).collect()
    }

    /// Reads the next list of flags.
    ///
    /// # Panics
    /// If there is no further list.
    pub fn flags(&mut self) -> Vec<bool> {
        self.numbers().iter().map(|flag| *flag != 0.0).collect()
    }
}

//! The message from rank 0 that gives a rank its part of the heart for a beat.

use std::borrow::Cow;

use cardiotwin_linalg::parallel::{MessageReader, MessageWriter, Part};

use super::anatomy::Anatomy;
use super::end_diastole::EndDiastole;
use super::piece::{pack, unpack};

/// One rank's part of the heart, in that rank's numbering.
#[derive(Debug)]
pub(super) struct Share<'a> {
    pub part: Part,
    pub anatomy: Cow<'a, Anatomy>,
    pub end_diastole: EndDiastole,
    pub activation_ms: Vec<f64>,
}

impl<'a> Share<'a> {
    pub fn of(
        part: Part,
        anatomy: &'a Anatomy,
        end_diastole: &EndDiastole,
        activation_ms: &[f64],
    ) -> Self {
        let whole = part.layout.neighbours.is_empty();
        let (anatomy, end_diastole) = (anatomy.part(&part), end_diastole.part(&part));
        let activation_ms = if whole {
            activation_ms.to_vec()
        } else {
            part.take(1, activation_ms)
        };
        Self {
            part,
            anatomy,
            end_diastole,
            activation_ms,
        }
    }

    pub fn into_owned(self) -> Share<'static> {
        Share {
            anatomy: Cow::Owned(self.anatomy.into_owned()),
            ..self
        }
    }

    /// Encodes the part as a message.
    pub fn message(&self) -> Vec<f64> {
        let mut to = MessageWriter::default();
        self.part.pack(&mut to);
        pack(&self.anatomy, &mut to);
        let EndDiastole {
            unloaded,
            anchor,
            u,
            pressure_kpa,
        } = &self.end_diastole;
        to.numbers(unloaded.as_flattened())
            .numbers(anchor)
            .numbers(u)
            .numbers(&[*pressure_kpa]);
        to.numbers(&self.activation_ms);
        to.numbers
    }

    /// Decodes a part from a message.
    pub fn from_message(numbers: &[f64]) -> Share<'static> {
        let mut from = MessageReader::new(numbers);
        let part = Part::unpack(&mut from);
        let anatomy = Cow::Owned(unpack(&mut from));
        let end_diastole = EndDiastole {
            unloaded: from.numbers().as_chunks().0.to_vec(),
            anchor: from.numbers().to_vec(),
            u: from.numbers().to_vec(),
            pressure_kpa: from.numbers()[0],
        };
        Share {
            part,
            anatomy,
            end_diastole,
            activation_ms: from.numbers().to_vec(),
        }
    }
}

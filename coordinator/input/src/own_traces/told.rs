//! What a user may state of traces, what is asked for, and how each thing was learned.

use std::path::Path;

use cardiotwin_schemas::raw::CuffPressures;
use cardiotwin_signals::Problem;

/// What the user states next to the file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Choices {
    /// Name or number, from 1, of the column with the left ventricle's pressure.
    pub pressure: Option<String>,
    /// Name or number of the column with its volume.
    pub volume: Option<String>,
    /// Name or number of the column with the time.
    pub time: Option<String>,
    /// Unit of the pressure, in place of the header's.
    pub pressure_unit: Option<String>,
    /// Unit of the volume.
    pub volume_unit: Option<String>,
    /// Unit of the time.
    pub time_unit: Option<String>,
    /// Time between samples \[ms\], for a file without a time.
    pub sample_interval_ms: Option<f64>,
    /// Cycle length \[ms\], for a file without a time, or of a single beat.
    pub cycle_length_ms: Option<f64>,
    /// Arm cuff pressures.
    pub cuff: Option<CuffPressures>,
    /// Volume of the wall \[mL\].
    pub wall_volume_ml: Option<f64>,
    /// Filling pressure \[mmHg\].
    pub left_atrial_pressure_mmhg: Option<f64>,
}

/// A question that only the user can answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    /// What is asked.
    pub asks_for: AsksFor,
    /// The question in words.
    pub words: String,
    /// The same as a problem, for a user who cannot be asked.
    pub problem: Problem,
}

/// Field of [`Choices`] that answers a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AsksFor {
    /// [`Choices::pressure`].
    Pressure,
    /// [`Choices::volume`].
    Volume,
    /// [`Choices::pressure_unit`].
    PressureUnit,
    /// [`Choices::volume_unit`].
    VolumeUnit,
    /// [`Choices::time_unit`].
    TimeUnit,
    /// The heart rate per minute, as [`Choices::cycle_length_ms`].
    HeartRate,
}

impl AsksFor {
    /// Option of the command line that answers it.
    #[must_use]
    pub fn option(self) -> &'static str {
        match self {
            Self::Pressure => "--pressure",
            Self::Volume => "--volume",
            Self::PressureUnit => "--pressure-unit",
            Self::VolumeUnit => "--volume-unit",
            Self::TimeUnit => "--time-unit",
            Self::HeartRate => "--heart-rate",
        }
    }

    /// The choices with this answer.
    ///
    /// # Errors
    /// The answer in words, if a heart rate is no positive number.
    pub fn answered(self, answer: &str, mut choices: Choices) -> Result<Choices, String> {
        let answer = answer.trim();
        let text = || Some(answer.to_owned());
        match self {
            Self::Pressure => choices.pressure = text(),
            Self::Volume => choices.volume = text(),
            Self::PressureUnit => choices.pressure_unit = text(),
            Self::VolumeUnit => choices.volume_unit = text(),
            Self::TimeUnit => choices.time_unit = text(),
            Self::HeartRate => {
                let rate = answer.parse().ok().filter(|rate: &f64| *rate > 0.0);
                let rate = rate.ok_or_else(|| format!("{answer:?} is no heart rate per minute"))?;
                choices.cycle_length_ms = Some(60_000.0 / rate);
            }
        }
        Ok(choices)
    }
}

/// Why traces are not understood.
#[derive(Debug, Clone, PartialEq)]
pub enum NotUnderstood {
    /// The file cannot be used.
    Problems(Vec<Problem>),
    /// The user must say something.
    Question(Box<Question>),
}

impl From<Problem> for NotUnderstood {
    fn from(problem: Problem) -> Self {
        Self::Problems(vec![problem])
    }
}

/// How something was learned from the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Learned {
    /// The header or the user says so.
    Told,
    /// The numbers suggest it.
    Guessed,
}

/// The column as it is called in a sentence.
pub(crate) fn column_words(label: &str) -> String {
    let number = label.strip_prefix("column ");
    match number.map(str::parse::<usize>) {
        // Without a header, the label is a number.
        Some(Ok(_)) => label.to_owned(),
        _ => format!("column `{label}`"),
    }
}

/// A column with its meaning and unit.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Signal {
    /// Header or number of the column.
    pub(crate) label: String,
    /// Values in ms, mmHg or mL.
    pub(crate) values: Vec<f64>,
    /// How the column was chosen, and why.
    pub(crate) chosen: (Learned, String),
    /// How its unit was found, and why.
    pub(crate) unit: (Learned, String),
}

/// Problem with a question, for a user who can be asked and one who cannot.
pub(crate) fn question(
    path: &Path,
    asks_for: AsksFor,
    found: impl Into<String>,
    expected: impl Into<String>,
    words: impl Into<String>,
    example: &str,
) -> NotUnderstood {
    let remedy = format!("say it: {} {example}", asks_for.option());
    NotUnderstood::Question(Box::new(Question {
        asks_for,
        words: words.into(),
        problem: Problem::error(path, found, expected, remedy),
    }))
}

//! Units of the columns: as stated, by the header, or by the size of the numbers.

use std::ops::RangeInclusive;
use std::path::Path;

use cardiotwin_lab_files::plain::{unit_factor, units_of};
use cardiotwin_signals::Problem;

use super::columns::Choice;
use super::rises::ends;
use super::told::{AsksFor, Choices, Learned, NotUnderstood, Signal, question};
use crate::nearest;

/// Units of a pressure, as users write them.
const PRESSURE_UNITS: &str = "mmHg, kPa, hPa, mbar, Pa, Torr or cmH2O";
/// Units of a volume.
const VOLUME_UNITS: &str = "mL, L, uL, cm3 or mm3";
/// Units of a time.
pub(super) const TIME_UNITS: &str = "ms, s, us or min";

/// Largest pressures \[mmHg\] and volumes \[mL\] by which a unit is guessed. Ranges of two units do
/// not overlap: between them nothing is guessed. A right ventricle or a mouse needs its unit stated.
const TOP_MMHG: RangeInclusive<f64> = 40.0..=300.0;
const TOP_ML: RangeInclusive<f64> = 10.0..=600.0;
/// Largest pressures and volumes of any heart, in a stated unit.
const ANY_TOP_MMHG: RangeInclusive<f64> = 8.0..=400.0;
const ANY_TOP_ML: RangeInclusive<f64> = 0.005..=2000.0;
/// In kPa, the upper end of the guess: 195 mmHg. Above it the numbers may be mmHg of a weak heart.
const TOP_KPA: RangeInclusive<f64> = 5.3..=26.0;

/// A unit with the sizes by which it is recognised.
struct Guess {
    unit: &'static str,
    tops: RangeInclusive<f64>,
}

struct Kind {
    quantity: &'static str,
    ours: &'static str,
    units: &'static str,
    option: AsksFor,
    guesses: &'static [Guess],
    /// Largest values of any heart.
    any: RangeInclusive<f64>,
}

const PRESSURE: Kind = Kind {
    quantity: "lv_pressure",
    ours: "mmHg",
    units: PRESSURE_UNITS,
    option: AsksFor::PressureUnit,
    guesses: &[
        Guess {
            unit: "mmHg",
            tops: TOP_MMHG,
        },
        Guess {
            unit: "kPa",
            tops: TOP_KPA,
        },
        Guess {
            unit: "Pa",
            tops: 5300.0..=40_000.0,
        },
    ],
    any: ANY_TOP_MMHG,
};

const VOLUME: Kind = Kind {
    quantity: "volume",
    ours: "mL",
    units: VOLUME_UNITS,
    option: AsksFor::VolumeUnit,
    guesses: &[
        Guess {
            unit: "mL",
            tops: TOP_ML,
        },
        Guess {
            unit: "L",
            tops: 0.01..=0.6,
        },
        Guess {
            unit: "mm3",
            tops: 10_000.0..=600_000.0,
        },
    ],
    any: ANY_TOP_ML,
};

/// The pressure in mmHg.
pub(super) fn pressure(
    path: &Path,
    choice: &Choice,
    choices: &Choices,
) -> Result<Signal, NotUnderstood> {
    PRESSURE.signal(path, choice, &choices.pressure_unit)
}

/// The volume in mL.
pub(super) fn volume(
    path: &Path,
    choice: &Choice,
    choices: &Choices,
) -> Result<Signal, NotUnderstood> {
    VOLUME.signal(path, choice, &choices.volume_unit)
}

impl Kind {
    fn signal(
        &self,
        path: &Path,
        choice: &Choice,
        given: &Option<String>,
    ) -> Result<Signal, NotUnderstood> {
        let column = &choice.column;
        let (low, top) = ends(&column.values);
        let (factor, unit) = self.factor(path, choice, given, top)?;
        if !self.any.contains(&(factor * top)) {
            return Err(self.implausible(path, choice, factor, top));
        }
        if self.quantity == "volume" && low <= 0.0 {
            let problem = Problem::error(
                path,
                format!("`{}` from {low} to {top}", column.label),
                "volumes of the cavity, all positive",
                "export calibrated volumes; a volume relative to another one cannot be used",
            );
            return Err(problem.into());
        }
        Ok(Signal {
            label: column.label.clone(),
            values: column.values.iter().map(|v| factor * v).collect(),
            chosen: (choice.learned, choice.why.clone()),
            unit,
        })
    }

    fn factor(
        &self,
        path: &Path,
        choice: &Choice,
        given: &Option<String>,
        top: f64,
    ) -> Result<(f64, (Learned, String)), NotUnderstood> {
        if let Some(unit) = given {
            let factor = stated(path, self.quantity, unit, self.option.option(), self.units)?;
            let header = choice.column.unit.as_deref().unwrap_or_default();
            // The option is how a user corrects a wrong header, and how a slip contradicts a right one.
            let contradicts = |of_header: f64| of_header != factor;
            let against = match unit_factor(self.quantity, header).is_some_and(contradicts) {
                true => format!(", AGAINST the {header} of its header"),
                false => String::new(),
            };
            let how = format!("{unit} as stated{against}");
            return Ok((factor, (Learned::Told, how)));
        }
        let column = &choice.column;
        if let (Some(factor), Some(unit)) = (
            unit_factor(self.quantity, column.unit.as_deref().unwrap_or_default()),
            &column.unit,
        ) {
            return Ok((factor, (Learned::Told, format!("{unit} in the header"))));
        }
        if let Some(unit) = &column.unit {
            let meant = nearest(unit, units_of(self.quantity)).map_or_else(
                || format!("say the unit: {} UNIT", self.option.option()),
                |meant| format!("did you mean {} {meant}?", self.option.option()),
            );
            let problem = Problem::error(
                path,
                format!("column `{}` with the unit {unit}", column.label),
                self.units,
                meant,
            );
            return Err(problem.into());
        }
        let fits = |guess: &&Guess| guess.tops.contains(&top);
        let Some(guess) = self.guesses.iter().find(fits) else {
            return Err(question(
                path,
                self.option,
                format!("column `{}` without a unit, up to {top}", column.label),
                self.units,
                format!(
                    "`{}` reaches {top} and has no unit: {}?",
                    column.label, self.units
                ),
                "UNIT",
            ));
        };
        let factor = unit_factor(self.quantity, guess.unit).unwrap_or(1.0);
        let why = format!(
            "{} by its size ({} says another)",
            guess.unit,
            self.option.option()
        );
        Ok((factor, (Learned::Guessed, why)))
    }

    /// Refusal of values that no heart has in their unit, with the unit that would fit.
    fn implausible(&self, path: &Path, choice: &Choice, factor: f64, top: f64) -> NotUnderstood {
        let fits = |guess: &&Guess| guess.tops.contains(&top);
        let meant = self.guesses.iter().find(fits).map_or_else(
            || format!("check the column; {} says its unit", self.option.option()),
            |guess| format!("did you mean {} {}?", self.option.option(), guess.unit),
        );
        Problem::error(
            path,
            format!(
                "column `{}` up to {:.4} {}",
                choice.column.label,
                factor * top,
                self.ours
            ),
            format!(
                "a top of {} to {} {}",
                self.any.start(),
                self.any.end(),
                self.ours
            ),
            meant,
        )
        .into()
    }
}

/// Factor of a unit that the user states.
pub(super) fn stated(
    path: &Path,
    quantity: &str,
    unit: &str,
    option: &str,
    units: &str,
) -> Result<f64, NotUnderstood> {
    unit_factor(quantity, unit).ok_or_else(|| {
        let remedy = match nearest(unit, units_of(quantity)) {
            Some(meant) => format!("did you mean {option} {meant}?"),
            None => format!("give one of these: {option} UNIT"),
        };
        Problem::error(path, format!("{option} {unit}"), units, remedy).into()
    })
}

#[cfg(test)]
mod tests {
    use cardiotwin_lab_files::plain::PlainColumn;

    use super::*;

    fn column(quantity: &'static str, unit: Option<&str>, values: &[f64]) -> Choice {
        Choice {
            column: PlainColumn {
                number: 1,
                label: "x".into(),
                quantity: Some(quantity),
                unit: unit.map(str::to_owned),
                factor: None,
                values: values.to_vec(),
            },
            learned: Learned::Told,
            why: String::new(),
        }
    }

    fn tops(
        kind: &Kind,
        unit: Option<&str>,
        given: Option<&str>,
        values: &[f64],
    ) -> Result<(f64, String), String> {
        let choice = column(kind.quantity, unit, values);
        match kind.signal(Path::new("own.csv"), &choice, &given.map(str::to_owned)) {
            Ok(signal) => Ok((ends(&signal.values).1, signal.unit.1)),
            Err(NotUnderstood::Problems(problems)) => Err(problems[0].remedy.clone()),
            Err(NotUnderstood::Question(question)) => Err(question.problem.remedy),
        }
    }

    #[test]
    fn units_come_from_the_user_the_header_or_the_size() {
        let of = |unit, given, top| tops(&PRESSURE, unit, given, &[5.0, top]).unwrap();
        assert_eq!(
            of(None, None, 118.0),
            (
                118.0,
                "mmHg by its size (--pressure-unit says another)".into()
            )
        );
        assert_eq!(of(Some("mmHg"), None, 118.0).1, "mmHg in the header");
        assert_eq!(
            of(Some("mmHg"), Some("hPa"), 118.0).1,
            "hPa as stated, AGAINST the mmHg of its header"
        );
        assert_eq!(of(Some("mbar"), Some("hPa"), 118.0).1, "hPa as stated");
        let (top, why) = of(None, None, 16.0);
        assert!(
            (top - 120.0).abs() < 0.1 && why.starts_with("kPa"),
            "{top} {why}"
        );
        assert_eq!(tops(&VOLUME, None, None, &[0.05, 0.13]).unwrap().0, 130.0);
        assert_eq!(
            tops(&VOLUME, None, None, &[50_000.0, 130_000.0]).unwrap().0,
            130.0
        );
    }

    #[test]
    fn sizes_between_two_units_are_asked_for_and_wrong_ones_refused() {
        let remedy =
            |kind: &Kind, unit, given, top| tops(kind, unit, given, &[5.0, top]).unwrap_err();
        assert_eq!(
            remedy(&PRESSURE, None, None, 33.0),
            "say it: --pressure-unit UNIT"
        );
        assert_eq!(
            remedy(&PRESSURE, Some("kPa"), None, 118.0),
            "did you mean --pressure-unit mmHg?"
        );
        assert_eq!(
            remedy(&PRESSURE, Some("mmHq"), None, 118.0),
            "did you mean --pressure-unit mmhg?"
        );
        assert_eq!(
            remedy(&PRESSURE, None, Some("kpascal"), 118.0),
            "give one of these: --pressure-unit UNIT"
        );
        assert_eq!(
            remedy(&VOLUME, Some("L"), None, 118.0),
            "did you mean --volume-unit mL?"
        );
        let relative = tops(&VOLUME, None, None, &[-20.0, 60.0]).unwrap_err();
        assert!(
            relative.starts_with("export calibrated volumes"),
            "{relative}"
        );
    }
}

//! Names and units in headers: which column is which quantity.

use crate::wanted::Wanted;

/// Name of a column as the file has it, with its unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// The whole header of the column, for example `LVP (mmHg)`.
    pub full: String,
    /// Name without the unit, for example `LVP`.
    pub name: String,
    /// Unit as written, for example `mmHg`; `None` if the header has none.
    pub unit: Option<String>,
}

impl Label {
    /// Splits a header such as `LVP (mmHg)`, `Pressure [kPa]`, `Time, s` or `time_ms`.
    #[must_use]
    pub fn new(header: &str) -> Self {
        let full = header.trim().trim_matches('"').trim().to_owned();
        let (name, unit) = split(&full);
        Self {
            name: name.to_owned(),
            unit: unit.map(str::to_owned),
            full,
        }
    }

    /// A name with a unit that the file gives apart from it.
    #[must_use]
    pub fn with_unit(name: &str, unit: Option<&str>) -> Self {
        match unit.map(str::trim).filter(|unit| !unit.is_empty()) {
            None => Self::new(name),
            Some(unit) => {
                let name = name.trim().trim_matches('"').trim();
                let titled = Self::new(name);
                let (bare, unit_of_both) = match &titled.unit {
                    Some(own) if is_same_unit(own, unit) => (titled.name.as_str(), unit.to_owned()),
                    // Two units for one column: neither counts.
                    Some(own) if name.ends_with([')', ']', '}']) => {
                        (titled.name.as_str(), format!("{own} or {unit}"))
                    }
                    _ => (name, unit.to_owned()),
                };
                Self {
                    full: format!("{name} ({unit})"),
                    name: bare.to_owned(),
                    unit: Some(unit_of_both),
                }
            }
        }
    }
}

fn split(full: &str) -> (&str, Option<&str>) {
    for (open, close) in [('(', ')'), ('[', ']'), ('{', '}')] {
        if let Some(inner) = full.strip_suffix(close)
            && let Some(at) = inner.rfind(open)
        {
            let unit = inner[at + 1..].trim();
            return (inner[..at].trim(), (!unit.is_empty()).then_some(unit));
        }
    }
    // A unit such as mL_per_s has the separator in itself.
    if let Some(at) = full.find("_per_")
        && let Some((name, _)) = full[..at].rsplit_once('_')
        && !name.is_empty()
    {
        return (name, Some(&full[name.len() + 1..]));
    }
    for sign in [", ", " / ", " in ", "_", " "] {
        if let Some((name, unit)) = full.rsplit_once(sign)
            && !name.trim().is_empty()
            && DIMENSIONS.iter().any(|d| d.factor(unit.trim()).is_some())
        {
            return (name.trim(), Some(unit.trim()));
        }
    }
    (full, None)
}

/// Units of one kind with their factors to the unit of this program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dimension {
    pub(crate) name: &'static str,
    units: &'static [(&'static str, f64)],
}

const TIME: Dimension = Dimension {
    name: "a time",
    units: &[
        ("ms", 1.0),
        ("msec", 1.0),
        ("millisecond", 1.0),
        ("milliseconds", 1.0),
        ("s", 1e3),
        ("sec", 1e3),
        ("second", 1e3),
        ("seconds", 1e3),
        ("us", 1e-3),
        ("µs", 1e-3),
        ("min", 6e4),
        ("minutes", 6e4),
        ("hours", 3.6e6),
        ("days", 8.64e7),
    ],
};
const PRESSURE: Dimension = Dimension {
    name: "a pressure",
    units: &[
        ("mmhg", 1.0),
        ("mm hg", 1.0),
        ("torr", 1.0),
        ("kpa", cardiotwin_units::MMHG_PER_KPA),
        ("hpa", 0.1 * cardiotwin_units::MMHG_PER_KPA),
        ("mbar", 0.1 * cardiotwin_units::MMHG_PER_KPA),
        ("pa", 1e-3 * cardiotwin_units::MMHG_PER_KPA),
        // 98.0665 Pa, the conventional pressure of a centimetre of water.
        ("cmh2o", 0.098_066_5 * cardiotwin_units::MMHG_PER_KPA),
    ],
};
const FLOW: Dimension = Dimension {
    name: "a flow",
    units: &[
        ("ml/s", 1.0),
        ("ml/sec", 1.0),
        ("ml_per_s", 1.0),
        ("cm3/s", 1.0),
        ("cm³/s", 1.0),
        ("l/min", 1e3 / 60.0),
        ("l_per_min", 1e3 / 60.0),
        ("ml/min", 1.0 / 60.0),
        ("l/s", 1e3),
    ],
};
const VOLTAGE: Dimension = Dimension {
    name: "a voltage",
    units: &[
        ("mv", 1.0),
        ("millivolt", 1.0),
        ("millivolts", 1.0),
        ("uv", 1e-3),
        ("µv", 1e-3),
        ("microvolt", 1e-3),
        ("microvolts", 1e-3),
        ("v", 1e3),
        ("volt", 1e3),
        ("volts", 1e3),
    ],
};
const VOLUME: Dimension = Dimension {
    name: "a volume",
    units: &[
        ("ml", 1.0),
        ("cm3", 1.0),
        ("cm³", 1.0),
        ("cc", 1.0),
        ("l", 1e3),
        ("ul", 1e-3),
        ("µl", 1e-3),
        ("mm3", 1e-3),
        ("mm³", 1e-3),
    ],
};
const DIMENSIONS: [Dimension; 5] = [TIME, PRESSURE, FLOW, VOLTAGE, VOLUME];

impl Dimension {
    /// Factor from a unit as written.
    pub(crate) fn factor(&self, unit: &str) -> Option<f64> {
        // The Greek mu and the micro sign look alike and have different codes.
        let unit = unit.trim().to_lowercase().replace('\u{3bc}', "µ");
        self.units
            .iter()
            .find(|(known, _)| *known == unit)
            .map(|(_, factor)| *factor)
    }
}

impl Dimension {
    /// Its units in lower case.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        self.units.iter().map(|(name, _)| *name).collect()
    }
}

/// Whether a unit stands for numbers without a calibration.
fn is_arbitrary(unit: &str) -> bool {
    let unit: String = unit
        .chars()
        .filter(|c| c.is_alphanumeric())
        .flat_map(char::to_lowercase)
        .collect();
    ["", "au", "nu", "adu", "counts", "raw", "units"].contains(&unit.as_str())
}

/// Whether two units are the same, whatever their spelling.
fn is_same_unit(a: &str, b: &str) -> bool {
    DIMENSIONS.iter().any(|dimension| {
        let factor = dimension.factor(a);
        factor.is_some() && factor == dimension.factor(b)
    })
}

/// Whether a text is the unit of any quantity, or stands for no unit.
pub(crate) fn is_unit(text: &str) -> bool {
    let inner = text
        .trim()
        .trim_matches('"')
        .trim_matches(['(', ')', '[', ']', '{', '}']);
    DIMENSIONS.iter().any(|d| d.factor(inner).is_some())
        || ["", "*", "-", "%", "bpm", "g"].contains(&inner)
}

/// A quantity's kind, and its names in laboratories.
pub(crate) struct Known {
    pub(crate) quantity: &'static str,
    pub(crate) dimension: Dimension,
    /// Names in lower case, letters and digits only.
    names: &'static [&'static str],
    /// Name that fits only if it is the only column of its kind; it gets a warning.
    general: &'static [&'static str],
    /// Words that tell the quantity within a longer name, if the unit is one of the quantity's.
    within: &'static [&'static str],
    /// Whether its unit does not matter, because only its shape is read.
    needs_no_unit: bool,
    /// Whether the first of several columns may be taken.
    first_of_several: bool,
}

impl Known {
    /// Whether a laboratory calls the quantity so, also if others may bear the name.
    /// - `name`: letters and digits in lower case
    pub(crate) fn has_name(&self, name: &str) -> bool {
        self.names.contains(&name) || self.general.contains(&name)
    }
}

pub(crate) const KNOWN: [Known; 6] = [
    Known {
        quantity: "time",
        dimension: TIME,
        names: &[
            "time",
            "t",
            "times",
            "elapsedtime",
            "timestamp",
            "datetime",
            "dateandtime",
            "timeofday",
            "relativetime",
            "triggertime",
            "phasetime",
            "zeit",
            "temps",
            "tiempo",
            "tempo",
            "tid",
            "tijd",
        ],
        general: &[],
        within: &[],
        needs_no_unit: false,
        first_of_several: true,
    },
    Known {
        quantity: "lv_pressure",
        dimension: PRESSURE,
        names: &[
            "lvp",
            "plv",
            "lvpressure",
            "pressurelv",
            "leftventricularpressure",
            "leftventriclepressure",
            "lvpress",
            "lvcatheter",
            "ventricularpressure",
            "lv",
            "lvprs",
        ],
        general: &["pressure", "press", "p", "druck", "pression"],
        within: &[],
        needs_no_unit: false,
        first_of_several: false,
    },
    Known {
        quantity: "aortic_pressure",
        dimension: PRESSURE,
        names: &[
            "aop",
            "pao",
            "paorta",
            "aorticpressure",
            "pressureao",
            "pressureaorta",
            "aortapressure",
            "aorta",
            "ao",
            "aopressure",
            "aorticrootpressure",
            "aortic",
            "aopress",
        ],
        general: &[],
        within: &[],
        needs_no_unit: false,
        first_of_several: false,
    },
    Known {
        quantity: "flow",
        dimension: FLOW,
        names: &[
            "aorticflow",
            "aoflow",
            "qao",
            "flowao",
            "aortaflow",
            "flowaorta",
            "flow",
            "flowrate",
            "netflow",
            "q",
            "bloodflow",
        ],
        general: &[],
        within: &[],
        needs_no_unit: false,
        first_of_several: false,
    },
    Known {
        quantity: "ecg",
        dimension: VOLTAGE,
        names: &[
            "ecg",
            "ekg",
            "ecgi",
            "ecgii",
            "ecgiii",
            "leadi",
            "leadii",
            "leadiii",
            "i",
            "ii",
            "iii",
            "mlii",
            "ecglead",
            "ecgleadii",
            "ecgleadi",
            "egm",
            "electrocardiogram",
            "electrocardiograph",
            "elektrokardiogramm",
            "elektrokardiogram",
            "ableitung",
            "ableitungi",
            "ableitungii",
            "ableitungiii",
            "surfaceecg",
        ],
        general: &[],
        within: &["ecg", "ekg"],
        needs_no_unit: true,
        first_of_several: true,
    },
    Known {
        quantity: "volume",
        dimension: VOLUME,
        names: &[
            "endovol",
            "lvv",
            "vlv",
            "lvvol",
            "lvvolume",
            "volumelv",
            "lvendovol",
            "lvendovolume",
            "endovolume",
            "lvendo",
            "leftventricularvolume",
            "leftventriclevolume",
            "lvcavityvolume",
            "lvbloodvolume",
            "volume",
            "vol",
            "volumen",
            "cavityvolume",
        ],
        general: &[],
        within: &[],
        needs_no_unit: false,
        first_of_several: false,
    },
];

/// Letters and digits of a name in lower case, without a number at its end.
pub(crate) fn plain_name(name: &str) -> String {
    let name: String = name
        .chars()
        .filter(|c| c.is_alphanumeric())
        .flat_map(char::to_lowercase)
        .collect();
    let without = name.trim_end_matches(|c: char| c.is_ascii_digit());
    if without.is_empty() {
        name
    } else {
        without.to_owned()
    }
}

/// Column that a wanted quantity was found in.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Match {
    pub(crate) place: usize,
    pub(crate) factor: f64,
    /// The name alone does not determine the quantity; there is no other column of the kind.
    pub(crate) by_kind: bool,
    /// Number of other columns with as good a name.
    pub(crate) others: usize,
}

/// Reasons why a name does not give a column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum NoMatch {
    /// No column has a known name.
    None,
    /// Several columns have known names.
    Several(Vec<usize>),
    /// The column has no unit.
    NoUnit(usize),
    /// The unit is not one of the quantity's.
    OtherUnit(usize, &'static str),
}

/// Finds a column by the names that laboratories use.
pub(crate) fn find(labels: &[Label], wanted: &Wanted) -> Result<Match, NoMatch> {
    let Some(known) = KNOWN.iter().find(|known| known.quantity == wanted.quantity) else {
        return Err(NoMatch::None);
    };
    let named = |names: &[&str]| -> Vec<usize> {
        (0..labels.len())
            .filter(|i| names.contains(&plain_name(&labels[*i].name).as_str()))
            .collect()
    };
    let mut places = named(known.names);
    if places.is_empty() {
        let has_word = |i: &usize| {
            let name = plain_name(&labels[*i].name);
            let unit = labels[*i].unit.as_deref();
            known.within.iter().any(|word| name.contains(word))
                && unit.is_some_and(|unit| known.dimension.factor(unit).is_some())
        };
        places = (0..labels.len()).filter(has_word).collect();
    }
    let by_kind = places.is_empty();
    if by_kind {
        places = named(known.general);
        let of_kind = |label: &Label| {
            label
                .unit
                .as_deref()
                .is_some_and(|unit| known.dimension.factor(unit).is_some())
        };
        if labels.iter().filter(|label| of_kind(label)).count() > 1 {
            places.clear();
        }
    }
    // A channel of the same name with another kind of unit, such as dP/dt, is another quantity.
    let fits = |i: &usize| {
        labels[*i]
            .unit
            .as_deref()
            .is_some_and(|u| known.dimension.factor(u).is_some())
    };
    if places.iter().any(fits) {
        places.retain(fits);
    }
    let others = places.len().saturating_sub(1);
    let place = match places[..] {
        [] => return Err(NoMatch::None),
        [place] => place,
        [place, ..] if known.first_of_several => place,
        _ => return Err(NoMatch::Several(places)),
    };
    let factor = match &labels[place].unit {
        None if known.needs_no_unit => 1.0,
        None => return Err(NoMatch::NoUnit(place)),
        Some(unit) => known
            .dimension
            .factor(unit)
            .or_else(|| (known.needs_no_unit && is_arbitrary(unit)).then_some(1.0))
            .ok_or(NoMatch::OtherUnit(place, known.dimension.name))?,
    };
    Ok(Match {
        place,
        factor,
        by_kind,
        others,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(headers: &[&str], quantity: &'static str) -> Result<(usize, f64), NoMatch> {
        let labels: Vec<Label> = headers.iter().map(|h| Label::new(h)).collect();
        find(&labels, &Wanted::new(quantity)).map(|m| (m.place, m.factor))
    }

    #[test]
    fn names_and_units_are_told_apart() {
        for (header, name, unit) in [
            ("LVP (mmHg)", "LVP", Some("mmHg")),
            ("Pressure [kPa]", "Pressure", Some("kPa")),
            ("Time, s", "Time", Some("s")),
            ("Time(ms)", "Time", Some("ms")),
            ("time_ms", "time", Some("ms")),
            ("flow_mL_per_s", "flow", Some("mL_per_s")),
            ("lv_pressure_mmHg", "lv_pressure", Some("mmHg")),
            ("\"ECG II (mV)\"", "ECG II", Some("mV")),
            ("Papvol", "Papvol", None),
            ("LV pressure", "LV pressure", None),
        ] {
            let label = Label::new(header);
            assert_eq!(
                (label.name.as_str(), label.unit.as_deref()),
                (name, unit),
                "{header}"
            );
        }
    }

    #[test]
    fn names_of_laboratories_are_known() {
        assert_eq!(
            of(&["Time (s)", "LVP (mmHg)", "AoP (mmHg)"], "lv_pressure"),
            Ok((1, 1.0))
        );
        assert_eq!(
            of(&["Time (s)", "LVP (mmHg)", "AoP (mmHg)"], "aortic_pressure"),
            Ok((2, 1.0))
        );
        assert_eq!(
            of(
                &["Time[ms]", "Endovol[ml]", "Epivol[ml]", "RVEndovol[ml]"],
                "volume"
            ),
            Ok((1, 1.0))
        );
        assert_eq!(of(&["t (ms)", "Druck (hPa)"], "lv_pressure").unwrap().0, 1);
        assert_eq!(of(&["ECG (\u{3bc}V)"], "ecg"), Ok((0, 1e-3)));
        // Any lead, and without a unit: only the times of R waves are read.
        for name in ["EKG V5 (mV)", "Surface EKG (mV)", "ECG", "ECG (a.u.)"] {
            assert_eq!(of(&["LVP (mmHg)", name], "ecg"), Ok((1, 1.0)), "{name}");
        }
        // dP/dt of the same channel has another unit.
        assert_eq!(
            of(&["LVP (mmHg)", "LVP (mmHg/s)"], "lv_pressure"),
            Ok((0, 1.0))
        );
    }

    #[test]
    fn a_unit_in_the_name_and_beside_it_must_agree() {
        let label = Label::with_unit("LVP [mm Hg]", Some("mmHg"));
        assert_eq!(
            find(&[label], &Wanted::new("lv_pressure")).map(|m| m.factor),
            Ok(1.0)
        );
        let label = Label::with_unit("LVP (kPa)", Some("mmHg"));
        assert_eq!(label.unit.as_deref(), Some("kPa or mmHg"));
        assert_eq!(
            find(&[label], &Wanted::new("lv_pressure")),
            Err(NoMatch::OtherUnit(0, "a pressure"))
        );
    }

    #[test]
    fn what_is_unsure_is_not_guessed() {
        assert_eq!(of(&["LVP"], "lv_pressure"), Err(NoMatch::NoUnit(0)));
        assert_eq!(
            of(&["LVP (V)"], "lv_pressure"),
            Err(NoMatch::OtherUnit(0, "a pressure"))
        );
        assert_eq!(of(&["ECG HR (bpm)"], "ecg"), Err(NoMatch::None),);
        assert_eq!(
            of(&["ECG (bpm)"], "ecg"),
            Err(NoMatch::OtherUnit(0, "a voltage"))
        );
        assert_eq!(
            of(&["LVP 1 (mmHg)", "LVP 2 (mmHg)"], "lv_pressure"),
            Err(NoMatch::Several(vec![0, 1]))
        );
        // With two pressures, `Pressure` may be either.
        assert_eq!(
            of(&["Pressure (mmHg)", "CVP (mmHg)"], "lv_pressure"),
            Err(NoMatch::None)
        );
        assert_eq!(
            of(&["Pressure (mmHg)"], "aortic_pressure"),
            Err(NoMatch::None)
        );
    }
}

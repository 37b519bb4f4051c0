//! The chosen constants of a search, and how to change each.

use cardiotwin_discover::forward::{Candidate, Forward as _};
use cardiotwin_discover::reduced::BASE;
use cardiotwin_discover::{Measured, Reduced, Settings};

/// A chosen constant.
pub struct Constant {
    /// Name in the table.
    pub name: String,
    /// Value with its unit.
    pub value: String,
    change: Change,
}

enum Change {
    Value(Field),
    Settings(fn(&mut Settings, f64)),
    Prior(&'static str),
    Candidates(fn(&mut Candidate, f64)),
}

type Field = fn(&mut Settings) -> &mut f64;

impl Constant {
    /// Multiplies the constant by a factor.
    pub fn apply(&self, settings: &mut Settings, model: &mut Reduced, factor: f64) {
        match self.change {
            Change::Value(field) => *field(settings) *= factor,
            Change::Settings(change) => change(settings, factor),
            Change::Prior(name) => model.scale_prior(name, factor),
            Change::Candidates(change) => {
                (model.candidates_mut().iter_mut()).for_each(|candidate| change(candidate, factor));
            }
        }
    }
}

/// Constants of the error model, of the competitors and of the criteria of a name, with their units.
const VALUES: [(&str, &str, Field); 16] = [
    ("uncertainty of a stated noise level", "%", |s| {
        &mut s.error_model.stated_noise
    }),
    ("correlation of neighbouring frames", "", |s| {
        &mut s.error_model.frame_correlation
    }),
    ("timing error", "ms", |s| &mut s.error_model.timing_ms),
    ("correlation time of the timing error", "ms", |s| {
        &mut s.error_model.timing_correlation_ms
    }),
    ("smooth error of pressure", "mmHg", |s| {
        &mut s.error_model.pressure_mmhg
    }),
    (
        "correlation time of the smooth error of pressure",
        "ms",
        |s| &mut s.error_model.pressure_correlation_ms,
    ),
    ("smooth error of volume", "mL", |s| {
        &mut s.error_model.volume_ml
    }),
    (
        "correlation time of the smooth error of volume",
        "ms",
        |s| &mut s.error_model.volume_correlation_ms,
    ),
    ("offset of pressure", "mmHg", |s| {
        &mut s.error_model.offset_mmhg
    }),
    ("shift of volume against pressure", "ms", |s| {
        &mut s.error_model.shift_ms
    }),
    ("common factor of volumes", "%", |s| {
        &mut s.error_model.scale
    }),
    ("competitor: factors of the activation", "%", |s| {
        &mut s.error_model.competitors.activation
    }),
    ("competitor: smooth error of pressure", "mmHg", |s| {
        &mut s.error_model.competitors.pressure_mmhg
    }),
    ("competitor: smooth error of volume", "mL", |s| {
        &mut s.error_model.competitors.volume_ml
    }),
    ("evidence for a name", "", |s| &mut s.search.least_evidence),
    ("chance of a name by noise alone", "%", |s| {
        &mut s.search.false_alarm
    }),
];

fn with_unit(value: f64, unit: &str) -> String {
    match unit {
        "%" => format!("{:.0} %", 100.0 * value),
        _ => format!("{value} {unit}").trim_end().to_owned(),
    }
}

/// All constants, with the values that they have for a patient.
pub fn all(measured: &Measured) -> Vec<Constant> {
    let (model, mut settings) = (Reduced::new(measured), Settings::default());
    let most_effects = settings.search.max_effects;
    let values = VALUES.map(|(name, unit, field)| Constant {
        name: name.to_owned(),
        value: with_unit(*field(&mut settings), unit),
        change: Change::Value(field),
    });
    let other_settings = [
        Constant {
            name: "competitor: errors learnt on healthy hearts".to_owned(),
            value: "as learnt".to_owned(),
            change: Change::Settings(|settings, factor| {
                settings.learnt = std::mem::take(&mut settings.learnt).scaled(factor);
            }),
        },
        Constant {
            name: "effects of one patient, at most".to_owned(),
            value: most_effects.to_string(),
            change: Change::Settings(|settings, factor| {
                let most = &mut settings.search.max_effects;
                *most = (f64::from(*most) * factor).ceil() as u32;
            }),
        },
    ];
    let priors = BASE
        .into_iter()
        .zip(model.base())
        .map(|(name, p)| Constant {
            name: format!("prior of `{name}`"),
            value: format!("± {}", with_unit(p.sd, if p.log { "%" } else { "" })),
            change: Change::Prior(name),
        });
    let candidates = [
        Constant {
            name: "smallest meaningful size of every effect".to_owned(),
            value: "catalogue".to_owned(),
            change: Change::Candidates(|candidate, factor| candidate.smallest *= factor),
        },
        Constant {
            name: "prior width of every effect's parameters".to_owned(),
            value: "catalogue".to_owned(),
            change: Change::Candidates(|candidate, factor| {
                candidate.parameters.iter_mut().for_each(|p| p.sd *= factor);
            }),
        },
        Constant {
            name: "prior odds of every effect".to_owned(),
            value: "catalogue".to_owned(),
            change: Change::Candidates(|candidate, factor| {
                candidate.log_prior += 2.0 * factor.ln();
            }),
        },
    ];
    (values.into_iter())
        .chain(other_settings)
        .chain(priors)
        .chain(candidates)
        .collect()
}

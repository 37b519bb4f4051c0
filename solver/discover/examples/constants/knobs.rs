//! The chosen constants of a search, and how to change each.

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
    Settings(fn(&mut Settings, f64)),
    Prior(&'static str),
    Candidates(fn(&mut cardiotwin_discover::forward::Candidate, f64)),
}

impl Constant {
    /// Multiplies the constant by a factor.
    pub fn apply(&self, settings: &mut Settings, model: &mut Reduced, factor: f64) {
        match self.change {
            Change::Settings(change) => change(settings, factor),
            Change::Prior(name) => model.scale_prior(name, factor),
            Change::Candidates(change) => {
                (model.candidates_mut().iter_mut()).for_each(|candidate| change(candidate, factor));
            }
        }
    }
}

type OfSettings = (&'static str, &'static str, fn(&mut Settings, f64));

/// Constants of the error model, of the competitors and of the criteria of a name.
const OF_SETTINGS: [OfSettings; 18] = [
    ("uncertainty of a stated noise level", "10 %", |s, f| {
        s.error_model.stated_noise *= f;
    }),
    ("correlation of neighbouring frames", "0.2", |s, f| {
        s.error_model.frame_correlation *= f;
    }),
    ("timing error", "0.5 ms", |s, f| {
        s.error_model.timing_ms *= f
    }),
    ("correlation time of the timing error", "15 ms", |s, f| {
        s.error_model.timing_correlation_ms *= f;
    }),
    ("smooth error of pressure", "0.3 mmHg", |s, f| {
        s.error_model.pressure_mmhg *= f;
    }),
    (
        "correlation time of the smooth error of pressure",
        "40 ms",
        |s, f| {
            s.error_model.pressure_correlation_ms *= f;
        },
    ),
    ("smooth error of volume", "0.5 mL", |s, f| {
        s.error_model.volume_ml *= f;
    }),
    (
        "correlation time of the smooth error of volume",
        "60 ms",
        |s, f| {
            s.error_model.volume_correlation_ms *= f;
        },
    ),
    ("offset of pressure", "1 mmHg", |s, f| {
        s.error_model.offset_mmhg *= f;
    }),
    ("shift of volume against pressure", "4 ms", |s, f| {
        s.error_model.shift_ms *= f;
    }),
    ("common factor of volumes", "2 %", |s, f| {
        s.error_model.scale *= f
    }),
    ("competitor: factors of the activation", "15 %", |s, f| {
        s.error_model.competitors.activation *= f;
    }),
    ("competitor: smooth error of pressure", "2 mmHg", |s, f| {
        s.error_model.competitors.pressure_mmhg *= f;
    }),
    ("competitor: smooth error of volume", "3 mL", |s, f| {
        s.error_model.competitors.volume_ml *= f;
    }),
    (
        "competitor: errors learnt on healthy hearts",
        "as learnt",
        |s, f| {
            s.learnt = std::mem::take(&mut s.learnt).scaled(f);
        },
    ),
    ("evidence for a name", "4.4", |s, f| {
        s.search.least_evidence *= f
    }),
    ("chance of a name by noise alone", "4 %", |s, f| {
        s.search.false_alarm *= f;
    }),
    ("effects of one patient, at most", "3", |s, f| {
        s.search.max_effects = (f64::from(s.search.max_effects) * f).ceil() as u32;
    }),
];

/// All constants, with the values that they have for a patient.
pub fn all(measured: &Measured) -> Vec<Constant> {
    use cardiotwin_discover::forward::Forward as _;
    let model = Reduced::new(measured);
    let of_settings = OF_SETTINGS.map(|(name, value, change)| Constant {
        name: name.to_owned(),
        value: value.to_owned(),
        change: Change::Settings(change),
    });
    let priors = BASE
        .into_iter()
        .zip(model.base())
        .map(|(name, p)| Constant {
            name: format!("prior of `{name}`"),
            value: if p.log {
                format!("± {:.0} %", 100.0 * p.sd)
            } else {
                format!("± {}", p.sd)
            },
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
    of_settings
        .into_iter()
        .chain(priors)
        .chain(candidates)
        .collect()
}

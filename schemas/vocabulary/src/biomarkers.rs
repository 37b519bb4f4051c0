//! Biomarkers of pressure, volume, active stress and stretch (Jung et al. 2022, Appendix C).
//!
//! [`Biomarker`] and [`Biomarkers`] are generated from one table, in which a new biomarker is one
//! line. `cardiotwin-signals` reads the biomarkers from traces.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::label::Label;

/// Trace from which a biomarker is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TraceOf {
    /// Pressure in the cavity.
    Pressure,
    /// Volume of the cavity.
    Volume,
}

macro_rules! biomarkers {
    ($($(#[doc = $doc:literal])* $variant:ident, $field:ident, $key:literal, $unit:literal,
       $symbol:literal, $subscript:literal, $trace:ident, $meaning:literal;)*) => {
        /// Name of one biomarker of a beat.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum Biomarker {
            $($(#[doc = $doc])* #[serde(rename = $key)] $variant,)*
        }

        /// Biomarkers of one beat of the left ventricle. Absent where the trace is absent.
        #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(default)]
        #[schemars(deny_unknown_fields)]
        pub struct Biomarkers {
            $($(#[doc = $doc])*
            #[serde(rename = $key, skip_serializing_if = "Option::is_none")]
            pub $field: Option<f64>,)*
        }

        impl Biomarker {
            /// All biomarkers, in the order of tables.
            pub const ALL: [Self; [$($key),*].len()] = [$(Self::$variant),*];

            /// Key with its unit, as in files.
            #[must_use]
            pub const fn key(self) -> &'static str {
                match self { $(Self::$variant => $key,)* }
            }

            /// Symbol, unit and meaning.
            #[must_use]
            pub const fn label(self) -> Label {
                match self { $(Self::$variant => Label {
                    key: $key, symbol: $symbol, subscript: $subscript, unit: $unit, meaning: $meaning,
                },)* }
            }

            /// Trace from which the biomarker is read. Biomarkers of [`TraceOf::Volume`] are absent
            /// in a personalisation to pressure alone.
            #[must_use]
            pub const fn trace(self) -> TraceOf {
                match self { $(Self::$variant => TraceOf::$trace,)* }
            }
        }

        impl Biomarkers {
            /// Value of one biomarker, in the unit of its key.
            #[must_use]
            pub const fn get(&self, biomarker: Biomarker) -> Option<f64> {
                match biomarker { $(Biomarker::$variant => self.$field,)* }
            }

            /// Mutable value of one biomarker, in the unit of its key.
            pub const fn get_mut(&mut self, biomarker: Biomarker) -> &mut Option<f64> {
                match biomarker { $(Biomarker::$variant => &mut self.$field,)* }
            }
        }
    };
}

biomarkers! {
    // variant, field, key in files, unit, symbol, subscript, trace, meaning;
    /// Peak pressure.
    PMax, p_max_mmhg, "P_max_mmHg", "mmHg", "P", "max", Pressure, "peak pressure";
    /// Largest pressure rate before the peak.
    DpdtMax, dpdt_max_mmhg_per_ms, "dPdt_max_mmHg_per_ms", "mmHg/ms", "dP/dt", "max", Pressure, "largest pressure rate before the peak";
    /// Smallest (negative) pressure rate after the peak.
    DpdtMin, dpdt_min_mmhg_per_ms, "dPdt_min_mmHg_per_ms", "mmHg/ms", "dP/dt", "min", Pressure, "smallest pressure rate after the peak";
    /// Pressure transient duration at 90 % decay, t3 − t1.
    Ptd90, ptd90_ms, "PTD90_ms", "ms", "PTD", "90", Pressure, "pressure transient duration, t3 − t1";
    /// Stroke volume.
    Sv, sv_ml, "SV_mL", "mL", "SV", "", Volume, "stroke volume";
    /// Time constant of ejection.
    TauVd, tau_vd_ms, "tau_VD_ms", "ms", "τ", "VD", Volume, "time constant of ejection";
    /// Time constant of rapid filling.
    TauVr, tau_vr_ms, "tau_VR_ms", "ms", "τ", "VR", Volume, "time constant of rapid filling";
    /// Volume at the beat's start.
    Edv, edv_ml, "EDV_mL", "mL", "EDV", "", Volume, "volume at the beat's start";
    /// Smallest volume.
    Esv, esv_ml, "ESV_mL", "mL", "ESV", "", Volume, "smallest volume";
    /// Pressure at the beat's start.
    Edp, edp_mmhg, "EDP_mmHg", "mmHg", "EDP", "", Pressure, "pressure at the beat's start";
    /// Measured EDV minus simulated volume at the beat's end.
    EndOfBeatGap, end_of_beat_gap_ml, "end_of_beat_gap_mL", "mL", "gap", "", Volume, "measured EDV minus simulated volume at the beat's end";
}

impl Biomarker {
    /// The five biomarkers of Table 2 of Jung et al. 2022, in its order.
    pub const TABLE_2: [Self; 5] = [
        Self::PMax,
        Self::DpdtMax,
        Self::DpdtMin,
        Self::Ptd90,
        Self::Sv,
    ];
    /// Terms of step 1's cost (Jung et al. 2022, eqs. 12 and 14), biomarkers of pressure first. A robustness sweep of
    /// kind `data` perturbs the same six.
    pub const OF_COST: [Self; 6] = [
        Self::PMax,
        Self::DpdtMax,
        Self::DpdtMin,
        Self::Ptd90,
        Self::TauVd,
        Self::TauVr,
    ];
    /// Biomarkers that steps 1 and 3 compare: the terms of the cost, then stroke volume.
    pub const OF_ORGAN: [Self; 7] = [
        Self::PMax,
        Self::DpdtMax,
        Self::DpdtMin,
        Self::Ptd90,
        Self::TauVd,
        Self::TauVr,
        Self::Sv,
    ];

    /// Unit as printed in reports.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        self.label().unit
    }

    /// Key without its unit, for example `P_max`.
    #[must_use]
    pub fn name(self) -> &'static str {
        let unit = self.unit().replace('/', "_per_");
        self.key().trim_end_matches(&unit).trim_end_matches('_')
    }

    /// Keys of [`Self::OF_COST`], in its order.
    pub const COST_KEYS: [&'static str; Self::OF_COST.len()] = keys(Self::OF_COST);
    /// Keys of [`Self::OF_ORGAN`], in its order.
    pub const ORGAN_KEYS: [&'static str; Self::OF_ORGAN.len()] = keys(Self::OF_ORGAN);

    /// The biomarker with this key.
    #[must_use]
    pub fn named(key: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|biomarker| biomarker.key() == key)
    }

    /// Whether a volume trace is needed to read the biomarker.
    #[must_use]
    pub const fn is_of_volume(self) -> bool {
        matches!(self.trace(), TraceOf::Volume)
    }
}

const fn keys<const N: usize>(of: [Biomarker; N]) -> [&'static str; N] {
    let mut keys = [""; N];
    let mut idx = 0;
    while idx < N {
        keys[idx] = of[idx].key();
        idx += 1;
    }
    keys
}

impl std::fmt::Display for Biomarker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.key())
    }
}

impl FromIterator<(Biomarker, Option<f64>)> for Biomarkers {
    fn from_iter<I: IntoIterator<Item = (Biomarker, Option<f64>)>>(values: I) -> Self {
        let mut all = Self::default();
        for (biomarker, value) in values {
            *all.get_mut(biomarker) = value;
        }
        all
    }
}

impl Biomarkers {
    /// Sets one value, in the unit of the biomarker's key.
    pub const fn set(&mut self, biomarker: Biomarker, value: Option<f64>) {
        *self.get_mut(biomarker) = value;
    }

    /// The biomarkers of [`Biomarker::OF_ORGAN`] with their values.
    #[must_use]
    pub fn of_organ(&self) -> [(Biomarker, Option<f64>); Biomarker::OF_ORGAN.len()] {
        Biomarker::OF_ORGAN.map(|biomarker| (biomarker, self.get(biomarker)))
    }

    /// The same values without biomarkers outside [`Biomarker::OF_ORGAN`].
    #[must_use]
    pub fn organ_alone(&self) -> Self {
        self.of_organ().into_iter().collect()
    }

    /// The same values without biomarkers that need a volume trace.
    #[must_use]
    pub fn pressure_alone(&self) -> Self {
        let of_pressure = |biomarker: &Biomarker| !biomarker.is_of_volume();
        let kept = Biomarker::ALL.into_iter().filter(of_pressure);
        kept.map(|biomarker| (biomarker, self.get(biomarker)))
            .collect()
    }

    /// Values of `given`, completed by those of `self`.
    #[must_use]
    pub fn overridden_by(&self, given: &Self) -> Self {
        Biomarker::ALL
            .into_iter()
            .map(|biomarker| (biomarker, given.get(biomarker).or(self.get(biomarker))))
            .collect()
    }

    /// Measured (`self`) over simulated value; `None` unless both exist, have the same sign and
    /// give a finite ratio.
    #[must_use]
    pub fn ratio_to(&self, simulated: &Self, biomarker: Biomarker) -> Option<f64> {
        let ratio = self.get(biomarker)? / simulated.get(biomarker)?;
        (ratio.is_finite() && ratio > 0.0).then_some(ratio)
    }
}

/// The time points that define the biomarkers (paper, Figure A1), ms from the beat's start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct TimePoints {
    /// Time of the upstroke at which the pressure crosses its minimum plus 10 % of the amplitude.
    pub t1_ms: Option<f64>,
    /// Time of the peak pressure.
    pub t2_ms: Option<f64>,
    /// Time of the downstroke at which the pressure crosses the level of `t1_ms` again.
    pub t3_ms: Option<f64>,
    /// Beginning of ejection.
    pub t4_ms: Option<f64>,
    /// End of ejection.
    pub t5_ms: Option<f64>,
    /// Beginning of filling.
    pub t6_ms: Option<f64>,
    /// Time at which 80 % of the volume is recovered.
    pub t7_ms: Option<f64>,
}

/// Biomarkers of active stress, stretch and calcium, which are the targets of step 2. They come
/// from a cell or from median nodal traces.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CellBiomarkers {
    /// Peak active stress.
    #[serde(rename = "Sa_max_kPa")]
    pub sa_max_kpa: f64,
    /// Largest rate of the active stress before its peak.
    #[serde(rename = "dSadt_max_kPa_per_ms")]
    pub dsadt_max_kpa_per_ms: f64,
    /// Stress transient duration at 30 % decay.
    #[serde(rename = "STD30_ms")]
    pub std30_ms: f64,
    /// Stress transient duration at 50 % decay.
    #[serde(rename = "STD50_ms")]
    pub std50_ms: f64,
    /// Stress transient duration at 90 % decay.
    #[serde(rename = "STD90_ms")]
    pub std90_ms: f64,
    /// Smallest fibre stretch.
    pub lambda_min: f64,
}

impl CellBiomarkers {
    /// Values in the order of [`CELL_BIOMARKERS`].
    #[must_use]
    pub const fn values(&self) -> [f64; 6] {
        [
            self.sa_max_kpa,
            self.dsadt_max_kpa_per_ms,
            self.std30_ms,
            self.std50_ms,
            self.std90_ms,
            self.lambda_min,
        ]
    }

    /// Values with their keys in files, in the order of [`CELL_BIOMARKERS`].
    #[must_use]
    pub fn by_name(&self) -> [(&'static str, f64); 6] {
        let values = self.values();
        std::array::from_fn(|idx| (CELL_BIOMARKERS[idx].key, values[idx]))
    }
}

/// Labels of [`CellBiomarkers`], in its order.
pub const CELL_BIOMARKERS: [Label; 6] = [
    of_cell("Sa_max_kPa", "S", "a,max", "kPa", "peak active stress"),
    of_cell(
        "dSadt_max_kPa_per_ms",
        "dSₐ/dt",
        "max",
        "kPa/ms",
        "largest rate before the peak",
    ),
    of_cell(
        "STD30_ms",
        "STD",
        "30",
        "ms",
        "stress transient duration at 30 % decay",
    ),
    of_cell(
        "STD50_ms",
        "STD",
        "50",
        "ms",
        "stress transient duration at 50 % decay",
    ),
    of_cell(
        "STD90_ms",
        "STD",
        "90",
        "ms",
        "stress transient duration at 90 % decay",
    ),
    of_cell("lambda_min", "λ", "min", "", "smallest fibre stretch"),
];

const fn of_cell(
    key: &'static str,
    symbol: &'static str,
    subscript: &'static str,
    unit: &'static str,
    meaning: &'static str,
) -> Label {
    Label {
        key,
        symbol,
        subscript,
        unit,
        meaning,
    }
}

/// Widths of the windows over which biomarkers of noisy traces are read. A window is absent if
/// single samples are used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct NoiseWindows {
    /// Width of the window for the largest pressure and the pressure rates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_ms: Option<f64>,
    /// Width of the window for the volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_ms: Option<f64>,
}

impl NoiseWindows {
    /// Whether samples of both traces are used without smoothing.
    #[must_use]
    pub fn are_none(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_biomarker_has_a_place_of_its_own_under_its_key() {
        let values = (1..=Biomarker::ALL.len()).map(|n| Some(n as f64));
        let biomarkers: Biomarkers = Biomarker::ALL.into_iter().zip(values).collect();
        let written = serde_json::to_value(biomarkers).unwrap();
        assert_eq!(written.as_object().unwrap().len(), Biomarker::ALL.len());
        for (n, biomarker) in (1..).zip(Biomarker::ALL) {
            assert_eq!(written[biomarker.key()], f64::from(n), "{biomarker}");
            assert_eq!(biomarkers.get(biomarker), Some(f64::from(n)));
            assert_eq!(Biomarker::named(biomarker.key()), Some(biomarker));
            let unit = biomarker.unit().replace('/', "_per_");
            assert_eq!(biomarker.key(), format!("{}_{unit}", biomarker.name()));
        }
    }

    #[test]
    fn biomarkers_of_the_cell_stand_under_their_keys() {
        let biomarkers = CellBiomarkers {
            sa_max_kpa: 1.0,
            dsadt_max_kpa_per_ms: 2.0,
            std30_ms: 3.0,
            std50_ms: 4.0,
            std90_ms: 5.0,
            lambda_min: 6.0,
        };
        let written = serde_json::to_value(biomarkers).unwrap();
        assert_eq!(written.as_object().unwrap().len(), CELL_BIOMARKERS.len());
        for (key, value) in biomarkers.by_name() {
            assert_eq!(written[key], value, "{key}");
        }
    }

    #[test]
    fn given_values_win_and_fill() {
        let found = Biomarkers {
            p_max_mmhg: Some(120.0),
            sv_ml: Some(70.0),
            ..Biomarkers::default()
        };
        let given = Biomarkers {
            p_max_mmhg: Some(125.0),
            ptd90_ms: Some(400.0),
            ..Biomarkers::default()
        };
        let merged = found.overridden_by(&given);
        assert_eq!(
            (merged.p_max_mmhg, merged.sv_ml, merged.ptd90_ms),
            (Some(125.0), Some(70.0), Some(400.0))
        );
        assert_eq!(merged.edv_ml, None);
    }

    #[test]
    fn pressure_alone_keeps_no_volume_and_organ_alone_no_other_biomarker() {
        let all: Biomarkers = Biomarker::ALL.map(|b| (b, Some(1.0))).into_iter().collect();
        let kept = |b: Biomarkers| {
            Biomarker::ALL
                .into_iter()
                .filter(move |k| b.get(*k).is_some())
        };
        assert!(kept(all.pressure_alone()).all(|b| !b.is_of_volume()));
        let of_pressure = Biomarker::ALL.into_iter().filter(|b| !b.is_of_volume());
        assert!(of_pressure.eq(kept(all.pressure_alone())));
        assert!(kept(all.organ_alone()).all(|b| Biomarker::OF_ORGAN.contains(&b)));
        assert_eq!(kept(all.organ_alone()).count(), Biomarker::OF_ORGAN.len());
    }
}

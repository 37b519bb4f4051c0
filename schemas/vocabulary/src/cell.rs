//! Table of the cell model's parameters: Land's active stress, Rice's calcium and the passive
//! scale.

use crate::label::Label;

/// One parameter of the cell model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellParameter {
    /// Key in files, symbol, unit and meaning.
    pub label: Label,
    /// Default value in the unit of the key.
    pub default: f64,
    /// Interval of the sensitivity analysis of Jung et al. 2022 (Table A5), from which steps 2 and
    /// 3 start; `None` for the passive scale.
    pub interval: Option<[f64; 2]>,
    /// Source of the default.
    pub source: &'static str,
}

const LAND: &str = "Jung et al. 2022, Table A2 (Land et al. 2017)";
const RICE: &str = "Jung et al. 2022, Table A4 (Rice et al. 2008)";
const SENSITIVITY: &str =
    "Jung et al. 2022, sensitivity analysis; Table A3's 2.1 kPa is of isolated tissue";

macro_rules! cell_parameters {
    ($($key:literal, $symbol:literal, $subscript:literal, $unit:literal, $default:literal, $interval:expr, $source:expr, $meaning:literal;)*) => {
        /// All parameters of the cell model, in the order of files and engines: Land active (17), Rice calcium (4), passive
        /// scale.
        pub const CELL: [CellParameter; [$($key),*].len()] = [$(CellParameter {
            label: Label { key: $key, symbol: $symbol, subscript: $subscript, unit: $unit, meaning: $meaning },
            default: $default,
            interval: $interval,
            source: $source,
        }),*];
        /// Keys of [`CELL`], in its order.
        pub const CELL_PARAMETERS: [&str; CELL.len()] = [$($key),*];
        /// Defaults of [`CELL`], in its order and units.
        pub const CELL_DEFAULTS: [f64; CELL.len()] = [$($default),*];
    };
}

cell_parameters! {
    // key in files, symbol, subscript, unit, default, interval, source of the default, meaning;
    "k_TRPN_per_ms", "k", "TRPN", "1/ms", 0.1, Some([0.05, 0.4]), LAND, "unbinding of calcium from troponin";
    "n_TRPN", "n", "TRPN", "", 2.0, Some([1.0, 5.0]), LAND, "cooperativity of calcium and troponin";
    "Ca50_ref_uM", "Ca", "50,ref", "µM", 0.805, Some([0.5, 2.0]), LAND, "calcium sensitivity";
    "k_U_per_ms", "k", "U", "1/ms", 1.0, Some([0.01, 2.0]), LAND, "blocked to unblocked";
    "n_Tm", "n", "Tm", "", 5.0, Some([3.0, 7.0]), LAND, "cooperativity of tropomyosin";
    "TRPN50", "TRPN", "50", "", 0.35, Some([0.3, 0.5]), LAND, "troponin at half blocking";
    "k_UW_per_ms", "k", "UW", "1/ms", 0.182, Some([0.026, 0.312]), LAND, "unbound to weakly bound cross-bridges";
    "k_WS_per_ms", "k", "WS", "1/ms", 0.012, Some([0.004, 0.048]), LAND, "weakly to strongly bound cross-bridges";
    "r_W", "r", "W", "", 0.5, Some([0.25, 0.75]), LAND, "share of weakly bound cross-bridges";
    "r_S", "r", "S", "", 0.25, Some([0.1, 0.25]), LAND, "share of strongly bound cross-bridges";
    "gamma_S_per_ms", "γ", "S", "1/ms", 0.0085, Some([0.005, 0.02]), LAND, "distortion-dependent unbinding, strong";
    "gamma_W_per_ms", "γ", "W", "1/ms", 0.615, Some([0.05, 3.0]), LAND, "distortion-dependent unbinding, weak";
    "phi", "φ", "", "", 2.23, Some([0.1, 4.0]), LAND, "distortion decay";
    "A_eff", "A", "eff", "", 25.0, Some([12.5, 37.5]), LAND, "distortion by velocity";
    "beta_0", "β", "0", "", 2.3, Some([1.15, 4.6]), LAND, "stretch dependence of the stress";
    "beta_1_uM", "β", "1", "µM", -2.4, Some([-3.6, -1.2]), LAND, "stretch dependence of the calcium sensitivity";
    "Smax_ref_kPa", "S", "max,ref", "kPa", 120.0, Some([90.0, 140.0]), LAND, "peak isometric stress";
    "Ca_res_uM", "Ca", "res", "µM", 0.15, Some([0.075, 0.225]), RICE, "resting calcium";
    "Ca_max_uM", "Ca", "max", "µM", 0.6, Some([0.3, 0.9]), RICE, "peak calcium";
    "tau_CR_ms", "τ", "CR", "ms", 129.0, Some([64.5, 192.5]), RICE, "time constant of the calcium rise";
    "tau_CD_ms", "τ", "CD", "ms", 128.0, Some([64.0, 192.0]), RICE, "time constant of the calcium decay";
    "a_p_kPa", "a", "p", "kPa", 42.0, None, SENSITIVITY, "passive stiffness of the cell model";
}

/// Constants of Land's passive element except its scale `a_p_kPa`; no fit and no file moves them.
pub const PASSIVE_ELEMENT: [CellParameter; 4] = [
    passive("b", "b", "", "", 9.1, "exponent of the parallel spring"),
    passive("k", "k", "", "", 7.0, "serial spring over parallel spring"),
    passive("eta_l_ms", "η", "l", "ms", 200.0, "dashpot on lengthening"),
    passive("eta_s_ms", "η", "s", "ms", 20.0, "dashpot on shortening"),
];

const fn passive(
    key: &'static str,
    symbol: &'static str,
    subscript: &'static str,
    unit: &'static str,
    default: f64,
    meaning: &'static str,
) -> CellParameter {
    CellParameter {
        label: Label {
            key,
            symbol,
            subscript,
            unit,
            meaning,
        },
        default,
        interval: None,
        source: "Jung et al. 2022, Table A3",
    }
}

/// The parameter with this key in [`CELL`] or [`PASSIVE_ELEMENT`], for constants.
///
/// # Panics
/// Where neither table has the key, which in a constant is an error of the compiler.
#[must_use]
pub const fn constant_of_cell(key: &str) -> CellParameter {
    let mut idx = 0;
    while idx < CELL.len() + PASSIVE_ELEMENT.len() {
        let parameter = if idx < CELL.len() {
            CELL[idx]
        } else {
            PASSIVE_ELEMENT[idx - CELL.len()]
        };
        if are_equal(parameter.label.key, key) {
            return parameter;
        }
        idx += 1;
    }
    panic!("the cell model has no parameter with this key")
}

const fn are_equal(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut idx = 0;
    while idx < a.len() && idx < b.len() && a[idx] == b[idx] {
        idx += 1;
    }
    idx == a.len() && idx == b.len()
}

/// Keys of the parameters that describe Rice's calcium transient.
pub const RICE_PARAMETERS: [&str; 4] = ["Ca_res_uM", "Ca_max_uM", "tau_CR_ms", "tau_CD_ms"];

/// The nine parameters of Land and Rice that Jung et al. 2022 fit (Table A7), in its order.
pub const TABLE_A7: [&str; 9] = [
    "n_TRPN",
    "beta_1_uM",
    "n_Tm",
    "Ca50_ref_uM",
    "k_UW_per_ms",
    "Ca_res_uM",
    "Ca_max_uM",
    "tau_CR_ms",
    "tau_CD_ms",
];

/// The parameter of the cell model with this key.
#[must_use]
pub fn cell_parameter(key: &str) -> Option<&'static CellParameter> {
    CELL.iter().find(|parameter| parameter.label.key == key)
}

/// Default of a parameter of the cell model, in the unit of its key.
#[must_use]
pub fn cell_default(key: &str) -> Option<f64> {
    cell_parameter(key).map(|parameter| parameter.default)
}

/// Intervals of the sensitivity analysis (Table A5) by key, in the order of [`CELL`].
pub fn cell_intervals() -> impl Iterator<Item = (&'static str, [f64; 2])> {
    CELL.iter()
        .filter_map(|parameter| Some((parameter.label.key, parameter.interval?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_lie_in_their_intervals_and_units_in_their_keys() {
        for parameter in CELL.iter().chain(&PASSIVE_ELEMENT) {
            assert_eq!(constant_of_cell(parameter.label.key), *parameter);
            let Label { key, unit, .. } = parameter.label;
            let [lower, upper] = parameter.interval.unwrap_or([0.0, f64::INFINITY]);
            assert!((lower..=upper).contains(&parameter.default), "{key}");
            let suffix = unit.replace("1/", "per_").replace('µ', "u");
            assert!(key.ends_with(&suffix), "{key} has unit {unit}");
        }
        assert!(
            RICE_PARAMETERS
                .iter()
                .all(|key| cell_parameter(key).is_some())
        );
        assert_eq!(cell_intervals().count(), 21);
    }
}

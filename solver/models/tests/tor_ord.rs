//! ToR-ORd against the authors' own programs. The script next to `tests/data/tor_ord.json` ran them.

use cardiotwin_models::contraction::{Land2017, Land2017Parameters};
use cardiotwin_models::tor_ord::{
    CellType, Factors, N_STATES, Outside, PacingError, SAMPLE_MS, STATES, State, TOLERANCE, TorOrd,
    Troponin,
};
use serde_json::Value;

/// Order of the states in the authors' programs; the last six only with Land's model.
const AUTHORS: [&str; N_STATES] = [
    "v", "nai", "nass", "ki", "kss", "cai", "cass", "cansr", "cajsr", "m", "hp", "h", "j", "jp",
    "mL", "hL", "hLp", "a", "iF", "iS", "ap", "iFp", "iSp", "d", "ff", "fs", "fcaf", "fcas", "jca",
    "nca", "nca_i", "ffp", "fcafp", "xs1", "xs2", "Jrel_np", "CaMKt", "ikr_c0", "ikr_c1", "ikr_c2",
    "ikr_o", "ikr_i", "Jrel_p", "S", "W", "CaTRPN", "B", "zeta_S", "zeta_W",
];

fn numbers(value: &Value) -> Vec<f64> {
    let array = value.as_array().unwrap();
    array.iter().map(|x| x.as_f64().unwrap()).collect()
}

fn position(name: &str) -> usize {
    STATES.iter().position(|state| *state == name).unwrap()
}

/// A case of the reference.
struct Case {
    name: String,
    cell: TorOrd,
    cycle_ms: f64,
    n_beats: u64,
    start: State,
    end: Vec<f64>,
    time_ms: Vec<f64>,
    expected: Value,
}

/// Margara's constants of Land's model.
fn land() -> Land2017 {
    Land2017::new(Land2017Parameters {
        k_u_per_ms: 0.021,
        n_tm: 2.036,
        cap_unblocking: true,
        ..Land2017Parameters::default()
    })
    .unwrap()
}

fn case(of: &Value) -> Case {
    let cell_type = match of["cell_type"].as_str().unwrap() {
        "endo" => CellType::Endocardial,
        "epi" => CellType::Epicardial,
        _ => CellType::MidMyocardial,
    };
    let factors = Factors::from_values(numbers(&of["factors"]).try_into().unwrap());
    let [na_mm, ca_mm, k_mm] = numbers(&of["outside_mM"]).try_into().unwrap();
    let outside = Outside { na_mm, ca_mm, k_mm };
    let troponin = if of["with_land"].as_bool().unwrap() {
        Troponin::Land
    } else {
        Troponin::Instantaneous
    };
    let mut start = State([0.0; N_STATES]);
    for (name, value) in AUTHORS.iter().zip(numbers(&of["start"])) {
        start.0[position(name)] = value;
    }
    if troponin == Troponin::Instantaneous {
        // Land's states follow only; any would do.
        start.0[position("CaTRPN")] = 8e-3;
        start.0[position("B")] = 1.0;
    }
    Case {
        name: of["name"].as_str().unwrap().to_owned(),
        cell: TorOrd::new(
            cell_type,
            factors,
            outside,
            troponin,
            land().equations(),
            1.0,
        ),
        cycle_ms: of["cycle_ms"].as_f64().unwrap(),
        n_beats: of["n_beats"].as_u64().unwrap(),
        start,
        end: numbers(&of["end"]),
        time_ms: numbers(&of["time_ms"]),
        expected: of.clone(),
    }
}

fn cases() -> Vec<Case> {
    let document: Value = serde_json::from_str(include_str!("data/tor_ord.json")).unwrap();
    let cases = document["cases"].as_array().unwrap();
    cases.iter().map(case).collect()
}

impl Case {
    /// States of the last beat at the reference's times, and at its end.
    fn run(&self, tolerance: f64) -> (Vec<State>, State) {
        let mut state = self.start;
        for _ in 1..self.n_beats {
            state = self.cell.beat(&state, self.cycle_ms, tolerance, |_, _| {});
        }
        let mut every = Vec::new();
        let end = self
            .cell
            .beat(&state, self.cycle_ms, tolerance, |_, state| {
                every.push(*state);
            });
        let at = |ms: &f64| every[(ms / SAMPLE_MS).round() as usize];
        (self.time_ms.iter().map(at).collect(), end)
    }

    /// Largest difference to a trace of the reference from 6 ms on, when the upstroke is over.
    fn difference(&self, found: &[State], state: &str, key: &str) -> f64 {
        let idx = position(state);
        let expected = numbers(&self.expected[key]);
        let late = self.time_ms.iter().zip(found).zip(&expected);
        late.filter(|((ms, _), _)| **ms >= 6.0)
            .map(|((_, found), expected)| (found.0[idx] - expected).abs())
            .fold(0.0, f64::max)
    }
}

/// Potential, calcium and force of every case along its last beat, and all states at its end.
fn check(tolerance: f64, mv: f64, permille_of_peak: f64, end_permille: f64) {
    let cases = cases();
    assert_eq!(cases.len(), 7);
    for case in cases {
        let (found, end) = case.run(tolerance);
        let name = &case.name;
        let v = case.difference(&found, "v", "V_mV");
        assert!(v < mv, "{name}: {v} mV");
        for (state, key) in [
            ("cai", "Ca_i_mM"),
            ("cass", "Ca_ss_mM"),
            ("cajsr", "Ca_jsr_mM"),
            ("CaTRPN", "CaTRPN"),
            ("S", "S"),
        ] {
            if case.expected[key].is_null() {
                continue;
            }
            let peak = numbers(&case.expected[key]).into_iter().fold(0.0, f64::max);
            let off = 1e3 * case.difference(&found, state, key) / peak;
            assert!(off < permille_of_peak, "{name}: {state} {off} permille");
        }
        for (state, expected) in AUTHORS.iter().zip(&case.end) {
            let found = end.0[position(state)];
            let off = 1e3 * (found - expected).abs() / expected.abs().max(1e-4);
            assert!(off < end_permille, "{name}: {state} {found} for {expected}");
        }
    }
}

/// Observed: 0.52 mV, 5.1 and 3.4 permille.
#[test]
fn with_the_usual_steps_every_case_is_the_authors() {
    check(TOLERANCE, 1.0, 10.0, 7.0);
}

/// Observed: 0.002 mV, 0.02 and 0.11 permille, what the reference's own tolerance leaves.
#[test]
fn with_short_steps_every_case_is_the_authors_closely() {
    check(1e-5, 0.01, 0.05, 0.3);
}

/// Peak of calcium \[µM\], and duration of the action potential at 90 % of repolarisation \[ms\].
fn marks(ca_um: &[f64], v_mv: &[f64]) -> [f64; 2] {
    let max = |x: &[f64]| x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let level = v_mv[0] + 0.1 * (max(v_mv) - v_mv[0]);
    let last = v_mv.iter().rposition(|v| *v > level).unwrap();
    let part = (v_mv[last] - level) / (v_mv[last] - v_mv[last + 1]);
    [max(ca_um), SAMPLE_MS * (last as f64 + part)]
}

/// Marks of one beat from a state.
fn marks_from(case: &Case, start: &State, cycle_ms: f64, tolerance: f64) -> [f64; 2] {
    let (mut ca_um, mut v_mv) = (Vec::new(), Vec::new());
    case.cell.beat(start, cycle_ms, tolerance, |_, state| {
        ca_um.push(state.ca_um());
        v_mv.push(state.v_mv());
    });
    marks(&ca_um, &v_mv)
}

#[track_caller]
fn assert_near(name: &str, found: [f64; 2], expected: [f64; 2], permille: [f64; 2]) {
    for ((found, expected), permille) in found.iter().zip(expected).zip(permille) {
        let off = 1e3 * (found / expected - 1.0).abs();
        assert!(off < permille, "{name}: {found} for {expected}");
    }
}

/// Observed: 1.4 permille of the peak, 0.8 of the duration.
#[test]
fn steps_of_half_the_length_move_calcium_and_duration_by_less_than_half_a_percent() {
    for case in cases() {
        let of = |tolerance: f64| marks_from(&case, &case.start, case.cycle_ms, tolerance);
        // The error of first order falls with the square of the step.
        assert_near(&case.name, of(TOLERANCE), of(0.25 * TOLERANCE), [5.0, 5.0]);
    }
}

/// The authors' starting states are those of a long pacing. Observed: 6 permille of the peak, 4 of the duration, 0.28 mV.
#[test]
fn paced_from_rest_the_cell_reaches_the_authors_beat() {
    let cases = cases();
    let paced = |case: &&Case| case.name.starts_with("land-") && case.cycle_ms == 1000.0;
    assert_eq!(cases.iter().filter(paced).count(), 3);
    for case in cases.iter().filter(paced) {
        let found = case.cell.periodic(1000.0).unwrap();
        let expected = marks_from(case, &case.start, 1000.0, TOLERANCE);
        let marks = marks(&found.ca_um, &found.v_mv);
        assert_near(&case.name, marks, expected, [12.0, 8.0]);
        assert!(
            (found.v_mv[0] - case.start.v_mv()).abs() < 0.5,
            "{}",
            case.name
        );
        assert!((found.ca_um[0] / case.start.ca_um() - 1.0).abs() < 5e-3);
    }
}

/// The margin is what potassium's drift, and slow sodium at short cycles, still move. Observed: 13 and 26 permille.
#[test]
fn a_beat_that_repeats_stays_for_many_beats() {
    let cases = cases();
    for (k, cycle_ms) in [(3, 650.0), (4, 800.0), (5, 800.0)] {
        let case = &cases[k];
        let found = case.cell.periodic(cycle_ms).unwrap();
        let mut state = found.start;
        for _ in 0..300 {
            state = case.cell.beat(&state, cycle_ms, TOLERANCE, |_, _| {});
        }
        let much_later = marks_from(case, &state, cycle_ms, TOLERANCE);
        let marks = marks(&found.ca_um, &found.v_mv);
        assert_near(&case.name, marks, much_later, [20.0, 35.0]);
    }
}

/// At 240 beats a minute the action potential does not end before each stimulus.
#[test]
fn a_cell_that_never_repeats_says_so() {
    let error = cases()[3].cell.periodic(250.0).unwrap_err();
    assert!(
        matches!(error, PacingError::NotPeriodic { percent, .. } if percent > 10.0),
        "{error}"
    );
}

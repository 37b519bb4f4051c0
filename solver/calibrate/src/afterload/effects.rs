//! Catalogue of effects beyond three elements: each is a term of the load or of the measurement.

use super::parameters::{Parameter, at};

/// Origin of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The effect belongs to the arteries: the model is changed.
    Physiology,
    /// The effect belongs to the measurement: the data should be corrected.
    Artefact,
    /// Flow and pressure do not show whether the arteries or the measurement cause the effect.
    Either,
}

/// An effect that a search may add.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effect {
    /// Name in files and tables; the same name as in the heart's catalogue if the effect is the
    /// same.
    pub name: &'static str,
    /// Origin of the effect.
    pub kind: Kind,
    /// Meaning, in one sentence.
    pub meaning: &'static str,
    /// Equation in the form in which it is computed.
    pub equation: &'static str,
    /// Publication on the effect. Only the abstracts of Stergiopulos et al. 1999, of Westerhof et al.
    /// 2009 and of Gardner 1981 were read. Ranges, starts and smallest values are ours.
    pub source: &'static str,
    /// Names of effects with exactly the same traces.
    pub same_as: &'static [&'static str],
    /// Measurement that would distinguish the effect from others.
    pub separated_by: &'static str,
    /// Parameters that the effect adds.
    pub parameters: &'static [Parameter],
}

/// Effects that a search tries.
pub const EFFECTS: [Effect; 10] = [
    Effect {
        name: "wave_reflection",
        kind: Kind::Physiology,
        meaning: "inertia of the blood between proximal and distal arteries sends part of the ejected wave back",
        equation: "C split f : 1 - f, between them L dQ/dt = P1 - P2 - R_l Q",
        source: "Stergiopulos et al. 1999, Am J Physiol 276:H81; Westerhof et al. 2009, Med Biol Eng Comput 47:131",
        same_as: &[],
        separated_by: "pressure at a second, distal site",
        parameters: &[
            Parameter {
                name: "inertance_mmHg_s2_per_mL",
                position: at::JUNCTION_INERTANCE,
                factor: 1.0,
                range: (1e-4, 0.03),
                starts: &[1e-3, 6e-3],
                smallest: 3e-4,
            },
            Parameter {
                name: "proximal_share",
                position: at::PROXIMAL_SHARE,
                factor: 1.0,
                range: (0.1, 0.7),
                starts: &[0.2, 0.5],
                smallest: 0.0,
            },
            Parameter {
                name: "resistance_mmHg_s_per_mL",
                position: at::JUNCTION_RESISTANCE,
                factor: 1.0,
                range: (0.0, 0.15),
                starts: &[0.05],
                smallest: 0.0,
            },
        ],
    },
    Effect {
        name: "tube_reflection",
        kind: Kind::Physiology,
        meaning: "a wave takes its time to the periphery and back: a tube of impedance R1 that ends in the compliance",
        equation: "P = R1 Q + Pc(t - T), C dPc/dt = Q(t - T) + (Pc(t - 2T) - Pc)/(2 R1) - Pc/R2",
        source: "Burattini & Di Carlo 1988, IEEE Trans Biomed Eng 35:107; Westerhof et al. 2009, Med Biol Eng Comput 47:131",
        same_as: &[],
        separated_by: "pressure at a second, distal site",
        parameters: &[Parameter {
            name: "travel_time_ms",
            position: at::TRAVEL,
            factor: 1e3,
            range: (0.004, 0.2),
            starts: &[0.02, 0.05, 0.1],
            smallest: 0.006,
        }],
    },
    Effect {
        name: "parallel_inertance",
        kind: Kind::Physiology,
        meaning: "inertia of the blood in the whole arterial tree beside the characteristic resistance (four elements)",
        equation: "P = Pc + R1 (Q - Q_L), L dQ_L/dt = R1 (Q - Q_L)",
        source: "Burattini & Gnudi 1982, Comput Biomed Res 15:83; Stergiopulos et al. 1999, Am J Physiol 276:H81",
        same_as: &[],
        separated_by: "steady flow against mean pressure, for the total resistance",
        parameters: &[Parameter {
            name: "rate_R1_over_L_per_s",
            position: at::PARALLEL_RATE,
            factor: 1.0,
            range: (0.5, 200.0),
            starts: &[2.0, 10.0, 40.0],
            smallest: 0.5,
        }],
    },
    Effect {
        name: "series_inertance",
        kind: Kind::Physiology,
        meaning: "inertia of the blood between the pressure's site and the compliance (four elements)",
        equation: "P = R1 Q + L dQ/dt + Pc",
        source: "Landes 1943, Z Biol 101:418; Sharp et al. 2000, Med Biol Eng Comput 38:180",
        same_as: &[],
        separated_by: "flow and pressure at one site, by one device",
        parameters: &[Parameter {
            name: "inertance_mmHg_s2_per_mL",
            position: at::SERIES_INERTANCE,
            factor: 1.0,
            range: (0.0, 0.02),
            starts: &[5e-4],
            smallest: 1e-4,
        }],
    },
    Effect {
        name: "viscoelastic_wall",
        kind: Kind::Physiology,
        meaning: "part of the arteries' stretch follows the pressure late (creep), a compliance that falls with frequency",
        equation: "V = C ((1 - s) P + s x), tau dx/dt = P - x",
        source: "Burattini & Natalucci 1998, Med Eng Phys 20:502; Westerhof et al. 2009, Med Biol Eng Comput 47:131",
        same_as: &[],
        separated_by: "diameter of the aorta against its pressure",
        parameters: &[
            Parameter {
                name: "creep_share",
                position: at::CREEP_SHARE,
                factor: 1.0,
                range: (0.0, 0.95),
                starts: &[0.3, 0.7],
                smallest: 0.05,
            },
            Parameter {
                name: "creep_time_ms",
                position: at::CREEP_TIME,
                factor: 1e3,
                range: (0.01, 1.0),
                starts: &[0.04, 0.2],
                smallest: 0.0,
            },
        ],
    },
    Effect {
        name: "quadratic_loss",
        kind: Kind::Physiology,
        meaning: "a narrowing downstream of the pressure's site (K > 0), or pressure taken from the jet's speed (K < 0)",
        equation: "P = R1 Q + K Q|Q| + Pc",
        source: "Bernoulli's equation; Young & Tsai 1973, J Biomech 6:395",
        same_as: &[],
        separated_by: "pressure at a second site, or the same at another stroke volume",
        parameters: &[Parameter {
            name: "loss_mmHg_s2_per_mL2",
            position: at::LOSS,
            factor: 1.0,
            range: (-1e-3, 1e-3),
            starts: &[-3e-5, 3e-5],
            smallest: 5e-6,
        }],
    },
    Effect {
        name: "pressure_dependent_compliance",
        kind: Kind::Physiology,
        meaning: "arteries become stiffer with pressure",
        equation: "C(P) = C exp(-beta (P - mean P))",
        source: "Hughes et al. 1979 and Liu et al. 1986, Am J Physiol 251:H588 (exponential pressure-volume relation)",
        same_as: &[],
        separated_by: "the same arteries at another mean pressure",
        parameters: &[Parameter {
            name: "beta_per_mmHg",
            position: at::STIFFENING,
            factor: 1.0,
            range: (-0.05, 0.1),
            starts: &[0.01],
            smallest: 2e-3,
        }],
    },
    Effect {
        name: "outflow_pressure",
        kind: Kind::Either,
        meaning: "pressure falls towards another value than zero: venous or critical closing pressure, or a trace's zero",
        equation: "C dPc/dt = Q - (Pc - P_out)/R2",
        source: "Segers et al. 2008, Hypertension 52:1; a shift of pressure or flow has the same equations (docs/afterload.md)",
        same_as: &["pressure_offset", "flow_offset"],
        separated_by: "both zeros checked against the atmosphere and no flow; a long diastole (asystole) of the pressure",
        parameters: &[Parameter {
            name: "outflow_pressure_mmHg",
            position: at::OUTFLOW,
            factor: 1.0,
            range: (-150.0, 150.0),
            starts: &[-20.0, 20.0, 60.0],
            smallest: 5.0,
        }],
    },
    Effect {
        name: "timing_misalignment",
        kind: Kind::Artefact,
        meaning: "pressure comes later (earlier where negative) than flow: clocks, filters, or the way between both sites",
        equation: "P_measured(t) = P(t - D)",
        source: "Segers et al. 2008, Hypertension 52:1 (alignment of flow and pressure)",
        same_as: &[],
        separated_by: "flow and pressure at one site, by one device",
        parameters: &[Parameter {
            name: "delay_ms",
            position: at::LAG,
            factor: 1e3,
            range: (-0.08, 0.08),
            starts: &[-0.02, 0.01],
            smallest: 2e-3,
        }],
    },
    Effect {
        name: "catheter_response",
        kind: Kind::Artefact,
        meaning: "the pressure line rings or lags as a damped oscillator",
        equation: "P_measured'' + 2 z w P_measured' + w^2 P_measured = w^2 P, w = 2 pi f",
        source: "Gardner 1981, Anesthesiology 54:227",
        same_as: &[],
        separated_by: "a fast-flush test of the line, or a catheter-tip manometer",
        parameters: &[
            Parameter {
                name: "period_ms",
                position: at::CATHETER_PERIOD,
                factor: 1e3,
                range: (0.01, 0.2),
                starts: &[0.025, 0.08],
                smallest: 0.02,
            },
            Parameter {
                name: "damping",
                position: at::CATHETER_DAMPING,
                factor: 1.0,
                range: (0.05, 1.5),
                starts: &[0.15, 0.6],
                smallest: 0.0,
            },
        ],
    },
];

/// Effects that flow and pressure at one site cannot show even in principle, with the reason.
pub const HIDDEN: [(&str, &str); 4] = [
    (
        "voigt_wall",
        "a wall with one viscous element (P = V/C + eta dV/dt) has an impedance of the same form as three elements: it only \
         changes their values; the aorta's diameter would show it",
    ),
    (
        "flow_scaling",
        "a wrong flow calibration scales R1, R2 and 1/C together; another measurement of stroke volume would show it",
    ),
    (
        "pressure_offset",
        "a shifted pressure zero has exactly the traces of outflow_pressure; checked zeros would show it",
    ),
    (
        "flow_offset",
        "a shifted flow zero has exactly the traces of outflow_pressure; checked zeros would show it",
    ),
];

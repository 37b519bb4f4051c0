//! Invented findings for tests: a kick, no missing effect, a gap without a name.

use std::collections::BTreeMap;

use cardiotwin_schemas::discover::{
    BiomarkerGap, ComparedSignal, Dependence, DiscoverSeries, Discovered, EffectClass, Findings,
    FiniteElementBeat, FiniteElementGap, FoundModel, GapAt, InThreeDimensions, IndexChange,
    PhaseBegin, Place, RankedEffect, SearchSettings, Side, SimulatedCurves, StatedFilling,
    Unexplained,
};
use cardiotwin_schemas::organ::{EffectSpec, OneFibrePassive, WindkesselParameters};

const PHASES: [(&str, f64); 7] = [
    ("isovolumic_contraction", 20.0),
    ("early_ejection", 80.0),
    ("late_ejection", 200.0),
    ("isovolumic_relaxation", 330.0),
    ("rapid_filling", 400.0),
    ("diastasis", 520.0),
    ("atrial_systole", 680.0),
];

/// A candidate with one strength parameter.
pub fn effect(name: &str, log_evidence: f64, artefact: bool) -> RankedEffect {
    RankedEffect {
        name: name.to_owned(),
        meaning: "What it is.".to_owned(),
        artefact,
        probability: if log_evidence > 6.0 { 0.98 } else { 0.01 },
        delta_bic: log_evidence - 3.0,
        log_evidence,
        robust_evidence: log_evidence,
        delta_deviance: log_evidence + 8.0,
        strength: [("amplitude_mmHg".to_owned(), 7.9)].into(),
        interval: [("amplitude_mmHg".to_owned(), [6.25, 9.5])].into(),
        plausible: log_evidence > 0.0,
        in_3d: InThreeDimensions {
            way: "as-it-is".to_owned(),
            how: None,
        },
        remedy: artefact.then(|| "correct the trace".to_owned()),
    }
}

fn place(signal: &str, phase: &str, size: f64, z: f64, share: f64) -> Place {
    let sign = if size < 0.0 { Side::Below } else { Side::Above };
    let unit = if signal == "volume" { "mL" } else { "mmHg" };
    let biomarkers = vec!["EDV".to_owned()];
    Place {
        signal: signal.into(),
        phase: phase.into(),
        sign,
        size,
        unit: unit.into(),
        z,
        share,
        biomarkers,
    }
}

/// A finding with these candidates, the first `n_accepted` of which are accepted.
pub fn finding(effects: Vec<RankedEffect>, n_accepted: usize) -> Discovered {
    let accepted: Vec<String> = effects[..n_accepted]
        .iter()
        .map(|e| e.name.clone())
        .collect();
    let of = |artefact: bool| -> Vec<EffectSpec> {
        let chosen = effects[..n_accepted]
            .iter()
            .filter(|e| e.artefact == artefact);
        chosen
            .map(|e| EffectSpec {
                name: e.name.clone(),
                parameters: e.strength.clone(),
            })
            .collect()
    };
    let time_ms: Vec<f64> = (0..20).map(|i| 40.0 * f64::from(i)).collect();
    let compared = |level: f64, noise_sd: f64| ComparedSignal {
        measured: time_ms
            .iter()
            .map(|t| level + 40.0 * (t / 130.0).sin())
            .collect(),
        before: time_ms
            .iter()
            .map(|t| level + 36.0 * (t / 130.0).sin())
            .collect(),
        after: time_ms
            .iter()
            .map(|t| level + 39.5 * (t / 130.0).sin())
            .collect(),
        heldout_before: None,
        heldout_after: None,
        noise_sd,
        time_ms: time_ms.clone(),
    };
    let (pressure, volume) = (compared(60.0, 1.0), compared(110.0, 2.5));
    let curves = SimulatedCurves {
        time_ms: time_ms.clone(),
        pressure_before_mmhg: pressure.before.clone(),
        pressure_after_mmhg: pressure.after.clone(),
        volume_before_ml: volume.before.clone(),
        volume_after_ml: volume.after.clone(),
    };
    let shrinks = |before: f64, after: f64| if n_accepted == 0 { before } else { after };
    let (physiology, artefacts) = (of(false), of(true));
    let findings = Findings {
        none: n_accepted == 0,
        effects,
        accepted,
        confusable: if n_accepted == 0 {
            vec![]
        } else {
            vec!["passive_stiffening".to_owned()]
        },
        confusable_with: vec![],
        classes: vec![],
        deciding_measurement: if n_accepted == 0 {
            vec![]
        } else {
            vec!["atrial or wedge pressure".to_owned()]
        },
        not_identifiable: vec!["cross_fibre_stress".to_owned()],
        not_identifiable_without: vec![],
        unexplained: None,
        remaining: None,
        gap_before: 1.61,
        gap_after: shrinks(1.61, 0.94),
        gap_heldout_before: Some(1.72),
        gap_heldout_after: Some(shrinks(1.72, 1.1)),
        p_value: 0.0005,
        threshold: 6.0,
        nameless_evidence: 2.1,
        places: vec![
            place("volume", "atrial_systole", 6.0, 3.1, 0.6),
            place("pressure", "diastasis", -0.9, -1.4, 0.3),
            place("whole_heart_volume", "beat", 0.4, 0.1, 0.1),
        ],
        where_after: vec![place("volume", "atrial_systole", 0.5, 0.3, 0.2)],
        gaps: ["volume", "pressure"]
            .map(|signal| GapAt {
                signal: signal.to_owned(),
                phase: "beat".to_owned(),
                n: 20,
                before: 1.7,
                after: shrinks(1.7, 0.95),
                heldout_before: Some(1.8),
                heldout_after: None,
            })
            .into(),
    };
    Discovered {
        findings,
        model: FoundModel {
            effects: physiology,
            corrections: artefacts,
            afterload: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.05,
                peripheral_resistance_mmhg_s_per_ml: 0.9,
                compliance_ml_per_mmhg: 1.5,
            },
            left_atrial_pressure_mmhg: 7.0,
            passive: OneFibrePassive {
                wall_volume_ml: 110.0,
                unloaded_volume_ml: 50.0,
                end_diastolic_volume_ml: 150.0,
                end_diastolic_pressure_mmhg: 11.0,
                stiffness_kpa: 1.1,
                exponent: 9.0,
            },
        },
        indices: [
            ("filling_pressure_mmHg", 12.5, 8.5),
            ("ejection_fraction", 0.56, 0.565),
        ]
        .map(|(name, before, after)| IndexChange {
            name: name.to_owned(),
            before,
            after,
        })
        .into(),
        biomarkers: vec![BiomarkerGap {
            name: "EDV_mL".to_owned(),
            measured: 151.0,
            before: Some(140.0),
            after: Some(150.0),
        }],
        stated_filling: Some(StatedFilling {
            left_atrial_pressure_mmhg: 6.5,
            measured_ml: 151.0,
            before_ml: Some(131.0),
            after_ml: Some(149.0),
            late_filling_before_ml: Some(18.0),
            late_filling_after_ml: Some(2.0),
        }),
        base: BTreeMap::new(),
        base_before: BTreeMap::new(),
        noise_seen_over_stated: None,
        n_evaluations: 5000,
        series: DiscoverSeries {
            phases: PHASES
                .map(|(phase, begin_ms)| PhaseBegin {
                    phase: phase.to_owned(),
                    begin_ms,
                })
                .into(),
            pressure,
            volume,
            curves,
        },
        seed: 1,
        settings: SearchSettings {
            effects: vec!["atrial_kick".to_owned()],
            least_evidence: 4.4,
            false_alarm: 0.04,
            n_bootstrap: 2000,
            max_effects: 3,
        },
        data: [
            ("pressure".to_owned(), "ab".repeat(32)),
            ("volume".to_owned(), "cd".repeat(32)),
        ]
        .into(),
    }
}

/// A finding in which only an atrial kick is accepted.
pub fn kick() -> Discovered {
    finding(
        vec![
            effect("atrial_kick", 20.0, false),
            effect("viscoelasticity", -2.0, false),
        ],
        1,
    )
}

/// A finding in which no candidate is better than the base model.
pub fn nothing() -> Discovered {
    let mut found = finding(vec![effect("viscoelasticity", 1.0, false)], 0);
    found.findings.p_value = 0.4;
    found
}

/// A gap that no candidate explains.
pub fn unexplained() -> Discovered {
    let mut found = nothing();
    found.findings.unexplained = Some(Unexplained {
        kind: "activation".to_owned(),
        log_evidence: 22.0,
        place: found.findings.places[0].clone(),
        depends_on: vec![Dependence {
            signal: "pressure".into(),
            variable: "aortic_flow".into(),
            share: 0.4,
        }],
    });
    found
}

/// A gap that is too small to be called unexplained.
pub fn gap() -> Discovered {
    let mut found = unexplained();
    found.findings.remaining = found.findings.unexplained.take();
    found
}

/// A likely candidate without a name, although chance alone is as good in half of the draws.
pub fn likely() -> Discovered {
    let mut found = finding(vec![effect("atrial_kick", 3.0, false)], 0);
    found.findings.p_value = 0.5;
    found.findings.effects[0].probability = 0.91;
    found
}

/// Two effects of which one is missing.
pub fn one_of_two() -> Discovered {
    let names = ["delayed_relaxation", "dyssynchrony"];
    let mut found = finding(names.map(|name| effect(name, 5.0, false)).into(), 0);
    found.findings.classes = vec![EffectClass {
        effects: names.map(str::to_owned).into(),
        probability: 0.92,
    }];
    found.findings.deciding_measurement = vec!["QRS".to_owned()];
    found
}

/// A gap on the finite-element ventricle, with the curves of the search.
pub fn finite_element(found: &Discovered) -> FiniteElementGap {
    let beat = |task: &str, pressure_rms_mmhg, volume_rms_ml| FiniteElementBeat {
        task: task.to_owned(),
        pressure_rms_mmhg,
        volume_rms_ml,
    };
    FiniteElementGap {
        nodes: 1043,
        before: beat("b", 6.6, 4.4),
        after: beat("a", 4.1, 1.3),
        gaps: found.findings.gaps.clone(),
        series: found.series.clone(),
    }
}

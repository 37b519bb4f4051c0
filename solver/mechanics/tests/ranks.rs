//! A beat on several threads is the beat on one.

mod support;

use std::ops::ControlFlow;

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, EndDiastole, FiniteElementVentricle, FoundState, PassiveFit, PassiveJob,
    PassiveState, PassiveStateError, Piece, Search, SearchProgress, UnloadingSettings,
    VentricleParts, WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_models::beat::{BeatOutcome, BeatSettings, BeatTraces, run_beats, run_observed};
use cardiotwin_models::circulation::Circulation;
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::step_control::StepControl;
use cardiotwin_models::ventricle::{
    GroupContraction, Ventricle, VentricleError, VentricleSnapshot,
};
use cardiotwin_units::Ms;
use support::{MUSCLE, circulation, heart};

/// A heart of soft muscle that was inflated to 1.2 kPa.
struct Subject {
    anatomy: Anatomy,
    times: Vec<f64>,
    wall: WallParameters,
    end_diastole: EndDiastole,
}

fn subject(kind: ElementKind) -> Subject {
    let (mesh, times) = heart();
    let anatomy = Anatomy::of(&mesh, &MUSCLE, kind).expect("an anatomy");
    let mut wall = WallParameters::default();
    wall.muscle = wall.muscle.with_stiffness(0.8);
    let mut state = PassiveState::unloaded_image(&Piece::whole(&anatomy), &wall).expect("a wall");
    state
        .inflate(1.2, &mut Search::new(UnloadingSettings::default()))
        .expect("inflates");
    Subject {
        anatomy,
        times,
        wall,
        end_diastole: state.into(),
    }
}

impl Subject {
    fn on(&self, n_ranks: usize) -> FiniteElementVentricle {
        self.try_on(n_ranks).expect("a ventricle")
    }

    fn try_on(&self, n_ranks: usize) -> Result<FiniteElementVentricle, VentricleError> {
        let tanh = TanhParameters {
            t_cr_ms: 400.0,
            ..TanhParameters::default()
        };
        let parts = VentricleParts {
            anatomy: &self.anatomy,
            wall: &self.wall,
            end_diastole: self.end_diastole.clone(),
            contraction: GroupContraction::tanh(Tanh::new(tanh).expect("parameters")),
            activation_ms: &self.times,
            cycle_length: Ms(660.0),
            pressure_terms: vec![],
            viscosity: None,
            settings: StepSettings::default(),
        };
        FiniteElementVentricle::on_threads(parts, n_ranks, ThreadSettings::default())
    }

    fn beat(&self, n_ranks: usize) -> (BeatTraces, VentricleSnapshot) {
        let settings = BeatSettings {
            record_nodes: true,
            step: Ms(2.0),
            ..BeatSettings::one_beat(Ms(660.0))
        };
        self.beat_with(n_ranks, &settings)
    }

    fn beat_with(
        &self,
        n_ranks: usize,
        settings: &BeatSettings,
    ) -> (BeatTraces, VentricleSnapshot) {
        let (mut ventricle, mut blood) = (self.on(n_ranks), circulation());
        match run_beats(&mut ventricle, &mut blood, settings) {
            BeatOutcome::Finished(result) => {
                assert!(result.succeeded(), "{:?}", result.checks);
                (result.traces, ventricle.snapshot())
            }
            BeatOutcome::Diverged { t, reason, .. } => {
                panic!("{n_ranks} ranks diverged at {} ms: {reason}", t.0)
            }
        }
    }
}

/// Largest difference over the largest value.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let largest = a
        .iter()
        .fold(0.0_f64, |m, x| m.max(x.abs()))
        .max(f64::MIN_POSITIVE);
    a.iter()
        .zip(b)
        .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()))
        / largest
}

/// Greatest and least pressure and slope, and stroke volume.
fn biomarkers(traces: &BeatTraces) -> [f64; 4] {
    let (p, v) = (&traces.pressure_mmhg, &traces.volume_ml);
    let most = |x: &mut dyn Iterator<Item = f64>| x.fold(f64::MIN, f64::max);
    let slopes = || p.windows(3).map(|w| 0.5 * (w[2] - w[0]));
    [
        most(&mut p.iter().copied()),
        most(&mut slopes()),
        most(&mut slopes().map(|s| -s)),
        most(&mut v.iter().copied()) - -most(&mut v.iter().map(|v| -v)),
    ]
}

#[test]
fn a_beat_is_the_same_on_any_number_of_threads_and_the_same_to_the_bit_on_as_many() {
    let subject = subject(ElementKind::LINEAR_NODAL);
    let (alone, end) = subject.beat(1);
    for n_ranks in [2, 3] {
        let (traces, snapshot) = subject.beat(n_ranks);
        for (a, b) in biomarkers(&alone).into_iter().zip(biomarkers(&traces)) {
            assert!((a / b - 1.0).abs() < 1e-4, "{n_ranks} ranks: {b} for {a}");
        }
        let (one, more) = (
            alone.nodes.as_ref().expect("recorded"),
            traces.nodes.as_ref().expect("recorded"),
        );
        assert_eq!(one.activation_ms, more.activation_ms);
        assert!(apart(&one.weights, &more.weights) < 1e-12);
        assert!(apart(&one.lambda, &more.lambda) < 1e-4 && apart(&one.sa_kpa, &more.sa_kpa) < 1e-3);
        assert_eq!(
            snapshot.values[0], end.values[0],
            "both end at the same time"
        );
        if n_ranks == 2 {
            assert_eq!(
                subject.beat(n_ranks),
                (traces, snapshot),
                "on as many threads again"
            );
        }
    }
}

/// Steps of 1 ms, and of up to 4 ms where their error allows it.
fn controlled() -> BeatSettings {
    BeatSettings {
        record_nodes: true,
        control: Some(StepControl {
            longest: Ms(4.0),
            tolerance_per_s: 5.0,
        }),
        ..BeatSettings::one_beat(Ms(660.0))
    }
}

#[test]
fn controlled_steps_are_the_same_on_any_number_of_threads() {
    let subject = subject(ElementKind::LINEAR_NODAL);
    let (alone, end) = subject.beat_with(1, &controlled());
    for n_ranks in [2, 3] {
        let (traces, snapshot) = subject.beat_with(n_ranks, &controlled());
        for (a, b) in biomarkers(&alone).into_iter().zip(biomarkers(&traces)) {
            assert!((a / b - 1.0).abs() < 1e-3, "{n_ranks} ranks: {b} for {a}");
        }
        assert_eq!(traces.time_ms, alone.time_ms);
        assert_eq!(snapshot.values[0], end.values[0]);
        if n_ranks == 2 {
            let again = subject.beat_with(n_ranks, &controlled());
            assert_eq!(again, (traces, snapshot), "on as many threads again");
        }
    }
}

#[test]
fn a_controlled_beat_goes_on_from_a_snapshot_to_the_bit() {
    let subject = subject(ElementKind::LINEAR_NODAL);
    let (whole, end) = subject.beat_with(1, &controlled());
    for stop_ms in [70.0, 300.0] {
        let (mut ventricle, mut blood) = (subject.on(1), circulation());
        let stopped = run_observed(&mut ventricle, &mut blood, &controlled(), None, |seen| {
            if seen.ventricle.time().0 < stop_ms {
                return ControlFlow::Continue(());
            }
            let states = (seen.ventricle.snapshot(), seen.circulation.snapshot());
            ControlFlow::Break((seen.progress.clone(), states))
        });
        let ControlFlow::Break((progress, (wall, load))) = stopped else {
            panic!("stopped at {stop_ms} ms")
        };
        let (mut ventricle, mut blood) = (subject.on(1), circulation());
        ventricle.restore(&wall).expect("a snapshot of this heart");
        blood.restore(&load).expect("its own snapshot");
        let from = Some(progress);
        let resumed = run_observed(&mut ventricle, &mut blood, &controlled(), from, |_| {
            ControlFlow::<()>::Continue(())
        });
        let ControlFlow::Continue(BeatOutcome::Finished(resumed)) = resumed else {
            panic!("the beat ends")
        };
        assert_eq!(resumed.traces, whole, "stopped at {stop_ms} ms");
        assert_eq!(ventricle.snapshot(), end, "stopped at {stop_ms} ms");
    }
}

#[test]
fn steps_are_the_same_with_every_linear_element_and_more_threads() {
    for kind in [ElementKind::LINEAR_NODAL, ElementKind::LINEAR_POINTWISE] {
        let subject = subject(kind);
        let first = |n_ranks: usize| steps(&mut subject.on(n_ranks), &mut circulation(), 50);
        let (alone, others) = (first(1), first(4));
        assert!(
            apart(&alone, &others) < 1e-5,
            "{kind:?}: {}",
            apart(&alone, &others)
        );
    }
}

fn steps(ventricle: &mut FiniteElementVentricle, blood: &mut Circulation, n: usize) -> Vec<f64> {
    let mut seen = vec![];
    for _ in 0..n {
        let tried = ventricle.try_step(blood, Ms(1.0)).expect("a step");
        ventricle.commit();
        blood.commit();
        seen.extend([tried.pressure.0, tried.volume.0]);
    }
    seen
}

#[test]
fn a_snapshot_goes_on_on_any_number_of_threads() {
    let subject = subject(ElementKind::LINEAR_NODAL);
    let (mut two, mut blood) = (subject.on(2), circulation());
    steps(&mut two, &mut blood, 60);
    let (wall, load) = (two.snapshot(), blood.snapshot());
    let uninterrupted = steps(&mut two, &mut blood, 20);
    for n_ranks in [1, 2, 3] {
        let (mut other, mut blood) = (subject.on(n_ranks), circulation());
        other.restore(&wall).expect("a snapshot of the same heart");
        blood.restore(&load).expect("its own snapshot");
        // Levels of rigid motions belong to a partition: other ranks have none yet, and say so with a zero each.
        let again = other.snapshot().values;
        let n = again.len() - if n_ranks == 2 { 0 } else { n_ranks };
        assert_eq!(again[..n], wall.values[..n], "{n_ranks} ranks");
        let resumed = steps(&mut other, &mut blood, 20);
        assert!(
            apart(&uninterrupted, &resumed) < 1e-5,
            "{n_ranks} ranks: {}",
            apart(&uninterrupted, &resumed)
        );
        assert!(
            n_ranks != 2 || resumed == uninterrupted,
            "to the bit on as many threads"
        );
    }
    let mut foreign = wall;
    foreign.values.pop();
    assert!(matches!(
        two.restore(&foreign),
        Err(VentricleError::ForeignSnapshot { .. })
    ));
}

#[test]
fn a_step_that_fails_fails_on_all_threads_and_can_be_tried_again() {
    let subject = subject(ElementKind::LINEAR_NODAL);
    let (mut ventricle, mut blood) = (subject.on(3), circulation());
    steps(&mut ventricle, &mut blood, 5);
    let (wall, load) = (ventricle.snapshot(), blood.snapshot());
    // So long a step has no solution.
    assert!(ventricle.try_step(&mut blood, Ms(1e5)).is_err());
    ventricle.roll_back();
    blood.roll_back();
    assert_eq!(
        (ventricle.snapshot().values[..5].to_vec(), blood.snapshot()),
        (wall.values[..5].to_vec(), load)
    );
    steps(&mut ventricle, &mut blood, 5);
}

#[test]
fn what_several_threads_cannot_compute_is_refused() {
    let mut subject = subject(ElementKind::QUADRATIC_NODAL);
    let refused = subject.try_on(2).expect_err("quadratic elements");
    assert_eq!(
        refused.to_string(),
        "ranks = 2 must be 1 with quadratic elements"
    );
    subject = self::subject(ElementKind::LINEAR_NODAL);
    subject.end_diastole.unloaded[7] = [500.0, 0.0, 0.0];
    let alone = subject
        .try_on(1)
        .expect_err("an inverted element")
        .to_string();
    let many = subject
        .try_on(3)
        .expect_err("an inverted element")
        .to_string();
    let name = alone
        .split("element ")
        .nth(1)
        .and_then(|t| t.split(' ').next())
        .expect("a name");
    assert!(
        alone.contains("has Jacobian") && many.contains("has Jacobian"),
        "{alone} {many}"
    );
    assert!(
        !name.is_empty() && many.contains("rank") || many.contains(name),
        "{many} for {name}"
    );
}

fn anatomy() -> Anatomy {
    Anatomy::of(&heart().0, &MUSCLE, ElementKind::LINEAR_NODAL).expect("an anatomy")
}

/// Step 0 with the solver of large meshes.
fn found(anatomy: &Anatomy, job: &PassiveJob, n_ranks: usize) -> FoundState {
    let mut search = Search::new(UnloadingSettings::on_ranks());
    job.on_threads(anatomy, &mut search, n_ranks, ThreadSettings::default())
        .expect("a passive state")
}

/// Largest distance of a node in two states \[mm\], unloaded and loaded.
fn farthest(a: &FoundState, b: &FoundState) -> f64 {
    let loaded = |state: &FoundState| -> Vec<f64> {
        state
            .end_diastole
            .unloaded
            .as_flattened()
            .iter()
            .zip(&state.end_diastole.u)
            .map(|(x, u)| x + u)
            .collect()
    };
    let of = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()))
    };
    let unloaded = of(
        a.end_diastole.unloaded.as_flattened(),
        b.end_diastole.unloaded.as_flattened(),
    );
    unloaded.max(of(&loaded(a), &loaded(b)))
}

#[test]
fn step_0_is_the_same_on_any_number_of_threads_and_the_same_to_the_bit_on_as_many() {
    let anatomy = anatomy();
    let given = PassiveJob {
        wall: WallParameters::default(),
        target: PassiveFit::Given {
            image_pressure_kpa: 0.8,
            end_diastolic_pressure_kpa: 1.6,
        },
        slope: None,
        steepened_by: None,
    };
    let alone = found(&anatomy, &given, 1);
    for n_ranks in [2, 3, 4] {
        let several = found(&anatomy, &given, n_ranks);
        // The unloading's own tolerance is 0.02 mm.
        let apart = farthest(&alone, &several);
        assert!(apart < 0.01, "{n_ranks} ranks: {apart} mm");
        assert!(
            (several.volume_mm3 / alone.volume_mm3 - 1.0).abs() < 1e-4,
            "{n_ranks} ranks"
        );
        assert!(
            (several.unloaded_volume_mm3 / alone.unloaded_volume_mm3 - 1.0).abs() < 1e-4,
            "{n_ranks} ranks"
        );
        assert_eq!(
            (several.end_diastole.pressure_kpa, several.passes),
            (alone.end_diastole.pressure_kpa, alone.passes)
        );
        if n_ranks == 2 {
            assert_eq!(
                found(&anatomy, &given, n_ranks),
                several,
                "on as many threads again"
            );
        }
    }
}

#[test]
fn a_law_is_fitted_on_several_threads_as_on_one() {
    let anatomy = anatomy();
    let job = PassiveJob {
        wall: WallParameters::default(),
        target: PassiveFit::Unloaded {
            end_diastolic_pressure_kpa: 1.2,
            unloaded_volume_mm3: 80e3,
        },
        slope: None,
        steepened_by: Some(1.3),
    };
    let [alone, several] = [1, 2].map(|n_ranks| found(&anatomy, &job, n_ranks));
    let law = |state: &FoundState| state.wall.muscle;
    let [one, other] = [&alone, &several].map(|state| law(state).stiffness_kpa());
    assert!(
        (other / one - 1.0).abs() < 1e-3,
        "{:?} {:?}",
        law(&several),
        law(&alone)
    );
    assert_eq!(law(&several).exponent(), law(&alone).exponent());
    assert!(
        (law(&alone).exponent().expect("one") / job.wall.muscle.exponent().expect("one") - 1.3)
            .abs()
            < 1e-12
    );
    assert!((several.unloaded_volume_mm3 / 80e3 - 1.0).abs() < 1e-3);
    assert!(
        farthest(&alone, &several) < 0.02,
        "{} mm",
        farthest(&alone, &several)
    );
}

#[test]
fn whoever_watches_step_0_ends_it_on_all_threads_and_errors_are_those_of_one() {
    let anatomy = anatomy();
    let mut job = PassiveJob {
        wall: WallParameters::default(),
        target: PassiveFit::ImageUnloaded {
            end_diastolic_pressure_kpa: 1.2,
        },
        slope: None,
        steepened_by: None,
    };
    let mut asked = 0;
    let mut watch = |_: &SearchProgress| {
        asked += 1;
        if asked < 3 {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    };
    let mut search = Search::watched(UnloadingSettings::on_ranks(), &mut watch);
    let ended = job.on_threads(&anatomy, &mut search, 3, ThreadSettings::default());
    assert_eq!(ended, Err(PassiveStateError::Stopped));
    // All ranks count the same work and end together.
    let mut short = UnloadingSettings::on_ranks();
    short.most_work.newton_iterations = 3;
    let ended = job.on_threads(
        &anatomy,
        &mut Search::new(short),
        3,
        ThreadSettings::default(),
    );
    assert!(
        matches!(ended, Err(PassiveStateError::TooMuchWork { .. })),
        "{ended:?}"
    );
    // More than it can bear.
    job.target = PassiveFit::ImageUnloaded {
        end_diastolic_pressure_kpa: 1e3,
    };
    let mut settings = UnloadingSettings::on_ranks();
    (settings.smallest_load, settings.newton.max_iterations) = (0.2, 5);
    let errors = [1, 3].map(|n_ranks| {
        job.on_threads(
            &anatomy,
            &mut Search::new(settings),
            n_ranks,
            ThreadSettings::default(),
        )
        .expect_err("too much")
    });
    assert!(
        errors
            .iter()
            .all(|e| matches!(e, PassiveStateError::Inflation { .. })),
        "{errors:?}"
    );
}

//! Coverage of the posterior's 90 % intervals over simulated patients.
//!
//! `posterior-calibration FIRST PATIENTS FACTOR,… SPEC…`: each specification of a task `posterior`
//! (`attempts/*/*/spec.json` of a run) supplies heart, loads, noise and prior. A patient's true
//! parameters are a draw of this prior with a physiological beat. A finite-element ventricle is
//! simulated in the organ's law of the specification. The traces get noise as specified
//! in the file; the measured biomarkers get an error of `step3.uncertainty_percent`. Step 3
//! proposes a twin for them, starting from a cell at the prior's centre, and the task `posterior`
//! receives that twin, as in a run. Neither of them has access to the true values. The task runs
//! once with each `posterior.error_factor`. Periodic beats of its draws under other loads are
//! compared with those of the true parameters. Lines go to stdout, and a table goes to stderr at
//! the end.

use std::collections::BTreeMap;

use anyhow::{Context as _, anyhow};
use cardiotwin_calibrate::normal::quantile;
use cardiotwin_calibrate::posterior::TruncatedNormal;
use cardiotwin_calibrate::statistics::quantile_of;
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::organ::BeatCount;
use cardiotwin_schemas::outcome::{Determination, OrganBeatResult, TaskResult};
use cardiotwin_schemas::posterior::{PosteriorResult, PosteriorSpec, Spread, TraceNoise, TwinBeat};
use cardiotwin_schemas::samples::{BeatSamples, MeasuredTraces, N_SAMPLES, TraceDeviations};
use cardiotwin_schemas::task::{OrganBeatSpec, ProposalRun, Step3ProposalSpec, Step3Run, TaskSpec};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::organ_beat::{ReducedOrgan, reduced_beat};
use cardiotwin_worker::tasks::posterior;
use cardiotwin_worker::tasks::proposal::axes::{Axis, axes, is_sensitive, named};
use cardiotwin_worker::tasks::proposal::step3;
use cardiotwin_worker::tasks::surrogate::surrogate;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Limits of a physiological beat: peak pressure (mmHg) and ejection fraction.
const PRESSURE: [f64; 2] = [70.0, 220.0];
const EJECTION: [f64; 2] = [0.3, 0.8];
/// Other loads: name, factor of the filling pressure, factor of the peripheral resistance.
const LOADS: [(&str, f64, f64); 2] = [("preload +20 %", 1.2, 1.0), ("afterload +20 %", 1.0, 1.2)];
const PERIODIC: BeatCount = BeatCount::Periodic {
    max: 30,
    tolerance: 0.1,
};

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let mut number =
        |what| -> anyhow::Result<usize> { Ok(arguments.next().context(what)?.parse()?) };
    let (first, n) = (
        number("the first patient's number?")?,
        number("how many patients?")?,
    );
    let factors = arguments.next().context("which error factors?")?;
    let factors: Vec<f64> = factors
        .split(',')
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    let hearts: Vec<PosteriorSpec> = arguments
        .map(|path| heart(&path))
        .collect::<anyhow::Result<_>>()?;
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
    let mut counts = Counts::default();
    for patient in first..first + n {
        let heart = hearts
            .get(patient % hearts.len().max(1))
            .context("no specification was named")?;
        let mut generator = Pcg64::seed_from_u64(20_261_125 + patient as u64);
        let simulated = simulated(heart, &mut generator)?;
        let scratch =
            std::env::temp_dir().join(format!("posterior-calibration-{}", std::process::id()));
        std::fs::create_dir_all(&scratch)?;
        let mut context = Context::plain(&scratch, threads);
        let spec = with_twin(simulated.spec.clone(), &simulated.organ, &mut context);
        for factor in &factors {
            let answer = spec.as_ref().map_err(ToString::to_string).and_then(|spec| {
                let mut spec = spec.clone();
                spec.settings.error_factor = *factor;
                posterior::run(&spec, &mut context).map_err(|error| error.to_string())
            });
            let Ok(TaskResult::Posterior(found)) = answer else {
                println!("{patient}: {answer:?}");
                counts.add(*factor, "without an answer", false);
                continue;
            };
            let twin = spec.as_ref().map(|spec| &spec.twin.parameters);
            if let Ok(twin) = twin {
                counts.patient(*factor, &simulated, twin, &found);
            }
            println!("{patient}: factor {factor} {:?}", found.sampling);
        }
        println!("{}", counts.summary());
        std::fs::remove_dir_all(&scratch)?;
    }
    eprint!("{}", counts.table());
    Ok(())
}

/// Number of true values inside their intervals and number of all true values, by error factor and
/// kind of value.
#[derive(Default)]
struct Counts(BTreeMap<String, [usize; 2]>);

impl Counts {
    fn add(&mut self, factor: f64, what: &str, held: bool) {
        let [holds, all] = self.0.entry(format!("{factor:.2} {what}")).or_default();
        (*holds, *all) = (*holds + usize::from(held), *all + 1);
    }

    fn patient(
        &mut self,
        factor: f64,
        simulated: &Simulated,
        twin: &BTreeMap<String, f64>,
        found: &PosteriorResult,
    ) {
        let holds = |spread: &Spread, value: f64| (spread.p5..=spread.p95).contains(&value);
        for (name, spread) in &found.parameters {
            let held = holds(&spread.posterior, simulated.parameters[name]);
            self.add(
                factor,
                &format!("parameters that are {}", spread.mark.as_str()),
                held,
            );
            if let Some(twin) = twin.get(name) {
                self.add(
                    factor,
                    "the twin's parameters",
                    holds(&spread.posterior, *twin),
                );
            }
            if spread.mark == Determination::Determined {
                self.add(factor, &format!("  determined: {name}"), held);
            }
        }
        for (biomarker, value) in simulated.beat.biomarkers.of_organ() {
            if let (Some(value), Some(spread)) = (value, found.biomarkers.get(biomarker.key())) {
                self.add(factor, "biomarkers of its beat", holds(spread, value));
            }
        }
        for (load, preload, afterload) in LOADS {
            let mut beat = OrganBeatSpec {
                beats: PERIODIC,
                ..simulated.spec.beat.clone()
            };
            beat.circulation.left_atrial_pressure_mmhg *= preload;
            beat.circulation
                .afterload
                .peripheral_resistance_mmhg_s_per_ml *= afterload;
            let of = |parameters: &BTreeMap<String, f64>| {
                one(&beat.with_parameters(parameters), &simulated.organ)
            };
            let Some(true_beat) = of(&simulated.parameters) else {
                continue;
            };
            let draws: Vec<OrganBeatResult> = (0..found.draws.len())
                .filter_map(|d| of(&found.draw(d)))
                .collect();
            for (biomarker, value) in true_beat.biomarkers.of_organ() {
                let mut values: Vec<f64> = draws
                    .iter()
                    .filter_map(|d| d.biomarkers.get(biomarker))
                    .collect();
                values.sort_by(f64::total_cmp);
                let Some(value) = value.filter(|_| values.len() > draws.len() / 2) else {
                    continue;
                };
                let held =
                    (quantile_of(&values, 0.05)..=quantile_of(&values, 0.95)).contains(&value);
                self.add(factor, &format!("biomarkers under {load}"), held);
                self.add(factor, &format!("  {load}: {biomarker}"), held);
            }
        }
    }

    fn summary(&self) -> String {
        let share = |(what, [held, all]): (&String, &[usize; 2])| {
            format!("{what} {:.3} of {all}", *held as f64 / *all as f64)
        };
        self.0
            .iter()
            .filter(|(what, _)| !what.contains(": "))
            .map(share)
            .collect::<Vec<_>>()
            .join("; ")
    }

    fn table(&self) -> String {
        let line = |(what, [held, all]): (&String, &[usize; 2])| {
            format!(
                "{what:<50} {held:>5} of {all:>5}  {:>5.1} %\n",
                100.0 * *held as f64 / *all as f64
            )
        };
        self.0.iter().map(line).collect()
    }
}

fn heart(path: &str) -> anyhow::Result<PosteriorSpec> {
    let text = std::fs::read_to_string(path).with_context(|| path.to_owned())?;
    let value: serde_json::Value = serde_json::from_str(&text)?;
    let task = value.get("task").cloned().unwrap_or(value);
    match serde_json::from_value(task).with_context(|| path.to_owned())? {
        TaskSpec::Posterior(spec) => Ok(*spec),
        other => Err(anyhow!(
            "{path}: a task of kind {}, expected posterior",
            other.kind()
        )),
    }
}

/// Time steps of simulated beats, as in the task: in the one-fibre ventricle and in the organ's law.
const STEP_MS: [f64; 2] = [2.0, 4.0];

/// Ventricle in which patients are simulated.
fn ventricle(spec: &PosteriorSpec) -> anyhow::Result<ReducedOrgan> {
    Ok(surrogate(
        &spec.beat,
        spec.law.as_deref(),
        spec.prior.as_ref(),
    )?)
}

/// A beat of the ventricle with the task's steps; `None` if the beat is incomplete.
fn one(beat: &OrganBeatSpec, organ: &ReducedOrgan) -> Option<OrganBeatResult> {
    let [in_one_fibre, in_law] = STEP_MS;
    let shortest_ms = if organ.law.is_some() {
        in_law
    } else {
        in_one_fibre
    };
    let beat = OrganBeatSpec {
        time_step_ms: beat.time_step_ms.max(shortest_ms),
        ..beat.clone()
    };
    reduced_beat(&beat, organ)
        .ok()
        .flatten()
        .filter(|beat| beat.failed_check().is_none())
}

fn normal(generator: &mut Pcg64) -> f64 {
    quantile(generator.random::<f64>().max(f64::MIN_POSITIVE))
}

/// A patient with noisy traces, and the true parameters and beat.
struct Simulated {
    spec: PosteriorSpec,
    organ: ReducedOrgan,
    parameters: BTreeMap<String, f64>,
    beat: OrganBeatResult,
}

/// Draws a patient from a heart's prior.
fn simulated(heart: &PosteriorSpec, generator: &mut Pcg64) -> anyhow::Result<Simulated> {
    let axes = axes(&heart.parameters);
    let prior: Vec<TruncatedNormal> = axes.iter().map(Axis::truncated).collect();
    let organ = ventricle(heart)?;
    for _ in 0..100_000 {
        let drawn: Vec<f64> = prior
            .iter()
            .map(|prior| prior.from_standard(normal(generator)))
            .collect();
        let parameters = named(&axes, &drawn);
        let beat = heart.beat.with_parameters(&parameters);
        let Some(truth) = one(&beat, &organ).filter(|_| is_sensitive(&beat)) else {
            continue;
        };
        let (b, whole) = (
            &truth.biomarkers,
            truth
                .biomarkers
                .of_organ()
                .iter()
                .all(|(_, value)| value.is_some()),
        );
        let (Some(pressure), Some(sv), Some(edv)) = (b.p_max_mmhg, b.sv_ml, b.edv_ml) else {
            continue;
        };
        let within = |value: f64, range: [f64; 2]| (range[0]..=range[1]).contains(&value);
        if !whole || !within(pressure, PRESSURE) || !within(sv / edv, EJECTION) {
            continue;
        }
        let noise = TraceNoise::of(&heart.noise);
        let samples = noisy(
            &truth.samples,
            &noise,
            heart.beat.cycle_length_ms,
            generator,
        );
        let mut measured = truth.biomarkers;
        // The order is fixed, so that a seed always gives the same hearts.
        let drawn = Biomarker::TABLE_2
            .into_iter()
            .chain([Biomarker::TauVd, Biomarker::TauVr]);
        for biomarker in drawn {
            let place = measured.get_mut(biomarker);
            let percent = heart
                .uncertainty_percent
                .get(biomarker.key())
                .copied()
                .unwrap_or_default();
            *place = place.map(|value| value * (1.0 + 0.01 * percent * normal(generator)));
        }
        let spec = PosteriorSpec {
            samples,
            measured,
            ..heart.clone()
        };
        return Ok(Simulated {
            spec,
            organ,
            parameters,
            beat: truth,
        });
    }
    Err(anyhow!("no draw of the prior is a heart's"))
}

/// Replaces the task's twin by the one that step 3 proposes for the patient's measurements.
fn with_twin(
    spec: PosteriorSpec,
    organ: &ReducedOrgan,
    context: &mut Context,
) -> anyhow::Result<PosteriorSpec> {
    let centre: BTreeMap<String, f64> = spec
        .parameters
        .iter()
        .map(|(name, p)| (name.clone(), p.centre))
        .collect();
    let first = one(&spec.beat.with_parameters(&centre), organ);
    let run = ProposalRun {
        parameters: centre,
        biomarkers: first.as_ref().map(|beat| beat.biomarkers),
        whole_beat: first.is_some(),
        predicted_misfit: None,
    };
    let proposal = step3::run(
        &Step3ProposalSpec {
            beat: spec.beat.clone(),
            measured: spec.measured,
            runs: vec![Step3Run {
                run,
                samples: first.map(|beat| beat.samples),
            }],
            parameters: spec.parameters.clone(),
            uncertainty_percent: spec.uncertainty_percent.clone(),
            step1: None,
            traces: Some(MeasuredTraces {
                samples: spec.samples.clone(),
                deviations: TraceDeviations::default(),
                cycle_length_ms: spec.beat.cycle_length_ms,
            }),
            law: spec.law.clone(),
            prior: spec.prior.clone(),
            seed: spec.seed,
        },
        context,
    )?;
    let TaskResult::Step3Proposal(proposal) = proposal else {
        return Err(anyhow!("not a proposal"));
    };
    let parameters = proposal.parameters;
    let beat =
        one(&spec.beat.with_parameters(&parameters), organ).context("the twin has no beat")?;
    Ok(PosteriorSpec {
        twin: TwinBeat {
            parameters,
            biomarkers: beat.biomarkers,
            samples: beat.samples,
        },
        ..spec
    })
}

/// Adds an Ornstein-Uhlenbeck process to the pressure. The volume gets independent noise at each
/// frame, linear in between.
fn noisy(
    samples: &BeatSamples,
    noise: &TraceNoise,
    cycle_ms: f64,
    generator: &mut Pcg64,
) -> BeatSamples {
    let kept = (-cycle_ms / N_SAMPLES as f64 / noise.pressure_correlation_ms).exp();
    let mut error = noise.pressure_rms_mmhg * normal(generator);
    let mut pressure = |p: &f64| {
        let value = p + error;
        error =
            kept * error + (1.0 - kept * kept).sqrt() * noise.pressure_rms_mmhg * normal(generator);
        value
    };
    let pressure_mmhg = samples.pressure_mmhg.iter().map(&mut pressure).collect();
    let n_frames = noise.volume_frames as usize;
    let frames: Vec<f64> = (0..n_frames)
        .map(|_| noise.volume_rms_ml * normal(generator))
        .collect();
    let volume = |(k, v): (usize, &f64)| {
        let at = k as f64 * n_frames as f64 / N_SAMPLES as f64;
        let (i, rest) = (at.floor() as usize, at.fract());
        v + (1.0 - rest) * frames[i % n_frames] + rest * frames[(i + 1) % n_frames]
    };
    BeatSamples {
        pressure_mmhg,
        volume_ml: samples.volume_ml.iter().enumerate().map(volume).collect(),
    }
}

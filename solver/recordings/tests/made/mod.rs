//! Synthetic recordings with known truth: beats of an independent heart with jitter, breathing,
//! ectopic beats, drift, damage, a damped line and noise. A cine series with another cycle length
//! and a lag accompanies them.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Mutex;

use cardiotwin_recordings::cine::Cine;
use cardiotwin_recordings::prepare::Raw;
use cardiotwin_recordings::recording::{Channels, Recording};
use cardiotwin_validation::circulation::Beat;
use cardiotwin_validation::patient;
use cardiotwin_validation::random::Random;
use cardiotwin_vocabulary::preparation::RawImage;

/// Specification of a recording.
#[derive(Debug, Clone, Copy)]
pub struct Wish {
    pub seed: u64,
    pub n_beats: usize,
    pub step_ms: f64,
    pub ecg: bool,
    /// Standard deviation of cycle lengths, relative to the usual one.
    pub jitter: f64,
    /// Number of beats for each ectopic one; 0 for no ectopic beats.
    pub ectopic_every: usize,
    /// Number of beats for each damaged one; 0 for no damage.
    pub damage_every: usize,
    pub drift_mmhg_per_min: f64,
    /// Natural frequency \[Hz\] and damping of the line.
    pub line: Option<(f64, f64)>,
    /// Root mean square \[mmHg\] and correlation time \[ms\] of the noise.
    pub noise: (f64, f64),
    /// Noise of a cine frame \[mL\].
    pub frame_noise_ml: f64,
}

impl Wish {
    pub fn usual(seed: u64) -> Self {
        Self {
            seed,
            n_beats: 60,
            step_ms: 1.0,
            ecg: true,
            jitter: 0.03,
            ectopic_every: 12,
            damage_every: 17,
            drift_mmhg_per_min: 0.0,
            line: None,
            noise: (0.8, 8.0),
            frame_noise_ml: 2.0,
        }
    }
}

/// Kind of a beat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Good,
    Ectopic,
    /// The next beat is ectopic.
    CutShort,
    AfterEctopic,
    Damaged,
}

/// Truth that the recording's reader does not know.
#[derive(Debug, Clone)]
pub struct Truth {
    /// R waves on the recording's clock \[ms\].
    pub onsets_ms: Vec<f64>,
    pub kinds: Vec<Kind>,
    /// Pressure, aortic pressure and volume of the usual beat, every ms.
    pub beat: Beat,
    pub cycle_ms: f64,
    /// Start and end of the flow through the aortic valve, from the R wave \[ms\].
    pub ejection_ms: (f64, f64),
    /// Map from the usual beat's time to the cine's: factor of systole, factor of diastole, and lag
    /// \[ms\].
    pub cine: (f64, f64, f64),
    /// Factor of the cine's volumes that corrects their error.
    pub volume_factor: f64,
    /// Delay of the line \[ms\].
    pub delay_ms: f64,
    pub line: Option<(f64, f64)>,
}

/// Makes a recording with its truth.
pub fn make(wish: &Wish) -> (Raw, Truth) {
    let mut random = Random::new(wish.seed, 77);
    let truth = lay_out(wish, heart(wish.seed), &mut random);
    let recording = record(wish, &truth, &mut random);
    let cine = cine(wish, &truth, &mut random);
    let late = 0.82 * cine.cycle_length_ms;
    let whole_heart = RawImage {
        time_ms: late,
        volume_ml: volume_on_cine_clock(&truth, late),
        sd_ml: Some(4.0),
    };
    (
        Raw {
            recording,
            cine: Some(cine),
            whole_heart: Some(whole_heart),
        },
        truth,
    )
}

/// Steady beat of a random heart; each is computed only once.
fn heart(seed: u64) -> Beat {
    static KNOWN: Mutex<BTreeMap<u64, Beat>> = Mutex::new(BTreeMap::new());
    let mut known = KNOWN.lock().unwrap();
    let drawn = || {
        let mut random = Random::new(seed, 76);
        loop {
            let beat = patient::draw(&mut random).beat();
            if let Some(beat) = beat.filter(|beat| patient::implausible(beat).is_none()) {
                return beat;
            }
        }
    };
    known.entry(seed).or_insert_with(drawn).clone()
}

/// Draws R waves and kinds of beats.
fn lay_out(wish: &Wish, beat: Beat, random: &mut Random) -> Truth {
    let cycle_ms = beat.pressure.len() as f64;
    let mut kinds = vec![Kind::Good; wish.n_beats];
    let mut onsets_ms = vec![random.between(350.0, 900.0)];
    let mut until_ectopic = wish.ectopic_every / 2 + 1;
    for i in 0..wish.n_beats {
        let usual = cycle_ms * (1.0 + wish.jitter * random.normal().clamp(-2.5, 2.5));
        let mut length = usual;
        if wish.ectopic_every > 0
            && until_ectopic == 0
            && kinds[i] == Kind::Good
            && i + 3 < wish.n_beats
        {
            length = usual * random.between(0.5, 0.8);
            kinds[i] = Kind::CutShort;
            kinds[i + 1] = Kind::Ectopic;
            kinds[i + 2] = Kind::AfterEctopic;
            until_ectopic = wish.ectopic_every.max(5) - 1;
        } else if kinds[i] == Kind::Ectopic {
            // Compensatory pause: the next sinus beat comes at its regular time.
            length = 2.0 * cycle_ms - (onsets_ms[i] - onsets_ms[i - 1]);
        }
        until_ectopic = until_ectopic.saturating_sub(1);
        onsets_ms.push(onsets_ms[i] + length);
    }
    if wish.damage_every > 0 {
        let mut i = wish.damage_every / 2;
        while i < wish.n_beats {
            if kinds[i] == Kind::Good {
                kinds[i] = Kind::Damaged;
                i += wish.damage_every;
            } else {
                i += 1;
            }
        }
    }
    let peak = beat.aortic_flow.iter().copied().fold(0.0, f64::max);
    let above = |q: &f64| *q > 0.02 * peak;
    let begin = beat.aortic_flow.iter().position(above).unwrap() as f64;
    let end = beat.aortic_flow.iter().rposition(above).unwrap() as f64;
    let cine_cycle = random.between(0.9, 1.15);
    let systole = cine_cycle.powf(0.4);
    let diastole = (cine_cycle * cycle_ms - systole * end) / (cycle_ms - end);
    let cine = (systole, diastole, random.between(-60.0, 60.0));
    let delay_ms = wish.line.map_or(0.0, |(f, z)| 2.0 * z / (TAU * f) * 1e3);
    Truth {
        onsets_ms,
        kinds,
        beat,
        cycle_ms,
        ejection_ms: (begin, end),
        cine,
        volume_factor: random.between(0.93, 1.08),
        delay_ms,
        line: wish.line,
    }
}

/// Time in the usual beat for a time in a beat of another length. Systole and relaxation keep their
/// duration, and the rest of diastole is stretched.
pub fn usual_time(truth: &Truth, since_onset_ms: f64, length_ms: f64) -> f64 {
    let hold = (truth.ejection_ms.1 + 150.0).min(truth.cycle_ms - 60.0);
    if since_onset_ms <= hold || length_ms <= hold + 20.0 {
        return since_onset_ms.min(truth.cycle_ms);
    }
    (hold + (since_onset_ms - hold) * (truth.cycle_ms - hold) / (length_ms - hold))
        .min(truth.cycle_ms)
}

pub fn periodic(values: &[f64], t: f64) -> f64 {
    let n = values.len();
    let t = t.rem_euclid(n as f64);
    let i = (t as usize).min(n - 1);
    values[i] + (t - i as f64) * (values[(i + 1) % n] - values[i])
}

fn record(wish: &Wish, truth: &Truth, random: &mut Random) -> Recording {
    let last = *truth.onsets_ms.last().unwrap() + random.between(200.0, 500.0);
    let n = (last / wish.step_ms) as usize;
    let breath = (random.between(3000.0, 5000.0), random.between(0.0, TAU));
    let breathing = |t: f64| (t / breath.0 * TAU + breath.1).sin();
    let weak = random.between(0.6, 0.85);
    let wide: Vec<f64> = slower(&truth.beat.pressure);
    // Both pressures come from the same beats, so that they share every irregularity.
    let of = |ventricle: bool, t: f64, i: usize| -> f64 {
        let (onset, length) = match i {
            0 => (truth.onsets_ms[0] - truth.cycle_ms, truth.cycle_ms),
            _ => (
                truth.onsets_ms[i - 1],
                truth
                    .onsets_ms
                    .get(i)
                    .map_or(truth.cycle_ms, |o| o - truth.onsets_ms[i - 1]),
            ),
        };
        let at = usual_time(truth, t - onset, length.min(1.6 * truth.cycle_ms));
        let kind = i
            .checked_sub(1)
            .and_then(|k| truth.kinds.get(k))
            .copied()
            .unwrap_or(Kind::Good);
        let source = match (ventricle, kind) {
            (true, Kind::Ectopic) => &wide,
            (true, _) => &truth.beat.pressure,
            _ => &truth.beat.aortic_pressure,
        };
        let strength = match kind {
            Kind::Ectopic => weak,
            Kind::AfterEctopic => 1.07,
            _ => 1.0,
        };
        let low = source[0];
        low + strength * (periodic(source, at) - low)
    };
    let mut i = 0;
    let mut lv = Vec::with_capacity(n);
    let mut aortic = Vec::with_capacity(n);
    let mut ecg = Vec::with_capacity(n);
    let (rms, tau) = wish.noise;
    let rho = (-wish.step_ms / tau).exp();
    let mut colour = [rms * random.normal(), rms * random.normal()];
    for k in 0..n {
        let t = k as f64 * wish.step_ms;
        while i < truth.onsets_ms.len() && t >= truth.onsets_ms[i] {
            i += 1;
        }
        // Each beat replaces the previous one over 20 ms; a premature beat meets a pressure that is
        // still falling.
        let since = if i == 0 {
            1e3
        } else {
            t - truth.onsets_ms[i - 1]
        };
        let share = (since / 20.0).clamp(0.0, 1.0);
        let b = breathing(t);
        let drift = wish.drift_mmhg_per_min * t / 60_000.0;
        for (ventricle, out) in [(true, &mut lv), (false, &mut aortic)] {
            let p = if share < 1.0 {
                share * of(ventricle, t, i) + (1.0 - share) * of(ventricle, t, i - 1)
            } else {
                of(ventricle, t, i)
            };
            out.push(p * (1.0 + 0.02 * b) + 1.2 * b + drift);
        }
        ecg.push(
            electrocardiogram(truth, t, i)
                + 0.25 * (t / 3900.0 * TAU).sin()
                + 0.02 * random.normal(),
        );
    }
    if let Some(line) = wish.line {
        lv = through_line(&lv, wish.step_ms, line);
    }
    for (channel, colour) in [&mut lv, &mut aortic].into_iter().zip(&mut colour) {
        for value in channel.iter_mut() {
            *value += *colour;
            *colour = rho * *colour + rms * (1.0 - rho * rho).sqrt() * random.normal();
            // Resolution of the analogue-to-digital converter.
            *value = (*value * 50.0).round() / 50.0;
        }
    }
    damage(wish, truth, &mut lv, random);
    let time_ms: Vec<f64> = (0..n).map(|k| k as f64 * wish.step_ms).collect();
    let channels = Channels {
        lv_pressure_mmhg: Some(lv),
        aortic_pressure_mmhg: Some(aortic),
        flow_ml_per_s: None,
        ecg_mv: wish.ecg.then_some(ecg),
        lv_volume_ml: None,
    };
    Recording::new(&time_ms, channels).unwrap()
}

/// An ectopic beat spreads slowly, so that its pressure rises and falls over a longer time.
fn slower(pressure: &[f64]) -> Vec<f64> {
    let n = pressure.len();
    let half = 25;
    (0..n)
        .map(|i| {
            (0..=2 * half)
                .map(|k| pressure[(i + n + k - half) % n])
                .sum::<f64>()
                / (2 * half + 1) as f64
        })
        .collect()
}

fn electrocardiogram(truth: &Truth, t: f64, next: usize) -> f64 {
    let mut value = 0.0;
    for i in next.saturating_sub(2)..(next + 2).min(truth.onsets_ms.len()) {
        let d = t - truth.onsets_ms[i];
        let bell = |centre: f64, width: f64| (-0.5 * ((d - centre) / width).powi(2)).exp();
        let ectopic = truth.kinds.get(i) == Some(&Kind::Ectopic);
        value += if ectopic {
            1.3 * bell(0.0, 26.0) - 0.35 * bell(0.4 * truth.cycle_ms, 45.0)
        } else {
            1.0 * bell(0.0, 9.0) - 0.2 * bell(-24.0, 8.0) - 0.2 * bell(24.0, 8.0)
                + 0.3 * bell(0.36 * truth.cycle_ms, 38.0)
                + 0.12 * bell(-150.0, 22.0)
        };
    }
    value
}

/// A fluid-filled line, modelled as a damped oscillator.
pub fn through_line(
    pressure: &[f64],
    step_ms: f64,
    (frequency_hz, damping): (f64, f64),
) -> Vec<f64> {
    let w = TAU * frequency_hz * 1e-3;
    let inner = 20;
    let dt = step_ms / f64::from(inner);
    let (mut x, mut v) = (pressure[0], 0.0);
    pressure
        .iter()
        .map(|p| {
            let here = x;
            for _ in 0..inner {
                v += dt * (w * w * (p - x) - 2.0 * damping * w * v);
                x += dt * v;
            }
            here
        })
        .collect()
}

fn damage(wish: &Wish, truth: &Truth, lv: &mut [f64], random: &mut Random) {
    let mut which = 0;
    for (i, kind) in truth.kinds.iter().enumerate() {
        if *kind != Kind::Damaged {
            continue;
        }
        let length = truth.onsets_ms[i + 1] - truth.onsets_ms[i];
        let from = truth.onsets_ms[i] + random.between(0.1, 0.4) * length;
        let place = |t: f64| ((t / wish.step_ms) as usize).min(lv.len() - 1);
        let (a, b) = (
            place(from),
            place(from + random.between(0.25, 0.45) * length),
        );
        match which % 3 {
            0 => lv[a..b].fill(f64::NAN),
            1 => {
                let held = lv[a];
                lv[a..b].fill(held);
            }
            _ => lv[a..(a + 3).min(b)].iter_mut().for_each(|p| *p += 140.0),
        }
        which += 1;
    }
}

/// True volume at a time on the cine's clock.
pub fn volume_on_cine_clock(truth: &Truth, t: f64) -> f64 {
    let (systole, diastole, lag) = truth.cine;
    let end = truth.ejection_ms.1;
    let cycle = systole * end + diastole * (truth.cycle_ms - end);
    let t = (t - lag).rem_euclid(cycle);
    let here = if t <= systole * end {
        t / systole
    } else {
        end + (t - systole * end) / diastole
    };
    periodic(&truth.beat.volume, here)
}

fn cine(wish: &Wish, truth: &Truth, random: &mut Random) -> Cine {
    let (systole, diastole, _) = truth.cine;
    let end = truth.ejection_ms.1;
    let cycle = systole * end + diastole * (truth.cycle_ms - end);
    let n = 25 + (random.between(0.0, 6.0) as usize);
    let time: Vec<f64> = (0..n).map(|i| i as f64 * cycle / n as f64).collect();
    let volume = time
        .iter()
        .map(|t| {
            volume_on_cine_clock(truth, *t) / truth.volume_factor
                + wish.frame_noise_ml * random.normal()
        })
        .collect();
    Cine::new(time, volume, Some(cycle)).unwrap()
}

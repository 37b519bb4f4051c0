//! Search for effects that three elements miss in a record. Candidates are refitted jointly,
//! compared, and added as long as the evidence supports them.

use super::AfterloadError;
use super::effects::{EFFECTS, Effect, HIDDEN};
use super::held_out::Folds;
use super::nameless;
use super::noise::{self, Scale};
use super::problem::{Problem, TOLERANCE};
use super::record::Record;
use super::simulate::{Start, pressure};
use crate::least_squares::Fit;
use crate::normal;
use cardiotwin_vocabulary::fits::AfterloadUnexplained;
use cardiotwin_vocabulary::statistics::EffectiveSampleSize;

/// Settings of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct DiscoverySettings {
    /// Names of the candidates; all effects if empty.
    pub effects: Vec<String>,
    /// Fall of BIC required to name an effect.
    pub threshold: f64,
    /// Largest number of effects to add.
    pub most: usize,
    /// Probability that the interval of a strength covers the truth.
    pub confidence_level: f64,
}

impl Default for DiscoverySettings {
    fn default() -> Self {
        Self {
            effects: Vec::new(),
            threshold: 6.0,
            most: 3,
            confidence_level: 0.95,
        }
    }
}

/// Relative fall of the held-out misfit (rms) that an effect must bring.
const LEAST_HELD_OUT_FALL: f64 = 0.03;
/// A fitted value within this share of its range from an end counts as implausible.
const AT_END: f64 = 1e-3;
/// Number of best candidates that are tried in pairs.
const PAIRED: usize = 4;
/// Evidence below which one effect can be mistaken for another.
const CONFUSED: f64 = 6.0;

/// One candidate added to a model, with all parameters refitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Effect that was added.
    pub effect: &'static Effect,
    /// Fall of BIC against the model without the candidate.
    pub delta_bic: f64,
    /// Probability among all candidates of the stage, the nameless competitor and no effect.
    pub probability: f64,
    /// Misfit with the candidate, root of the mean square, mmHg.
    pub root_mean_square_mmhg: f64,
    /// Parameters of the effect: name, value and interval, in the unit of the name.
    pub strength: Vec<(&'static str, f64, Option<[f64; 2]>)>,
    /// R1, R2 (mmHg s/mL) and C (mL/mmHg) of the refit.
    pub three: [f64; 3],
    /// Reason why the candidate is not named; `None` if it may be.
    pub refused: Option<String>,
}

/// An effect that the search accepted.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Catalogue entry of the effect.
    pub effect: &'static Effect,
    /// Fall of BIC of the final model against the same model without the effect.
    pub delta_bic: f64,
    /// Parameters of the effect in the final model: name, value and interval.
    pub strength: Vec<(&'static str, f64, Option<[f64; 2]>)>,
}

/// Candidates for addition to one model.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Names of the effects that the model already contains.
    pub with: Vec<&'static str>,
    /// Candidates with their evidence, best first.
    pub candidates: Vec<Candidate>,
    /// Nameless competitor of the candidates.
    pub nameless: AfterloadUnexplained,
    /// Probability that nothing is missing.
    pub none_probability: f64,
    /// Probability of the nameless competitor.
    pub nameless_probability: f64,
    /// Effective number of samples and correlations of the residuals.
    pub sample_size: EffectiveSampleSize,
}

/// Misfits before and after the search, root of the mean square, mmHg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Misfit of three elements over all samples.
    pub before_mmhg: f64,
    /// Misfit of the final model over all samples.
    pub after_mmhg: f64,
    /// Misfit of three elements over samples held out of their fit.
    pub held_out_before_mmhg: f64,
    /// Misfit of the final model over samples held out of its fit.
    pub held_out_after_mmhg: f64,
    /// Whether whole beats were held out, rather than blocks of a beat.
    pub by_beat: bool,
    /// Number of parts that were held out in turn.
    pub n_folds: usize,
}

/// An effect that could be mistaken for an accepted one in this record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Confusable {
    /// Name of the accepted effect.
    pub accepted: &'static str,
    /// Name of the other effect, which fits the accepted effect's traces almost as well.
    pub other: &'static str,
    /// Evidence that would distinguish the two; zero if their equations are the same.
    pub delta_bic: f64,
    /// Measurement that would distinguish them.
    pub separated_by: &'static str,
}

/// Result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Discovery {
    /// Stages of the search; the first starts from the three elements.
    pub stages: Vec<Stage>,
    /// Effects of the final model.
    pub accepted: Vec<Found>,
    /// Effects that could be mistaken for an accepted one.
    pub confusable: Vec<Confusable>,
    /// Effects that this record, or any record, cannot show: name and reason.
    pub not_identifiable: Vec<(&'static str, String)>,
    /// Remaining discrepancy that every beat repeats and no candidate explains.
    pub unexplained: Option<AfterloadUnexplained>,
    /// Misfits before and after the search.
    pub gap: Gap,
    /// R1, R2 (mmHg s/mL) and C (mL/mmHg) of the three elements alone.
    pub before: [f64; 3],
    /// R1, R2 (mmHg s/mL) and C (mL/mmHg) of the final model.
    pub after: [f64; 3],
    /// Pressure of the three elements at the samples of the record, mmHg.
    pub pressure_before_mmhg: Vec<f64>,
    /// Pressure of the final model at the samples of the record, mmHg.
    pub pressure_after_mmhg: Vec<f64>,
    /// Effective number of samples of the final model's residuals.
    pub sample_size: EffectiveSampleSize,
}

/// A model with its fit.
#[derive(Clone)]
struct Fitted {
    effects: Vec<&'static Effect>,
    fit: Fit,
}

struct Search<'a> {
    record: &'a Record,
    settings: &'a DiscoverySettings,
    effects: Vec<&'static Effect>,
}

/// Searches a record for effects that three elements miss.
///
/// # Errors
/// [`AfterloadError`] if a minimisation cannot start.
pub fn discover(
    record: &Record,
    settings: &DiscoverySettings,
) -> Result<Discovery, AfterloadError> {
    let wanted = |e: &&Effect| {
        settings.effects.is_empty() || settings.effects.iter().any(|name| name == e.name)
    };
    let search = Search {
        record,
        settings,
        effects: EFFECTS.iter().filter(wanted).collect(),
    };
    search.run()
}

impl<'a> Search<'a> {
    fn problem(&self, effects: &[&'static Effect]) -> Problem<'a> {
        Problem::new(self.record, Start::Free, effects)
    }

    fn base(&self) -> Result<Fitted, AfterloadError> {
        let fit = self.problem(&[]).fit_base(TOLERANCE)?;
        Ok(Fitted {
            effects: Vec::new(),
            fit,
        })
    }

    /// Adds one effect to a model and refits it from the model's optimum with all starts of the
    /// effect.
    fn with(&self, model: &Fitted, effect: &'static Effect) -> Result<Fitted, AfterloadError> {
        let mut effects = model.effects.clone();
        effects.push(effect);
        let mut starts = vec![model.fit.parameters.clone()];
        for parameter in effect.parameters {
            starts = starts
                .into_iter()
                .flat_map(|start| {
                    parameter
                        .starts
                        .iter()
                        .map(move |value| [&start[..], &[*value]].concat())
                })
                .collect();
        }
        let fit = self.problem(&effects).fit_from(&starts, TOLERANCE)?;
        Ok(Fitted { effects, fit })
    }

    /// Adds effects to the three elements one after the other, with a refit after each.
    fn anew(&self, base: &Fitted, effects: &[&'static Effect]) -> Result<Fitted, AfterloadError> {
        effects
            .iter()
            .try_fold(base.clone(), |model, effect| self.with(&model, effect))
    }

    fn three(&self, model: &Fitted) -> [f64; 3] {
        let values = self.problem(&model.effects).values(&model.fit.parameters);
        [values[0], values[1], values[2]]
    }

    fn residuals(&self, model: &Fitted) -> Vec<f64> {
        self.problem(&model.effects)
            .all_residuals(&model.fit.parameters)
    }

    fn run(&self) -> Result<Discovery, AfterloadError> {
        let base = self.base()?;
        let (mut model, mut stages) = (base.clone(), Vec::new());
        loop {
            let (stage, best) = self.stage(&model)?;
            stages.push(stage);
            let best = match best {
                None => self.pair(&model, &stages[stages.len() - 1])?,
                found => found,
            };
            match best {
                Some(better) if better.effects.len() <= self.settings.most => model = better,
                _ => break,
            }
        }
        model = self.exchange(&base, model)?;
        if !self.beats_nameless(&base, &model)? {
            for candidate in &mut stages[0].candidates {
                if model
                    .effects
                    .iter()
                    .any(|e| e.name == candidate.effect.name)
                {
                    candidate.refused = Some("a shape without a name explains more".to_owned());
                }
            }
            model = base.clone();
        }
        self.conclude(base, model, stages)
    }

    /// Compares all candidates for addition to a model; also returns the best one that may be
    /// named.
    fn stage(&self, model: &Fitted) -> Result<(Stage, Option<Fitted>), AfterloadError> {
        let mut tried = Vec::new();
        for effect in self
            .effects
            .iter()
            .filter(|e| model.effects.iter().all(|had| had.name != e.name))
        {
            tried.push(self.with(model, effect)?);
        }
        let richest = tried
            .iter()
            .min_by(|a, b| a.fit.sum_of_squares.total_cmp(&b.fit.sum_of_squares))
            .filter(|best| best.fit.sum_of_squares < model.fit.sum_of_squares)
            .unwrap_or(model);
        let sample_size = noise::effective_sample_size(self.record, &self.residuals(richest));
        let n_effective = sample_size.n_effective;
        let folds = Folds::new(self.record, &sample_size);
        let held_out = self.held_out(model, &folds)?;
        let mut rated = Vec::new();
        for fitted in tried {
            let effect = fitted.effects[fitted.effects.len() - 1];
            let delta_bic = self.delta_bic(model, &fitted, n_effective);
            let refused = self.refused(&fitted, 1, delta_bic, held_out, &folds)?;
            let strength = self.strength(&fitted, effect, n_effective);
            let three = self.three(&fitted);
            let n = self.record.n_samples() as f64;
            let root_mean_square_mmhg = (fitted.fit.sum_of_squares / n).sqrt();
            let candidate = Candidate {
                effect,
                delta_bic,
                probability: 0.0,
                root_mean_square_mmhg,
                strength,
                three,
                refused,
            };
            rated.push((candidate, fitted));
        }
        rated.sort_by(|a, b| b.0.delta_bic.total_cmp(&a.0.delta_bic));
        let problem = self.problem(&model.effects);
        let nameless = nameless::fit(&problem, &model.fit, n_effective)?;
        let nameless_bic = nameless.delta_bic(
            Scale::new(self.record),
            model.fit.sum_of_squares,
            n_effective,
        );
        let nameless = nameless::describe(&problem, &model.fit, &nameless, nameless_bic);
        let top = rated
            .iter()
            .map(|r| r.0.delta_bic)
            .fold(nameless_bic.max(0.0), f64::max);
        let weight = |delta_bic: f64| (0.5 * (delta_bic - top)).exp();
        let sum: f64 = rated.iter().map(|r| weight(r.0.delta_bic)).sum::<f64>()
            + weight(0.0)
            + weight(nameless_bic);
        rated
            .iter_mut()
            .for_each(|r| r.0.probability = weight(r.0.delta_bic) / sum);
        let best = rated
            .iter()
            .find(|r| r.0.refused.is_none())
            .map(|r| r.1.clone());
        let stage = Stage {
            with: model.effects.iter().map(|e| e.name).collect(),
            candidates: rated.into_iter().map(|r| r.0).collect(),
            none_probability: weight(0.0) / sum,
            nameless_probability: weight(nameless_bic) / sum,
            nameless,
            sample_size,
        };
        Ok((stage, best))
    }

    /// The best pair of effects that show only together. Each of the best candidates is paired with
    /// every other effect.
    fn pair(&self, model: &Fitted, stage: &Stage) -> Result<Option<Fitted>, AfterloadError> {
        if stage.nameless.delta_bic < self.settings.threshold {
            return Ok(None);
        }
        let mut best: Option<(f64, Fitted)> = None;
        for first in stage.candidates.iter().take(PAIRED).map(|c| c.effect) {
            let one = self.with(model, first)?;
            for second in self
                .effects
                .iter()
                .filter(|e| one.effects.iter().all(|had| had.name != e.name))
            {
                let both = self.with(&one, second)?;
                let sample_size = noise::effective_sample_size(self.record, &self.residuals(&both));
                let evidence = self.delta_bic(model, &both, sample_size.n_effective);
                if evidence < 2.0 * self.settings.threshold
                    || best.as_ref().is_some_and(|b| b.0 >= evidence)
                {
                    continue;
                }
                let folds = Folds::new(self.record, &sample_size);
                let held_out = self.held_out(model, &folds)?;
                if self
                    .refused(&both, 2, evidence, held_out, &folds)?
                    .is_none()
                {
                    best = Some((evidence, both));
                }
            }
        }
        Ok(best.map(|b| b.1))
    }

    /// Whether the named effects explain the record better than nameless harmonics.
    fn beats_nameless(&self, base: &Fitted, model: &Fitted) -> Result<bool, AfterloadError> {
        if model.effects.is_empty() {
            return Ok(true);
        }
        let n_effective =
            noise::effective_sample_size(self.record, &self.residuals(model)).n_effective;
        let nameless = nameless::fit(&self.problem(&[]), &base.fit, n_effective)?;
        let named = self.delta_bic(base, model, n_effective);
        Ok(named
            > nameless.delta_bic(
                Scale::new(self.record),
                base.fit.sum_of_squares,
                n_effective,
            ))
    }

    fn delta_bic(&self, without: &Fitted, with: &Fitted, n_effective: f64) -> f64 {
        let n_of = |m: &Fitted| self.problem(&m.effects).n_coordinates();
        let scale = Scale::new(self.record);
        let gain = scale.delta_bic(
            without.fit.sum_of_squares,
            with.fit.sum_of_squares,
            n_of(with),
            n_effective,
        );
        gain + n_of(without) as f64 * n_effective.ln()
    }

    /// Reason why a candidate is not named; `None` if it may be.
    fn refused(
        &self,
        with: &Fitted,
        n_new: usize,
        delta_bic: f64,
        held_out: f64,
        folds: &Folds,
    ) -> Result<Option<String>, AfterloadError> {
        if delta_bic < self.settings.threshold {
            return Ok(Some(format!("evidence below {}", self.settings.threshold)));
        }
        let new = &with.effects[with.effects.len() - n_new..];
        let values = self.problem(&with.effects).values(&with.fit.parameters);
        for p in new.iter().flat_map(|effect| effect.parameters) {
            let (low, high) = p.range;
            let (value, margin) = (values[p.position], AT_END * (high - low));
            if p.smallest > 0.0 && (value - high >= -margin || (low < 0.0 && value - low <= margin))
            {
                return Ok(Some(format!("{} at the end of its range", p.name)));
            }
            if value.abs() < p.smallest {
                return Ok(Some(format!(
                    "{} below its smallest meaningful size",
                    p.name
                )));
            }
        }
        let now = self.held_out(with, folds)?;
        if now > (1.0 - LEAST_HELD_OUT_FALL) * held_out {
            return Ok(Some(format!(
                "held-out misfit {held_out:.2} to {now:.2} mmHg"
            )));
        }
        Ok(None)
    }

    /// Misfit over the samples held out of each fit, mmHg.
    fn held_out(&self, model: &Fitted, folds: &Folds) -> Result<f64, AfterloadError> {
        let mut sum = 0.0;
        for fold in 0..folds.n {
            let mut problem = self.problem(&model.effects);
            problem.counts = folds.seen(fold);
            let fit = problem.fit_from(std::slice::from_ref(&model.fit.parameters), TOLERANCE)?;
            let residuals = problem.all_residuals(&fit.parameters);
            sum += residuals
                .iter()
                .zip(&folds.of)
                .filter(|(_, f)| **f == fold)
                .map(|(r, _)| r * r)
                .sum::<f64>();
        }
        Ok((sum / self.record.n_samples() as f64).sqrt())
    }

    /// Drops effects that the final model does not need, and exchanges effects for others that fit
    /// better.
    fn exchange(&self, base: &Fitted, mut model: Fitted) -> Result<Fitted, AfterloadError> {
        if model.effects.len() < 2 {
            return Ok(model);
        }
        let n_effective =
            noise::effective_sample_size(self.record, &self.residuals(&model)).n_effective;
        for k in (0..model.effects.len()).rev() {
            let mut others = model.effects.clone();
            let dropped = others.remove(k);
            let without = self.anew(base, &others)?;
            if self.delta_bic(&without, &model, n_effective) < self.settings.threshold {
                model = without;
                continue;
            }
            for effect in self.effects.iter().filter(|e| e.name != dropped.name) {
                if others.iter().any(|had| had.name == effect.name) {
                    continue;
                }
                let other = self.with(&without, effect)?;
                if self.delta_bic(&model, &other, n_effective) > self.settings.threshold {
                    model = other;
                }
            }
        }
        Ok(model)
    }

    /// Parameters of one effect, with intervals of the linearised model for the effective number of
    /// samples.
    fn strength(
        &self,
        model: &Fitted,
        effect: &'static Effect,
        n_effective: f64,
    ) -> Vec<(&'static str, f64, Option<[f64; 2]>)> {
        let problem = self.problem(&model.effects);
        let values = problem.values(&model.fit.parameters);
        let errors = model.fit.standard_errors();
        let z = normal::quantile(0.5 + 0.5 * self.settings.confidence_level);
        let inflation = (self.record.n_samples() as f64 / n_effective).sqrt();
        let before = model
            .effects
            .iter()
            .take_while(|e| e.name != effect.name)
            .map(|e| e.parameters.len())
            .sum::<usize>();
        effect
            .parameters
            .iter()
            .enumerate()
            .map(|(k, p)| {
                let value = values[p.position];
                let half = errors[problem.n_base() + before + k].map(|e| z * e * inflation);
                let interval = half.map(|h| {
                    [
                        (value - h).max(p.range.0) * p.factor,
                        (value + h).min(p.range.1) * p.factor,
                    ]
                });
                (p.name, value * p.factor, interval)
            })
            .collect()
    }

    fn conclude(
        &self,
        base: Fitted,
        model: Fitted,
        stages: Vec<Stage>,
    ) -> Result<Discovery, AfterloadError> {
        let residuals = self.residuals(&model);
        let sample_size = noise::effective_sample_size(self.record, &residuals);
        let n_effective = sample_size.n_effective;
        let folds = Folds::new(self.record, &sample_size);
        let n = self.record.n_samples() as f64;
        let rms = |m: &Fitted| (m.fit.sum_of_squares / n).sqrt();
        let gap = Gap {
            before_mmhg: rms(&base),
            after_mmhg: rms(&model),
            held_out_before_mmhg: self.held_out(&base, &folds)?,
            held_out_after_mmhg: self.held_out(&model, &folds)?,
            by_beat: folds.by_beat,
            n_folds: folds.n,
        };
        let mut accepted = Vec::new();
        for effect in &model.effects {
            let others: Vec<_> = model
                .effects
                .iter()
                .copied()
                .filter(|e| e.name != effect.name)
                .collect();
            let without = self.anew(&base, &others)?;
            accepted.push(Found {
                effect,
                delta_bic: self.delta_bic(&without, &model, n_effective),
                strength: self.strength(&model, effect, n_effective),
            });
        }
        let measured = &self.record.pressure;
        let model_pressure = |r: &[f64]| {
            r.iter()
                .zip(measured)
                .map(|(r, p)| r + p)
                .collect::<Vec<f64>>()
        };
        let names: Vec<_> = model.effects.iter().map(|e| e.name).collect();
        let nameless = match stages.iter().find(|stage| stage.with == names) {
            Some(stage) => stage.nameless.clone(),
            None => self.stage(&model)?.0.nameless,
        };
        let unexplained = (nameless.delta_bic > self.settings.threshold).then_some(nameless);
        Ok(Discovery {
            confusable: self.confusable(&model, n_effective)?,
            not_identifiable: self.not_identifiable(&model, n_effective)?,
            accepted,
            unexplained,
            gap,
            before: self.three(&base),
            after: self.three(&model),
            pressure_before_mmhg: model_pressure(&self.residuals(&base)),
            pressure_after_mmhg: model_pressure(&residuals),
            sample_size,
            stages,
        })
    }

    /// Evidence from a model's noise-free pressure against another model fitted to it, at the
    /// misfit of the record; `left_over` is the sum of squares of that fit.
    fn evidence_of(&self, left_over: f64, model: &Fitted, n_effective: f64) -> f64 {
        let own = Scale::new(self.record).variance(model.fit.sum_of_squares);
        n_effective * (left_over / self.record.n_samples() as f64 / own).ln_1p()
    }

    /// Effects that could be mistaken for the accepted ones. Each is fitted in place of an accepted
    /// effect to the noise-free pressure of the final model.
    fn confusable(
        &self,
        model: &Fitted,
        n_effective: f64,
    ) -> Result<Vec<Confusable>, AfterloadError> {
        let values = self.problem(&model.effects).values(&model.fit.parameters);
        let exact = self
            .record
            .with_pressure(pressure(self.record, &values, Start::Free));
        let there = Search {
            record: &exact,
            settings: self.settings,
            effects: self.effects.clone(),
        };
        let mut found = Vec::new();
        for effect in &model.effects {
            for other in effect.same_as {
                found.push(Confusable {
                    accepted: effect.name,
                    other,
                    delta_bic: 0.0,
                    separated_by: effect.separated_by,
                });
            }
            let others: Vec<_> = model
                .effects
                .iter()
                .copied()
                .filter(|e| e.name != effect.name)
                .collect();
            let without = there.anew(&there.base()?, &others)?;
            for rival in self
                .effects
                .iter()
                .filter(|e| model.effects.iter().all(|had| had.name != e.name))
            {
                let fitted = there.with(&without, rival)?;
                let evidence = self.evidence_of(fitted.fit.sum_of_squares, model, n_effective);
                if evidence < CONFUSED {
                    found.push(Confusable {
                        accepted: effect.name,
                        other: rival.name,
                        delta_bic: evidence,
                        separated_by: rival.separated_by,
                    });
                }
            }
        }
        Ok(found)
    }

    /// Effects that no record shows, and those that this record would not show at a typical
    /// strength.
    fn not_identifiable(
        &self,
        model: &Fitted,
        n_effective: f64,
    ) -> Result<Vec<(&'static str, String)>, AfterloadError> {
        let mut found: Vec<(&'static str, String)> = HIDDEN
            .iter()
            .map(|(name, why)| (*name, (*why).to_owned()))
            .collect();
        let values = self.problem(&model.effects).values(&model.fit.parameters);
        for effect in self
            .effects
            .iter()
            .filter(|e| model.effects.iter().all(|had| had.name != e.name))
        {
            let mut typical = values;
            effect
                .parameters
                .iter()
                .for_each(|p| typical[p.position] = p.starts[0]);
            let exact = self
                .record
                .with_pressure(pressure(self.record, &typical, Start::Free));
            let there = Search {
                record: &exact,
                settings: self.settings,
                effects: Vec::new(),
            };
            let problem = there.problem(&model.effects);
            let refitted =
                problem.fit_from(std::slice::from_ref(&model.fit.parameters), TOLERANCE)?;
            let evidence = self.evidence_of(refitted.sum_of_squares, model, n_effective);
            if evidence < CONFUSED {
                let why = format!(
                    "a typical one would change the evidence by {evidence:.1} only: the others take it up"
                );
                found.push((effect.name, why));
            }
        }
        Ok(found)
    }
}

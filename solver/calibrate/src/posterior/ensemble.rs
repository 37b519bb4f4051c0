//! Draws from a posterior by randomised maximum likelihood, made together.
//!
//! Each draw descends for itself by Levenberg–Marquardt steps, from the answer of the model that is
//! linearised at the mode. Some draws, the pilots, also descend from their own points of the prior; if
//! that serves better, the model has several valleys, and all draws do so. A further descent ends as
//! soon as it no longer promises a better end. Derivatives come from the
//! points that all draws have evaluated. Where a step falls short of its promise, points next to the
//! present one are added, which serve all draws. Ensembles share derivatives since Gu and Oliver 2007 (SPE J. 12:438) and Chen
//! and Oliver 2012 (Math. Geosci. 44:1), with one regression for all draws. Here each draw has a
//! regression of its own, in which near points count most.

use super::draw::{Draw, deviates, farthest};
use super::mode::Mode;
use super::points::Points;
use super::{Evaluated, Target};
use crate::descent::{Aim, DAMPING, DIFFERENCE, KEPT, LONGEST, MOST_DAMPING};
use crate::random::{Purpose, generator};

/// Promised gain of the next step below which a descent ends. The heights of draws differ by √(n/2),
/// which is 3 for 22 parameters.
const GAIN: f64 = 0.25;
/// Number of tries over which [`GAIN_OF_TRIES`] counts.
const TRIES: usize = 5;
/// A descent also ends if the last [`TRIES`] tries together gained less than this.
const GAIN_OF_TRIES: f64 = 0.5;
/// Distance of points next to the present one: a little more than the least at which points count.
const BESIDE: f64 = 1.01 * DIFFERENCE;
/// Largest number of times that a descent evaluates points next to its own.
const PROBINGS: usize = 1;
/// Every fifth draw also descends from its point of the prior, and so finds other valleys.
const PILOTS: usize = 5;
/// Fall of the height by which another valley serves better, and the share of the pilots from which
/// on all draws look for one. Without other valleys, one pilot in twenty falls as much.
const BETTER: f64 = 3.0;
const SHARE_OF_PILOTS: f64 = 0.1;
/// Number of halvings of the way from the mode to a start, before the mode itself is the start.
const HALVINGS: usize = 6;
/// Least gain over the best end so far that a further descent must promise.
const LEAST_LEAD: f64 = 1.0;

/// The present descent of a draw.
enum Place<Q> {
    /// The start is sought on the way from the mode, after this number of halvings.
    Start(usize),
    /// A point that was reached.
    At(Box<Reached<Q>>),
    /// All descents have ended.
    Ended,
}

struct Reached<Q> {
    u: Vec<f64>,
    found: Evaluated<Q>,
    height: f64,
    damping: f64,
    /// Height after each try.
    heights: Vec<f64>,
    /// Whether differences were taken here.
    is_probed: bool,
    /// Whether differences are to be taken here.
    is_doubtful: bool,
}

/// Best end of the descents of a draw.
struct End<Q> {
    u: Vec<f64>,
    seen: Q,
    height: f64,
    converged: bool,
}

struct Member<Q> {
    aim: Aim,
    /// Height above which an end is not plausible.
    farthest: f64,
    /// Ways from the mode to the remaining starts, the next one last.
    ways: Vec<Vec<f64>>,
    /// Way from the mode to the draw of the prior.
    to_prior: Vec<f64>,
    /// Height at the end of the first descent.
    first_height: Option<f64>,
    /// Whether the descent from the draw of the prior is due after the first one, come what may.
    is_pilot: bool,
    place: Place<Q>,
    best: Option<End<Q>>,
    /// Number of times that points next to the present one were evaluated.
    probings: usize,
    evaluations: usize,
}

/// What a candidate is for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Purposed {
    Start,
    /// A point next to the present one, in the direction of each coordinate.
    Probes,
    /// A step with the gain that it promises.
    Step(f64),
    /// The undamped step at the end of a descent.
    Last,
    /// Nothing is left to evaluate; whether the descent ended by itself.
    Nothing(bool),
}

/// The next point of a draw.
#[derive(Debug, Clone, PartialEq)]
struct Candidate {
    u: Vec<f64>,
    purpose: Purposed,
}

/// The next point of a draw with the model's result.
#[derive(Debug, Clone, PartialEq)]
pub struct Next<Q> {
    index: usize,
    candidate: Candidate,
    found: Option<Evaluated<Q>>,
    /// Points next to the present one, with the residuals there.
    probes: Vec<(Vec<f64>, Vec<f64>)>,
}

/// Draws in the making.
pub struct Ensemble<'a, Q> {
    target: &'a Target<'a, Q>,
    mode: &'a Mode,
    members: Vec<Member<Q>>,
    points: Points,
    max_tries: usize,
    /// Whether the pilots have told if other valleys serve better.
    is_searched: bool,
}

impl<'a, Q> Ensemble<'a, Q> {
    /// Draws with a seed and indices from 0 to `n` − 1.
    ///
    /// - `max_tries`: limit of steps of a descent, including those without gain
    #[must_use]
    pub fn new(
        target: &'a Target<'a, Q>,
        mode: &'a Mode,
        seed: u64,
        n: u64,
        max_tries: usize,
    ) -> Self {
        let member = |index| {
            let mut generator = generator(seed, Purpose::Posterior, [index, 0]);
            let prior = deviates(&mut generator, mode.u.len());
            let errors = deviates(&mut generator, mode.residuals.len());
            let way: Vec<f64> = prior.iter().zip(&mode.u).map(|(p, u)| p - u).collect();
            let aim = Aim {
                errors,
                prior,
                weight: 1.0,
            };
            let linear = aim.step(&mode.u, &mode.residuals, &mode.jacobian, 0.0, f64::INFINITY);
            let linear = linear.map(|(step, _)| step.as_slice().to_vec());
            Member {
                is_pilot: index % PILOTS as u64 == 0,
                ..Member::new(aim, mode, way, linear)
            }
        };
        Self {
            target,
            mode,
            members: (0..n).map(member).collect(),
            points: Points::new(mode),
            max_tries,
            is_searched: false,
        }
    }

    /// Indices of the draws that are not done.
    #[must_use]
    pub fn pending(&self) -> Vec<usize> {
        let is_pending = |i: &usize| !matches!(self.members[*i].place, Place::Ended);
        (0..self.members.len()).filter(is_pending).collect()
    }

    /// The next point of a draw, and the model's result there. The caller may compute those of all
    /// pending draws in parallel.
    #[must_use]
    pub fn next(&self, index: usize) -> Next<Q> {
        let candidate = self.candidate(&self.members[index]);
        let mut probes = Vec::new();
        let found = match candidate.purpose {
            Purposed::Nothing(_) => None,
            Purposed::Probes => {
                probes = self.beside(&candidate.u);
                None
            }
            _ => self.target.at(&candidate.u),
        };
        Next {
            index,
            candidate,
            found,
            probes,
        }
    }

    /// Points next to `u` in the direction of each coordinate, with the residuals there; the other side
    /// where the model has no result.
    fn beside(&self, u: &[f64]) -> Vec<(Vec<f64>, Vec<f64>)> {
        let beside = |j: usize| {
            // Inwards first, where the prior is dense and most models have a result.
            let inwards = if u[j] > 0.0 { -BESIDE } else { BESIDE };
            [inwards, -inwards].into_iter().find_map(|step| {
                let mut moved = u.to_vec();
                moved[j] += step;
                let found = self.target.at(&moved)?;
                Some((moved, found.residuals))
            })
        };
        (0..u.len()).filter_map(beside).collect()
    }

    fn candidate(&self, member: &Member<Q>) -> Candidate {
        let nothing = |converged| Candidate {
            u: Vec::new(),
            purpose: Purposed::Nothing(converged),
        };
        let here = match &member.place {
            Place::Ended => return nothing(false),
            Place::Start(halvings) => {
                let share = if *halvings < HALVINGS {
                    0.5_f64.powi(*halvings as i32)
                } else {
                    0.0
                };
                let way = member.ways.last().into_iter().flatten();
                let u = self.mode.u.iter().zip(way).map(|(u, way)| u + share * way);
                return Candidate {
                    u: u.collect(),
                    purpose: Purposed::Start,
                };
            }
            Place::At(here) => here,
        };
        if here.is_doubtful {
            return Candidate {
                u: here.u.clone(),
                purpose: Purposed::Probes,
            };
        }
        let tries = here.heights.len();
        if here.damping > MOST_DAMPING || tries > self.max_tries {
            return nothing(false);
        }
        let jacobian = self.points.jacobian(&here.u, &here.found.residuals);
        let step = |damping, longest| {
            let step = member
                .aim
                .step(&here.u, &here.found.residuals, &jacobian, damping, longest);
            step.map(|(step, promised)| {
                let u = here.u.iter().zip(&step).map(|(u, s)| u + s);
                (u.collect(), promised)
            })
        };
        // The promise of the undamped step is the most that the present derivatives offer.
        if let Some(best) = &member.best
            && step(0.0, f64::INFINITY).is_none_or(|(_, most): (Vec<f64>, f64)| {
                here.height - most > best.height - LEAST_LEAD
            })
        {
            return nothing(true);
        }
        let is_slow =
            tries > TRIES && here.heights[tries - 1 - TRIES] - here.height < GAIN_OF_TRIES;
        match step(here.damping, LONGEST) {
            Some((u, promised)) if !is_slow && promised >= GAIN => Candidate {
                u,
                purpose: Purposed::Step(promised),
            },
            // An undamped last step makes up for the damping.
            Some(_) => step(0.0, f64::INFINITY).map_or_else(
                || nothing(true),
                |(u, _)| Candidate {
                    u,
                    purpose: Purposed::Last,
                },
            ),
            None => nothing(false),
        }
    }

    /// Takes the results of [`Self::next`] in the order of the draws, which must be the same in
    /// every run.
    pub fn tell(&mut self, results: Vec<Next<Q>>) {
        for next in results {
            if let Some(found) = &next.found {
                self.points.add(&next.candidate.u, &found.residuals);
            }
            for (u, residuals) in &next.probes {
                self.points.add(u, residuals);
            }
            self.members[next.index].advance(next);
        }
        if !self.is_searched && self.pending().is_empty() {
            self.is_searched = true;
            self.search_other_valleys();
        }
    }

    /// Lets all draws descend from their points of the prior if that served the pilots.
    fn search_other_valleys(&mut self) {
        let pilots = self.members.iter().filter(|member| member.is_pilot);
        let is_better = |member: &&Member<Q>| {
            let best = member.best.as_ref().map(|best| best.height);
            best.zip(member.first_height)
                .is_some_and(|(best, first)| best < first - BETTER)
        };
        let n_better = pilots.clone().filter(is_better).count();
        if n_better as f64 > SHARE_OF_PILOTS * pilots.count() as f64 {
            for member in self.members.iter_mut().filter(|member| !member.is_pilot) {
                member.begin_at_prior();
            }
        }
    }

    /// The draws; those without any result are left out.
    #[must_use]
    pub fn draws(self) -> Vec<Draw<Q>> {
        let draw = |member: Member<Q>| {
            let End {
                u,
                seen,
                height,
                converged,
            } = member.best?;
            Some(Draw {
                u,
                seen,
                converged: converged && height <= member.farthest,
                evaluations: member.evaluations,
            })
        };
        self.members.into_iter().filter_map(draw).collect()
    }
}

impl<Q> Member<Q> {
    /// - `linear`: way to the answer of the model that is linearised at the mode, where a descent
    ///   needs few steps
    fn new(aim: Aim, mode: &Mode, to_prior: Vec<f64>, linear: Option<Vec<f64>>) -> Self {
        let ways = std::iter::once(vec![0.0; mode.u.len()])
            .chain([to_prior.clone()])
            .chain(linear)
            .collect();
        Self {
            aim,
            farthest: farthest(mode),
            ways,
            to_prior,
            first_height: None,
            is_pilot: false,
            place: Place::Start(0),
            best: None,
            probings: 0,
            evaluations: 0,
        }
    }

    fn advance(&mut self, next: Next<Q>) {
        let Next {
            candidate: Candidate { u, purpose },
            found,
            probes,
            ..
        } = next;
        self.evaluations += match purpose {
            Purposed::Nothing(_) => 0,
            Purposed::Probes => probes.len(),
            _ => 1,
        };
        let height = found
            .as_ref()
            .map(|found| self.aim.height(&u, &found.residuals));
        match purpose {
            Purposed::Start => {
                let Place::Start(halvings) = &mut self.place else {
                    return;
                };
                if let Some((found, height)) = found.zip(height) {
                    self.place = Place::At(Box::new(Reached {
                        u,
                        found,
                        height,
                        damping: DAMPING,
                        heights: vec![height],
                        is_probed: false,
                        is_doubtful: false,
                    }));
                } else if *halvings < HALVINGS {
                    *halvings += 1;
                } else {
                    self.begin_again();
                }
            }
            Purposed::Probes => {
                self.probings += 1;
                if let Place::At(here) = &mut self.place {
                    (here.is_probed, here.is_doubtful) = (true, false);
                }
            }
            Purposed::Step(promised) => {
                let Place::At(here) = &mut self.place else {
                    return;
                };
                let kept = height.map_or(f64::NEG_INFINITY, |height| here.height - height);
                let was_probed = here.is_probed;
                let is_impossible = found.is_none();
                if let Some((found, height)) = found.zip(height).filter(|(_, h)| *h < here.height) {
                    (here.u, here.found, here.height) = (u, found, height);
                    here.is_probed = false;
                }
                here.heights.push(here.height);
                if kept < KEPT[0] * promised {
                    let may_probe = self.probings < PROBINGS;
                    if was_probed || is_impossible || !may_probe {
                        here.damping *= 4.0;
                    }
                    here.is_doubtful = !here.is_probed && !was_probed && may_probe;
                } else if kept > KEPT[1] * promised {
                    here.damping /= 5.0;
                }
            }
            Purposed::Last => {
                if let Place::At(here) = &mut self.place
                    && let Some((found, height)) =
                        found.zip(height).filter(|(_, h)| *h < here.height)
                {
                    (here.u, here.found, here.height) = (u, found, height);
                }
                self.end(true);
            }
            Purposed::Nothing(converged) => self.end(converged),
        }
    }

    /// Ends a descent. Another one follows if its end is too high.
    fn end(&mut self, converged: bool) {
        if let Place::At(here) = std::mem::replace(&mut self.place, Place::Ended) {
            let is_better = self
                .best
                .as_ref()
                .is_none_or(|best| here.height < best.height);
            if is_better {
                self.best = Some(End {
                    u: here.u,
                    seen: here.found.seen,
                    height: here.height,
                    converged,
                });
            }
        }
        let height = self.best.as_ref().map(|best| best.height);
        if self.first_height.is_none() {
            self.first_height = height;
            if self.is_pilot {
                self.begin_at_prior();
                return;
            }
        }
        if height.is_none_or(|height| height > self.farthest) {
            self.begin_again();
        }
    }

    fn begin_at_prior(&mut self) {
        self.ways = vec![vec![0.0; self.to_prior.len()], self.to_prior.clone()];
        self.place = Place::Start(0);
        self.probings = 0;
    }

    fn begin_again(&mut self) {
        self.ways.pop();
        self.probings = 0;
        self.place = if self.ways.is_empty() {
            Place::Ended
        } else {
            Place::Start(0)
        };
    }
}

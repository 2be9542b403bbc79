//! The search in free motion: laws of force added one at a time while the proof holds.

use super::free::{FreeParameter, at_values, flats};
use super::screen::{
    ForceCandidate, ScreenBase, ScreenSeed, beginnings, candidates, constant_of_nature, region,
    rescreen_from_prior, screen, with_effect,
};
use super::weak_form::{LensFit, WeakFormRegression, fit_forces};
use crate::effects::{EffectEntry, ParamId};
use crate::num::{Stop, Stopped, elementary};
use crate::world::Model;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::slice;

/// Fall of chi-square, in units of what remains and beyond the price of its parameters (BIC), that an effect must
/// bring: the price of looking at the whole library.
pub const PROOF: f64 = 20.0;
/// A richer law must beat a simpler one by this, and on what was left out too.
const RICHER: f64 = 10.0;
/// Engines and cameras realise a law to about 5 %: of what it explains, this share is no matter of another law.
const REALISED: f64 = 0.05 * 0.05;
/// A simpler law that explains this share is asked for first.
const NEARLY: f64 = 0.9;
/// Videos do not distinguish laws whose odds are below 20 to 1: 2 ln 20, in units of chi-square.
pub const ALIKE: f64 = 5.991_464_547;
/// Fall of chi-square that chance brings a parameter that is not needed, at most (Akaike, IEEE Trans. Automat. Control 19 (1974) 716).
const AKAIKE: f64 = 2.0;
/// Fall of chi-square that a law must bring beside the object on which it shows most: one object may have met something.
pub const ELSEWHERE: f64 = 10.0;
/// An amplitude differs from zero by this many deviations of what objects say of it.
const AGREED: f64 = 2.0;
/// Share of the misfit beyond noise that laws must explain to be named, where more than `CLEAN` of it (reduced
/// chi-square) remains.
const MOSTLY: f64 = 0.7;
pub const CLEAN: f64 = 0.15;
/// Laws that are tried beside another: those that promise most.
const PROMISING: usize = 8;
/// Deviations of chi-square beyond which noise does not explain the motion.
const BEYOND: f64 = 2.0;
/// Where none of them explains the motion, those that explain most are sought anew from what was believed.
const ANEW: usize = 3;
/// First choices that are tried with a second effect beside them.
const FIRST_CHOICES: usize = 3;
/// Numbers of a law of which two may be what one of more stands for.
const SIMPLE: usize = 2;

/// What the force lens found.
#[derive(Clone, Serialize, Deserialize)]
pub struct FreeMotion {
    /// With the effects found, at the best values.
    pub models: Vec<Model>,
    pub free: Vec<FreeParameter>,
    pub seen: LensFit,
    /// In the order added.
    pub found: Vec<ForceCandidate>,
    /// All candidates of the round that decided, best first, with their scores.
    pub ranked: Vec<(f64, ForceCandidate)>,
    /// Kinds that trajectories explain as well as the one found, it included, where they were asked.
    pub alike: Vec<String>,
    /// Of the models without any effect added.
    pub base: LensFit,
    pub degrees_of_freedom: f64,
    /// What remains of all objects but the worst (reduced chi-square): one may have met something.
    pub trimmed_chi_square: f64,
}

impl FreeMotion {
    /// What remains unexplained, in units of the noise: 1 is noise.
    pub fn reduced_chi_square(&self) -> f64 {
        self.seen.chi_square / self.degrees_of_freedom
    }

    /// What remains after the best of all candidates (reduced chi-square): their evidence is told in units of that.
    pub fn unit(&self) -> f64 {
        let least = self.ranked.iter().map(|(_, c)| c.chi_square).fold(f64::INFINITY, f64::min);
        (least / self.degrees_of_freedom).clamp(1.0, f64::MAX)
    }

    /// How many numbers the laws have that were found.
    pub fn added(&self) -> usize {
        self.found.iter().map(|c| c.added).sum()
    }

    /// The price of the numbers that the laws found have beyond so many.
    pub fn dearer(&self, numbers: usize) -> f64 {
        self.added().saturating_sub(numbers) as f64 * elementary::ln(self.degrees_of_freedom)
    }

    /// Kinds that explain the motion as well as what was found, with it, those of fewest parameters first: odds below 20 to 1, and
    /// where the amplitude found is `uncertain` also simpler laws that explain nearly as much. Two laws found are one kind,
    /// joined by `+`. Empty where nothing is as good, or where free motion alone does not prove what was found.
    pub fn rivals(&self, lens: &WeakFormRegression, uncertain: bool) -> Vec<String> {
        let Some(first) = self.found.first() else { return vec![] };
        let is_law = |(_, c): &&(f64, ForceCandidate)| c.entry.spec.name == first.entry.spec.name;
        let proven = self.ranked.iter().find(is_law).is_some_and(|(score, c)| proven(lens, *score, c));
        if !proven && self.found.len() == 1 {
            return vec![];
        }
        let unit = self.unit().min(self.reduced_chi_square().max(1.0));
        let constants: f64 = self.found.iter().map(|c| constant_of_nature(c.entry, &c.values)).sum();
        let (added, fall) = (self.added(), (self.base.cost - self.seen.cost + constants) / unit);
        let rival = |c: &ForceCandidate| {
            let simpler = uncertain && c.added < added && c.gain >= NEARLY * fall * unit;
            simpler || (self.as_likely(c.added, c.gain / unit, added, fall) && holds_elsewhere(lens, c))
        };
        let kinds: Vec<&str> = self.found.iter().map(|c| c.entry.kind).collect();
        let mut near = vec![(added, kinds.join("+"))];
        for (_, c) in self.ranked.iter().filter(|(_, c)| rival(c)) {
            if !near.iter().any(|(_, kind)| kind == c.entry.kind) {
                near.push((c.added, c.entry.kind.into()));
            }
        }
        near.sort_by_key(|(added, _)| *added);
        if near.len() > 1 { near.into_iter().map(|(_, kind)| kind).collect() } else { vec![] }
    }

    /// Whether a law of `numbers` parameters that gains so much has odds no worse than 20 to 1 against another.
    fn as_likely(&self, numbers: usize, gain: f64, others: usize, other_gain: f64) -> bool {
        let (more, own) = (gain - other_gain, numbers as f64 - others as f64);
        // A richer law that explains no more than chance or than what engines make of a law has a number too many.
        let superfluous = own > 0.0 && more < AKAIKE * own + REALISED * other_gain;
        own * elementary::ln(self.degrees_of_freedom) - more < ALIKE && !superfluous
    }

    /// For each of several laws found that others could replace beside the rest: that law and those that do as well, with the
    /// numbers that they have there. `models` are those without any law found.
    pub fn substitutes(
        &self,
        lens: &WeakFormRegression,
        models: &[Model],
        stop: Stop,
    ) -> Result<Vec<Vec<ForceCandidate>>, Stopped> {
        let (mut all, region) = (vec![], region(lens.scenes));
        if self.found.len() < 2 {
            return Ok(all);
        }
        for (number, law) in self.found.iter().enumerate() {
            stop(number as f64 / self.found.len() as f64)?;
            let rest = self.found.iter().enumerate().filter(|(k, _)| *k != number).map(|(_, other)| other);
            let mut beside = models.to_vec();
            for other in rest.filter(|other| !other.entry.of_objects()) {
                beside = with_effect(&beside, other.entry, &other.values, &region);
            }
            let (free, seen) = fit_forces(lens, &beside);
            let base = ScreenBase::new(lens, &beside, free, seen);
            let ranked = round(lens, &beside, &base, law.entry.spec.params.len(), PROMISING);
            let is_law = |c: &&ForceCandidate| c.entry.spec.name == law.entry.spec.name;
            let Some(own) = ranked.iter().map(|(_, c)| c).find(is_law) else { continue };
            let unit = self.reduced_chi_square().max(1.0);
            let near = |c: &ForceCandidate| {
                c.entry.kind != own.entry.kind
                    && c.certain()
                    && self.as_likely(c.added, c.gain / unit, own.added, own.gain / unit)
                    && holds_elsewhere(lens, c)
            };
            let mut alike = vec![own.clone()];
            alike.extend(ranked.iter().map(|(_, c)| c).filter(|c| near(c)).cloned());
            alike.sort_by_key(|c| c.added);
            if alike.len() > 1 {
                all.push(alike);
            }
        }
        Ok(all)
    }

    /// Cost with the price of all added parameters.
    pub fn priced(&self) -> f64 {
        self.seen.cost + self.added() as f64 * elementary::ln(self.degrees_of_freedom)
    }
}

/// Adds at most one effect to the models. Deterministic, whatever the number of threads.
pub fn search(lens: &WeakFormRegression, models: &[Model], stop: Stop) -> Result<FreeMotion, Stopped> {
    one_after_another(lens, models, 1, &[], stop)
}

/// Adds more effects, at most `most` in all, after what `search` found for the same models.
pub fn search_on(
    lens: &WeakFormRegression,
    models: &[Model],
    begun: FreeMotion,
    most: usize,
    stop: Stop,
) -> Result<FreeMotion, Stopped> {
    let Some(first) = begun.found.first().cloned() else { return Ok(begun) };
    let ranked = begun.ranked;
    let most = most.max(1);
    let mut greedy = one_after_another(lens, models, most, &[first], stop)?;
    if greedy.found.len() >= 2 || (greedy.found.len() == 1 && most > 1 && !explained(&greedy)) {
        // The first pick may be a compromise of two: begin with the next ones too.
        let first = greedy.found[0].entry.spec.name;
        let others = ranked.iter().filter(|(score, c)| c.entry.spec.name != first && proven(lens, *score, c));
        for (_, other) in others.take(FIRST_CHOICES).cloned() {
            let pair = one_after_another(lens, models, most, &[other], stop)?;
            if pair.priced() + RICHER < greedy.priced() {
                greedy = pair;
            }
        }
    }
    greedy = as_pair(lens, models, &ranked, greedy, most, stop)?;
    if !explains(&greedy) {
        greedy = one_after_another(lens, models, 0, &[], stop)?;
    }
    let kept = steady(lens, &greedy);
    if kept < greedy.found.len() {
        let found = greedy.found[..kept].to_vec();
        greedy = one_after_another(lens, models, kept, &found, stop)?;
    }
    // What explains more alone comes first: a step that trajectories refuse is the last one.
    if let [_, second] = &greedy.found[..] {
        let place =
            |c: &ForceCandidate| ranked.iter().position(|(_, r)| r.entry.spec.name == c.entry.spec.name);
        if let Some(at) = place(second)
            && place(&greedy.found[0]).is_none_or(|first| at < first)
        {
            let alone = ranked[at].1.clone();
            greedy.found.truncate(1);
            greedy.found.insert(0, alone);
        }
    }
    // The round that chose the first effect is the one that ranks the library.
    greedy.ranked = ranked;
    Ok(greedy)
}

/// Two laws of few numbers in place of what was found, where they do as well: a whirl far away is a drag and a wind.
fn as_pair(
    lens: &WeakFormRegression,
    models: &[Model],
    ranked: &[(f64, ForceCandidate)],
    found: FreeMotion,
    most: usize,
    stop: Stop,
) -> Result<FreeMotion, Stopped> {
    let (rich, mut least) = (found.added(), found.priced() + RICHER);
    let mut best = found;
    let simple = ranked.iter().filter(|(_, c)| c.added <= SIMPLE && c.added + 1 < rich && c.certain());
    for (_, first) in simple.take(FIRST_CHOICES) {
        let room = SIMPLE.min(rich - 1 - first.added);
        let pair = laws_of(room, lens, models, most.min(2), slice::from_ref(first), stop)?;
        if pair.added() < rich && pair.priced() < least {
            (least, best) = (pair.priced(), pair);
        }
    }
    Ok(best)
}

/// What was found without its last `refused` effects.
pub fn fewer(
    lens: &WeakFormRegression,
    models: &[Model],
    motion: &FreeMotion,
    refused: usize,
    stop: Stop,
) -> Result<FreeMotion, Stopped> {
    let kept = motion.found.len().saturating_sub(refused);
    let mut less = one_after_another(lens, models, kept, &motion.found[..kept], stop)?;
    less.ranked.clone_from(&motion.ranked);
    Ok(less)
}

/// One law in place of all that were found.
pub fn instead(
    lens: &WeakFormRegression,
    models: &[Model],
    motion: &FreeMotion,
    law: &ForceCandidate,
    stop: Stop,
) -> Result<FreeMotion, Stopped> {
    let one = one_after_another(lens, models, 1, slice::from_ref(law), stop)?;
    Ok(FreeMotion { ranked: motion.ranked.clone(), ..one })
}

/// Whether what was found leaves noise, or explains most of what noise does not: where a model is far from the noise
/// anyway, any law takes up some of what is wrong.
fn explains(free: &FreeMotion) -> bool {
    let excess = |seen: &LensFit| seen.chi_square / free.degrees_of_freedom - 1.0;
    excess(&free.seen) < CLEAN || excess(&free.seen) < (1.0 - MOSTLY) * excess(&free.base)
}

/// How many of the effects found, from the first on, have an amplitude that objects agree about.
fn steady(lens: &WeakFormRegression, free: &FreeMotion) -> usize {
    let Some(scatter) = lens.scatter(&free.models, &free.free, &free.seen.values) else {
        return free.found.len();
    };
    let agreed = |c: &&ForceCandidate| {
        c.entry.spec.params.iter().take(c.entry.amplitudes).any(|p| {
            let name = ParamId { effect: c.entry.spec.name, parameter: p.name, label: "" }.to_string();
            let at = free.free.iter().position(|f| f.name == name);
            at.is_none_or(|at| free.seen.values[at].abs() > AGREED * scatter[at])
        })
    };
    free.found.iter().take_while(agreed).count()
}

/// Whether noise explains what is left.
fn explained(free: &FreeMotion) -> bool {
    free.reduced_chi_square() < super::MISFIT
}

/// Whether a candidate is worth its price and certain, shows on more than one object, and what was left out gains too.
fn proven(lens: &WeakFormRegression, score: f64, c: &ForceCandidate) -> bool {
    score > PROOF && c.certain() && holds_elsewhere(lens, c)
}

/// Whether what was left out gains too, if there is more than one part.
fn holds_elsewhere(lens: &WeakFormRegression, c: &ForceCandidate) -> bool {
    lens.folds.len() < 2 || (c.held_out > 0.0 && c.gain_without_best_track > ELSEWHERE)
}

/// Whether a chi-square is beyond what noise leaves.
pub fn leaves_something(chi_square: f64, degrees: f64) -> bool {
    chi_square > degrees + BEYOND * (2.0 * degrees).sqrt()
}

/// Candidates of at most `room` numbers beside the models, best first: at most so many, those that promise most.
fn round(
    lens: &WeakFormRegression,
    models: &[Model],
    base: &ScreenBase,
    room: usize,
    most: usize,
) -> Vec<(f64, ForceCandidate)> {
    let region = region(lens.scenes);
    let degrees = lens.degrees_of_freedom().max(1) as f64;
    let mut begun: Vec<(&'static EffectEntry, Vec<ScreenSeed>)> = candidates(models, lens.scenes)
        .into_par_iter()
        .filter(|entry| entry.spec.params.len() <= room)
        .filter_map(|entry| Some((entry, beginnings(lens, &base.fitted, entry, &region)?)))
        .collect();
    begun.sort_by(|a, b| b.1[0].gain.total_cmp(&a.1[0].gain));
    begun.truncate(most);
    let best = |(entry, tried): &(&'static EffectEntry, Vec<ScreenSeed>)| {
        screen(lens, base, &base.fitted, entry, tried, &region)
    };
    let mut candidates: Vec<ForceCandidate> = begun.par_iter().filter_map(best).collect();
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    if candidates.first().is_some_and(|c| leaves_something(c.chi_square, degrees)) {
        let believed = base.believed(lens);
        let most = candidates.par_iter_mut().take(ANEW);
        most.for_each(|c| rescreen_from_prior(lens, base, &believed, &region, c));
    }
    // What remains is in units of the best that holds elsewhere: a law that suits one object alone is none.
    let holds = |c: &&ForceCandidate| lens.folds.len() < 2 || c.gain_without_best_track > ELSEWHERE;
    let remains = candidates.iter().filter(holds).map(|c| c.chi_square).fold(base.seen.chi_square, f64::min);
    let least = (remains / degrees).max(1.0);
    let score = |c: &ForceCandidate| c.gain / least - c.added as f64 * elementary::ln(degrees);
    let mut ranked: Vec<(f64, ForceCandidate)> = candidates.into_iter().map(|c| (score(&c), c)).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    // The simpler law wins unless the richer one proves itself, or leaves noise where the simpler leaves more.
    let left = |c: &ForceCandidate| c.chi_square > super::MISFIT * degrees;
    if let Some((best, champion)) = ranked.first() {
        let simpler = ranked.iter().skip(1).position(|(score, c)| {
            c.added < champion.added
                && c.gain >= NEARLY * champion.gain
                && (left(champion) || !left(c))
                && (best - score < RICHER + REALISED * best || c.held_out >= champion.held_out)
        });
        if let Some(at) = simpler {
            let winner = ranked.remove(at + 1);
            ranked.insert(0, winner);
        }
    }
    ranked
}

fn one_after_another(
    lens: &WeakFormRegression,
    models: &[Model],
    most: usize,
    given: &[ForceCandidate],
    stop: Stop,
) -> Result<FreeMotion, Stopped> {
    laws_of(usize::MAX, lens, models, most, given, stop)
}

/// The same of laws that have at most `room` numbers, but for those that are given.
fn laws_of(
    room: usize,
    lens: &WeakFormRegression,
    models: &[Model],
    most: usize,
    given: &[ForceCandidate],
    stop: Stop,
) -> Result<FreeMotion, Stopped> {
    let (mut free, mut seen) = fit_forces(lens, models);
    let mut state = FreeMotion {
        models: at_values(models, &free, &seen.values),
        free: free.clone(),
        seen: seen.clone(),
        found: vec![],
        ranked: vec![],
        alike: vec![],
        base: seen.clone(),
        degrees_of_freedom: lens.degrees_of_freedom().max(1) as f64,
        trimmed_chi_square: 0.0,
    };
    for number in 0..most {
        stop(number as f64 / (most + 1) as f64)?;
        let winner = match given.get(number) {
            Some(candidate) => candidate.clone(),
            None => {
                let base = ScreenBase::new(lens, &state.models, free, seen);
                // The first round ranks the library.
                let most = if number == 0 { usize::MAX } else { PROMISING };
                let ranked = round(lens, &state.models, &base, room, most);
                let known: f64 = state.found.iter().map(|c| c.gain).sum();
                let more = |c: &ForceCandidate| c.gain > REALISED * known;
                let chosen = ranked.iter().find(|(score, c)| proven(lens, *score, c) && more(c)).cloned();
                if number == 0 || state.ranked.is_empty() {
                    state.ranked = ranked.clone();
                }
                let Some((_, winner)) = chosen else { break };
                winner
            }
        };
        state.models = winner.models.clone();
        (free, seen) = fit_forces(lens, &state.models);
        state.models = at_values(&state.models, &free, &seen.values);
        (state.free, state.seen) = (free.clone(), seen.clone());
        state.found.push(winner);
    }
    let residual = lens.residual(&state.models, &flats(&state.models, &state.free, &state.seen.values));
    state.trimmed_chi_square = lens.trimmed_chi_square(&residual);
    stop(1.0)?;
    Ok(state)
}

#[cfg(test)]
mod tests {
    use super::super::screen::with_nuisance;
    use super::super::tests::{CUBE, DISC, Launch, film_under};
    use super::*;
    use crate::effects::effect;
    use crate::effects::formula::Formula;
    use crate::num::never;
    use crate::scene::Shape;
    use crate::world::{ActiveEffect, Preset};

    const BALL: Shape = Shape::Ball { radius: 0.2 };

    /// What is found, two laws at most, with its rivals, where a law acts that the library does not have.
    fn found_under(law: &str, launches: &[Vec<Launch>]) -> FreeMotion {
        let scenes = film_under(launches, |model| {
            let formula = Formula::new(law, vec![]).expect("it is one");
            let active = ActiveEffect::of_formula("law", formula, &model.bodies).expect("it is one");
            model.effects.push(active);
        });
        let lens = WeakFormRegression::new(&scenes);
        let models: Vec<Model> = scenes.iter().map(|s| Preset::for_world(s.world).model(s)).collect();
        let models = with_nuisance(&models);
        let first = search(&lens, &models, &never).expect("never stops");
        let motion = search_on(&lens, &models, first, 2, &never).expect("never stops");
        FreeMotion { alike: motion.rivals(&lens, false), ..motion }
    }

    /// A fan blows a little less at the far end: that is its wind still, and no source somewhere or patch beside.
    #[test]
    fn what_an_engine_makes_of_a_law_is_no_other_law() {
        let launches = [
            vec![(DISC, 0.6, [-1.5, 0.5], [1.0, 0.3]), (CUBE, 0.8, [1.5, -1.5], [-0.5, 0.9])],
            vec![(DISC, 0.6, [0.0, 1.5], [0.4, -1.2]), (CUBE, 0.6, [1.6, 0.2], [-1.2, -0.2])],
            vec![(DISC, 0.6, [-1.5, -1.5], [0.8, 0.9]), (DISC, 0.6, [1.5, 1.2], [-1.1, 0.2])],
        ];
        let wind = "fx = 0.4*(1 - 0.005*x); fy = -0.4*(1 + 0.005*y)";
        let motion = found_under(wind, &launches);
        let found: Vec<_> = motion.found.iter().map(|c| (c.entry.spec.name, c.gain)).collect();
        assert!(matches!(found[..], [("uniform_force", _)]), "{found:?}");
    }

    /// One disc that a wind turns aside moves almost as on a table that turns, which has a number less.
    #[test]
    fn a_simpler_law_that_leaves_structure_is_not_the_one() {
        let puck = Shape::Disc { radius: 0.05 };
        let motion = found_under("ax = 0.25", &[vec![(puck, 0.3, [-1.0, -0.31], [-0.12, -1.77])]]);
        let found: Vec<_> = motion.found.iter().map(|c| c.entry.spec.name).collect();
        assert!(matches!(found[..], ["tilt" | "uniform_force"]), "{found:?}");
        let rivals = motion.alike;
        assert!(
            rivals.contains(&"tilt".to_string()) && rivals.contains(&"uniform_force".to_string()),
            "{rivals:?}"
        );
    }

    /// A whirl about a centre far away is both at once, but for one number more.
    #[test]
    fn a_drag_and_a_wind_are_no_whirl() {
        let puck = Shape::Disc { radius: 0.1 };
        let three = |[a, b, c]: [([f64; 2], [f64; 2]); 3]| {
            vec![(puck, 0.5, a.0, a.1), (puck, 1.0, b.0, b.1), (puck, 2.0, c.0, c.1)]
        };
        let launches = [
            three([
                ([-1.07, -0.03], [1.84, 0.06]),
                ([0.54, -1.03], [-1.15, 0.64]),
                ([-0.58, 1.02], [0.07, -1.06]),
            ]),
            three([
                ([-0.45, 0.72], [1.16, -1.12]),
                ([0.44, -1.14], [0.33, 1.49]),
                ([-0.65, 1.21], [0.66, -0.98]),
            ]),
            three([
                ([0.16, -0.90], [0.16, 1.09]),
                ([-0.75, 1.16], [0.62, -1.0]),
                ([-1.33, 1.24], [0.69, -1.83]),
            ]),
            three([
                ([-1.27, 0.68], [1.01, -1.11]),
                ([-0.28, -0.73], [0.17, 0.96]),
                ([1.14, -0.23], [-1.28, -0.07]),
            ]),
        ];
        let law = "fx = 0.6 - 0.6*vx; fy = -0.4 - 0.6*vy";
        let motion = found_under(law, &launches);
        let mut found: Vec<_> = motion.found.iter().map(|c| c.entry.spec.name).collect();
        found.sort_unstable();
        assert_eq!(found, ["linear_drag", "uniform_force"]);
    }

    /// Without the whirl, friction and where it acts bend as far as they can, and from there a wrong law is near.
    #[test]
    fn a_whirl_on_an_air_table_is_found_though_friction_bends_to_stand_in_for_it() {
        let launches = [
            vec![
                (BALL, 1.2, [1.1, -0.5], [-0.3, 0.3]),
                (DISC, 0.9, [-0.8, 0.3], [0.4, -0.2]),
                (CUBE, 0.9, [1.3, 1.9], [-0.6, -0.8]),
                (DISC, 1.2, [1.3, -1.6], [-0.5, 0.8]),
            ],
            vec![
                (BALL, 1.2, [1.2, 0.5], [-0.8, -0.6]),
                (DISC, 0.8, [-1.7, 0.3], [0.6, -0.1]),
                (CUBE, 1.5, [2.0, -1.8], [-0.4, 0.3]),
                (DISC, 1.9, [-1.4, 0.4], [1.4, 0.1]),
            ],
            vec![
                (BALL, 1.1, [1.9, -1.4], [-0.5, 0.3]),
                (DISC, 1.5, [-0.4, -0.9], [0.7, 0.6]),
                (CUBE, 0.9, [1.3, -0.5], [-1.1, 0.0]),
                (DISC, 1.2, [1.8, 1.2], [-0.6, -0.6]),
            ],
        ];
        let whirl = [0.17, 0.6, 0.65, 0.09];
        let scenes = film_under(&launches, |model| {
            let parameters = model.effects.iter_mut().flat_map(|e| &mut e.parameters);
            for p in parameters.filter(|p| ["sliding", "mu_roll"].contains(&&p.name[..])) {
                p.values.fill(0.002);
            }
            let mut active = ActiveEffect::new(&effect("vortex").expect("vortex").spec, &model.bodies);
            active.parameters.iter_mut().zip(whirl).for_each(|(p, v)| p.values.fill(v));
            model.effects.push(active);
        });
        let models: Vec<Model> = scenes.iter().map(|s| Preset::for_world(s.world).model(s)).collect();
        let motion =
            search(&WeakFormRegression::new(&scenes), &with_nuisance(&models), &never).expect("never stops");
        let found: Vec<_> = motion.found.iter().map(|c| (c.entry.spec.name, c.values.clone())).collect();
        let [("vortex", values)] = &found[..] else { panic!("{found:?}") };
        assert!((values[1] - whirl[1]).abs() < 0.05 && motion.reduced_chi_square() < 1.1, "{values:?}");
    }
}

//! Candidates through the force lens: which law of the library would explain the free motion, and how well.

use super::checkpoints::effect_by_name;
use super::free::{FreeParameter, at_values, flats, free_parameters, stride, values_of};
use super::search::PROOF;
use super::weak_form::{LensFit, PROOFS, Projector, WeakFormRegression};
use crate::effects::{ActsOn, EFFECTS, EffectEntry, Hook, ParamId, Region, Role, Seed, effect};
use crate::num::{Vec2, elementary, quantile, vec2};
use crate::scene::Scene;
use crate::world::{ActiveEffect, Model, Prior};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Seeds along each coordinate of a place: half a metre apart on a field of four, as a source that is soft within 0.3 m is
/// felt.
const PLACES: usize = 8;
/// Seeds that are refined, and seeds of a law that has a place that climb before: what a source does near it no slope
/// afar tells.
const REFINED: usize = 3;
const PLACED: usize = 8;
/// Halvings of the climb's steps; the first is half of the distance between seeds.
const CLIMBS: i32 = 4;
/// Sweeps with one step.
const SWEEPS: usize = 4;
/// Gains closer than this share are one peak.
const SAME_PEAK: f64 = 1e-3;
/// Amplitude at which a candidate's columns are taken (its own unit): small beside any that is seen.
const PROBE: f64 = 1e-3;
/// Prior deviation of an amplitude and of a parameter without bounds (its own unit): wide.
const WIDE: f64 = 10.0;
/// An amplitude is a constant of nature up to this share: that well a scale of lengths is known.
const SAME_CONSTANT: f64 = 0.02;
/// An amplitude differs from zero by this many deviations.
pub const CERTAIN: f64 = 4.0;
const REFINEMENTS: usize = 15;
/// Deviations that a normal number falls short of its mean by in one of twenty draws.
const ONE_OF_TWENTY: f64 = 1.644_853_627;

/// One candidate as the force lens sees it.
#[derive(Clone, Serialize, Deserialize)]
pub struct ForceCandidate {
    #[serde(with = "effect_by_name")]
    pub entry: &'static EffectEntry,
    /// Parameters in the order of the spec.
    pub values: Vec<f64>,
    pub sd: Vec<f64>,
    /// How many parameters it adds, and how many of them, the first, are amplitudes: each object may have its own.
    pub added: usize,
    pub amplitudes: usize,
    /// Fall of the lens's cost against the model without it.
    pub gain: f64,
    /// Fall of the cost on what was left out, summed: the law's numbers are of the other parts, all else suits the part.
    pub held_out: f64,
    /// Chi-square of what was left out, summed.
    pub left_out: f64,
    /// Fall of chi-square on all tracks but the one that gains most.
    pub gain_without_best_track: f64,
    pub chi_square: f64,
    /// The models with the candidate at these values, shared parameters refitted.
    pub models: Vec<Model>,
}

/// The models with what an engine or an uneven foot does beside physics, so that no law is found in it: the
/// friction of each sliding body may be a little askew (found in Bullet's boxes and cylinders).
pub fn with_nuisance(models: &[Model]) -> Vec<Model> {
    let one = |model: &Model| {
        let mut model = model.clone();
        for entry in EFFECTS.iter().filter(|e| !e.profile.nuisance_priors.is_empty()) {
            if model.effect(entry.spec.name).is_some() {
                continue;
            }
            let mut active = ActiveEffect::new(&entry.spec, &model.bodies);
            for (name, sd) in entry.profile.nuisance_priors {
                let own = active.parameters.iter_mut().filter(|p| p.name == *name);
                own.for_each(|p| p.prior.sd = *sd);
            }
            model.effects.push(active);
        }
        model
    };
    models.iter().map(one).collect()
}

impl ForceCandidate {
    /// Whether an amplitude differs from zero beyond doubt.
    pub fn certain(&self) -> bool {
        certain(&self.values, &self.sd, self.amplitudes)
    }

    /// The place that it has, if it has one (m).
    pub fn place(&self) -> Option<Vec2> {
        let coordinate = |seed: Seed| -> Option<f64> {
            let (name, _) = self.entry.seeds.iter().find(|(_, s)| *s == seed)?;
            let at = self.entry.spec.params.iter().position(|p| p.name == *name)?;
            self.values.get(at).copied()
        };
        Some(vec2(coordinate(Seed::PlaceX)?, coordinate(Seed::PlaceY)?))
    }
}

/// Whether one of the first `amplitudes` values differs from zero beyond doubt.
pub fn certain(values: &[f64], sd: &[f64], amplitudes: usize) -> bool {
    values.iter().zip(sd).take(amplitudes).any(|(a, sd)| a.abs() > CERTAIN * sd)
}

/// Effects that the models lack.
pub fn candidates(models: &[Model], scenes: &[Scene]) -> Vec<&'static EffectEntry> {
    let active =
        |name: &str| models.iter().any(|m| m.effect(name).is_some_and(|e| e.on && !is_nearly_absent(e)));
    let covered =
        |name: &str| EFFECTS.iter().any(|by| by.profile.covers.contains(&name) && active(by.spec.name));
    let several = scenes.iter().any(|s| s.objects.len() > 1);
    let open = |e: &&EffectEntry| {
        let name = e.spec.name;
        let alone = !several && (e.uses(Hook::Pair) || e.uses(Hook::Contact));
        let no_wall = e.profile.acts_on == ActsOn::TableWalls && models.iter().all(|m| m.walls.is_empty());
        !no_wall && e.is_candidate() && !active(name) && !covered(name) && !alone
    };
    EFFECTS.iter().filter(open).collect()
}

/// Whether a model expects a law to be absent, up to what is usual (a table that is not quite level): a search may then find
/// much of it.
fn is_nearly_absent(active: &ActiveEffect) -> bool {
    let Some(entry) = effect(&active.name).filter(|e| e.profile.role == Role::Law) else { return false };
    active
        .parameters
        .iter()
        .take(entry.amplitudes)
        .all(|p| p.means.iter().all(|mean| *mean == 0.0) && p.prior.sd > 0.0 && p.prior.sd < WIDE)
}

/// The box that all tracks lie in, and how long the films are.
pub fn region(scenes: &[Scene]) -> Region {
    let mut region = Region {
        low: vec2(f64::INFINITY, f64::INFINITY),
        high: vec2(f64::NEG_INFINITY, f64::NEG_INFINITY),
        duration: 0.0,
        places: PLACES,
    };
    for scene in scenes {
        for p in scene.tracks.iter().flat_map(|t| &t.samples).map(|s| s.position) {
            region.low = vec2(region.low.x.min(p.x), region.low.y.min(p.y));
            region.high = vec2(region.high.x.max(p.x), region.high.y.max(p.y));
        }
        let film = scene.times.last().zip(scene.times.first()).map_or(0.0, |(b, a)| b - a);
        region.duration = region.duration.max(film);
    }
    region
}

/// The models with one more effect, its parameters free; what they expected of it does not count.
pub fn with_effect(models: &[Model], entry: &EffectEntry, values: &[f64], region: &Region) -> Vec<Model> {
    let size = (region.high - region.low).norm().max(0.1);
    let one = |model: &Model| {
        let mut model = model.clone();
        model.effects.retain(|e| e.name != entry.spec.name);
        let mut active = ActiveEffect::new(&entry.spec, &model.bodies);
        for (k, (parameter, value)) in active.parameters.iter_mut().zip(values).enumerate() {
            let amplitude = k < entry.amplitudes;
            let metres = entry.spec.params[k].unit == "m";
            let sd = if !amplitude && metres { size } else { WIDE };
            parameter.prior = Prior { mean: if amplitude { 0.0 } else { *value }, sd };
            parameter.values.iter_mut().for_each(|v| *v = *value);
            parameter.means.iter_mut().for_each(|m| *m = parameter.prior.mean);
        }
        model.effects.push(active);
        model
    };
    models.iter().map(one).collect()
}

/// The models' free parameters as all parts see them, and as each part that can be left out sees them alone.
pub struct ScreenBase {
    pub free: Vec<FreeParameter>,
    pub seen: LensFit,
    alone: Vec<LensFit>,
    pub fitted: LinearisationPoint,
}

impl ScreenBase {
    pub fn new(lens: &WeakFormRegression, models: &[Model], free: Vec<FreeParameter>, seen: LensFit) -> Self {
        let one = |fold| lens.solve(models, &free, &seen.values, PROOFS, &lens.rest(fold));
        let alone = lens.folds.iter().map(|fold| one(fold)).collect();
        let fitted = LinearisationPoint::new(lens, models, &free, &seen, true);
        ScreenBase { free, seen, alone, fitted }
    }

    /// Where the numbers are what was believed of them: numbers that stand in for a law that is missing bend far, and a
    /// search for the law need not find the way back.
    pub fn believed(&self, lens: &WeakFormRegression) -> LinearisationPoint {
        let means: Vec<f64> = self.free.iter().map(|f| f.mean).collect();
        let seen = lens.solve(&self.fitted.models, &self.free, &means, 0, &[]);
        LinearisationPoint::new(lens, &self.fitted.models, &self.free, &seen, false)
    }
}

/// Where the numbers of models stand while a law is sought beside them.
pub struct LinearisationPoint {
    pub models: Vec<Model>,
    cost: f64,
    /// What projects the numbers out of a law's columns.
    projector: Option<Projector>,
    /// Whether they are the best without the law.
    best: bool,
}

impl LinearisationPoint {
    pub fn new(
        lens: &WeakFormRegression,
        models: &[Model],
        free: &[FreeParameter],
        seen: &LensFit,
        best: bool,
    ) -> Self {
        let models = at_values(models, free, &seen.values);
        let projector = lens.projector(&models, free, &seen.values);
        LinearisationPoint { models, cost: seen.cost, projector, best }
    }
}

/// Numbers of a law to begin with, and by how much it lowers the cost there if it is linear.
pub struct ScreenSeed {
    pub gain: f64,
    values: Vec<f64>,
}

/// Where one effect beside the models' free parameters may best begin; best first. `None` where the lens is blind to it.
pub fn beginnings(
    lens: &WeakFormRegression,
    stand: &LinearisationPoint,
    entry: &'static EffectEntry,
    region: &Region,
) -> Option<Vec<ScreenSeed>> {
    if !entry.shows_in_free_motion() {
        return None;
    }
    let projector = stand.projector.as_ref()?;
    // The best amplitudes at other numbers, by linear algebra alone.
    let at = |seed: &[f64]| -> Option<ScreenSeed> {
        if lens.is_stopped() {
            return None;
        }
        let columns = columns(lens, stand, projector, entry, seed, region);
        let inside = |(_, amplitudes): &(f64, DVector<f64>)| {
            amplitudes.iter().zip(entry.spec.params).all(|(a, p)| (p.min..=p.max).contains(a))
        };
        // Where a bound holds the base back, what the law would free it to do counts too.
        let freed = || {
            let (cost, amplitudes) = lens.joint(projector, stand.cost, &columns)?;
            Some((stand.cost - cost, amplitudes))
        };
        let held = || lens.gain(projector, &columns).filter(|_| stand.best).filter(inside);
        let (gain, amplitudes) = held().or_else(|| freed().filter(inside))?;
        let mut values = seed.to_vec();
        values[..entry.amplitudes].copy_from_slice(amplitudes.as_slice());
        Some(ScreenSeed { gain, values })
    };
    let mut tried: Vec<ScreenSeed> = entry.seeds(region).iter().filter_map(|seed| at(seed)).collect();
    tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    if entry.seeds.iter().any(|(_, s)| *s == Seed::PlaceX) {
        tried.truncate(PLACED);
        for best in &mut tried {
            climb(entry, region, best, &at);
        }
        tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        tried.dedup_by(|a, b| (a.gain - b.gain).abs() < SAME_PEAK * b.gain);
    }
    (!tried.is_empty()).then_some(tried)
}

/// What a small amplitude of each kind that the law has changes in the residual, its other numbers at `seed`.
fn columns(
    lens: &WeakFormRegression,
    stand: &LinearisationPoint,
    projector: &Projector,
    entry: &'static EffectEntry,
    seed: &[f64],
    region: &Region,
) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(projector.residual.len(), entry.amplitudes);
    let mut probe = seed.to_vec();
    probe[..entry.amplitudes].fill(0.0);
    let residual = |probe: &[f64]| {
        let probed = with_effect(&stand.models, entry, probe, region);
        let flats: Vec<Vec<f64>> = probed.iter().map(Model::flatten).collect();
        lens.residual(&probed, &flats)
    };
    let is_lacking = stand.models.iter().all(|m| m.effect(entry.spec.name).is_none());
    let absent = (!is_lacking).then(|| residual(&probe));
    let absent = absent.as_ref().unwrap_or(&projector.residual);
    for k in 0..entry.amplitudes {
        probe[k] = PROBE;
        columns.set_column(k, &((residual(&probe) - absent) / PROBE));
        probe[k] = 0.0;
    }
    columns
}

/// Smallest amplitude of a law, the less certain where it has two, that falls of the cost by `proof` in all and by `elsewhere`
/// without the track that shows it most prove, at a place, a frequency and the like of medium sensitivity. Noise hides one of
/// twenty of these: a fall at an amplitude a of deviation s is that of a normal number of mean a/s. `None` where the lens is blind.
pub fn detectable(
    lens: &WeakFormRegression,
    stand: &LinearisationPoint,
    entry: &'static EffectEntry,
    region: &Region,
    [proof, elsewhere]: [f64; 2],
) -> Option<f64> {
    let projector = stand.projector.as_ref()?;
    let least = |seed: &Vec<f64>| -> f64 {
        if lens.is_stopped() {
            return f64::INFINITY;
        }
        let columns = columns(lens, stand, projector, entry, seed, region);
        let information = lens.information(projector, &columns).0;
        let shares: Vec<f64> = (0..columns.ncols())
            .map(|k| 1.0 - lens.largest_track_share(projector, &columns, k) / information[(k, k)])
            .collect();
        let Some(covariance) = information.cholesky().map(|c| c.inverse()) else { return f64::INFINITY };
        let amplitude = |(k, share): (usize, &f64)| {
            let of =
                |fall: f64, share: f64| (fall.sqrt() + ONE_OF_TWENTY) * (covariance[(k, k)] / share).sqrt();
            of(proof, 1.0).max(of(elsewhere, share.max(f64::MIN_POSITIVE)))
        };
        shares.iter().enumerate().map(amplitude).fold(0.0, f64::max)
    };
    let mut all: Vec<f64> = entry.seeds(region).par_iter().map(least).collect();
    quantile(&mut all, 0.5).filter(|least| least.is_finite())
}

/// The best that the effect can do from these beginnings, beside numbers that stand as there.
pub fn screen(
    lens: &WeakFormRegression,
    base: &ScreenBase,
    stand: &LinearisationPoint,
    entry: &'static EffectEntry,
    tried: &[ScreenSeed],
    region: &Region,
) -> Option<ForceCandidate> {
    if lens.is_stopped() {
        return None;
    }
    let ScreenBase { seen, alone, .. } = base;
    let projector = base.fitted.projector.as_ref()?;
    let refined = tried.iter().take(REFINED).map(|b| refine(lens, &stand.models, entry, &b.values, region));
    let (free_with, seen_with, with) = refined.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))?;
    let added: Vec<usize> = (0..free_with.len()).filter(|&k| of(&free_with[k], entry)).collect();
    let amplitude =
        |f: &FreeParameter| entry.spec.params[..entry.amplitudes].iter().any(|p| f.is(entry, p.name));
    // The law's numbers must hold where they were not found. What a part alone knows (the friction of a material that
    // no other part shows) is no matter of the law.
    let others_own: Vec<FreeParameter> = free_with.iter().filter(|f| !of(f, entry)).cloned().collect();
    let (mut held_out, mut left_out) = (0.0, 0.0);
    for (fold, alone) in lens.folds.iter().zip(alone) {
        let mut others = lens.solve(&with, &free_with, &seen_with.values, PROOFS, fold);
        // What the others do not tell of an object is not there.
        for &k in added.iter().filter(|_| entry.of_objects()) {
            if others.values[k].abs() < CERTAIN * others.sd[k] {
                others.values[k] = free_with[k].mean;
            }
        }
        let law = at_values(&with, &free_with, &others.values);
        let here = lens.solve(&law, &others_own, &values_of(&law, &others_own), PROOFS, &lens.rest(fold));
        held_out += alone.cost - here.cost;
        left_out += here.chi_square - here.left_out;
    }
    let gain = seen.cost - seen_with.cost;
    let law = LawOnTracks { entry, free: &free_with, seen: &seen_with, with: &with };
    let gain_without_best_track = match gain > PROOF {
        true => law.refitted_gain_without_best(lens, base, projector),
        false => law.gain_without_best(lens, base, projector),
    };
    let values: Vec<f64> = added.iter().map(|&k| seen_with.values[k]).collect();
    Some(ForceCandidate {
        entry,
        sd: added.iter().map(|&k| seen_with.sd[k]).collect(),
        added: added.len(),
        amplitudes: added.iter().filter(|&&k| amplitude(&free_with[k])).count(),
        gain: gain + constant_of_nature(entry, &values),
        values,
        held_out,
        left_out,
        gain_without_best_track,
        chi_square: seen_with.chi_square,
        models: at_values(&with, &free_with, &seen_with.values),
    })
}

/// A law fitted beside the base, as each track shows it.
struct LawOnTracks<'c> {
    entry: &'static EffectEntry,
    free: &'c [FreeParameter],
    seen: &'c LensFit,
    with: &'c [Model],
}

impl LawOnTracks<'_> {
    /// Fall of chi-square of each track.
    fn falls(&self, lens: &WeakFormRegression, projector: &Projector) -> Vec<f64> {
        let after = lens.residual(self.with, &flats(self.with, self.free, &self.seen.values));
        let pairs = lens.by_track(&projector.residual).into_iter().zip(lens.by_track(&after));
        pairs.map(|(before, after)| before.0 - after.0).collect()
    }

    /// Fall of chi-square on all tracks but the one that gains most, all numbers as they are.
    fn gain_without_best(&self, lens: &WeakFormRegression, base: &ScreenBase, projector: &Projector) -> f64 {
        let falls = self.falls(lens, projector);
        let most = falls.iter().copied().fold(0.0, f64::max);
        // What the model expected of the law itself, where all tracks bend it.
        let expected = base.free.iter().zip(&base.seen.values).filter(|(f, _)| of(f, self.entry));
        let unbent: f64 = expected.map(|(f, value)| elementary::powi((value - f.mean) / f.sd, 2)).sum();
        falls.iter().sum::<f64>() - most + unbent
    }

    /// Fall of the cost without the track that gains most: the law's numbers are of all tracks, all others are refitted on both
    /// sides. Numbers of the base that bend to stand in for the law pay in their priors, on each track: that is evidence, too.
    fn refitted_gain_without_best(
        &self,
        lens: &WeakFormRegression,
        base: &ScreenBase,
        projector: &Projector,
    ) -> f64 {
        let falls = self.falls(lens, projector);
        let Some(best) = (0..falls.len()).max_by(|&a, &b| falls[a].total_cmp(&falls[b])) else { return 0.0 };
        let rows = &lens.rows_by_track()[best];
        let before = lens.solve(&base.fitted.models, &base.free, &base.seen.values, PROOFS, rows);
        let law = at_values(self.with, self.free, &self.seen.values);
        let others: Vec<FreeParameter> = self.free.iter().filter(|f| !of(f, self.entry)).cloned().collect();
        let after = lens.solve(&law, &others, &values_of(&law, &others), PROOFS, rows);
        before.cost - after.cost
    }
}

/// What an amplitude that nature gives is worth against one that is anything (twice a log likelihood): free fall in a
/// vertical plane is a slope, and no wind that happens to be as strong.
pub fn constant_of_nature(entry: &EffectEntry, values: &[f64]) -> f64 {
    let Some(constant) = entry.profile.constant_of_nature else { return 0.0 };
    let amplitudes = values.iter().take(entry.amplitudes);
    let size = amplitudes.map(|a| a * a).sum::<f64>().sqrt();
    let width = SAME_CONSTANT * constant;
    if (size - constant).abs() < width { 2.0 * elementary::ln(WIDE / width) } else { 0.0 }
}

/// Looks for the same effect from what was believed, and keeps the better.
pub fn rescreen_from_prior(
    lens: &WeakFormRegression,
    base: &ScreenBase,
    believed: &LinearisationPoint,
    region: &Region,
    known: &mut ForceCandidate,
) {
    let begun = beginnings(lens, believed, known.entry, region);
    let found = begun.and_then(|tried| screen(lens, base, believed, known.entry, &tried, region));
    if let Some(found) = found.filter(|f| f.gain > known.gain) {
        *known = found;
    }
}

/// Moves the seeded numbers one at a time to where the gain is larger, by smaller and smaller steps.
fn climb(
    entry: &EffectEntry,
    region: &Region,
    best: &mut ScreenSeed,
    at: &impl Fn(&[f64]) -> Option<ScreenSeed>,
) {
    let spacing = (region.high - region.low).scaled(1.0 / region.places.max(1) as f64);
    let (mut level, mut sweeps, mut before) = (1, 0, best.gain);
    while level <= CLIMBS {
        let share = elementary::powi(0.5f64, level);
        for (k, p) in entry.spec.params.iter().enumerate() {
            let Some((_, seed)) = entry.seeds.iter().find(|(name, _)| *name == p.name) else { continue };
            for side in [-1.0, 1.0] {
                let mut moved = best.values.clone();
                moved[k] = match seed {
                    Seed::PlaceX => moved[k] + side * share * spacing.x,
                    Seed::PlaceY => moved[k] + side * share * spacing.y,
                    _ => moved[k] * elementary::powf(1.0 + share, side),
                }
                .clamp(p.min, p.max);
                if let Some(better) = at(&moved).filter(|b| b.gain > best.gain) {
                    *best = better;
                }
            }
        }
        sweeps += 1;
        if best.gain <= before * (1.0 + SAME_PEAK) || sweeps == SWEEPS {
            (level, sweeps) = (level + 1, 0);
        }
        before = best.gain;
    }
}

fn of(free: &FreeParameter, entry: &EffectEntry) -> bool {
    ParamId::parse(&free.name).is_some_and(|id| id.effect == entry.spec.name)
}

fn refine(
    lens: &WeakFormRegression,
    models: &[Model],
    entry: &EffectEntry,
    values: &[f64],
    region: &Region,
) -> (Vec<FreeParameter>, LensFit, Vec<Model>) {
    let with = with_effect(models, entry, values, region);
    let mut wide = free_parameters(lens.scenes, &with);
    stride(&mut wide, entry);
    let start = values_of(&with, &wide);
    let near = lens.solve(&with, &wide, &start, REFINEMENTS, &[]);
    let free = free_parameters(lens.scenes, &with);
    let seen = lens.solve(&with, &free, &near.values, REFINEMENTS, &[]);
    let seen = if seen.cost <= near.cost { LensFit { sd: near.sd, ..seen } } else { near };
    (free, seen, with)
}

#[cfg(test)]
mod tests {
    use super::super::search::ELSEWHERE;
    use super::super::tests::{DISC, film_under};
    use super::super::weak_form::fit_forces;
    use super::*;
    use crate::world::Preset;

    /// On an air table each puck has a damping of its own, which stands in for a drag of all: what it pays for that in its prior is
    /// evidence for the drag on each track.
    #[test]
    fn numbers_of_each_object_that_stand_in_for_a_law_are_evidence_of_each_track() {
        let three = |[a, b, c]: [([f64; 2], [f64; 2]); 3]| {
            [a, b, c].map(|(place, velocity)| (DISC, 0.5, place, velocity)).to_vec()
        };
        let launches = [
            three([([-2.0, 1.0], [1.9, 0.2]), ([2.0, -1.0], [-1.4, -0.3]), ([0.0, 3.0], [0.4, 1.2])]),
            three([([-2.0, -1.0], [1.2, 0.4]), ([2.0, 1.0], [-1.7, 0.5]), ([0.0, -3.0], [0.3, -1.5])]),
        ];
        let scenes = film_under(&launches, |model| {
            let ground = model.effects.iter_mut().flat_map(|e| &mut e.parameters);
            ground.filter(|p| p.name == "sliding").for_each(|p| p.values.fill(0.0));
            for (name, value) in [("damping", 0.03), ("quadratic_drag", 0.025)] {
                let mut active = ActiveEffect::new(&effect(name).expect(name).spec, &model.bodies);
                active.parameters[0].values.fill(value);
                model.effects.push(active);
            }
        });
        let air_table = Preset::named("air_table").expect("it is there");
        let models: Vec<Model> = scenes.iter().map(|s| air_table.model(s)).collect();
        let lens = WeakFormRegression::new(&scenes);
        let (free, seen) = fit_forces(&lens, &models);
        let base = ScreenBase::new(&lens, &models, free, seen);
        let entry = effect("quadratic_drag").expect("it is there");
        let (free, seen, with) = refine(&lens, &base.fitted.models, entry, &[0.02], &region(&scenes));
        let law = LawOnTracks { entry, free: &free, seen: &seen, with: &with };
        let projector = base.fitted.projector.as_ref().expect("it is determined");
        let [as_they_are, refitted] = [
            law.gain_without_best(&lens, &base, projector),
            law.refitted_gain_without_best(&lens, &base, projector),
        ];
        assert!(refitted > ELSEWHERE && refitted > as_they_are + ELSEWHERE, "{as_they_are} {refitted}");
    }
}

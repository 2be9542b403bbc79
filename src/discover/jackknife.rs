//! How far videos, or short films, disagree on the numbers of a law: each is left out in turn, whatever the noise is
//! (Tukey's jackknife; Efron and Stein, Ann. Statist. 9 (1981) 586).

use super::contact_law::{estimates_of, pooled};
use super::proof;
use super::revise::Revision;
use super::weak_form::WeakFormRegression;
use crate::effects::EffectEntry;
use crate::fit::{Fit, FitError, FitOptions, StartPoint, estimate, estimate_each, fit_jointly};
use crate::num::{Stop, elementary};
use crate::scene::Scene;
use crate::world::Model;
use rayon::prelude::*;

/// Most iterations of a fit without one of the videos, which begins where all of them ended.
const ITERATIONS: usize = 30;

/// One number of a law as several videos have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedEstimate {
    pub value: f64,
    /// Deviation by the noise.
    pub sd: f64,
    /// Deviation by how far the videos disagree.
    pub scatter: f64,
}

/// A law's parameters by their names.
pub struct LawParameters<'n> {
    pub law: &'n str,
    pub names: Vec<&'n str>,
}

pub fn numbers_of(entry: &'static EffectEntry) -> LawParameters<'static> {
    LawParameters { law: entry.spec.name, names: entry.spec.params.iter().map(|p| p.name).collect() }
}

/// The numbers of a law, one for each of its parameters that is identified, as the videos have them that a revision follows;
/// `None` where it follows one of several, or none.
pub fn of_videos(
    lens: &WeakFormRegression,
    revision: &Revision,
    numbers: &LawParameters,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Vec<Option<SharedEstimate>>>, FitError> {
    let all = &revision.fit.scenes;
    let followed: Vec<usize> = (0..all.len()).filter(|&k| !proof::lost(&all[k])).collect();
    if followed.len() < all.len().min(2) {
        return Ok(None);
    }
    let most = options.max_iterations.min(ITERATIONS);
    let near = FitOptions { start_point: StartPoint::NearOptimum, max_iterations: most, ..*options };
    let (scenes, fit) = &in_common(lens, revision, &followed, &near, stop)?;
    let known: Vec<Option<(f64, f64)>> =
        numbers.names.iter().map(|name| number(fit, numbers.law, name)).collect();
    let values: Vec<f64> = known.iter().map(|e| e.map_or(0.0, |e| e.0)).collect();
    let each: Vec<usize> = if scenes.len() > 1 { (0..scenes.len()).collect() } else { vec![] };
    let scatter = scatter(scenes, fit, numbers, &values, &each, &near, stop)?;
    let shared =
        |(e, scatter): (Option<(f64, f64)>, f64)| e.map(|(value, sd)| SharedEstimate { value, sd, scatter });
    Ok(Some(known.into_iter().zip(scatter).map(shared).collect()))
}

/// Those of the scenes that common numbers follow, and their fit.
fn in_common(
    lens: &WeakFormRegression,
    revision: &Revision,
    which: &[usize],
    near: &FitOptions,
    stop: Stop,
) -> Result<(Vec<Scene>, Fit), FitError> {
    let all = &revision.fit.scenes;
    let (scenes, models): (Vec<Scene>, Vec<Model>) =
        which.iter().map(|&k| (lens.scenes[k].clone(), all[k].model.clone())).unzip();
    if which.len() == all.len() && revision.unpooled.is_empty() {
        return Ok((scenes, revision.fit.clone()));
    }
    // From a mean of what they have no search of all of them finds back.
    let alone = estimate_each(&scenes, &models, near, stop)?;
    let fit = fit_jointly(&scenes, &models, &alone, near, stop)?;
    // One that common numbers lose has found another way to move as it did.
    let kept = which.iter().zip(&fit.scenes).filter(|(_, s)| !proof::lost(s));
    let kept: Vec<usize> = kept.map(|(k, _)| *k).collect();
    match kept.len() < 2 || kept.len() == which.len() {
        true => Ok((scenes, fit)),
        false => in_common(lens, revision, &kept, near, stop),
    }
}

/// Value and deviation of a parameter that the data identify.
fn number(fit: &Fit, effect: &str, parameter: &str) -> Option<(f64, f64)> {
    let of = estimates_of(fit, effect, parameter);
    pooled(&of).filter(|_| of.iter().any(|e| e.identified))
}

/// Deviations of a law's parameters by how much the scenes that tell of it disagree. One without which nothing tells of a
/// number cannot disagree with the others.
pub fn scatter(
    scenes: &[Scene],
    with: &Fit,
    numbers: &LawParameters,
    values: &[f64],
    told: &[usize],
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<f64>, FitError> {
    let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let one = |&left_out: &usize| -> Result<Vec<f64>, FitError> {
        let kept: Vec<usize> = (0..scenes.len()).filter(|&k| k != left_out).collect();
        let some: Vec<Scene> = kept.iter().map(|&k| scenes[k].clone()).collect();
        let models: Vec<Model> = kept.iter().map(|&k| with.scenes[k].model.clone()).collect();
        let found = estimate(&some, &models, &near, stop)?;
        let one = |(name, value): (&&str, &f64)| number(&found, numbers.law, name).map_or(*value, |e| e.0);
        Ok(numbers.names.iter().zip(values).map(one).collect())
    };
    let all: Result<Vec<Vec<f64>>, FitError> = told.par_iter().map(one).collect();
    let (all, n) = (all?, told.len().max(1) as f64);
    let deviation = |k: usize| {
        let mean = all.iter().map(|v| v[k]).sum::<f64>() / n;
        ((n - 1.0) / n * all.iter().map(|v| elementary::powi(v[k] - mean, 2)).sum::<f64>()).sqrt()
    };
    Ok((0..values.len()).map(deviation).collect())
}

#[cfg(test)]
mod tests {
    use super::super::contact_law::with_contact;
    use super::super::revise::revise;
    use super::super::screen::{region, with_nuisance};
    use super::super::tests::{DISC, film, models};
    use super::super::verdict::DiscoverOptions;
    use super::*;
    use crate::effects::effect;
    use crate::num::never;

    /// The fit's own deviation is that of the noise alone.
    #[test]
    fn videos_that_disagree_widen_the_deviation() {
        const FADING: &str = "speed_dependent_restitution";
        let entry = effect(FADING).expect("it is in the library");
        let meeting =
            |speed: f64| vec![(DISC, 0.6, [-1.0, 0.0], [speed, 0.0]), (DISC, 0.6, [0.0, 0.03], [0.0, 0.0])];
        let shared = |of_last: f64| {
            let with = |v0: f64, speeds: &[f64]| {
                let launches: Vec<_> = speeds.iter().map(|s| meeting(*s)).collect();
                film(&launches, Some((FADING, &[("inverse_v0", v0)])))
            };
            let scenes = [with(0.2, &[0.8, 1.2, 1.6]), with(of_last, &[1.0, 1.4])].concat();
            let (lens, region) = (WeakFormRegression::new(&scenes), region(&scenes));
            let with = with_contact(&with_nuisance(&models(&scenes)), entry, &[0.1], None, &region);
            let options = DiscoverOptions::default().fit;
            let revision = revise(&lens, &with, Some(FADING), &options, &never).expect("it can be fitted");
            let found =
                of_videos(&lens, &revision, &numbers_of(entry), &options, &never).expect("nobody stops it");
            found.expect("they are followed")[0].expect("it is identified")
        };
        let (alike, unlike) = (shared(0.2), shared(0.3));
        assert!(alike.scatter < 3.0 * alike.sd, "{alike:?}");
        assert!((alike.value - 0.2).abs() < 3.0 * alike.sd.max(alike.scatter), "{alike:?}");
        assert!(unlike.scatter > 3.0 * unlike.sd, "{unlike:?}");
    }
}

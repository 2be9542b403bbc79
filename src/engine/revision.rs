//! Revisions of the models of a set-up: each with its parent, what was changed, and the errors; kept with the models.

use super::study::Subject;
use super::{EngineError, StoredFit};
use crate::discover::{
    ChangeError, ChangeEvidence, DiscoverOptions, Discovery, FoundEffect, ModelChange, Origin,
    PredictionErrors, Revision, change, weigh,
};
use crate::effects::formula::FormulaError;
use crate::fit::{FitError, SceneFit, estimate_noise};
use crate::num::Stop;
use crate::scene::canonical_digest;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// How a revision came about, and what it is worth; the same for all its videos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Changes since the first.
    pub number: u32,
    pub videos: Vec<String>,
    /// Ids of its models, one a video.
    pub models: Vec<String>,
    /// Those of the revision that it came from; none for the first.
    pub parents: Vec<String>,
    pub added: Option<FoundEffect>,
    pub removed: Option<String>,
    /// Root mean square position residual on all frames (m).
    pub rmse: f64,
    pub unseen: PredictionErrors,
    pub reduced_chi_square: f64,
    /// Measurement noise of a position, all videos pooled (m).
    pub noise_sigma: f64,
    /// Against its parent.
    pub weight: Option<ChangeEvidence>,
    /// Why its videos cannot tell what it is worth, and what to film instead.
    #[serde(default)]
    pub too_little: Option<String>,
}

/// What a change that cannot be made is called in a request.
pub fn refused(change: &ModelChange, error: &ChangeError) -> EngineError {
    let path = match (error, change) {
        (
            ChangeError::Formula(
                FormulaError::Parameter { .. } | FormulaError::Unit { .. } | FormulaError::Count { .. },
            ),
            _,
        ) => "formula.parameters",
        (ChangeError::Formula(_), _) => "formula.text",
        (_, ModelChange::Write(..)) => "formula.name",
        _ => "effect",
    };
    EngineError::invalid(path, error.to_string())
}

/// The revision from which a change began and the one that it made, and the fits of those that are new.
pub fn changed(
    subject: &Subject,
    asked: &ModelChange,
    stop: Stop,
) -> Result<([Step; 2], Vec<StoredFit>), FitError> {
    let fits: Vec<&SceneFit> = subject.parents.iter().filter_map(|p| p.fit.scenes.first()).collect();
    let named = subject.videos.iter().zip(subject.parents.iter().map(|p| &p.id));
    let ours: BTreeSet<_> = named.collect();
    // A revision of more videos than these has other errors.
    let same = |s: &Step| s.videos.iter().zip(&s.models).collect::<BTreeSet<_>>() == ours;
    let known = subject.parents.first().and_then(|p| p.step.clone()).filter(same);
    let origin = match &known {
        Some(step) => Origin::Revision(&fits, step.unseen),
        None => Origin::Start(&subject.models),
    };
    // Those of a search, so that equal revisions are one.
    let options = DiscoverOptions::default().fit;
    let made = change(&subject.scenes, &origin, asked, &options, stop)?;
    let mut stored = vec![];
    let before = match (known, &made.before) {
        (Some(step), _) => step,
        (None, Some(first)) => {
            let (step, fits) = step(subject, first, None);
            stored.extend(fits);
            step
        }
        (None, None) => return Err(FitError::NoScene),
    };
    let (mut after, mut fits) = step(subject, &made.after, Some(&before));
    after.added = made.added;
    after.weight = Some(made.weight);
    after.too_little = made.too_little;
    if let ModelChange::Remove(name) = asked {
        after.removed = Some(name.clone());
    }
    fits.iter_mut().for_each(|f| f.step = Some(after.clone()));
    stored.extend(fits);
    Ok(([before, after], stored))
}

/// The revisions of a search, and their fits.
pub fn discovered(subject: &Subject, discovery: &Discovery) -> (Vec<Step>, Vec<StoredFit>) {
    let (mut steps, mut stored): (Vec<Step>, Vec<StoredFit>) = (vec![], vec![]);
    for (k, revision) in discovery.revisions.iter().enumerate() {
        let (mut next, mut fits) = step(subject, revision, steps.last());
        if let Some(before) = k.checked_sub(1).and_then(|k| discovery.revisions.get(k)) {
            let scenes: Vec<&SceneFit> = before.fit.scenes.iter().collect();
            next.weight = Some(weigh(&scenes, before.unseen(), revision));
            next.added = discovery.effects.get(k - 1).cloned();
        }
        fits.iter_mut().for_each(|f| f.step = Some(next.clone()));
        steps.push(next);
        stored.extend(fits);
    }
    (steps, stored)
}

/// A revision as it is kept, and the fit of each video.
fn step(subject: &Subject, revision: &Revision, parent: Option<&Step>) -> (Step, Vec<StoredFit>) {
    let Subject { videos, scenes, parents, .. } = subject;
    // The first revision of models that were fitted otherwise comes from those.
    let fitted = || parents.iter().map(|p| p.id.clone()).collect();
    let parents: Vec<String> = parent.map_or_else(fitted, |p| p.models.clone());
    let models: Vec<_> = revision.fit.scenes.iter().map(|s| &s.model).collect();
    let id = |video: &String| canonical_digest("revision", &(video, videos, &parents, &models));
    let ids: Vec<String> = videos.iter().map(id).collect();
    let squares: f64 = scenes.iter().map(|s| estimate_noise(s).position.powi(2)).sum();
    let step = Step {
        number: parent.map_or(0, |p| p.number + 1),
        videos: videos.clone(),
        models: ids.clone(),
        parents,
        added: None,
        removed: None,
        rmse: revision.rmse,
        unseen: revision.unseen(),
        reduced_chi_square: revision.reduced_chi_square,
        noise_sigma: (squares / scenes.len().max(1) as f64).sqrt(),
        weight: None,
        too_little: None,
    };
    let one = |(k, (video, id)): (usize, (&String, &String))| StoredFit {
        video: video.clone(),
        id: id.clone(),
        revision: step.number,
        fit: revision.fit.of_scene(k),
        step: Some(step.clone()),
    };
    let fits = videos.iter().zip(&ids).enumerate().map(one).collect();
    (step, fits)
}

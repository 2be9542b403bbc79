//! Revisions of the models of a set-up: each names its parent and its change, and is stored with its models.

use super::input::StudyInput;
use crate::discover::{
    ChangeError, DiscoverOptions, Discovery, ModelChange, Origin, Revision, change, weigh,
};
use crate::effects::formula::FormulaError;
use crate::engine::error::EngineError;
use crate::engine::results::{RevisionRecord, StoredFit, result_digest};
use crate::fit::{FitError, SceneFit, estimate_noise};
use crate::num::{Stop, elementary};
use std::collections::BTreeSet;

/// A change that cannot be made, with the path of the request's field.
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

/// The parent revision and the new one, and the fits of those that were not stored.
pub fn changed(
    input: &StudyInput,
    requested: &ModelChange,
    stop: Stop,
) -> Result<([RevisionRecord; 2], Vec<StoredFit>), FitError> {
    let fits: Vec<&SceneFit> = input.parents.iter().filter_map(|p| p.fit.scenes.first()).collect();
    let named = input.videos.iter().zip(input.parents.iter().map(|p| &p.id));
    let ours: BTreeSet<_> = named.collect();
    // The parent's record counts only if it is of exactly these videos: its errors are of all its videos.
    let same = |s: &RevisionRecord| s.videos.iter().zip(&s.models).collect::<BTreeSet<_>>() == ours;
    let known = input.parents.first().and_then(|p| p.record.clone()).filter(same);
    let origin = match &known {
        Some(record) => Origin::Revision(&fits, record.prediction_errors),
        None => Origin::Start(&input.models),
    };
    // The options of a discovery, so that the same change by both ways is the same revision.
    let options = DiscoverOptions::default().fit;
    let made = change(&input.scenes, &origin, requested, &options, stop)?;
    let mut stored = vec![];
    let before = match (known, &made.before) {
        (Some(record), _) => record,
        (None, Some(first)) => {
            let (record, fits) = record(input, first, None);
            stored.extend(fits);
            record
        }
        (None, None) => return Err(FitError::NoScene),
    };
    let (mut after, mut fits) = record(input, &made.after, Some(&before));
    after.added = made.added;
    after.evidence = Some(made.weight);
    after.not_identifiable_reason = made.too_little;
    if let ModelChange::Remove(name) = requested {
        after.removed = Some(name.clone());
    }
    fits.iter_mut().for_each(|f| f.record = Some(after.clone()));
    stored.extend(fits);
    Ok(([before, after], stored))
}

/// The revisions of a discovery, and their fits.
pub fn discovered(input: &StudyInput, discovery: &Discovery) -> (Vec<RevisionRecord>, Vec<StoredFit>) {
    let (mut records, mut stored): (Vec<RevisionRecord>, Vec<StoredFit>) = (vec![], vec![]);
    for (k, revision) in discovery.revisions.iter().enumerate() {
        let (mut next, mut fits) = record(input, revision, records.last());
        if let Some(before) = k.checked_sub(1).and_then(|k| discovery.revisions.get(k)) {
            let scenes: Vec<&SceneFit> = before.fit.scenes.iter().collect();
            next.evidence = Some(weigh(&scenes, before.unseen(), revision));
            next.added = discovery.effects.get(k - 1).cloned();
        }
        fits.iter_mut().for_each(|f| f.record = Some(next.clone()));
        records.push(next);
        stored.extend(fits);
    }
    (records, stored)
}

/// The record of a revision, and the fit of each video.
fn record(
    input: &StudyInput,
    revision: &Revision,
    parent: Option<&RevisionRecord>,
) -> (RevisionRecord, Vec<StoredFit>) {
    let StudyInput { videos, scenes, parents, .. } = input;
    // The parents of the first revision are the models that the request names.
    let fitted = || parents.iter().map(|p| p.id.clone()).collect();
    let parents: Vec<String> = parent.map_or_else(fitted, |p| p.models.clone());
    let models: Vec<_> = revision.fit.scenes.iter().map(|s| &s.model).collect();
    let id = |video: &String| result_digest("revision", &(video, videos, &parents, &models));
    let ids: Vec<String> = videos.iter().map(id).collect();
    let squares: f64 = scenes.iter().map(|s| elementary::powi(estimate_noise(s).position, 2)).sum();
    let record = RevisionRecord {
        number: parent.map_or(0, |p| p.number + 1),
        videos: videos.clone(),
        models: ids.clone(),
        parents,
        added: None,
        removed: None,
        rmse: revision.rmse,
        prediction_errors: revision.unseen(),
        reduced_chi_square: revision.reduced_chi_square,
        noise_sigma: (squares / scenes.len().max(1) as f64).sqrt(),
        evidence: None,
        not_identifiable_reason: None,
    };
    let one = |(k, (video, id)): (usize, (&String, &String))| StoredFit {
        video: video.clone(),
        id: id.clone(),
        revision: record.number,
        fit: revision.fit.of_scene(k),
        record: Some(record.clone()),
    };
    let fits = videos.iter().zip(&ids).enumerate().map(one).collect();
    (record, fits)
}

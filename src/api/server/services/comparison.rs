//! Comparisons of the models of two studies of the same videos.

use crate::api::convert::{findings, study};
use crate::api::v1;
use crate::engine::{Engine, EngineError, ModelSource, Study};
use std::sync::Arc;

/// Videos and models of the other side, if the request has one: of the same videos.
pub fn other_side(
    videos: &[String],
    against: Option<v1::StudyRequest>,
) -> Result<Option<(Vec<String>, ModelSource)>, EngineError> {
    let Some(against) = against else { return Ok(None) };
    let (others, source) = study::request(Some(against))?;
    let sorted = |videos: &[String]| {
        let mut sorted = videos.to_vec();
        sorted.sort();
        sorted
    };
    if sorted(videos) != sorted(&others) {
        return Err(EngineError::invalid(
            "against.videos",
            "are not those of the study; name the same videos",
        ));
    }
    Ok(Some((others, source)))
}

/// The comparison with the difference to the other side.
pub async fn with_difference(
    engine: &Arc<Engine>,
    alone: v1::Comparison,
    videos: &[String],
    start: &ModelSource,
    (their_videos, source): (Vec<String>, ModelSource),
) -> Result<v1::Comparison, EngineError> {
    let ours = engine.side(videos, start).await?;
    let theirs = engine.side(&their_videos, &source).await?;
    let of = |video: &String| theirs.iter().find(|f| f.video == *video).cloned();
    let others: Vec<_> = videos.iter().filter_map(of).collect();
    let (their_order, found) = engine.side_comparison(&others).await?;
    let study = Study { videos: their_order, findings: crate::engine::Findings::Comparison(found) };
    let other = findings::comparison(&study, videos).unwrap_or_default();
    let other = v1::Comparison { models: findings::model_names(&others), ..other };
    let models = findings::model_names(&ours);
    let difference = engine.side_difference(ours, others).await?;
    let difference = Some(Box::new(findings::difference(other, videos, difference)));
    Ok(v1::Comparison { models, difference, ..alone })
}

//! The models of one side of a comparison or a page: kept ones as they are, others fitted first.

use super::error::EngineError;
use super::model_source::{ModelSource, ModelSourceKind};
use super::pool::JobKind;
use super::results::{Findings, StoredFit};
use super::state::Engine;
use super::studies::StudyKind;
use crate::discover::{Comparison, Separation, log_evidence, separations};
use crate::fit::{FitOptions, SceneFit};
use crate::scene::Scene;
use std::collections::BTreeSet;
use std::sync::Arc;

/// How the models of one side differ from those of the other.
pub struct SideDifference {
    pub log_evidence: Result<f64, &'static str>,
    /// One list a video, in the order of the sides.
    pub separations: Vec<Vec<Separation>>,
}

impl Engine {
    /// The fitted models that a source means, in the order of the videos.
    pub async fn side(
        self: &Arc<Self>,
        videos: &[String],
        source: &ModelSource,
    ) -> Result<Vec<StoredFit>, EngineError> {
        let kept = self.parents(videos, source).await?;
        if !kept.is_empty() {
            return Ok(kept);
        }
        if let [video] = videos {
            let fit = self.fit(video, source, FitOptions::default()).await?.finish().await?;
            return Ok(vec![StoredFit::clone(&fit)]);
        }
        let mut sorted = videos.to_vec();
        sorted.sort();
        let fits = self.fit_joint(sorted, source, FitOptions::default()).await?.finish().await?;
        let of = |video: &String| fits.iter().find(|f| f.video == *video).cloned();
        Ok(videos.iter().filter_map(of).collect())
    }

    /// The errors of fitted models, each with its video.
    pub async fn side_comparison(
        self: &Arc<Self>,
        fits: &[StoredFit],
    ) -> Result<(Vec<String>, Comparison), EngineError> {
        let videos: Vec<String> = fits.iter().map(|f| f.video.clone()).collect();
        let kind = ModelSourceKind::FittedEach(fits.iter().map(|f| f.id.clone()).collect());
        let source = ModelSource { path: "study.models", kind };
        let study = self.study(&videos, &source, StudyKind::Compare).await?.finish().await?;
        match &study.findings {
            Findings::Comparison(found) => Ok((study.videos.clone(), found.clone())),
            _ => Err(EngineError::invalid("study", "is no comparison")),
        }
    }

    /// How the models `ours` differ from `others`, which are of the same videos in the same order.
    pub async fn side_difference(
        self: &Arc<Self>,
        ours: Vec<StoredFit>,
        others: Vec<StoredFit>,
    ) -> Result<SideDifference, EngineError> {
        let mut scenes = vec![];
        for fit in &ours {
            scenes.push(self.video(&fit.video).await?);
        }
        self.compute_as(JobKind::Comparison, move |stop| {
            let pairs = scenes.iter().zip(ours.iter().zip(&others));
            let apart = |(scene, (a, b)): (&Arc<Scene>, (&StoredFit, &StoredFit))| {
                stop(0.0)?;
                let models = a.fit.scenes.first().zip(b.fit.scenes.first());
                Ok(models.map_or(vec![], |(a, b)| separations(scene, [&a.model, &b.model])))
            };
            let separations = pairs.map(apart).collect::<Result<_, EngineError>>()?;
            Ok(SideDifference { log_evidence: evidence(&ours, &others), separations })
        })
        .await
    }
}

/// The log evidence ratio, or why there is none.
fn evidence(ours: &[StoredFit], others: &[StoredFit]) -> Result<f64, &'static str> {
    let data = |fits: &[StoredFit]| -> BTreeSet<String> {
        let of = |f: &StoredFit| f.record.as_ref().map_or(vec![f.video.clone()], |r| r.videos.clone());
        fits.iter().flat_map(of).collect()
    };
    let here: BTreeSet<String> = ours.iter().map(|f| f.video.clone()).collect();
    if data(ours) != data(others) {
        return Err("the two models were not fitted to the same videos");
    }
    if data(ours) != here {
        return Err("the models were fitted to more videos than these");
    }
    let scenes = |fits: &[StoredFit]| -> Vec<SceneFit> {
        fits.iter().filter_map(|f| f.fit.scenes.first().cloned()).collect()
    };
    let (ours, others) = (scenes(ours), scenes(others));
    Ok(log_evidence(&others.iter().collect::<Vec<_>>(), &ours.iter().collect::<Vec<_>>()))
}

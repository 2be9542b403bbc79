//! What a tenant has stored and running, for the dashboard.

use crate::engine::cache::Job;
use crate::engine::error::EngineError;
use crate::engine::results::{Findings, Study};
use crate::engine::state::Engine;
use crate::engine::traces::file::{TraceKind, TraceRecord};
use crate::engine::traces::stored::TraceFilter;
use crate::report::dashboard::{Dashboard, JobRow, TraceRow, VideoRow};
use crate::store::TableKind;

/// Videos of one page.
const MOST_VIDEOS: usize = 20;
/// Models of a video that are read.
const MOST_MODELS: usize = 50;
/// Discoveries of a video that are linked.
const MOST_DISCOVERIES: usize = 5;
/// Traces among which the latest are searched.
const MOST_TRACES: usize = 10_000;
/// Traces that are shown.
const LATEST: usize = 20;

impl Engine {
    /// The videos after the id `after`, the running jobs, and the latest traces.
    pub async fn overview(&self, after: &str) -> Result<Dashboard, EngineError> {
        let mut found = self.videos(after, MOST_VIDEOS + 1).await?;
        let more = found.len() > MOST_VIDEOS;
        found.truncate(MOST_VIDEOS);
        let next = found.last().filter(|_| more).map(|(id, _)| id.clone());
        let mut videos = vec![];
        for (id, scene) in found {
            let models = match self.models(&id, "", MOST_MODELS).await {
                // Deleted since it was listed.
                Err(EngineError::NotFound { .. }) => continue,
                models => models?,
            };
            let best = models.iter().max_by_key(|m| m.revision);
            let effects =
                best.and_then(|m| m.record.as_ref()?.added.as_ref()).map(|found| found.kind.clone());
            let fitted = best.and_then(|m| m.fit.scenes.first());
            videos.push(VideoRow {
                frames: scene.times.len(),
                objects: scene.objects.len(),
                seconds: scene.times.last().copied().unwrap_or_default(),
                name: scene.name,
                models: models.len(),
                error: fitted.map(|s| (s.rmse, s.noise_sigma)),
                added: effects,
                discoveries: self.discoveries(&id).await?,
                id,
            });
        }
        let mut records = self.traces(TraceFilter::default(), "", MOST_TRACES).await?;
        let (traces_in_all, trace_bytes) = (records.len(), records.iter().map(|r| r.size_bytes).sum());
        records.sort_by(|a, b| b.stored_ms.cmp(&a.stored_ms).then_with(|| a.id.cmp(&b.id)));
        let trace = |r: TraceRecord| TraceRow {
            about: match (&r.interventions[..], r.kind) {
                ([], TraceKind::Simulation) => "prediction".into(),
                ([], TraceKind::Fit) => "fit".into(),
                ([], TraceKind::Discovery) => "discovery".into(),
                (interventions, _) => interventions.join(", "),
            },
            id: r.id,
            video: r.video,
            size_bytes: r.size_bytes,
        };
        let job = |j: Job| JobRow {
            kind: j.kind,
            video: j.video,
            progress: j.progress,
            seconds: j.age.as_secs_f64(),
        };
        let load = self.load();
        Ok(Dashboard {
            version: env!("CARGO_PKG_VERSION"),
            running: load.running,
            waiting: load.waiting,
            fits: self.fits_run(),
            jobs: self.jobs().into_iter().map(job).collect(),
            videos,
            next,
            traces: records.into_iter().take(LATEST).map(trace).collect(),
            traces_in_all,
            trace_bytes,
        })
    }

    /// The videos of each discovery that was made with this one as its first.
    async fn discoveries(&self, video: &str) -> Result<Vec<Vec<String>>, EngineError> {
        let found = |study: &Study| matches!(study.findings, Findings::Discovery(_));
        let prefix = format!("{video}/");
        let rows = self.store.list(TableKind::Studies, &prefix, &prefix, MOST_DISCOVERIES, found).await?;
        let mut discoveries: Vec<Vec<String>> = rows.into_iter().map(|(_, study)| study.videos).collect();
        discoveries.dedup();
        Ok(discoveries)
    }
}

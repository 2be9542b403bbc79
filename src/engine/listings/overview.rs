//! What a tenant has stored and running, for the dashboard.

use crate::engine::cache::Job;
use crate::engine::error::EngineError;
use crate::engine::state::Engine;
use crate::engine::traces::file::{TraceKind, TraceRecord};
use crate::report::dashboard::{Dashboard, JobRow, TraceRow, VideoRow};
use crate::store::{PageStart, TableKind, TimedRow, VideoHead};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

/// Videos of one page.
const MOST_VIDEOS: usize = 20;
/// Models of a video that are counted.
const MOST_MODELS: usize = 50;
/// Discoveries of a video that are linked.
const MOST_DISCOVERIES: usize = 5;
/// Traces that are shown.
const LATEST: usize = 20;

/// What the overview reads of a model.
#[derive(Deserialize)]
struct ModelOutline {
    #[serde(default)]
    revision: u32,
    fit: FitOutline,
    #[serde(default, rename = "step")]
    record: Option<RevisionOutline>,
}

#[derive(Deserialize)]
struct FitOutline {
    scenes: Vec<FitErrors>,
}

/// Residual and measurement noise, root mean square (m).
#[derive(Deserialize)]
struct FitErrors {
    rmse: f64,
    noise_sigma: f64,
}

#[derive(Deserialize)]
struct RevisionOutline {
    added: Option<EffectOutline>,
}

#[derive(Deserialize)]
struct EffectOutline {
    kind: String,
}

/// What the overview reads of a study.
#[derive(Deserialize)]
struct StudyOutline {
    videos: Vec<String>,
    /// One kind of findings, by its name.
    findings: BTreeMap<String, IgnoredAny>,
}

/// The latest traces of those that were seen, and how many they are.
#[derive(Default)]
struct LatestTraces {
    count: usize,
    bytes: u64,
    latest: Vec<TraceRecord>,
}

impl LatestTraces {
    fn add(&mut self, record: TraceRecord) {
        self.count += 1;
        self.bytes += record.size_bytes;
        self.latest.push(record);
        if self.latest.len() > 2 * LATEST {
            self.cut();
        }
    }

    fn cut(&mut self) {
        self.latest.sort_by(|a, b| b.stored_ms.cmp(&a.stored_ms).then_with(|| a.id.cmp(&b.id)));
        self.latest.truncate(LATEST);
    }
}

impl Engine {
    /// The videos after the id `after`, the running jobs, and the latest traces.
    pub async fn overview(&self, after: &str) -> Result<Dashboard, EngineError> {
        let page = PageStart { prefix: "", after, size: MOST_VIDEOS };
        let found = self.store.list_videos(page, |_: &VideoHead, _| true).await?;
        let next = found.next;
        let mut videos = vec![];
        for row in found.rows {
            videos.push(self.video_row(row.key, row.value).await?);
        }
        let add = |seen: &mut LatestTraces, row: TimedRow<TraceRecord>| {
            seen.add(row.value);
            ControlFlow::Continue(())
        };
        let (mut traces, _) =
            self.store.fold(TableKind::Traces, ("", ""), LatestTraces::default(), add).await?;
        traces.cut();
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
            traces: traces.latest.into_iter().map(trace).collect(),
            traces_in_all: traces.count,
            trace_bytes: traces.bytes,
        })
    }

    async fn video_row(&self, id: String, video: VideoHead) -> Result<VideoRow, EngineError> {
        let prefix = format!("{id}/");
        type Best = (usize, Option<ModelOutline>);
        let step = |(count, best): &mut Best, row: TimedRow<ModelOutline>| {
            *count += 1;
            if best.as_ref().is_none_or(|best| best.revision <= row.value.revision) {
                *best = Some(row.value);
            }
            if *count < MOST_MODELS { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let ((models, best), _) =
            self.store.fold(TableKind::Fits, (&prefix, &prefix), (0, None), step).await?;
        let error = best.as_ref().and_then(|m| m.fit.scenes.first()).map(|s| (s.rmse, s.noise_sigma));
        Ok(VideoRow {
            frames: video.frames,
            objects: video.scene.objects.len(),
            seconds: video.seconds,
            name: video.scene.name,
            models,
            error,
            added: best.and_then(|m| Some(m.record?.added?.kind)),
            discoveries: self.discoveries(&id).await?,
            id,
        })
    }

    /// The videos of each discovery that was made with this one as its first.
    async fn discoveries(&self, video: &str) -> Result<Vec<Vec<String>>, EngineError> {
        let found = |study: &StudyOutline| study.findings.contains_key("Discovery");
        let prefix = format!("{video}/");
        let rows = self.store.list(TableKind::Studies, &prefix, &prefix, MOST_DISCOVERIES, found).await?;
        let mut discoveries: Vec<Vec<String>> = rows.into_iter().map(|(_, study)| study.videos).collect();
        discoveries.dedup();
        Ok(discoveries)
    }
}

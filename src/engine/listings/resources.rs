//! Videos, set-ups, models and revisions: listed with the times at which they were stored first.

use crate::engine::error::EngineError;
use crate::engine::results::StoredFit;
use crate::engine::state::Engine;
use crate::scene::WorldKind;
use crate::store::{Listing, PageStart, TableKind, TimedRow, VideoHead};
use std::collections::BTreeMap;

/// Stored first at or after the first and before the second time (ms after 1970).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CreatedRange {
    pub from_ms: Option<u64>,
    pub before_ms: Option<u64>,
}

impl CreatedRange {
    /// Nothing is known of the time of old rows: they are in no range.
    fn holds(&self, created_ms: Option<u64>) -> bool {
        self.from_ms.is_none_or(|from| created_ms.is_some_and(|ms| ms >= from))
            && self.before_ms.is_none_or(|before| created_ms.is_some_and(|ms| ms < before))
    }
}

/// Which videos to list; what is absent holds for all.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VideoFilter {
    pub setup: Option<String>,
    pub world: Option<WorldKind>,
    pub created: CreatedRange,
}

/// Which models of a video to list; what is absent holds for all.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModelFilter {
    pub preset: Option<String>,
    pub created: CreatedRange,
}

/// Which revisions to list; what is absent holds for all.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RevisionFilter {
    pub video: Option<String>,
    /// That it adds or removes.
    pub effect: Option<String>,
    pub created: CreatedRange,
}

/// A set-up that videos name.
#[derive(Debug, Clone, PartialEq)]
pub struct SetupRow {
    pub name: String,
    pub videos: usize,
    /// Of its first video (ms after 1970).
    pub created_ms: Option<u64>,
}

impl Engine {
    /// Up to `size` videos that the filter accepts, after the id `after`, by id.
    pub async fn list_videos(
        &self,
        filter: VideoFilter,
        after: &str,
        size: usize,
    ) -> Result<Listing<VideoHead>, EngineError> {
        let keep = move |video: &VideoHead, created_ms: Option<u64>| {
            let scene = &video.scene;
            filter.setup.as_ref().is_none_or(|setup| scene.setup.as_ref() == Some(setup))
                && filter.world.is_none_or(|world| scene.world == world)
                && filter.created.holds(created_ms)
        };
        Ok(self.store.list_videos(PageStart { prefix: "", after, size }, keep).await?)
    }

    /// Set-ups whose names begin with `prefix`, after the name `after`, by name; and how many damaged videos are left out.
    pub async fn list_setups(
        &self,
        prefix: &str,
        after: &str,
        size: usize,
    ) -> Result<(Vec<SetupRow>, usize), EngineError> {
        let (prefix, after) = (prefix.to_string(), after.to_string());
        let setups = BTreeMap::<String, SetupRow>::new();
        let step = move |setups: &mut BTreeMap<String, SetupRow>, row: TimedRow<VideoHead>| {
            let is_listed = |name: &String| name.starts_with(&prefix) && *name > after;
            let Some(name) = row.value.scene.setup.filter(is_listed) else { return };
            let new = SetupRow { name: name.clone(), videos: 0, created_ms: row.created_ms };
            let setup = setups.entry(name).or_insert(new);
            setup.videos += 1;
            // `None` is before all times: the oldest of its videos may be one without.
            setup.created_ms = setup.created_ms.min(row.created_ms);
        };
        let (setups, unreadable) = self.store.fold_videos(setups, step).await?;
        Ok((setups.into_values().take(size).collect(), unreadable))
    }

    /// Up to `size` models of a video that the filter accepts, after the one with the id `after`, by id.
    pub async fn list_models(
        &self,
        video: &str,
        filter: ModelFilter,
        after: &str,
        size: usize,
    ) -> Result<Listing<StoredFit>, EngineError> {
        self.video(video).await?;
        let prefix = format!("{video}/");
        let after = format!("{prefix}{after}");
        let keep = move |fit: &StoredFit, created_ms: Option<u64>| {
            let preset = fit.fit.scenes.first().map(|scene| &scene.model.preset);
            filter.preset.as_ref().is_none_or(|wanted| preset == Some(wanted))
                && filter.created.holds(created_ms)
        };
        let page = PageStart { prefix: &prefix, after: &after, size };
        Ok(self.store.list_page(TableKind::Fits, page, keep).await?)
    }

    /// Up to `size` revisions that the filter accepts, each as its first model, after the key `after`, by key.
    pub async fn list_revisions(
        &self,
        filter: RevisionFilter,
        after: &str,
        size: usize,
    ) -> Result<Listing<StoredFit>, EngineError> {
        let keep = move |fit: &StoredFit, created_ms: Option<u64>| {
            let Some(record) = fit.record.as_ref().filter(|r| r.videos.first() == Some(&fit.video)) else {
                return false;
            };
            let changes = |effect: &String| {
                record.added.as_ref().is_some_and(|added| added.effect == *effect)
                    || record.removed.as_ref() == Some(effect)
            };
            filter.video.as_ref().is_none_or(|video| record.videos.contains(video))
                && filter.effect.as_ref().is_none_or(changes)
                && filter.created.holds(created_ms)
        };
        Ok(self.store.list_page(TableKind::Fits, PageStart { prefix: "", after, size }, keep).await?)
    }

    /// When a video was stored first (ms after 1970).
    pub async fn video_created_ms(&self, id: &str) -> Result<Option<u64>, EngineError> {
        Ok(self.store.created_ms(TableKind::Videos, id).await?)
    }

    /// When a model was stored first (ms after 1970).
    pub async fn model_created_ms(&self, video: &str, id: &str) -> Result<Option<u64>, EngineError> {
        Ok(self.store.created_ms(TableKind::Fits, &format!("{video}/{id}")).await?)
    }
}

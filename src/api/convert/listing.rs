//! Listings of videos, set-ups, models and revisions: requests to domain values, rows to replies.

use super::findings::revision;
use super::model::model;
use super::read_mask::ReadMask;
use super::trace::{milliseconds, timestamp};
use super::video::{video_message, world};
use super::violations::Violations;
use crate::api::v1;
use crate::engine::{
    CreatedRange, EngineError, ModelFilter, RevisionFilter, SetupRow, StoredFit, TimedRow, VideoFilter,
    VideoHead,
};
use crate::scene::MAX_NAME;
use prost_types::{FieldMask, Timestamp};

/// One page of what a filter accepts.
pub struct ListingPage<F> {
    pub filter: F,
    pub mask: ReadMask,
    pub size: usize,
    /// Where the page before ended.
    pub after: String,
}

fn created(violations: &mut Violations, from: Option<Timestamp>, before: Option<Timestamp>) -> CreatedRange {
    CreatedRange {
        from_ms: milliseconds(violations, "created_from", from),
        before_ms: milliseconds(violations, "created_before", before),
    }
}

pub fn videos(given: v1::ListVideosRequest) -> Result<ListingPage<VideoFilter>, EngineError> {
    let mut violations = Violations::default();
    let any = given.world == i32::from(v1::World::Unspecified);
    let filter = VideoFilter {
        setup: Some(given.setup).filter(|setup| !setup.is_empty()),
        world: (!any).then(|| world(&mut violations, "world", given.world)),
        created: created(&mut violations, given.created_from, given.created_before),
    };
    let mask = ReadMask::new(&mut violations, given.read_mask, "Video");
    let (size, after) = violations.page(given.page_size, given.page_token);
    violations.finish(ListingPage { filter, mask, size, after })
}

pub fn video(row: &TimedRow<VideoHead>) -> v1::Video {
    let listed = video_message(&row.key, &row.value.scene, false);
    v1::Video { create_time: row.created_ms.map(timestamp), ..listed }
}

/// Prefix, size and start of a page of set-ups.
pub fn setups(given: v1::ListSetupsRequest) -> Result<(String, usize, String), EngineError> {
    let mut violations = Violations::default();
    if given.prefix.len() > MAX_NAME {
        violations.add("prefix", format!("has {} bytes; at most {MAX_NAME}", given.prefix.len()));
    }
    let (size, after) = page_of_texts(&mut violations, given.page_size, &given.page_token);
    violations.finish((given.prefix, size, after))
}

pub fn setup(row: SetupRow) -> v1::Setup {
    let create_time = row.created_ms.map(timestamp);
    v1::Setup { name: row.name, video_count: row.videos as u32, create_time }
}

/// Id of the video, and its page.
pub fn models(given: v1::ListModelsRequest) -> Result<(String, ListingPage<ModelFilter>), EngineError> {
    let mut violations = Violations::default();
    let video = violations.id("parent", &given.parent, "videos");
    let filter = ModelFilter {
        preset: Some(given.preset).filter(|preset| !preset.is_empty()),
        created: created(&mut violations, given.created_from, given.created_before),
    };
    let mask = ReadMask::new(&mut violations, given.read_mask, "Model");
    let (size, after) = violations.page(given.page_size, given.page_token);
    violations.finish((video, ListingPage { filter, mask, size, after }))
}

pub fn listed_model(row: &TimedRow<StoredFit>) -> v1::Model {
    v1::Model { create_time: row.created_ms.map(timestamp), ..model(&row.value) }
}

pub fn revisions(given: v1::ListRevisionsRequest) -> Result<ListingPage<RevisionFilter>, EngineError> {
    let mut violations = Violations::default();
    let filter = RevisionFilter {
        video: violations.optional_id("video", &given.video, "videos"),
        effect: Some(given.effect).filter(|effect| !effect.is_empty()),
        created: created(&mut violations, given.created_from, given.created_before),
    };
    let mask = ReadMask::new(&mut violations, given.read_mask, "Revision");
    let (size, after) = page_of_texts(&mut violations, given.page_size, &given.page_token);
    violations.finish(ListingPage { filter, mask, size, after })
}

pub fn listed_revision(row: &TimedRow<StoredFit>) -> Option<v1::Revision> {
    let record = row.value.record.as_ref()?;
    Some(v1::Revision { create_time: row.created_ms.map(timestamp), ..revision(record) })
}

/// A request for one resource: what the mask keeps of it.
pub fn mask(given: Option<FieldMask>, message: &str) -> Result<ReadMask, EngineError> {
    let mut violations = Violations::default();
    let mask = ReadMask::new(&mut violations, given, message);
    violations.finish(mask)
}

/// The token of the page after the row with this key, which is no id.
pub fn token(key: &str) -> String {
    key.bytes().map(|byte| format!("{byte:02x}")).collect()
}

fn page_of_texts(violations: &mut Violations, size: i32, token: &str) -> (usize, String) {
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let bytes: Option<Vec<u8>> = match token.len().is_multiple_of(2) && token.is_ascii() {
        true => token.as_bytes().chunks(2).map(byte).collect(),
        false => None,
    };
    let after = bytes.and_then(|bytes| String::from_utf8(bytes).ok());
    // The size alone is checked as on other pages.
    let (size, _) = violations.page(size, String::new());
    if after.is_none() {
        violations
            .add("page_token", "is not a token of this service; use next_page_token of the previous reply");
    }
    (size, after.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_of_texts_are_read_back_or_refused() {
        let mut violations = Violations::default();
        assert_eq!(page_of_texts(&mut violations, 3, &token("Tisch ö/1")), (3, "Tisch ö/1".to_string()));
        assert_eq!(page_of_texts(&mut violations, 0, "").1, "");
        assert!(violations.0.is_empty());
        for wrong in ["1", "zz", "ff", "ö"] {
            page_of_texts(&mut violations, -1, wrong);
        }
        assert_eq!(violations.0.len(), 8);
    }
}

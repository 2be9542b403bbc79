//! The scene of a request that creates a video, from tracks or from detections.

use super::detections::linked;
use crate::api::convert::video::scene_from_message;
use crate::api::v1;
use crate::engine::EngineError;
use crate::scene::{LinkReport, Scene};

/// The scene of a request; where it has detections, the report says how they were linked.
pub fn scene_from_request(
    request: v1::CreateVideoRequest,
) -> Result<(Scene, Option<LinkReport>), EngineError> {
    if request.detections.is_empty() {
        return Ok((scene_from_message(request.video)?, None));
    }
    let (video, report) = linked(request)?;
    Ok((scene_from_message(Some(video))?, Some(report)))
}

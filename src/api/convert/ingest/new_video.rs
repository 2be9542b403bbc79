//! The scene of a request that creates a video, from tracks or from detections.

use super::detections::linked;
use super::stills::checked;
use crate::api::convert::video::{scene_until, world};
use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::engine::EngineError;
use crate::media::Still;
use crate::num::Stop;
use crate::scene::{LinkReport, Scene, SceneFile, TableDefaults, Violation, read_scene};

/// How a video was made from a request.
#[derive(Default)]
pub struct IngestReport {
    /// How detections were linked.
    pub linking: Option<LinkReport>,
    /// What is assumed because a file does not state it.
    pub assumptions: Vec<String>,
}

/// What a request asks to store.
pub struct NewVideo {
    pub scene: Scene,
    pub stills: Vec<Still>,
    pub report: IngestReport,
}

/// The scene and the stills of a request, or all its violations at once.
pub fn new_video(mut request: v1::CreateVideoRequest, stop: Stop) -> Result<NewVideo, EngineError> {
    let given = request.video.as_mut().map(|video| std::mem::take(&mut video.stills)).unwrap_or_default();
    let made = scene_from_request(request, stop);
    let mut violations = Violations::default();
    let stills = checked(&mut violations, given, made.as_ref().ok().map(|(scene, _)| scene));
    match made {
        Ok((scene, report)) => violations.finish(NewVideo { scene, stills, report }),
        Err(EngineError::Invalid(first)) => {
            Err(EngineError::Invalid(first.into_iter().chain(violations.0).collect()))
        }
        Err(error) => Err(error),
    }
}

/// The scene of a request, and how it was made.
fn scene_from_request(
    request: v1::CreateVideoRequest,
    stop: Stop,
) -> Result<(Scene, IngestReport), EngineError> {
    if !request.file.is_empty() {
        return of_file(request);
    }
    if request.detections.is_empty() {
        return Ok((scene_until(request.video, stop)?, IngestReport::default()));
    }
    let (video, report) = linked(request, stop)?;
    Ok((scene_until(Some(video), stop)?, IngestReport { linking: Some(report), ..IngestReport::default() }))
}

/// The scene of a file, which is read as the command line reads it.
fn of_file(request: v1::CreateVideoRequest) -> Result<(Scene, IngestReport), EngineError> {
    let v1::CreateVideoRequest { video, file, object_size, detections, .. } = request;
    let video = video.unwrap_or_default();
    if !video.objects.is_empty() || !detections.is_empty() {
        return Err(EngineError::invalid("file", "is given beside objects or detections; give one of them"));
    }
    let given = |value: f64| Some(value).filter(|value| value.is_finite() && *value > 0.0);
    let defaults =
        TableDefaults { fps: given(video.fps), size: given(object_size), ..TableDefaults::default() };
    let name = if video.display_name.is_empty() { "video" } else { &video.display_name };
    let read = read_scene(name, &file, &defaults).map_err(|error| {
        let at = |v: Violation| Violation { path: format!("file: {}", v.path), message: v.message };
        EngineError::Invalid(error.violations.into_iter().map(at).collect())
    })?;
    let SceneFile { mut scene, assumed: assumptions, .. } = read;
    if video.world != v1::World::Unspecified as i32 {
        let mut r = Violations::default();
        let world = world(&mut r, "video.world", video.world);
        scene.world = r.finish(world)?;
    }
    scene.setup = Some(video.setup).filter(|setup| !setup.is_empty()).or(scene.setup);
    Ok((scene, IngestReport { assumptions, ..IngestReport::default() }))
}

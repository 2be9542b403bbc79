//! Stills of the videos that this command read: they go to the service with their scenes.

use crate::api;
use crate::api::v1::{CreateVideoRequest, Video};
use crate::media::Still;
use crate::scene::Scene;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Stills by the digest of their scene.
static STILLS: Mutex<BTreeMap<String, Vec<Still>>> = Mutex::new(BTreeMap::new());

/// No code panics while it holds this lock.
fn kept() -> MutexGuard<'static, BTreeMap<String, Vec<Still>>> {
    STILLS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps the stills of a scene that was read from a video.
pub fn keep(scene: &Scene, stills: Vec<Still>) {
    kept().insert(scene.digest(), stills);
}

/// The request that stores a scene, with its stills if it was read from a video.
pub fn post_request(scene: &Scene) -> CreateVideoRequest {
    let stills = match kept().get(&scene.digest()) {
        Some(stills) => stills.iter().map(api::still_message).collect(),
        None => vec![],
    };
    let video = Video { stills, ..api::video_message("", scene, true) };
    CreateVideoRequest { video: Some(video), ..Default::default() }
}

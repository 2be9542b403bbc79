//! Stills of a video: messages to pictures that are checked, and back.

use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::media::{MAX_STILLS, Still};
use crate::scene::Scene;

/// The stills of a request; `scene` is the one of the request, if it is valid.
pub fn checked(r: &mut Violations, given: Vec<v1::Still>, scene: Option<&Scene>) -> Vec<Still> {
    if given.len() > MAX_STILLS {
        r.add("video.stills", format!("are {}; give at most {MAX_STILLS}", given.len()));
        return vec![];
    }
    let mut stills: Vec<Still> = vec![];
    for (i, given) in given.into_iter().enumerate() {
        let path = |field: &str| format!("video.stills[{i}].{field}");
        let size = [given.width as usize, given.height as usize];
        let still = Still { frame: given.frame as usize, size, jpeg: given.jpeg };
        if let Some(before) = stills.last().filter(|before| before.frame >= still.frame) {
            let message =
                format!("is {}, after {}; give stills by increasing frame", still.frame, before.frame);
            r.add(path("frame"), message);
        }
        if let Some(frames) = scene.map(|s| s.times.len()).filter(|frames| still.frame >= *frames) {
            r.add(path("frame"), format!("is {}, but the video has {frames} frames", still.frame));
        }
        if let Some(image) = scene.and_then(|s| s.camera).map(|camera| camera.image_size)
            && (0..2).any(|k| (image[k] - size[k] as f64).abs() >= 1.0)
        {
            let message = format!(
                "is of frames of {size:?} px, but the camera has {image:?} px; give the size of its image"
            );
            r.add(path("width"), message);
        }
        if let Err(error) = still.check() {
            r.add(path("jpeg"), error.to_string());
        }
        stills.push(still);
    }
    stills
}

pub fn still_message(still: &Still) -> v1::Still {
    let [width, height] = still.size.map(|side| side as u32);
    v1::Still { frame: still.frame as u32, width, height, jpeg: still.jpeg.clone() }
}

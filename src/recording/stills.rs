//! Frames of the video as pictures, and the outlines of the objects on them, in Foxglove's schemas.

use super::draw::color;
use super::messages::{self as m, foxglove as fox};
use super::writer::{TraceWriter, timestamp};
use super::{Recording, RecordingError};
use crate::media::Still;
use crate::num::Vec2;
use crate::perception::outline_of;
use crate::scene::{Scene, Shape};
use prost_types::Timestamp;

/// Frame of reference of the pictures: x to the right, y down.
const CAMERA_FRAME: &str = "camera";
/// Width of an outline and height of a letter (px).
const THICKNESS: f64 = 1.5;
const LETTER_HEIGHT: f64 = 12.0;

/// Pictures, and on each the outlines at the measured positions (white) and at the simulated ones (the object's colour).
pub fn stills(recording: &Recording, to: &mut TraceWriter) -> Result<(), RecordingError> {
    for still in recording.stills {
        let time = recording.scene.time_of(still.frame);
        let timestamp = timestamp(time)?;
        let (data, frame_id) = (still.jpeg.clone(), CAMERA_FRAME.into());
        let image = fox::CompressedImage { timestamp, data, format: "jpeg".into(), frame_id };
        to.push(&m::IMAGE, time, &image)?;
        if let Some(scale) = scale(recording.scene, still) {
            to.push(&m::ANNOTATIONS, time, &annotations(recording, still, scale, timestamp))?;
        }
    }
    Ok(())
}

/// Pixels of the picture for one of the camera; `None` without a camera.
fn scale(scene: &Scene, still: &Still) -> Option<f64> {
    let [width, _] = still.picture_size()?;
    let camera = scene.camera.as_ref()?;
    Some(width as f64 / camera.image_size[0]).filter(|scale| scale.is_finite())
}

fn annotations(
    recording: &Recording,
    still: &Still,
    scale: f64,
    timestamp: Option<Timestamp>,
) -> fox::ImageAnnotations {
    let (scene, prediction) = (recording.scene, recording.prediction);
    let mut drawn = fox::ImageAnnotations::default();
    let white = fox::Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        let Some(sample) = track.samples.iter().find(|s| s.frame == still.frame) else { continue };
        let at = (sample.position, sample.yaw.unwrap_or(0.0));
        let Some(points) = outline(scene, &object.shape, at, scale) else { continue };
        let right = points.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        let below = points.iter().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
        drawn.texts.push(fox::TextAnnotation {
            timestamp,
            position: Some(fox::Point2 { x: right, y: below }),
            text: object.id.to_string(),
            font_size: LETTER_HEIGHT,
            text_color: Some(white),
            background_color: Some(fox::Color { a: 0.6, ..Default::default() }),
        });
        drawn.points.push(polygon(points, white, timestamp));
    }
    let row = prediction.best.states.get(still.frame).into_iter().flatten();
    for (state, body) in row.zip(&prediction.model.bodies) {
        let Some(state) = state else { continue };
        let word = scene.objects.iter().find(|o| o.id == body.id).map_or("", |o| &o.color);
        let points = outline(scene, &body.shape, (state.position, state.yaw), scale);
        drawn.points.extend(points.map(|points| polygon(points, color(word), timestamp)));
    }
    drawn
}

fn outline(scene: &Scene, shape: &Shape, (at, yaw): (Vec2, f64), scale: f64) -> Option<Vec<fox::Point2>> {
    let corners = outline_of(scene.camera.as_ref()?, shape, at, yaw)?;
    Some(corners.into_iter().map(|[u, v]| fox::Point2 { x: scale * u, y: scale * v }).collect())
}

fn polygon(
    points: Vec<fox::Point2>,
    color: fox::Color,
    timestamp: Option<Timestamp>,
) -> fox::PointsAnnotation {
    let kind = fox::points_annotation::Type::LineLoop;
    let outline_color = Some(color);
    fox::PointsAnnotation { timestamp, r#type: kind.into(), points, outline_color, thickness: THICKNESS }
}

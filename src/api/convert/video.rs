//! Videos: message to scene and back, with the paths of violations in terms of the message.

use super::ingest::camera;
use super::violations::Violations;
use crate::api::v1;
use crate::engine::EngineError;
use crate::num::{Stop, never, vec2};
use crate::scene::{
    FindingKind, MAX_FRAMES, Object, Outlier, Pixel, Sample, Scene, Shape, Table, Track, TrackFinding,
    Violation, WorldKind,
};

/// Frame rate where none is given (1/s).
pub const DEFAULT_FPS: f64 = 25.0;

/// The scene of a message, or all its violations at once.
pub fn scene_from_message(video: Option<v1::Video>) -> Result<Scene, EngineError> {
    scene_until(video, &never)
}

/// The same, until the caller stops it.
pub fn scene_until(video: Option<v1::Video>, stop: Stop) -> Result<Scene, EngineError> {
    let Some(video) = video else {
        return Err(EngineError::invalid("video", "is missing"));
    };
    let mut r = Violations::default();
    let world = world(&mut r, "video.world", video.world);
    let has_camera = video.camera.is_some();
    let mut camera = video.camera.and_then(|camera| camera::camera(&mut r, camera));
    let fps = if video.fps == 0.0 { DEFAULT_FPS } else { video.fps };
    let MeasuredObjects { objects, mut tracks, pixels } = measured(&mut r, video.objects);
    let image_noise = camera::image_noise(&mut r, video.image_noise_px);
    let camera_is_wrong = has_camera && camera.is_none();
    if !pixels.is_empty() && !camera_is_wrong {
        camera = camera::place(&mut r, camera, image_noise, &pixels, &objects, &mut tracks);
    }
    let times = if video.times.is_empty() {
        let last = tracks.iter().flat_map(|t| &t.samples).map(|s| s.frame + 1).max().unwrap_or(0);
        // One frame more than allowed is enough for the refusal.
        (0..last.min(MAX_FRAMES + 1)).map(|frame| frame as f64 / fps).collect()
    } else {
        video.times
    };
    let scene = Scene {
        name: if video.display_name.is_empty() { "video".into() } else { video.display_name },
        setup: Some(video.setup).filter(|s| !s.is_empty()),
        world,
        fps,
        times,
        camera,
        table: video.table.map(|t| Table { x: [t.x_min, t.x_max], y: [t.y_min, t.y_max] }),
        noise_sigma: video.noise_sigma,
        objects,
        tracks,
        outliers: vec![],
        findings: video.findings.into_iter().filter_map(finding).collect(),
        feature_layout: Some(video.feature_layout).filter(|name| !name.is_empty()),
        absent: vec![],
    };
    // Positions from image points mean nothing if the camera is wrong: their violations would mislead.
    if !pixels.is_empty() && !r.0.is_empty() {
        return r.finish(scene);
    }
    match scene.clone().validate_until(stop)? {
        Ok(scene) => r.finish(scene),
        Err(error) => {
            r.0.extend(error.violations.into_iter().map(|v| violation(&scene, v)));
            r.finish(scene)
        }
    }
}

/// The world of a field with this path.
pub fn world(r: &mut Violations, path: &str, world: i32) -> WorldKind {
    match v1::World::try_from(world) {
        Ok(v1::World::Unspecified | v1::World::Clevrer) => WorldKind::Clevrer,
        Ok(v1::World::Table) => WorldKind::Table,
        Ok(v1::World::AirTable) => WorldKind::AirTable,
        Ok(v1::World::Billiards) => WorldKind::Billiards,
        Err(_) => {
            r.add(path, format!("is {world}, which is no world"));
            WorldKind::Clevrer
        }
    }
}

/// The objects of a message with their tracks. Samples that are image points stand at the origin until the camera has
/// placed them.
#[derive(Default)]
struct MeasuredObjects {
    objects: Vec<Object>,
    tracks: Vec<Track>,
    pixels: Vec<Pixel>,
}

fn measured(r: &mut Violations, given: Vec<v1::Object>) -> MeasuredObjects {
    let mut found = MeasuredObjects::default();
    for (i, object) in given.into_iter().enumerate() {
        let shape = r.shape(&format!("video.objects[{i}].shape"), object.shape);
        let mut samples = Vec::new();
        for (k, sample) in object.samples.into_iter().enumerate() {
            let position = match sample.place {
                Some(v1::sample::Place::Position(p)) => vec2(p.x, p.y),
                Some(v1::sample::Place::Image(p)) => {
                    found.pixels.push(Pixel { object: i, sample: k, point: [p.u, p.v] });
                    vec2(0.0, 0.0)
                }
                None => {
                    r.add(format!("video.objects[{i}].samples[{k}].position"), "is missing");
                    vec2(0.0, 0.0)
                }
            };
            samples.push(Sample {
                frame: sample.frame as usize,
                position,
                yaw: sample.yaw,
                covariance: sample.covariance.map(camera::covariance),
            });
        }
        let v1::Object { id, color, material, mass, features, .. } = object;
        found.objects.push(Object { id, color, material, shape, mass, features });
        found.tracks.push(Track { samples });
    }
    found
}

/// The violation in terms of the message.
fn violation(scene: &Scene, violation: Violation) -> Violation {
    let path = &violation.path;
    let renamed = match path.as_str() {
        "..." => return violation,
        "name" => "display_name".to_string(),
        "camera.matrix" => path.clone(),
        "camera.image_size[0]" => "camera.image_width".to_string(),
        "camera.image_size[1]" => "camera.image_height".to_string(),
        "table.x[0]" => "table.x_min".to_string(),
        "table.x[1]" | "table.x" => "table.x_max".to_string(),
        "table.y[0]" => "table.y_min".to_string(),
        "table.y[1]" | "table.y" => "table.y_max".to_string(),
        _ => match (path.strip_prefix("camera.matrix"), path.rsplit_once('.')) {
            (Some(_), _) => {
                let digits: Vec<u32> = path.chars().filter_map(|c| c.to_digit(10)).collect();
                let index = digits.iter().fold(0, |sum, d| 4 * sum + d);
                format!("camera.matrix[{index}]")
            }
            (None, Some((at, axis @ ("x" | "y")))) if at.contains("samples[") => {
                format!("{at}.position.{axis}")
            }
            (None, Some((at, size @ ("size" | "half_length" | "half_width")))) => {
                format!("{at}.shape.{}", size_field(scene, at, size))
            }
            _ => path.clone(),
        },
    };
    Violation { path: format!("video.{renamed}"), message: violation.message }
}

fn size_field(scene: &Scene, at: &str, size: &str) -> String {
    let index = at.trim_start_matches("objects[").trim_end_matches(']').parse::<usize>().ok();
    match index.and_then(|i| scene.objects.get(i)).map(|o| o.shape) {
        Some(Shape::Disc { .. }) => "disc.radius".into(),
        Some(Shape::Ball { .. }) => "ball.radius".into(),
        Some(Shape::Square { .. }) => "square.half_side".into(),
        _ => format!("rectangle.{size}"),
    }
}

/// The message of a scene; without its times, samples and features in a list. Objects of which nothing was seen are the last.
pub fn video_message(id: &str, scene: &Scene, whole: bool) -> v1::Video {
    let world = match scene.world {
        WorldKind::Clevrer => v1::World::Clevrer,
        WorldKind::Table => v1::World::Table,
        WorldKind::AirTable => v1::World::AirTable,
        WorldKind::Billiards => v1::World::Billiards,
    };
    let seen = scene.objects.iter().enumerate().map(|(index, object)| match whole {
        true => object_message(object, &scene.all_samples(index)),
        false => v1::Object { features: vec![], ..object_message(object, &[]) },
    });
    let absent = scene.absent.iter().map(|object| object_message(object, &[]));
    let outlier = |outlier: &Outlier| v1::Outlier {
        object: scene.objects.get(outlier.object).map_or(0, |o| o.id),
        frame: outlier.sample.frame as u32,
        distance: outlier.distance,
    };
    v1::Video {
        name: format!("videos/{id}"),
        display_name: scene.name.clone(),
        setup: scene.setup.clone().unwrap_or_default(),
        world: world.into(),
        fps: scene.fps,
        times: if whole { scene.times.clone() } else { vec![] },
        camera: scene.camera.as_ref().map(camera::camera_message),
        table: scene.table.map(|t| v1::Table { x_min: t.x[0], x_max: t.x[1], y_min: t.y[0], y_max: t.y[1] }),
        noise_sigma: scene.noise_sigma,
        objects: seen.chain(absent).collect(),
        image_noise_px: 0.0,
        linking: None,
        assumptions: vec![],
        create_time: None,
        outliers: if whole { scene.outliers.iter().map(outlier).collect() } else { vec![] },
        findings: scene.findings.iter().map(finding_message).collect(),
        stills: vec![],
        feature_layout: scene.feature_layout.clone().unwrap_or_default(),
    }
}

/// What was found before of a video that is sent on; `None`: of a kind that this version does not know.
fn finding(given: v1::TrackFinding) -> Option<TrackFinding> {
    let kind = FindingKind::named(&given.kind).filter(|_| given.value.is_finite())?;
    let frames = given.frames.into_iter().map(|f| f as usize).collect();
    Some(TrackFinding { kind, objects: given.objects, frames, value: given.value })
}

fn finding_message(found: &TrackFinding) -> v1::TrackFinding {
    v1::TrackFinding {
        kind: found.kind.name().into(),
        objects: found.objects.clone(),
        frames: found.frames.iter().map(|&f| f as u32).collect(),
        value: found.value,
        text: found.to_string(),
    }
}

/// The message of an object with its samples.
pub fn object_message(object: &Object, samples: &[Sample]) -> v1::Object {
    v1::Object {
        id: object.id,
        color: object.color.clone(),
        material: object.material.clone(),
        shape: Some(shape(&object.shape)),
        mass: object.mass,
        features: object.features.clone(),
        samples: samples.iter().map(sample).collect(),
    }
}

fn sample(sample: &Sample) -> v1::Sample {
    let position = v1::Vector { x: sample.position.x, y: sample.position.y };
    v1::Sample {
        frame: sample.frame as u32,
        place: Some(v1::sample::Place::Position(position)),
        yaw: sample.yaw,
        covariance: sample.covariance.map(camera::covariance_message),
    }
}

fn shape(shape: &Shape) -> v1::Shape {
    use v1::shape::{Ball, Disc, Kind, Rectangle, Square};
    let kind = match *shape {
        Shape::Disc { radius } => Kind::Disc(Disc { radius }),
        Shape::Ball { radius } => Kind::Ball(Ball { radius }),
        Shape::Square { half_side } => Kind::Square(Square { half_side }),
        Shape::Rectangle { half_length, half_width } => {
            Kind::Rectangle(Rectangle { half_length, half_width })
        }
    };
    v1::Shape { kind: Some(kind) }
}

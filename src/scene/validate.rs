//! Checks a scene and reports everything that is wrong with it at once; ignores tracking outliers.

use crate::num::{Stop, Stopped, never};
use crate::scene::camera::projection::CameraError;
use crate::scene::limits::{
    FPS_RANGE, MASS_RANGE, MAX_FRAMES, MAX_NAME, MAX_OBJECTS, MAX_POSITION, NOISE_RANGE, SIZE_RANGE,
};
use crate::scene::measurement::examine;
use crate::scene::object::{Object, Shape};
use crate::scene::observation::{Sample, Scene, Table, Track};
use crate::scene::tracks::detection::checked_features;
use crate::scene::tracks::outliers::reject_outliers;
use crate::scene::violations::{SceneError, SceneViolations, readable};

/// Longest mean time from frame to frame (s).
const MAX_FRAME_TIME: f64 = 1.0 / FPS_RANGE[0];
/// Largest correlation of the errors of x and y.
const MAX_CORRELATION: f64 = 1.0 - 1e-9;
/// Least distance of two centres as a share of the sum of the inscribed radii: below it one object lies inside the other.
pub(super) const MIN_DISTANCE_SHARE: f64 = 0.5;

impl Scene {
    /// The scene with its outliers moved from `tracks` to `outliers`, and with what its tracks show of how they were measured; or
    /// everything that is wrong with it.
    pub fn validate(self) -> Result<Scene, SceneError> {
        // The second error never comes.
        self.validate_until(&never).unwrap_or_else(|stopped| Err(SceneError::single("", stopped.to_string())))
    }

    /// The same, until the caller stops it.
    pub fn validate_until(mut self, stop: Stop) -> Result<Result<Scene, SceneError>, Stopped> {
        let mut violations = SceneViolations::default();
        self.check_values(&mut violations);
        let given = self.put_absent_objects_aside();
        stop(0.0)?;
        let (tracks, outliers) = reject_outliers(&self);
        stop(0.0)?;
        if violations.is_empty() {
            (self.tracks, self.outliers) = (tracks, outliers);
            examine(&mut self, stop)?;
            self.check_places(&self.tracks, &given, &mut violations);
        } else {
            self.check_places(&tracks, &given, &mut violations);
        }
        Ok(violations.finish().map(|()| self))
    }

    /// Moves objects without samples to `absent`, as long as others have some; returns the indices that the others had.
    fn put_absent_objects_aside(&mut self) -> Vec<usize> {
        let is_seen: Vec<bool> = self.tracks.iter().map(|t| !t.samples.is_empty()).collect();
        if self.tracks.len() != self.objects.len() || !is_seen.contains(&true) {
            return (0..self.objects.len()).collect();
        }
        let all = std::mem::take(&mut self.objects).into_iter().zip(&is_seen);
        let (seen, absent): (Vec<_>, Vec<_>) = all.partition(|(_, is_seen)| **is_seen);
        self.objects = seen.into_iter().map(|(object, _)| object).collect();
        self.absent.extend(absent.into_iter().map(|(object, _)| object));
        self.tracks.retain(|t| !t.samples.is_empty());
        (0..is_seen.len()).filter(|k| is_seen[*k]).collect()
    }

    /// Overlaps and cushions, judged by tracks without outliers; `given`: the index of each object in the request.
    fn check_places(&self, tracks: &[Track], given: &[usize], r: &mut SceneViolations) {
        if self.objects.len() <= MAX_OBJECTS {
            self.check_overlaps(tracks, given, r);
        }
        self.check_cushions(tracks, r);
    }

    /// Every single value, each with its dotted path.
    fn check_values(&self, r: &mut SceneViolations) {
        check_name(r, "name", &self.name);
        if let Some(setup) = &self.setup {
            check_name(r, "setup", setup);
        }
        r.within(|| "fps".into(), self.fps, FPS_RANGE, "1/s");
        // 0: a perfect recording, whose noise is estimated.
        if let Some(sigma) = self.noise_sigma.filter(|sigma| *sigma != 0.0) {
            r.within(|| "noise_sigma".into(), sigma, NOISE_RANGE, "m");
        }
        self.check_times(r);
        self.check_camera_and_table(r);
        if self.objects.is_empty() {
            r.add("objects", "is empty; give at least one object");
        }
        if self.objects.len() > MAX_OBJECTS {
            r.add(
                "objects",
                format!("has {} objects; at most {MAX_OBJECTS} are allowed", self.objects.len()),
            );
        }
        if self.tracks.len() != self.objects.len() {
            let (tracks, objects) = (self.tracks.len(), self.objects.len());
            r.add("tracks", format!("has {tracks} tracks for {objects} objects; give one for each object"));
        }
        let mut length = None;
        for (i, object) in self.objects.iter().enumerate() {
            if let Err(message) = checked_features(&object.features, &mut length) {
                r.add(format!("objects[{i}].features"), message);
            }
            if let Some(j) = self.objects[..i].iter().position(|o| o.id == object.id) {
                r.add(
                    format!("objects[{i}].id"),
                    format!("is {}, as objects[{j}].id is; give each its own", object.id),
                );
            }
            check_object(r, i, object);
        }
        let is_any_seen = self.tracks.iter().any(|t| !t.samples.is_empty());
        for (i, track) in self.tracks.iter().enumerate() {
            if track.samples.is_empty() && !is_any_seen {
                r.add(format!("objects[{i}].samples"), "is empty; give at least one object with samples");
            }
            check_track(r, i, track, self.times.len());
        }
        let counts = || self.tracks.iter().map(|t| t.samples.len());
        if self.times.len() > 1 && counts().max() == Some(1) {
            let advice = "give positions over time, with the same identity for one object in all frames";
            r.add("tracks", format!("show each object in one frame only; {advice}"));
        }
    }

    fn check_times(&self, r: &mut SceneViolations) {
        match self.times.len() {
            0 => r.add("times", "is empty; give at least two frames"),
            1 => r.add("times", "has one frame only; give at least two frames"),
            n if n > MAX_FRAMES => {
                r.add("times", format!("has {n} frames; at most {MAX_FRAMES} are allowed"))
            }
            _ => {}
        }
        let mut before = f64::NEG_INFINITY;
        for (k, &t) in self.times.iter().enumerate() {
            if !t.is_finite() {
                r.add(format!("times[{k}]"), format!("is {t}; give a finite number"));
                continue;
            }
            if k == 0 && t < 0.0 {
                r.add("times[0]", format!("is {} s; times begin at 0 or later", readable(t)));
            }
            if t <= before {
                r.add(
                    format!("times[{k}]"),
                    format!("is {} after {}; times must increase", readable(t), readable(before)),
                );
            }
            before = t;
        }
        if let [first, .., last] = self.times[..]
            && let apart = (last - first) / (self.times.len() - 1) as f64
            && apart > MAX_FRAME_TIME
        {
            let message = format!(
                "are {} s apart; give seconds (divide milliseconds by 1000)",
                readable(apart.round())
            );
            r.add("times", message);
        }
    }

    fn check_camera_and_table(&self, r: &mut SceneViolations) {
        if let Some(camera) = &self.camera {
            for (row, values) in camera.matrix.iter().enumerate() {
                for (column, &v) in values.iter().enumerate() {
                    r.finite(|| format!("camera.matrix[{row}][{column}]"), v, 1e12, "");
                }
            }
            let finite = camera.matrix.iter().flatten().all(|v| v.is_finite());
            if finite && camera.is_singular() {
                r.add("camera.matrix", CameraError::Singular.to_string());
            }
            for (k, &v) in camera.image_size.iter().enumerate() {
                r.within(|| format!("camera.image_size[{k}]"), v, [1.0, 1e6], "px");
            }
        }
        if let Some(table) = &self.table {
            for (axis, [low, high]) in [("x", table.x), ("y", table.y)] {
                for (k, v) in [low, high].into_iter().enumerate() {
                    r.finite(|| format!("table.{axis}[{k}]"), v, MAX_POSITION, "m");
                }
                if low >= high {
                    r.add(
                        format!("table.{axis}"),
                        format!(
                            "is from {} to {}, which is empty; give low, then high",
                            readable(low),
                            readable(high)
                        ),
                    );
                }
            }
        }
    }

    /// Refuses a table that leaves most samples of an object outside: its unit or origin differs from that of the tracks. An
    /// object may leave the table near the end.
    fn check_cushions(&self, tracks: &[Track], r: &mut SceneViolations) {
        let Some(Table { x, y }) = self.table else { return };
        for (object, Track { samples }) in self.objects.iter().zip(tracks) {
            let beyond = |[low, high]: [f64; 2], at: f64| match low < high {
                true => (low - at).max(at - high),
                false => f64::NEG_INFINITY,
            };
            let outside = |s: &&Sample| {
                beyond(x, s.position.x).max(beyond(y, s.position.y)) > object.shape.inscribed_radius()
            };
            if let Some(first) = samples.iter().find(outside)
                && 2 * samples.iter().filter(outside).count() > samples.len()
            {
                let (id, frame, at) = (object.id, first.frame, first.position);
                let message = format!(
                    "leaves object {id} outside most of the time (in frame {frame} it is at {:.3}, {:.3} m); give the \
                     cushions in the unit and axes of the tracks",
                    at.x, at.y
                );
                r.add("table", message);
                return;
            }
        }
    }

    fn check_overlaps(&self, tracks: &[Track], given: &[usize], r: &mut SceneViolations) {
        let each = self.objects.iter().zip(tracks).zip(given);
        let each: Vec<(&Object, &Track, usize)> =
            each.map(|((o, track), index)| (o, track, *index)).collect();
        for (k, (b, track_b, j)) in each.iter().enumerate() {
            for (a, track_a, i) in &each[..k] {
                let limit = MIN_DISTANCE_SHARE * (a.shape.inscribed_radius() + b.shape.inscribed_radius());
                if let Some((frame, distance)) = first_closer(track_a, track_b, limit) {
                    r.add(
                        format!("objects[{j}]"),
                        format!(
                            "objects {} and {} (objects[{i}]) lie inside each other in frame {frame}: their centres \
                             are {distance:.3} m apart; check sizes and positions, or leave one of both out",
                            b.id, a.id
                        ),
                    );
                }
            }
        }
    }
}

/// The first common frame in which the centres are closer than `limit` (m), and their distance.
fn first_closer(a: &Track, b: &Track, limit: f64) -> Option<(usize, f64)> {
    let finite = |s: &Sample| s.position.x.is_finite() && s.position.y.is_finite();
    let mut others = b.samples.iter().peekable();
    for sample in &a.samples {
        while others.next_if(|o| o.frame < sample.frame).is_some() {}
        if let Some(other) = others.peek().filter(|o| o.frame == sample.frame) {
            let distance = (sample.position - other.position).norm();
            if distance < limit && finite(sample) && finite(other) {
                return Some((sample.frame, distance));
            }
        }
    }
    None
}

fn check_name(r: &mut SceneViolations, path: &str, name: &str) {
    if name.trim().is_empty() {
        r.add(path, "is empty; give a name");
    } else {
        check_text(r, path, name);
    }
}

/// Terminals obey control characters.
fn check_text(r: &mut SceneViolations, path: &str, text: &str) {
    if text.len() > MAX_NAME {
        r.add(path, format!("has {} bytes; give at most {MAX_NAME}", text.len()));
    } else if text.chars().any(char::is_control) {
        r.add(path, format!("is {text:?}; leave out control characters"));
    }
}

fn check_object(r: &mut SceneViolations, i: usize, object: &Object) {
    match object.shape {
        Shape::Disc { radius: size } | Shape::Ball { radius: size } | Shape::Square { half_side: size } => {
            r.within(|| format!("objects[{i}].size"), size, SIZE_RANGE, "m");
        }
        Shape::Rectangle { half_length, half_width } => {
            r.within(|| format!("objects[{i}].half_length"), half_length, SIZE_RANGE, "m");
            r.within(|| format!("objects[{i}].half_width"), half_width, SIZE_RANGE, "m");
        }
    }
    if let Some(mass) = object.mass {
        r.within(|| format!("objects[{i}].mass"), mass, MASS_RANGE, "kg");
    }
    for (key, word) in [("color", &object.color), ("material", &object.material)] {
        check_text(r, &format!("objects[{i}].{key}"), word);
    }
}

fn check_track(r: &mut SceneViolations, i: usize, track: &Track, frames: usize) {
    let mut before = None;
    for (k, sample) in track.samples.iter().enumerate() {
        let path = |key: &str| format!("objects[{i}].samples[{k}].{key}");
        if sample.frame >= frames {
            r.add(path("frame"), format!("is {}; the video has {frames} frames", sample.frame));
        } else if before.is_some_and(|b| sample.frame <= b) {
            r.add(
                path("frame"),
                format!("is {} after {}; frames must increase", sample.frame, before.unwrap_or(0)),
            );
        }
        before = before.max(Some(sample.frame));
        r.finite(|| path("x"), sample.position.x, MAX_POSITION, "m");
        r.finite(|| path("y"), sample.position.y, MAX_POSITION, "m");
        if let Some(yaw) = sample.yaw {
            r.finite(|| path("yaw"), yaw, MAX_POSITION, "rad");
        }
        if let Some(c) = &sample.covariance {
            let variances = NOISE_RANGE.map(|sigma| sigma * sigma);
            r.within(|| path("covariance.xx"), c.xx, variances, "m^2");
            r.within(|| path("covariance.yy"), c.yy, variances, "m^2");
            // With a correlation of one, one direction would have no noise.
            let correlation = c.xy / (c.xx * c.yy).sqrt();
            if !(-MAX_CORRELATION..MAX_CORRELATION).contains(&correlation) {
                r.add(
                    path("covariance.xy"),
                    format!("is {}; its absolute value must be below sqrt(xx yy)", readable(c.xy)),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;
    use crate::scene::MAX_FEATURES;
    use crate::scene::violations::MAX_VIOLATIONS;
    use crate::scene::{CLEVRER_CAMERA, Camera, WorldKind};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn scene() -> Scene {
        let object = |id| Object {
            id,
            color: "red".into(),
            material: "metal".into(),
            shape: Shape::Ball { radius: 0.2 },
            mass: Some(1.0),
            features: vec![],
        };
        let track = |y: f64| Track {
            samples: (0..5)
                .map(|f| Sample { frame: f, position: vec2(f as f64, y), yaw: Some(0.0), covariance: None })
                .collect(),
        };
        Scene {
            name: "s".into(),
            setup: None,
            world: WorldKind::Clevrer,
            fps: 25.0,
            times: (0..5).map(|f| f as f64 / 25.0).collect(),
            camera: Some(Camera { matrix: CLEVRER_CAMERA.matrix, image_size: [480.0, 320.0] }),
            table: Some(Table { x: [-1.0, 5.0], y: [-1.0, 3.0] }),
            noise_sigma: Some(0.005),
            objects: (0..3).map(object).collect(),
            tracks: (0..3).map(|i| track(i as f64)).collect(),
            outliers: vec![],
            findings: vec![],
            feature_layout: None,
            absent: vec![],
        }
    }

    /// Breaks one field and names the path that must be reported.
    type BreakOneField = fn(&mut Scene) -> &'static str;
    const BREAKS: &[BreakOneField] = &[
        |s| (s.name = String::new(), "name").1,
        |s| (s.setup = Some("x".repeat(MAX_NAME + 1)), "setup").1,
        |s| (s.objects[1].color = "red\u{1b}[31m".into(), "objects[1].color").1,
        |s| (s.fps = 0.0, "fps").1,
        |s| (s.noise_sigma = Some(f64::NAN), "noise_sigma").1,
        |s| (s.times[3] = s.times[2], "times[3]").1,
        |s| (s.times.iter_mut().for_each(|t| *t *= 1000.0), "times").1,
        |s| (s.table.as_mut().unwrap().x = [2.0, 1.0], "table.x").1,
        |s| (s.table.as_mut().unwrap().y = [-0.3, 0.7], "table").1,
        |s| (s.camera.as_mut().unwrap().matrix[1][2] = f64::INFINITY, "camera.matrix[1][2]").1,
        |s| (s.camera.as_mut().unwrap().image_size[1] = 0.0, "camera.image_size[1]").1,
        |s| (s.objects[2].id = 0, "objects[2].id").1,
        |s| (s.objects[1].mass = Some(-1.0), "objects[1].mass").1,
        |s| (s.objects[0].features = vec![f32::NAN], "objects[0].features").1,
        |s| (s.objects[1].features = vec![0.0; MAX_FEATURES + 1], "objects[1].features").1,
        |s| (s.objects[0].shape = Shape::Disc { radius: 0.0 }, "objects[0].size").1,
        |s| (s.tracks[0].samples[1].position.x = f64::NAN, "objects[0].samples[1].x").1,
        |s| (s.tracks[0].samples[2].position.y = 2e6, "objects[0].samples[2].y").1,
        |s| (s.tracks[1].samples[4].frame = 9, "objects[1].samples[4].frame").1,
        |s| (s.tracks[1].samples[2].frame = 1, "objects[1].samples[2].frame").1,
        |s| (s.tracks[2].samples[3].yaw = Some(f64::NAN), "objects[2].samples[3].yaw").1,
        |s| (s.tracks[2].samples[0].position = vec2(0.0, 1.1), "objects[2]").1,
    ];

    proptest! {
        #[test]
        fn every_broken_field_is_reported_and_nothing_else(chosen in proptest::sample::subsequence(
            (0..BREAKS.len()).collect::<Vec<_>>(), 0..=BREAKS.len()))
        {
            let mut broken = scene();
            let expected: BTreeSet<String> = chosen.iter().map(|&i| BREAKS[i](&mut broken).to_string()).collect();
            let found = match broken.validate() {
                Ok(_) => vec![],
                Err(e) => e.violations.into_iter().map(|v| v.path).collect(),
            };
            prop_assert_eq!(found.len(), expected.len());
            prop_assert_eq!(found.into_iter().collect::<BTreeSet<_>>(), expected);
        }
    }

    #[test]
    fn empty_lists_and_limits_are_reported() {
        let paths = |s: &Scene| -> Vec<String> {
            s.clone()
                .validate()
                .map_or_else(|e| e.violations.into_iter().map(|v| v.path).collect(), |_| vec![])
        };
        let mut s = scene();
        (s.objects, s.tracks) = (vec![], vec![]);
        assert_eq!(paths(&s), ["objects"]);
        let mut s = scene();
        (s.objects[0].features, s.objects[2].features) = (vec![1.0; 3], vec![1.0; 2]);
        assert_eq!(paths(&s), ["objects[2].features"]);
        let mut s = scene();
        s.tracks[1].samples.clear();
        let seen = s.clone().validate().unwrap();
        assert_eq!((seen.objects.len(), seen.tracks.len()), (s.objects.len() - 1, s.objects.len() - 1));
        assert_eq!(seen.absent, [s.objects[1].clone()]);
        // Paths are those of the request, also after objects that are not seen.
        let mut overlapping = s.clone();
        overlapping.tracks[2].samples[0].position = vec2(0.0, 0.1);
        assert_eq!(paths(&overlapping), ["objects[2]"]);
        s.tracks.iter_mut().for_each(|t| t.samples.clear());
        assert!(paths(&s).contains(&"objects[1].samples".to_string()));
        let mut s = scene();
        s.camera.as_mut().unwrap().matrix[2] = [0.0; 4];
        assert_eq!(paths(&s), ["camera.matrix"]);
        let mut s = scene();
        s.times.truncate(1);
        s.tracks.iter_mut().for_each(|t| t.samples.truncate(1));
        assert_eq!(paths(&s), ["times"]);
        let mut s = scene();
        s.times = (0..=MAX_FRAMES).map(|f| f as f64).collect();
        assert_eq!(paths(&s), ["times"]);
        // Detections that nothing links, such as a list of boxes without identities.
        let mut s = scene();
        s.tracks.iter_mut().for_each(|t| t.samples.truncate(1));
        assert_eq!(paths(&s), ["tracks"]);
        let mut s = scene();
        s.tracks[0].samples = (0..5)
            .cycle()
            .take(500)
            .map(|_| Sample { frame: 9, position: vec2(0.0, 0.0), yaw: None, covariance: None })
            .collect();
        assert_eq!(paths(&s).len(), MAX_VIOLATIONS + 1);
    }
}

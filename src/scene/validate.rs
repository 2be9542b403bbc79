//! Checks a scene and reports everything that is wrong with it at once.

use super::{
    CameraError, MAX_FRAMES, MAX_OBJECTS, Object, Sample, Scene, SceneError, Shape, Table, Track, Violation,
};
use std::collections::BTreeMap;

/// Most violations in one report; the rest is counted.
pub const MAX_VIOLATIONS: usize = 100;
/// Most of one kind in a file of rows, the same but for their numbers and what they quote: the first ones tell of all.
const MAX_ALIKE: usize = 5;
/// Longest name of a scene or a set-up (bytes): it becomes part of keys and file names.
pub const MAX_NAME: usize = 200;
/// Farthest coordinate (m); beyond it the resolution of positions suffers.
pub const MAX_POSITION: f64 = 1e6;
/// Frame rates that cameras have (1/s).
pub const FPS_RANGE: [f64; 2] = [0.1, 1e5];
/// Longest time from frame to frame (s), on the average.
const SLOWEST: f64 = 1.0 / FPS_RANGE[0];
/// Radii and half sides (m).
pub const SIZE_RANGE: [f64; 2] = [1e-6, 1e3];
/// kg.
pub const MASS_RANGE: [f64; 2] = [1e-9, 1e9];
/// Measurement noise (m).
pub const NOISE_RANGE: [f64; 2] = [1e-9, 1e3];
/// Largest correlation of the errors of x and y.
const MAX_CORRELATION: f64 = 1.0 - 1e-9;
/// Two objects whose centres are closer than this share of their inscribed radii's sum lie inside each other.
const DEEP_OVERLAP: f64 = 0.5;

/// Collects violations; keeps the first [`MAX_VIOLATIONS`] and counts the others.
#[derive(Default)]
pub(super) struct Report {
    violations: Vec<Violation>,
    /// Most of one kind, where not all are kept.
    most_alike: Option<usize>,
    /// Of each kind, how many then, and the place of the last one that is kept.
    kinds: BTreeMap<String, (usize, Option<usize>)>,
    more: usize,
}

/// What is alike in violations of one kind: all but numbers and what is quoted.
fn kind(path: &str, message: &str) -> String {
    let mut quoted = false;
    let alike = |c: &char| {
        quoted ^= *c == '"';
        !quoted && !c.is_ascii_digit() && !matches!(c, '-' | '.')
    };
    path.chars().chain(message.chars()).filter(alike).collect()
}

impl Report {
    /// Of a file that people read: of each kind it keeps [`MAX_ALIKE`].
    pub(super) fn of_rows() -> Self {
        Report { most_alike: Some(MAX_ALIKE), ..Report::default() }
    }

    pub(super) fn add(&mut self, path: impl Into<String>, message: impl Into<String>) {
        let (path, message) = (path.into(), message.into());
        let room = self.violations.len() < MAX_VIOLATIONS;
        if let Some(most) = self.most_alike {
            let (count, last) = self.kinds.entry(kind(&path, &message)).or_default();
            *count += 1;
            if *count > most {
                return;
            }
            *last = room.then_some(self.violations.len()).or(*last);
        }
        if room {
            self.violations.push(Violation { path, message });
        } else {
            self.more += 1;
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.violations.is_empty()
    }

    pub(super) fn finish(mut self) -> Result<(), SceneError> {
        if self.violations.is_empty() {
            return Ok(());
        }
        let most = self.most_alike.unwrap_or(usize::MAX);
        for (count, last) in self.kinds.into_values().filter(|(count, _)| *count > most) {
            if let Some(kept) = last.and_then(|at| self.violations.get_mut(at)) {
                kept.message += &format!(" (and {} more like these)", count - most);
            }
        }
        if self.more > 0 {
            let message = format!("and {} more violations; correct these first", self.more);
            self.violations.push(Violation { path: "...".to_string(), message });
        }
        Err(SceneError { violations: self.violations })
    }

    fn finite(&mut self, path: impl FnOnce() -> String, value: f64, most: f64, unit: &str) {
        if !value.is_finite() {
            self.add(path(), format!("is {value}; give a finite number"));
        } else if value.abs() > most {
            self.add(path(), format!("is {value}; it must lie within {most:e} {unit}"));
        }
    }

    fn within(&mut self, path: impl FnOnce() -> String, value: f64, [low, high]: [f64; 2], unit: &str) {
        if !(low..=high).contains(&value) {
            self.add(path(), format!("is {value}; it must be from {low:e} to {high:e} {unit}"));
        }
    }

    fn name(&mut self, path: &str, name: &str) {
        if name.trim().is_empty() {
            self.add(path, "is empty; give a name");
        } else if name.len() > MAX_NAME {
            self.add(path, format!("has {} bytes; at most {MAX_NAME} are allowed", name.len()));
        }
    }
}

/// A yaw that no angle in radians is, as it is read from a file: one that does not begin within a turn, or that jumps by
/// more than the turn that wrapping takes. Its frame and value.
pub(super) fn degrees(track: &Track) -> Option<(usize, f64)> {
    const TURN: f64 = 1.01 * std::f64::consts::TAU;
    let mut before = None;
    track.samples.iter().filter_map(|s| Some((s.frame, s.yaw?))).find(|(frame, yaw)| {
        let (last, known) = before.replace((*frame, *yaw)).unwrap_or((*frame, 0.0));
        (yaw - known).abs() > TURN * frame.saturating_sub(last).max(1) as f64
    })
}

impl Scene {
    /// Everything that is wrong with this scene, each with its dotted path; its tracks without strays tell what overlaps, as where
    /// a tracker went astray says nothing of sizes.
    pub(super) fn check(&self, steady: &[Track]) -> Result<(), SceneError> {
        let mut report = Report::default();
        let r = &mut report;
        r.name("name", &self.name);
        if let Some(setup) = &self.setup {
            r.name("setup", setup);
        }
        r.within(|| "fps".into(), self.fps, FPS_RANGE, "1/s");
        if let Some(sigma) = self.noise_sigma {
            r.within(|| "noise_sigma".into(), sigma, NOISE_RANGE, "m");
        }
        self.check_times(r);
        self.check_place(r);
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
            r.add("tracks", format!("has {tracks} tracks for {objects} objects; give one for each"));
        }
        for (i, object) in self.objects.iter().enumerate() {
            if let Some(j) = self.objects[..i].iter().position(|o| o.id == object.id) {
                r.add(
                    format!("objects[{i}].id"),
                    format!("is {}, as objects[{j}].id is; give each its own", object.id),
                );
            }
            check_object(r, i, object);
        }
        for (i, track) in self.tracks.iter().enumerate() {
            check_track(r, i, track, self.times.len());
        }
        if self.objects.len() <= MAX_OBJECTS {
            self.check_overlaps(steady, r);
        }
        self.check_cushions(steady, r);
        report.finish()
    }

    fn check_times(&self, r: &mut Report) {
        match self.times.len() {
            0 => r.add("times", "is empty; give at least two frames"),
            1 => r.add("times", "has one frame only; motion needs at least two"),
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
                r.add("times[0]", format!("is {t} s; times begin at 0 or later"));
            }
            if t <= before {
                r.add(format!("times[{k}]"), format!("is {t} after {before}; times must increase"));
            }
            before = t;
        }
        if let [first, .., last] = self.times[..]
            && let apart = (last - first) / (self.times.len() - 1) as f64
            && apart > SLOWEST
        {
            let message =
                format!("are {apart:.0} s apart; give seconds (milliseconds are to be divided by 1000)");
            r.add("times", message);
        }
    }

    fn check_place(&self, r: &mut Report) {
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
                        format!("is from {low} to {high}, which is empty; give low, then high"),
                    );
                }
            }
        }
    }

    /// Cushions in another unit than the tracks leave most of them outside; an object may leave the table in the end.
    fn check_cushions(&self, tracks: &[Track], r: &mut Report) {
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
                     cushions where the tracks have them, in the same unit",
                    at.x, at.y
                );
                r.add("table", message);
                return;
            }
        }
    }

    fn check_overlaps(&self, tracks: &[Track], r: &mut Report) {
        let pairs: Vec<(&Object, &Track)> = self.objects.iter().zip(tracks).collect();
        for (j, (b, track_b)) in pairs.iter().enumerate() {
            for (i, (a, track_a)) in pairs[..j].iter().enumerate() {
                let limit = DEEP_OVERLAP * (a.shape.inscribed_radius() + b.shape.inscribed_radius());
                if let Some((frame, distance)) = first_closer(track_a, track_b, limit) {
                    r.add(
                        format!("objects[{j}]"),
                        format!(
                            "objects {} and {} (objects[{i}]) lie inside each other in frame {frame}: their centres \
                             are {distance:.3} m apart; check sizes and positions",
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

fn check_object(r: &mut Report, i: usize, object: &Object) {
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
        if word.len() > MAX_NAME {
            r.add(
                format!("objects[{i}].{key}"),
                format!("has {} bytes; at most {MAX_NAME} are allowed", word.len()),
            );
        }
    }
}

fn check_track(r: &mut Report, i: usize, track: &Track, frames: usize) {
    if track.samples.is_empty() {
        r.add(format!("objects[{i}].samples"), "is empty; leave out an object that is never seen");
    }
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
            // A correlation of one leaves a direction without noise.
            let correlation = c.xy / (c.xx * c.yy).sqrt();
            if !(-MAX_CORRELATION..MAX_CORRELATION).contains(&correlation) {
                r.add(path("covariance.xy"), format!("is {}; it must be below sqrt(xx yy) in size", c.xy));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CLEVRER_CAMERA, Camera, WorldKind};
    use super::*;
    use crate::num::vec2;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn scene() -> Scene {
        let object = |id| Object {
            id,
            color: "red".into(),
            material: "metal".into(),
            shape: Shape::Ball { radius: 0.2 },
            mass: Some(1.0),
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
        }
    }

    /// Breaks one field and names the path that must be reported.
    type Break = fn(&mut Scene) -> &'static str;
    const BREAKS: &[Break] = &[
        |s| (s.name = String::new(), "name").1,
        |s| (s.setup = Some("x".repeat(MAX_NAME + 1)), "setup").1,
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
    fn emptiness_and_limits_are_reported() {
        let paths = |s: &Scene| -> Vec<String> {
            s.clone()
                .validate()
                .map_or_else(|e| e.violations.into_iter().map(|v| v.path).collect(), |_| vec![])
        };
        let mut s = scene();
        (s.objects, s.tracks) = (vec![], vec![]);
        assert_eq!(paths(&s), ["objects"]);
        let mut s = scene();
        s.tracks[1].samples.clear();
        assert_eq!(paths(&s), ["objects[1].samples"]);
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
        let mut s = scene();
        s.tracks[0].samples = (0..5)
            .cycle()
            .take(500)
            .map(|_| Sample { frame: 9, position: vec2(0.0, 0.0), yaw: None, covariance: None })
            .collect();
        assert_eq!(paths(&s).len(), MAX_VIOLATIONS + 1);
    }
}

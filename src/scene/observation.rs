//! One video as data: its frames, objects and tracks, and the times of its frames.

use crate::num::{Vec2, wrap_angle};
use crate::scene::camera::Camera;
use crate::scene::covariance::Covariance;
use crate::scene::measurement::{FindingKind, TrackFinding};
use crate::scene::object::Object;
use serde::{Deserialize, Serialize};

/// One video. Object `i` of `objects` has the track `tracks[i]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    pub name: String,
    /// The set-up (table and camera) of the video; videos of one set-up share physics.
    pub setup: Option<String>,
    pub world: WorldKind,
    /// Nominal frame rate (1/s); times beyond the last frame continue at it.
    pub fps: f64,
    /// Time of each frame (s), strictly increasing.
    pub times: Vec<f64>,
    pub camera: Option<Camera>,
    pub table: Option<Table>,
    /// Stated standard deviation of a position (m): taken where the tracks are too short to estimate it, and where samples state
    /// covariances, the least one, as errors that frames share do not scatter.
    pub noise_sigma: Option<f64>,
    pub objects: Vec<Object>,
    pub tracks: Vec<Track>,
    /// Samples that are not positions of their object. They are kept, but nothing uses them.
    #[serde(rename = "strays", default, skip_serializing_if = "Vec::is_empty")]
    pub outliers: Vec<Outlier>,
    /// What the tracks show of how they were measured; what is no measurement has been left out or put right.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<TrackFinding>,
    /// What the numbers of `Object::features` are, such as perception's layout; `None`: not named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub feature_layout: Option<String>,
    /// Objects of the set-up that the video does not show: they have no track and take no part in anything.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub absent: Vec<Object>,
}

/// The kind of place; it selects the default preset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WorldKind {
    Clevrer,
    Table,
    AirTable,
    Billiards,
}

impl WorldKind {
    const NAMES: [(&str, WorldKind); 4] = [
        ("clevrer", WorldKind::Clevrer),
        ("table", WorldKind::Table),
        ("air_table", WorldKind::AirTable),
        ("billiards", WorldKind::Billiards),
    ];

    /// The kind with this name in files.
    pub(super) fn named(name: &str) -> Option<WorldKind> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind)
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

/// Measured positions of one object, by increasing frame. Frames without a measurement, and outliers, are absent.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Track {
    pub samples: Vec<Sample>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Index into `Scene::times`.
    pub frame: usize,
    /// Bird's-eye position (m).
    pub position: Vec2,
    /// Orientation about z (rad), if it was measured.
    pub yaw: Option<f64>,
    /// Covariance of the position's error; `None`: the video's mean uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<Covariance>,
}

/// An ignored sample: the object would have had to jump there and back.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Outlier {
    /// Index of the object.
    pub object: usize,
    pub sample: Sample,
    /// Distance (m) from the straight line between the samples before and after.
    #[serde(rename = "off")]
    pub distance: f64,
}

/// Playing field with cushions (m).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Table {
    pub x: [f64; 2],
    pub y: [f64; 2],
}

/// Largest change of the yaw step from frame to frame (rad) in a steady rotation about z.
const MAX_YAW_STEP_CHANGE: f64 = 0.4;

impl Track {
    /// The sample of a frame.
    pub fn at(&self, frame: usize) -> Option<&Sample> {
        self.samples.binary_search_by_key(&frame, |s| s.frame).ok().and_then(|k| self.samples.get(k))
    }

    /// Whether every sample has a yaw and the yaw changes steadily. The yaw of a rolling ball does not: it flips each time
    /// the ball's mark passes over the top.
    pub fn turns_evenly(&self) -> bool {
        let turn = |a: f64, b: f64| wrap_angle(b - a);
        let even = |w: &[Sample]| match (w[0].yaw, w[1].yaw, w[2].yaw) {
            (Some(a), Some(b), Some(c)) => turn(turn(a, b), turn(b, c)).abs() < MAX_YAW_STEP_CHANGE,
            _ => false,
        };
        self.samples.len() > 2 && self.samples.windows(3).all(even)
    }

    /// The first yaw that cannot be radians read from a file, with its frame: the first yaw exceeds one turn, or it jumps by
    /// more than the one turn a frame that wrapping explains.
    pub(super) fn yaw_in_degrees(&self) -> Option<(usize, f64)> {
        const TURN: f64 = 1.01 * std::f64::consts::TAU;
        let mut before = None;
        self.samples.iter().filter_map(|s| Some((s.frame, s.yaw?))).find(|(frame, yaw)| {
            let (last, known) = before.replace((*frame, *yaw)).unwrap_or((*frame, 0.0));
            (yaw - known).abs() > TURN * frame.saturating_sub(last).max(1) as f64
        })
    }
}

impl Scene {
    pub fn object_index(&self, id: u32) -> Option<usize> {
        self.objects.iter().position(|o| o.id == id)
    }

    /// Time of a frame (s), also of frames after the video.
    pub fn time_of(&self, frame: usize) -> f64 {
        match self.times.get(frame) {
            Some(t) => *t,
            None => {
                let last = self.times.len().saturating_sub(1);
                self.times.last().copied().unwrap_or(0.0) + (frame - last) as f64 / self.fps
            }
        }
    }

    /// The frame shown at a time (s): the last one that is not later, also after the video.
    pub fn frame_at(&self, time: f64) -> usize {
        match self.times.last() {
            Some(&end) if time > end => {
                // At most 2^32 frames later, which no simulation has.
                self.times.len() - 1 + ((time - end) * self.fps + 1e-9).floor() as u32 as usize
            }
            _ => self.times.partition_point(|t| *t <= time + 1e-9).saturating_sub(1),
        }
    }

    /// The value of the first finding of a kind.
    pub fn finding(&self, kind: FindingKind) -> Option<f64> {
        self.findings.iter().find(|f| f.kind == kind).map(|f| f.value)
    }

    /// All samples of an object by frame, outliers included.
    pub fn all_samples(&self, object: usize) -> Vec<Sample> {
        let own = self.tracks.get(object).into_iter().flat_map(|t| &t.samples);
        let outliers = self.outliers.iter().filter(|s| s.object == object).map(|s| &s.sample);
        let mut all: Vec<Sample> = own.chain(outliers).copied().collect();
        all.sort_by_key(|s| s.frame);
        all
    }
}

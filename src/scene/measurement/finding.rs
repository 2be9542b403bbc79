//! What the tracks show of how they were measured, as data and in words.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Objects and frames that a sentence names.
const NAMED: usize = 6;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// Positions are multiples of a step: `value` (m).
    Steps,
    /// Frames that show the one before again; their samples are left out. `value`: their share of all.
    RepeatedFrames,
    /// Objects whose tracker gave the position before again; these samples are left out. `value`: their share.
    RepeatedPositions,
    /// Frames after which the camera lost some, though numbers and times go on; `value`: how many in all. Later times are shifted.
    LostFrames,
    /// Frames after which the frame rate is another; `value`: time between frames after the last of them over that before the first.
    /// Later times are changed.
    RateChange,
    /// Frames from which two objects have each other's identity; the tracks are put right.
    SwappedIdentities,
    /// Frames from which a track is not of its object; the samples are left out. `value`: how many.
    Leaps,
    /// Errors of neighbouring frames depend on each other; `value`: deviation of slow errors over that of fast ones.
    DependentNoise,
    /// Positions on straight lines between measured ones, which are left out; `value`: their share.
    Interpolated,
    /// The noise of an object is larger than that of another; `value`: by this factor. Each has its own.
    UnevenNoise,
    /// The camera moves slowly, as `objects` at rest show; `value`: root mean square of that (m).
    DriftingCamera,
    /// All objects move together by chance; `value`: root mean square of that (m).
    MovingCamera,
}

/// One thing that the tracks show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackFinding {
    pub kind: FindingKind,
    /// Ids; empty: all.
    pub objects: Vec<u32>,
    pub frames: Vec<usize>,
    /// In the unit of its kind.
    pub value: f64,
}

impl FindingKind {
    const NAMES: [(&str, FindingKind); 12] = [
        ("steps", FindingKind::Steps),
        ("repeated_frames", FindingKind::RepeatedFrames),
        ("repeated_positions", FindingKind::RepeatedPositions),
        ("lost_frames", FindingKind::LostFrames),
        ("rate_change", FindingKind::RateChange),
        ("swapped_identities", FindingKind::SwappedIdentities),
        ("leaps", FindingKind::Leaps),
        ("dependent_noise", FindingKind::DependentNoise),
        ("interpolated", FindingKind::Interpolated),
        ("uneven_noise", FindingKind::UnevenNoise),
        ("drifting_camera", FindingKind::DriftingCamera),
        ("moving_camera", FindingKind::MovingCamera),
    ];

    pub fn named(name: &str) -> Option<FindingKind> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind)
    }

    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

impl TrackFinding {
    /// What the camera did.
    fn camera(&self, f: &mut fmt::Formatter, objects: &str, frames: &str) -> fmt::Result {
        match self.kind {
            FindingKind::DriftingCamera => write!(
                f,
                "the camera moves slowly by {} (root mean square), as {objects} at rest show; this is taken out",
                length(self.value)
            ),
            FindingKind::MovingCamera if self.frames.is_empty() => write!(
                f,
                "all objects move together by {} (root mean square), as of a camera that shakes: what is fast is taken out, and the \
                 noise is as large",
                length(self.value)
            ),
            _ => write!(
                f,
                "all objects leap by {} together after {frames}, as of a camera that was bumped; this is taken out",
                length(self.value)
            ),
        }
    }
}

impl fmt::Display for TrackFinding {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (objects, frames) = (listed("object", &self.objects), listed("frame", &self.frames));
        match self.kind {
            FindingKind::Steps => write!(
                f,
                "positions come in steps of {}: the noise is at least {}",
                length(self.value),
                length(self.value / 12.0_f64.sqrt())
            ),
            FindingKind::RepeatedFrames => write!(
                f,
                "frames stand still: {:.0} % of them show the one before again ({frames}); they are left out",
                100.0 * self.value
            ),
            FindingKind::RepeatedPositions => write!(
                f,
                "{objects}: {:.0} % of the positions are the one before again ({frames}); they are left out",
                100.0 * self.value
            ),
            FindingKind::LostFrames => write!(
                f,
                "frames are missing (dropped) though the numbers go on: all objects leap ahead at once after {frames}; {:.0} frames \
                 are added to the times after that",
                self.value
            ),
            FindingKind::RateChange => write!(
                f,
                "the frame rate changes: all objects are faster or slower by one factor after {frames}; the time between frames \
                 is {:.3} times as long at the end, which is taken in",
                self.value
            ),
            FindingKind::SwappedIdentities => {
                write!(f, "{objects} have each other's identity from {frames} on; the tracks are put right")
            }
            FindingKind::Leaps => write!(
                f,
                "{objects} leaps away at {frames}: {:.0} positions are not its own (the tracker followed something else, or wrote a value for what it did not see) and are \
                 left out",
                self.value
            ),
            FindingKind::DependentNoise => write!(
                f,
                "errors of neighbouring frames are not independent: slow ones are {:.1} times as large as fast ones, as of positions \
                 that were smoothed, filtered or interpolated; give raw positions. The noise is taken as large as the slow errors",
                self.value
            ),
            FindingKind::Interpolated => write!(
                f,
                "{objects}: {:.0} % of the positions are interpolated between others ({frames}); they are left out",
                100.0 * self.value
            ),
            FindingKind::UnevenNoise => write!(
                f,
                "the noise of {objects} is {:.1} times that of the one that is measured best: each has its own",
                self.value
            ),
            FindingKind::DriftingCamera | FindingKind::MovingCamera => self.camera(f, &objects, &frames),
        }
    }
}

fn length(metres: f64) -> String {
    format!("{:.2} mm", 1e3 * metres)
}

/// "object 3", "frames 31, 65 and 9 more".
fn listed<T: fmt::Display>(noun: &str, all: &[T]) -> String {
    let named: Vec<String> = all.iter().take(NAMED).map(T::to_string).collect();
    let plural = if all.len() == 1 { "" } else { "s" };
    let more = if all.len() > NAMED { format!(" and {} more", all.len() - NAMED) } else { String::new() };
    match all.is_empty() {
        true => format!("all {noun}s"),
        false => format!("{noun}{plural} {}{more}", named.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_a_name_and_a_sentence() {
        for (name, kind) in FindingKind::NAMES {
            assert_eq!((FindingKind::named(name), kind.name()), (Some(kind), name));
            let written = serde_json::to_string(&kind).unwrap();
            assert_eq!(written, format!("\"{name}\""));
        }
        let lost =
            TrackFinding { kind: FindingKind::LostFrames, objects: vec![], frames: vec![31], value: 2.0 };
        assert!(lost.to_string().contains("leap ahead at once after frame 31; 2 frames"), "{lost}");
    }
}

//! From detections in single frames to tracks of objects, and the outliers of tracks.

pub(in crate::scene) mod detection;
pub(in crate::scene) mod link;
pub(in crate::scene) mod mask;
pub(in crate::scene) mod outliers;
mod silhouette;
mod track_candidate;

pub use detection::{AttributeScores, Detection, LinkOptions, checked_features};
pub use link::{LinkError, LinkReport, LinkedTracks, MAX_DETECTIONS, MAX_IN_FRAME, link};
pub use mask::{BoundingBox, MaskError, bounds as mask_bounds, decompress};
pub use silhouette::outline;

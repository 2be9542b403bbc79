//! What was observed of one video: objects, their tracks, the camera and the table; and the readers of its files.
//!
//! | part | job |
//! |---|---|
//! | `observation`, `object`, `covariance` | the data: `Scene`, `Track`, `Sample`; `Object`, `Shape`; the uncertainty of a position |
//! | `validate`, `violations`, `limits` | every check of a scene, all violations at once; what is allowed |
//! | `spelling` | the known name that a misspelt one means |
//! | `measurement` | how the tracks were measured: steps, repeats, lost frames, identities, dependent errors |
//! | `digest` | the key of a scene by its content |
//! | `camera` | projection, the inverse onto the ground plane, calibration from point pairs |
//! | `tracks` | detections to tracks: masks, silhouettes, linking; outliers of a tracker |
//! | `files` | bytes in, scene out: annotations, tables of text, Tracker projects, proposals, point pairs |

mod camera;
mod covariance;
mod digest;
mod files;
mod limits;
mod measurement;
mod object;
mod observation;
mod spelling;
#[cfg(test)]
mod tests;
mod tracks;
mod validate;
mod violations;

pub use camera::{
    CLEVRER_CAMERA, CalibrateError, Calibration, Camera, CameraError, CameraPose, IMAGE_NOISE,
    IMAGE_NOISE_RANGE, Intrinsics, LocateError, MAX_PAIRS, Pixel, PointPair, Rotation, calibrate,
};
pub use covariance::Covariance;
pub use digest::canonical_digest;
pub use files::{
    Proposals, SceneFile, TableDefaults, decoded, holds_positions, holds_records, observed_json, parse,
    parse_csv, parse_pairs, parse_proposals, read_scene, written_csv,
};
pub use limits::{
    DEFAULT_SIZE, MASS_RANGE, MAX_FEATURES, MAX_FRAMES, MAX_NAME, MAX_OBJECTS, MAX_POSITION, SIZE_RANGE,
};
pub use measurement::{FindingKind, TrackFinding};
pub use object::{Object, Shape};
pub use observation::{Outlier, Sample, Scene, Table, Track, WorldKind};
pub use spelling::misspelt;
pub use tracks::{
    AttributeScores, BoundingBox, Detection, LinkError, LinkOptions, LinkReport, LinkedTracks,
    MAX_DETECTIONS, MAX_IN_FRAME, MaskError, checked_features, decompress, link, mask_bounds, outline,
};
pub use violations::{SceneError, Violation};

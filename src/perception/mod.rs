//! Frames to tracks: which bodies a video shows, where each is in each frame, and how sure that is.
//!
//! | file | job |
//! |---|---|
//! | `ground`, `light` | the light of the empty ground, found although bodies rest on it; pixel values as light |
//! | `evidence`, `colour_histogram` | how a pixel departs from the ground; which pixels look like a body |
//! | `viewpoint`, `outline`, `depth_order` | projection; outlines of balls, cylinders and cubes; who hides whom |
//! | `region_search`, `contour_fit`, `frame_fit` | coarse fit by pixels, fine fit to edges, all bodies of a frame together |
//! | `candidates`, `body_track`, `tracking` | new bodies; one body through the video; the loop over frames |
//! | `camera_shake` | the common motion of resting bodies is the camera's |
//! | `body_size`, `perceive` | the bodies' size, the scale of a view from above; a video to a scene and a report |
//! | `appearance`, `attributes`, `report` | colour, material; what was seen and what was not |

mod appearance;
mod attributes;
mod body_size;
mod body_track;
mod camera_shake;
mod candidates;
mod image;
mod outlines;
mod perceive;
mod report;
#[cfg(test)]
mod tests;
mod tracking;

pub use appearance::AppearanceFeatures;
pub use outlines::outline::{BodyForm, Pose, outline_of};
pub use outlines::viewpoint::top_camera;
pub use perceive::{FEATURE_LAYOUT, Perception, PerceptionError, PerceptionOptions, View, perceive};
pub use report::{PerceivedObject, PerceptionReport, UnexplainedRegion};

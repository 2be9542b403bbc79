//! What only new videos have: detections, and cameras to convert and to calibrate.

pub mod camera;
pub mod detections;
pub mod new_video;
pub mod stills;
pub mod video_file;

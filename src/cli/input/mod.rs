//! Reads what a command is given: scenes, videos, detectors, models, formulas, and `ID=VALUE` pairs.

mod detector;
mod files;
mod models;
mod pairs;
mod scenes;
mod stills;
mod videos;

pub use detector::detect;
pub use files::{bytes, text};
pub use models::{ModelArgument, formula, is_model, model};
pub use pairs::{id_and_number, id_and_vector};
pub use scenes::{OBSERVED, outlier_message, scene, scene_paths, scenes};
pub use stills::post_request;
pub use videos::{VideoView, ViewArgs, camera, is_video_file, see, video_name};

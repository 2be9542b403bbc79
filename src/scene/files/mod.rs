//! Readers of the files that users give (text in, scene or detections out), and the writer of scene files.

mod annotation;
mod assumptions;
mod csv;
mod json_fields;
mod observed_json;
mod point_pairs;
mod proposals;
mod tracker;

pub use annotation::{parse, read_annotation};
pub use csv::{parse_csv, read_csv};
pub use observed_json::observed_json;
pub use point_pairs::parse_pairs;
pub use proposals::{Proposals, parse_proposals};
pub use tracker::{is_tracker, parse_tracker};

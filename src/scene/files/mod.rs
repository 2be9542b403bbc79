//! Readers of the files that users give (bytes in, scene or detections out), and the writer of scene files.

mod annotation;
mod archive;
mod assumptions;
mod csv;
mod encoding;
mod json_fields;
mod observed_json;
mod point_pairs;
mod proposals;
mod read;
mod records;
#[cfg(test)]
mod tests;
mod tracker_project;

pub use annotation::parse;
pub use csv::{TableDefaults, parse_csv, written_csv};
pub use observed_json::observed_json;
pub use point_pairs::parse_pairs;
pub use proposals::{Proposals, parse_proposals};
pub use read::{SceneFile, decoded, holds_positions, holds_records, read_scene};

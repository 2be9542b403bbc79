//! What a person or a program gets: files, tables, drawings, progress.

pub mod assumptions;
mod next;
pub mod progress;
pub mod revisions;
mod table;
mod write;

pub use next::next;
pub use table::{concise, interval, measured, number, table, with_interval};
pub use write::{file, json, print, result, tell, writable};

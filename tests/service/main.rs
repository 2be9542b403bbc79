//! Tests of the service over a real channel: results, storage, sharing, refusals, robustness.

mod agreement;
mod camera;
mod concepts;
mod crowd;
mod data;
mod discover;
mod disk;
mod endure;
mod fairness;
mod flow;
mod garbage;
mod harness;
mod import;
mod listings;
mod operations;
mod pages;
mod parsing;
mod process;
mod reflection;
mod revise;
mod security;
mod setup;
mod sharing;
mod side_by_side;
mod spans;
mod traces;

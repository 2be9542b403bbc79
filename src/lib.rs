//! vrdp understands the physics in a video: fit, predict, imagine, explain.

pub mod api;
pub mod body;
pub mod cli;
pub mod config;
pub mod discover;
pub mod effects;
pub mod engine;
pub mod fit;
pub mod num;
pub mod reason;
pub mod recording;
pub mod report;
pub mod scene;
pub mod store;
pub mod telemetry;
pub mod world;

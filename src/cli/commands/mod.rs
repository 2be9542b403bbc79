//! The commands, one file each.

pub mod demo;
pub mod files;
pub mod scene;
pub mod service;
pub mod study;
pub mod words;

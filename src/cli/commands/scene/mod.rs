//! Commands about single scenes.

mod accuracy;
pub mod ask;
pub mod fit;
pub mod questions;
pub mod score;
pub mod simulate;

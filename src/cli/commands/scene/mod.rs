//! Commands about single scenes.

mod accuracy;
pub mod ask;
mod asked;
pub mod fit;
pub mod parse;
pub mod questions;
pub mod score;
pub mod simulate;

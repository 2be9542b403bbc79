//! Commands about single scenes.

pub mod ask;
pub mod fit;
pub mod score;
pub mod simulate;

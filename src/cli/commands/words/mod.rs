//! Commands about words: learning them, and what they mean.

pub mod learn;
mod lessons;
pub mod show;

//! Words: what a request learns them from, and the lexica that are kept.

mod learning;
mod lexica;

pub use learning::{ExamplePlace, LearnRequest, NamedChange, NamedExample, VideoLessons};

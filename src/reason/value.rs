//! The values on the stack of a program.

use super::events::SceneEvent;
use crate::num::Vec2;
use crate::world::Intervention;

#[derive(Debug, Clone, PartialEq)]
pub enum ProgramValue {
    /// Indices of objects of the scene.
    Objects(Vec<usize>),
    Object(usize),
    Events(Vec<SceneEvent>),
    Event(SceneEvent),
    /// `None`: any time.
    Frame(Option<usize>),
    /// s.
    Time(f64),
    Span(SpanKind),
    Word(String),
    Order(usize),
    /// A factor, a length (m), a duration (s) or a frame.
    Factor(f64),
    Change(Vec<Intervention>),
    Text(String),
    Number(usize),
    Bool(bool),
    Quantity(f64, &'static str),
    Vector(Vec2, &'static str),
    /// What the video does not determine, and why.
    Undetermined(String),
}

/// A part of the time line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpanKind {
    Video,
    Prediction,
    Both,
}

//! The values on the stack of a program, and the operands of an operation.

use super::ReasonError;
use super::context::Halt;
use super::events::SceneEvent;
use super::program::Op;
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
    Word(&'static str),
    /// Word k of the lexicon.
    Concept(usize),
    Order(usize),
    /// A factor, or a length (m).
    Factor(f64),
    Change(Vec<Intervention>),
    Text(String),
    Number(usize),
    Bool(bool),
}

/// The operands of an operation, popped from the stack. The type check makes a wrong type unreachable from outside.
pub(super) struct Operands<'a> {
    pub op: Op,
    pub stack: &'a mut Vec<ProgramValue>,
}

impl Operands<'_> {
    /// A value of a wrong type.
    pub(super) fn mismatch(&self) -> Halt {
        let (expected, found) = ("a checked program", format!("{:?} on a value of a wrong type", self.op));
        Halt::Error(ReasonError::ProgramResult { expected, found })
    }

    pub(super) fn pop(&mut self) -> Result<ProgramValue, Halt> {
        self.stack.pop().ok_or_else(|| self.mismatch())
    }

    pub(super) fn objects(&mut self) -> Result<Vec<usize>, Halt> {
        match self.pop()? {
            ProgramValue::Objects(objects) => Ok(objects),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn object(&mut self) -> Result<usize, Halt> {
        match self.pop()? {
            ProgramValue::Object(object) => Ok(object),
            _ => Err(self.mismatch()),
        }
    }

    /// Objects, or one object.
    pub(super) fn any_objects(&mut self) -> Result<Vec<usize>, Halt> {
        match self.pop()? {
            ProgramValue::Objects(objects) => Ok(objects),
            ProgramValue::Object(object) => Ok(vec![object]),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn events(&mut self) -> Result<Vec<SceneEvent>, Halt> {
        match self.pop()? {
            ProgramValue::Events(events) => Ok(events),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn event(&mut self) -> Result<SceneEvent, Halt> {
        match self.pop()? {
            ProgramValue::Event(event) => Ok(event),
            _ => Err(self.mismatch()),
        }
    }

    /// The number of objects or events.
    pub(super) fn count(&mut self) -> Result<usize, Halt> {
        match self.pop()? {
            ProgramValue::Objects(objects) => Ok(objects.len()),
            ProgramValue::Events(events) => Ok(events.len()),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn word(&mut self) -> Result<&'static str, Halt> {
        match self.pop()? {
            ProgramValue::Word(word) => Ok(word),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn order(&mut self) -> Result<usize, Halt> {
        match self.pop()? {
            ProgramValue::Order(place) => Ok(place),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn factor(&mut self) -> Result<f64, Halt> {
        match self.pop()? {
            ProgramValue::Factor(factor) => Ok(factor),
            _ => Err(self.mismatch()),
        }
    }

    pub(super) fn bool(&mut self) -> Result<bool, Halt> {
        match self.pop()? {
            ProgramValue::Bool(value) => Ok(value),
            _ => Err(self.mismatch()),
        }
    }
}

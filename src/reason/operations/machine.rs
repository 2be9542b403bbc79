//! An operation, and what it works on: the stack, the rollout, and the change that is supposed.

use super::ops;
use crate::reason::ReasonError;
use crate::reason::context::{Halt, RolloutContext};
use crate::reason::events::SceneEvent;
use crate::reason::types::{Gives, Takes};
use crate::reason::value::{ProgramValue, SpanKind};
use crate::world::Intervention;

/// What an operation gives, or why the run ends.
pub type Outcome = Result<ProgramValue, Halt>;
/// The function of an operation.
pub type OperationFn = fn(&mut Machine) -> Outcome;

/// One operation of the language.
pub struct Operation {
    pub token: &'static str,
    /// Other tokens for it, in use by CLEVRER's programs and in Table 1 of Ding et al. (2021).
    pub aliases: &'static [&'static str],
    /// Operands, from the top of the stack.
    pub takes: &'static [Takes],
    pub gives: Gives,
    pub reads: &'static str,
    pub run: OperationFn,
    /// Whether it takes all changes on top of the stack.
    pub takes_all_changes: bool,
    /// Whether it also pops the events that it replaces.
    pub replaces_events: bool,
    /// Whether a moment may be on top of its operands.
    pub may_take_moment: bool,
}

impl PartialEq for Operation {
    fn eq(&self, other: &Operation) -> bool {
        self.token == other.token
    }
}

impl std::fmt::Debug for Operation {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.token)
    }
}

impl Operation {
    pub const fn of_changes(mut self, replaces_events: bool) -> Operation {
        self.takes_all_changes = true;
        self.replaces_events = replaces_events;
        self
    }

    pub const fn at_a_moment(mut self) -> Operation {
        self.may_take_moment = true;
        self
    }

    /// What it does in one line.
    pub fn line(&self) -> String {
        let names = self.takes.iter().enumerate();
        names.fold(self.reads.to_string(), |line, (k, (name, _))| line.replace(&format!("{{{k}}}"), name))
    }
}

/// The state of a run. The type check makes an operand of a wrong type unreachable from outside.
pub struct Machine<'a> {
    pub context: RolloutContext<'a>,
    pub stack: Vec<ProgramValue>,
    /// The operation under way.
    pub operation: Option<&'static Operation>,
    /// Describing words since the last `objects`, for messages.
    pub words: Vec<String>,
    /// What `suppose` has changed.
    pub supposed: Vec<Intervention>,
}

macro_rules! pops {
    ($($name:ident $variant:ident $kind:ty;)*) => {
        $(pub fn $name(&mut self) -> Result<$kind, Halt> {
            match self.pop()? {
                ProgramValue::$variant(value) => Ok(value),
                _ => Err(self.mismatch()),
            }
        })*
    };
}

impl Machine<'_> {
    pops! {
        objects Objects Vec<usize>;
        object Object usize;
        events Events Vec<SceneEvent>;
        event Event SceneEvent;
        span Span SpanKind;
        word Word String;
        order Order usize;
        factor Factor f64;
        boolean Bool bool;
    }

    pub fn token(&self) -> &'static str {
        self.operation.map_or("", |o| o.token)
    }

    /// A value of a wrong type.
    pub fn mismatch(&self) -> Halt {
        let (expected, found) = ("a checked program", format!("{} on a value of a wrong type", self.token()));
        Halt::Error(ReasonError::ProgramResult { expected, found })
    }

    pub fn pop(&mut self) -> Result<ProgramValue, Halt> {
        match self.stack.pop() {
            Some(ProgramValue::Undetermined(why)) => Err(Halt::Undetermined(why)),
            Some(value) => Ok(value),
            None => Err(self.mismatch()),
        }
    }

    /// Objects, or one object.
    pub fn any_objects(&mut self) -> Result<Vec<usize>, Halt> {
        match self.pop()? {
            ProgramValue::Objects(objects) => Ok(objects),
            ProgramValue::Object(object) => Ok(vec![object]),
            _ => Err(self.mismatch()),
        }
    }

    /// The number of objects or events.
    pub fn count(&mut self) -> Result<usize, Halt> {
        match self.pop()? {
            ProgramValue::Objects(objects) => Ok(objects.len()),
            ProgramValue::Events(events) => Ok(events.len()),
            _ => Err(self.mismatch()),
        }
    }

    /// Several changes; an object that stands by itself is removed.
    pub fn changes(&mut self) -> Result<Vec<Intervention>, Halt> {
        match self.pop()? {
            ProgramValue::Object(object) => {
                Ok(vec![Intervention::Remove { id: ops::id(self.context.scene, object)? }])
            }
            ProgramValue::Change(changes) => Ok(changes),
            _ => Err(self.mismatch()),
        }
    }

    /// The frame of a moment; `None` for any time.
    pub fn frame(&mut self) -> Result<Option<usize>, Halt> {
        let scene = self.context.scene;
        Ok(match self.pop()? {
            ProgramValue::Frame(frame) => frame,
            ProgramValue::Event(event) => Some(happened(event)?.frame),
            ProgramValue::Time(time) => Some(scene.frame_at(time)),
            ProgramValue::Factor(frame) => Some(frame as usize),
            _ => return Err(self.mismatch()),
        })
    }
}

/// An event that happened: one that did not has no time and no causes.
pub fn happened(event: SceneEvent) -> Result<SceneEvent, ReasonError> {
    match event.kind {
        crate::reason::events::SceneEventKind::Never => {
            Err(ReasonError::NoSingleEvent { found: "none".into() })
        }
        _ => Ok(event),
    }
}

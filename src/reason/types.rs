//! The types of values in programs, and what operations take and give.

/// Type of a value on the stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    Objects,
    Object,
    Events,
    Event,
    Frame,
    /// An instant (s).
    Time,
    /// A part of the time line: the video, the prediction, or both.
    Span,
    Color,
    Material,
    Shape,
    Side,
    Order,
    Factor,
    Law,
    /// A unit of a quantity.
    Unit,
    /// A word of a lexicon.
    Concept,
    Change,
    Text,
    Number,
    Bool,
    /// A number with a unit.
    Quantity,
    /// A plane vector with a unit.
    Vector,
}

impl Type {
    pub const ALL: [Type; 22] = [
        Type::Objects,
        Type::Object,
        Type::Events,
        Type::Event,
        Type::Frame,
        Type::Time,
        Type::Span,
        Type::Color,
        Type::Material,
        Type::Shape,
        Type::Side,
        Type::Order,
        Type::Factor,
        Type::Law,
        Type::Unit,
        Type::Concept,
        Type::Change,
        Type::Text,
        Type::Number,
        Type::Bool,
        Type::Quantity,
        Type::Vector,
    ];

    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Type::Objects => "objects",
            Type::Object => "an object",
            Type::Events => "events",
            Type::Event => "an event",
            Type::Frame => "a frame",
            Type::Time => "a time",
            Type::Span => "a span",
            Type::Color => "a color",
            Type::Material => "a material",
            Type::Shape => "a shape",
            Type::Side => "a side",
            Type::Order => "an order",
            Type::Factor => "a number",
            Type::Law => "a law",
            Type::Unit => "a unit",
            Type::Concept => "a word of the lexicon",
            Type::Change => "a change",
            Type::Text => "a text",
            Type::Number => "a count",
            Type::Bool => "yes or no",
            Type::Quantity => "a quantity",
            Type::Vector => "a vector",
        }
    }
}

/// One operand of an operation: how messages name it, and the types it may have.
pub type Takes = (&'static str, &'static [Type]);

/// What an operation leaves on the stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gives {
    One(Type),
    /// One object of objects, one event of events.
    OneOfOperand,
    /// Objects of objects, events of events.
    LikeOperand,
    /// Nothing: it sets what the following operations look at.
    Nothing,
}

pub const COLOR: Takes = ("a color", &[Type::Color, Type::Concept]);
pub const MATERIAL: Takes = ("a material", &[Type::Material, Type::Concept]);
pub const SHAPE: Takes = ("a shape", &[Type::Shape, Type::Concept]);
pub const CONCEPT: Takes =
    ("a word of the lexicon", &[Type::Concept, Type::Color, Type::Material, Type::Shape]);
pub const TABLE_SIDE: Takes = ("a side of the table", &[Type::Side]);
pub const DIRECTION: Takes = ("left, right, top or bottom", &[Type::Side]);
pub const ORDER: Takes = ("first, second or last", &[Type::Order]);
pub const LENGTH: Takes = ("a length", &[Type::Factor]);
pub const SECONDS: Takes = ("a number of seconds", &[Type::Factor]);
pub const FACTOR: Takes = ("a factor", &[Type::Factor]);
pub const NUMBER: Takes = ("a number", &[Type::Factor]);
pub const LAW: Takes = ("friction, object_friction or drag", &[Type::Law]);
pub const UNIT: Takes = ("a unit", &[Type::Unit]);
pub const YES_OR_NO: Takes = ("yes or no", &[Type::Bool]);
pub const OBJECT: Takes = ("an object", &[Type::Object]);
pub const OBJECTS: Takes = ("objects", &[Type::Objects]);
pub const ANY_OBJECTS: Takes = ("objects or an object", &[Type::Objects, Type::Object]);
pub const CHANGED: Takes = ("an object or a change", &[Type::Object, Type::Change]);
pub const OBJECTS_OR_EVENTS: Takes = ("objects or events", &[Type::Objects, Type::Events]);
pub const EVENT: Takes = ("an event", &[Type::Event]);
pub const EVENTS: Takes = ("events", &[Type::Events]);
/// A bare number is a frame.
pub const MOMENT: Takes =
    ("an event, a frame or a time", &[Type::Event, Type::Frame, Type::Time, Type::Factor]);
pub const SPAN: Takes = ("video, prediction or video_and_prediction", &[Type::Span]);
pub const CHOICE: Takes = ("the event or object of a choice", &[Type::Event, Type::Object]);
pub const QUANTITY: Takes = ("a quantity", &[Type::Quantity]);

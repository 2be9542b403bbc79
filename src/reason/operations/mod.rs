//! The operations of programs as one table: token, aliases, operands, result, reading and function. Adding one is a row and its
//! function.
//!
//! `reads` is the operation in English, with `{0}` for the operand on top of the stack, `{1}` for the one below.

mod changes;
mod estimates;
mod machine;
mod motion;
pub mod ops;
mod select;

pub use machine::{Machine, Operation};

use machine::OperationFn;

use super::types::{
    ANY_OBJECTS, CHANGED, CHOICE, COLOR, CONCEPT, DIRECTION, EVENT, EVENTS, FACTOR, Gives, LAW, LENGTH,
    MATERIAL, MOMENT, NUMBER, OBJECT, OBJECTS, OBJECTS_OR_EVENTS, ORDER, QUANTITY, SECONDS, SHAPE, SPAN,
    TABLE_SIDE, Takes, Type, UNIT, YES_OR_NO,
};

/// A row. Its aliases are lower case; tokens of a program are compared in lower case.
const fn row(
    [token, reads]: [&'static str; 2],
    aliases: &'static [&'static str],
    takes: &'static [Takes],
    gives: Gives,
    run: OperationFn,
) -> Operation {
    Operation {
        token,
        aliases,
        takes,
        gives,
        reads,
        run,
        takes_all_changes: false,
        replaces_events: false,
        may_take_moment: false,
    }
}

/// All operations.
pub static OPERATIONS: &[Operation] = &[
    row(["objects", "objects"], &[], &[], Gives::One(Type::Objects), select::all_objects),
    row(["events", "event of the video"], &[], &[], Gives::One(Type::Events), select::events),
    row(["all_events", "conceivable event"], &[], &[], Gives::One(Type::Events), select::all_events),
    row(
        ["unseen_events", "event after the video"],
        &["predictive_simulation"],
        &[],
        Gives::One(Type::Events),
        select::events,
    ),
    row(
        ["whole_events", "event of video and prediction"],
        &[],
        &[],
        Gives::One(Type::Events),
        select::events,
    ),
    row(["start", "the start of the video"], &[], &[], Gives::One(Type::Event), select::edge),
    row(["end", "the end of the video"], &[], &[], Gives::One(Type::Event), select::edge),
    row(["null", "any time"], &[], &[], Gives::One(Type::Frame), select::null),
    row(["object_number", "object {0}"], &[], &[NUMBER], Gives::One(Type::Object), select::object_number),
    row(["either", "{1} and {0}"], &[], &[OBJECT, OBJECT], Gives::One(Type::Objects), select::either),
    row(["pair", "the two {0}"], &[], &[OBJECTS], Gives::One(Type::Objects), select::pair),
    row(["unique", "the {0}"], &[], &[OBJECTS_OR_EVENTS], Gives::OneOfOperand, select::unique),
    row(["count", "number of: {0}"], &[], &[OBJECTS_OR_EVENTS], Gives::One(Type::Number), select::count),
    row(["exist", "is there: {0}?"], &[], &[OBJECTS_OR_EVENTS], Gives::One(Type::Bool), select::exist),
    row(["negate", "not: {0}"], &[], &[YES_OR_NO], Gives::One(Type::Bool), select::negate),
    row(
        ["belong_to", "is {1} among: {0}?"],
        &[],
        &[EVENTS, CHOICE],
        Gives::One(Type::Bool),
        select::belong_to,
    ),
    row(["filter_color", "{0} {1}"], &[], &[COLOR, OBJECTS], Gives::One(Type::Objects), select::filter_word),
    row(
        ["filter_material", "{0} {1}"],
        &[],
        &[MATERIAL, OBJECTS],
        Gives::One(Type::Objects),
        select::filter_word,
    ),
    row(["filter_shape", "{0} {1}"], &[], &[SHAPE, OBJECTS], Gives::One(Type::Objects), select::filter_word),
    row(
        ["filter_concept", "{0} {1}"],
        &[],
        &[CONCEPT, OBJECTS_OR_EVENTS],
        Gives::LikeOperand,
        select::filter_concept,
    )
    .at_a_moment(),
    row(
        ["filter_moving", "{1} that move at {0}"],
        &[],
        &[MOMENT, OBJECTS],
        Gives::One(Type::Objects),
        select::filter_motion,
    ),
    row(
        ["filter_stationary", "{1} that rest at {0}"],
        &[],
        &[MOMENT, OBJECTS],
        Gives::One(Type::Objects),
        select::filter_motion,
    ),
    row(
        ["filter_in", "entrance of {0}, {1}"],
        &[],
        &[ANY_OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_kind,
    ),
    row(
        ["filter_out", "exit of {0}, {1}"],
        &[],
        &[ANY_OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_kind,
    ),
    row(
        ["filter_collision", "collision of {0}, {1}"],
        &[],
        &[ANY_OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_kind,
    ),
    row(
        ["filter_side", "hit of the {0} side by {1}, {2}"],
        &[],
        &[TABLE_SIDE, ANY_OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_kind,
    ),
    row(
        ["filter_contact", "collision of {0} with an object or a side, {1}"],
        &[],
        &[ANY_OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_sides,
    ),
    row(
        ["filter_sides", "hit of a side by {0}, {1}"],
        &[],
        &[ANY_OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_sides,
    ),
    row(
        ["filter_among", "collision among {0}, {1}"],
        &[],
        &[OBJECTS, EVENTS],
        Gives::One(Type::Events),
        select::filter_among,
    ),
    row(
        ["filter_partner", "collision of {1} with one of {0}, {2}"],
        &[],
        &[OBJECTS, OBJECT, EVENTS],
        Gives::One(Type::Events),
        select::filter_partner,
    ),
    row(
        ["filter_before", "{1} before {0}"],
        &[],
        &[MOMENT, EVENTS],
        Gives::One(Type::Events),
        select::filter_time,
    ),
    row(
        ["filter_after", "{1} after {0}"],
        &[],
        &[MOMENT, EVENTS],
        Gives::One(Type::Events),
        select::filter_time,
    ),
    row(
        ["filter_start", "the start of the video"],
        &[],
        &[EVENTS],
        Gives::One(Type::Event),
        select::filter_edge,
    ),
    row(["filter_end", "the end of the video"], &[], &[EVENTS], Gives::One(Type::Event), select::filter_edge),
    row(
        ["filter_order", "the {0} {1}"],
        &[],
        &[ORDER, EVENTS],
        Gives::One(Type::Event),
        select::filter_order,
    ),
    row(
        ["filter_ancestor", "causes of {0}"],
        &[],
        &[EVENT, EVENTS],
        Gives::One(Type::Events),
        select::filter_ancestor,
    ),
    row(
        ["lost_events", "event of the video that is none of: {0}"],
        &[],
        &[EVENTS],
        Gives::One(Type::Events),
        select::lost_events,
    ),
    row(
        ["new_events", "{0}, and not in the video"],
        &[],
        &[EVENTS],
        Gives::One(Type::Events),
        select::new_events,
    ),
    row(
        ["get_frame", "frame of {0}"],
        &["query_frame"],
        &[EVENT],
        Gives::One(Type::Frame),
        select::get_frame,
    ),
    row(
        ["get_object", "the object of {0}"],
        &["query_object"],
        &[EVENT],
        Gives::One(Type::Object),
        select::get_object,
    ),
    row(
        ["get_col_partner", "what {0} meets in {1}"],
        &["query_collision_partner"],
        &[OBJECT, EVENT],
        Gives::One(Type::Object),
        select::get_partner,
    ),
    row(["participants", "objects of {0}"], &[], &[EVENTS], Gives::One(Type::Objects), select::participants),
    row(["query_color", "color of {0}"], &[], &[OBJECT], Gives::One(Type::Text), select::query),
    row(["query_material", "material of {0}"], &[], &[OBJECT], Gives::One(Type::Text), select::query),
    row(["query_shape", "shape of {0}"], &[], &[OBJECT], Gives::One(Type::Text), select::query),
    row(
        ["count_colors", "number of different colors of {0}"],
        &[],
        &[OBJECTS],
        Gives::One(Type::Number),
        select::count_distinct,
    ),
    row(
        ["count_materials", "number of different materials of {0}"],
        &[],
        &[OBJECTS],
        Gives::One(Type::Number),
        select::count_distinct,
    ),
    row(
        ["count_shapes", "number of different shapes of {0}"],
        &[],
        &[OBJECTS],
        Gives::One(Type::Number),
        select::count_distinct,
    ),
    row(
        ["filter_counterfact", "event of the video with the change: {0}"],
        &["get_counterfact", "counterfact_events", "counterfactual_simulation"],
        &[CHANGED],
        Gives::One(Type::Events),
        changes::counterfact,
    )
    .of_changes(true),
    row(["suppose", "with the change: {0}"], &[], &[CHANGED], Gives::Nothing, changes::suppose)
        .of_changes(false),
    row(["actual", "without a change"], &[], &[], Gives::Nothing, changes::actual),
    row(["remove", "without {0}"], &[], &[CHANGED], Gives::One(Type::Change), changes::remove),
    row(["apply_heavier", "{0} 5 times as heavy"], &[], &[CHANGED], Gives::One(Type::Change), changes::scale),
    row(
        ["apply_lighter", "{0} 0.2 times as heavy"],
        &[],
        &[CHANGED],
        Gives::One(Type::Change),
        changes::scale,
    ),
    row(
        ["scale_mass", "{1} {0} times as heavy"],
        &[],
        &[FACTOR, CHANGED],
        Gives::One(Type::Change),
        changes::scale,
    ),
    row(
        ["scale_velocity", "{1} {0} times as fast"],
        &[],
        &[FACTOR, CHANGED],
        Gives::One(Type::Change),
        changes::scale,
    ),
    row(
        ["scale_restitution", "{1} {0} times as bouncy"],
        &[],
        &[FACTOR, CHANGED],
        Gives::One(Type::Change),
        changes::scale,
    ),
    row(["at_rest", "{0} at rest"], &[], &[CHANGED], Gives::One(Type::Change), changes::scale),
    row(
        ["reverse", "{0} in the opposite direction"],
        &[],
        &[CHANGED],
        Gives::One(Type::Change),
        changes::scale,
    ),
    row(
        ["shift", "{2} {1} m further to the {0}"],
        &[],
        &[DIRECTION, LENGTH, CHANGED],
        Gives::One(Type::Change),
        changes::shift,
    ),
    row(
        ["add_another", "another of the {3} {1} m to the {0} of {2}"],
        &[],
        &[DIRECTION, LENGTH, OBJECT, OBJECTS],
        Gives::One(Type::Change),
        changes::add_another,
    ),
    row(["apply", "{1} {0}"], &[], &[CONCEPT, CHANGED], Gives::One(Type::Change), changes::apply_word),
    row(["switch_off", "no {0}"], &[], &[LAW], Gives::One(Type::Change), changes::switch_off),
    row(["both", "{1} and {0}"], &[], &[CHANGED, CHANGED], Gives::One(Type::Change), changes::both),
    row(
        ["difference_made", "what differs from the video among: {0}"],
        &[],
        &[EVENTS],
        Gives::One(Type::Text),
        estimates::difference_made,
    ),
    row(["at_frame", "frame {0}"], &[], &[NUMBER], Gives::One(Type::Frame), motion::at_frame),
    row(["at_time", "{0} s"], &[], &[SECONDS], Gives::One(Type::Time), motion::at_time),
    row(["later", "{0} s after {1}"], &[], &[SECONDS, MOMENT], Gives::One(Type::Time), motion::offset),
    row(["earlier", "{0} s before {1}"], &[], &[SECONDS, MOMENT], Gives::One(Type::Time), motion::offset),
    row(["just_before", "just before {0}"], &[], &[EVENT], Gives::One(Type::Time), motion::beside_event),
    row(["just_after", "just after {0}"], &[], &[EVENT], Gives::One(Type::Time), motion::beside_event),
    row(["get_time", "time of {0}"], &[], &[EVENT], Gives::One(Type::Time), motion::get_time),
    row(
        ["until", "time from the end of the video to {0}"],
        &[],
        &[EVENT],
        Gives::One(Type::Quantity),
        motion::until,
    ),
    row(
        ["position", "position of {1} at {0}"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Vector),
        motion::position,
    ),
    row(
        ["velocity", "velocity of {1} at {0}"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Vector),
        motion::velocity,
    ),
    row(["speed", "speed of {1} at {0}"], &[], &[MOMENT, OBJECT], Gives::One(Type::Quantity), motion::speed),
    row(
        ["acceleration", "acceleration of {1} at {0}"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Quantity),
        motion::acceleration,
    ),
    row(
        ["direction", "direction of motion of {1} at {0}, from the x axis"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Quantity),
        motion::direction,
    ),
    row(["spin", "spin of {1} at {0}"], &[], &[MOMENT, OBJECT], Gives::One(Type::Quantity), motion::spin),
    row(
        ["kinetic_energy", "kinetic energy of {1} at {0}"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Quantity),
        estimates::kinetic_energy,
    ),
    row(
        ["momentum", "momentum of {1} at {0}"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Vector),
        estimates::momentum,
    ),
    row(
        ["is_moving", "does {1} move at {0}?"],
        &[],
        &[MOMENT, OBJECT],
        Gives::One(Type::Bool),
        motion::is_moving,
    ),
    row(
        ["moves", "does {1} ever move in the {0}?"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Bool),
        motion::moves,
    ),
    row(
        ["distance", "distance of the centres of {2} and {1} at {0}"],
        &[],
        &[MOMENT, OBJECT, OBJECT],
        Gives::One(Type::Quantity),
        motion::distance,
    ),
    row(
        ["separation", "distance of the centres of {1} at {0}"],
        &[],
        &[MOMENT, OBJECTS],
        Gives::One(Type::Quantity),
        motion::separation,
    ),
    row(
        ["path_length", "path of {1} in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::path_length,
    ),
    row(
        ["displacement", "distance from start to end of {1} in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::displacement,
    ),
    row(
        ["top_speed", "top speed of {1} in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::speed_over,
    ),
    row(
        ["least_speed", "least speed of {1} in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::speed_over,
    ),
    row(
        ["mean_speed", "mean speed of {1} in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::speed_over,
    ),
    row(
        ["closest_distance", "least distance of the centres of {2} and {1} in the {0}"],
        &[],
        &[SPAN, OBJECT, OBJECT],
        Gives::One(Type::Quantity),
        motion::closest_distance,
    ),
    row(
        ["closest_time", "time at which {2} and {1} are closest in the {0}"],
        &[],
        &[SPAN, OBJECT, OBJECT],
        Gives::One(Type::Time),
        motion::closest_time,
    ),
    row(
        ["path_after", "path of {1} from {0} until it rests or collides again"],
        &[],
        &[EVENT, OBJECT],
        Gives::One(Type::Quantity),
        motion::path_after,
    ),
    row(
        ["start_time", "time at which {1} starts to move in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Time),
        motion::motion_time,
    ),
    row(
        ["stop_time", "time at which {1} comes to rest in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Time),
        motion::motion_time,
    ),
    row(
        ["stops", "does {1} come to rest in the {0}?"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Bool),
        motion::stops,
    ),
    row(
        ["moving_duration", "time that {1} moves in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::motion_duration,
    ),
    row(
        ["resting_duration", "time that {1} rests in the {0}"],
        &[],
        &[SPAN, OBJECT],
        Gives::One(Type::Quantity),
        motion::motion_duration,
    ),
    row(
        ["speed_lost", "speed that {0} loses, by the frames before and after {1}"],
        &[],
        &[OBJECT, EVENT],
        Gives::One(Type::Quantity),
        motion::speed_lost,
    ),
    row(
        ["fastest", "the fastest of {1} at {0}"],
        &[],
        &[MOMENT, OBJECTS],
        Gives::One(Type::Object),
        motion::extreme,
    ),
    row(
        ["slowest", "the slowest of {1} at {0}"],
        &[],
        &[MOMENT, OBJECTS],
        Gives::One(Type::Object),
        motion::extreme,
    ),
    row(
        ["farthest", "the one of {1} with the longest path in the {0}"],
        &[],
        &[SPAN, OBJECTS],
        Gives::One(Type::Object),
        motion::extreme,
    ),
    row(
        ["least_far", "the one of {1} with the shortest path in the {0}"],
        &[],
        &[SPAN, OBJECTS],
        Gives::One(Type::Object),
        motion::extreme,
    ),
    row(
        ["first_to_stop", "the first of {1} to stop in the {0}"],
        &[],
        &[SPAN, OBJECTS],
        Gives::One(Type::Object),
        motion::extreme,
    ),
    row(
        ["is_heavier", "is {1} heavier than {0}?"],
        &[],
        &[OBJECT, OBJECT],
        Gives::One(Type::Bool),
        estimates::is_heavier,
    ),
    row(["heaviest", "the heaviest of {0}"], &[], &[OBJECTS], Gives::One(Type::Object), estimates::by_mass),
    row(["lightest", "the lightest of {0}"], &[], &[OBJECTS], Gives::One(Type::Object), estimates::by_mass),
    row(["mass", "mass of {0}"], &[], &[OBJECT], Gives::One(Type::Quantity), estimates::mass),
    row(
        ["mass_ratio", "mass of {1} over mass of {0}"],
        &[],
        &[OBJECT, OBJECT],
        Gives::One(Type::Quantity),
        estimates::mass_ratio,
    ),
    row(
        ["restitution", "coefficient of restitution of {0}"],
        &[],
        &[OBJECT],
        Gives::One(Type::Quantity),
        estimates::restitution,
    ),
    row(
        ["friction_of", "coefficient of friction of {0}"],
        &[],
        &[OBJECT],
        Gives::One(Type::Quantity),
        estimates::coefficient,
    ),
    row(
        ["drag_of", "coefficient of drag of {0}"],
        &[],
        &[OBJECT],
        Gives::One(Type::Quantity),
        estimates::coefficient,
    ),
    row(
        ["why_moved", "what set {0} in motion"],
        &[],
        &[OBJECT],
        Gives::One(Type::Text),
        estimates::why_moved,
    ),
    row(
        ["greater", "is {1} greater than {0}?"],
        &[],
        &[QUANTITY, QUANTITY],
        Gives::One(Type::Bool),
        estimates::greater,
    ),
    row(
        ["difference", "{1} minus {0}"],
        &[],
        &[QUANTITY, QUANTITY],
        Gives::One(Type::Quantity),
        estimates::difference,
    ),
    row(["ratio", "{1} over {0}"], &[], &[QUANTITY, QUANTITY], Gives::One(Type::Quantity), estimates::ratio),
    row(["of_unit", "{1} {0}"], &[], &[UNIT, NUMBER], Gives::One(Type::Quantity), estimates::of_unit),
    row(["in_unit", "{1} in {0}"], &[], &[UNIT, QUANTITY], Gives::One(Type::Quantity), estimates::in_unit),
    row(
        ["fit_error", "root mean square error of the fit"],
        &[],
        &[],
        Gives::One(Type::Quantity),
        estimates::fit_error,
    ),
    row(["missing_part", "what the model lacks"], &[], &[], Gives::One(Type::Text), estimates::missing_part),
    row(
        ["is_unexplained", "does the model leave more than the noise explains?"],
        &[],
        &[],
        Gives::One(Type::Bool),
        estimates::is_unexplained,
    ),
];

/// The operation with this token or alias.
pub fn operation(token: &str) -> Option<&'static Operation> {
    OPERATIONS.iter().find(|o| o.token == token || o.aliases.contains(&token))
}

/// "(an event, events) -> events", operands from the bottom of the stack.
pub fn signature_words(operation: &Operation) -> String {
    let mut operands: Vec<&str> = operation.takes.iter().rev().map(|(name, _)| *name).collect();
    if operation.may_take_moment {
        operands.push("optionally an event, a frame or a time");
    }
    let result = match operation.gives {
        Gives::One(kind) => kind.name(),
        Gives::OneOfOperand => "an object or an event",
        Gives::LikeOperand => "objects or events",
        Gives::Nothing => "nothing",
    };
    format!("({}) -> {result}", operands.join(", "))
}

/// An operation as clients see it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OperationInfo {
    pub name: &'static str,
    pub aliases: &'static [&'static str],
    pub signature: String,
    /// What it gives.
    pub line: String,
    /// A program that uses it, if a question of the reader does.
    pub example: Option<String>,
}

/// All operations. `examples`: programs from which each operation takes the first that uses it.
pub fn list_operations(examples: &[Vec<String>]) -> Vec<OperationInfo> {
    let example = |o: &Operation| {
        let uses =
            |tokens: &&Vec<String>| tokens.iter().any(|t| t == o.token || o.aliases.contains(&t.as_str()));
        examples.iter().find(uses).map(|tokens| tokens.join(" "))
    };
    let info = |o: &Operation| OperationInfo {
        name: o.token,
        aliases: o.aliases,
        signature: signature_words(o),
        line: o.line(),
        example: example(o),
    };
    OPERATIONS.iter().map(info).collect()
}

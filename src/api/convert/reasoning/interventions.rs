//! Interventions: messages to domain values.

use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::engine::MAX_SPEED;
use crate::scene::{MASS_RANGE, MAX_NAME, MAX_POSITION, SIZE_RANGE, Shape};
use crate::world::{BodySpec, FACTORS, Intervention, Start, State};

/// Largest yaw (rad): beyond it an `f64` resolves angles too coarsely.
const MAX_ANGLE: f64 = 1e6;
/// Latest start of an added object (s): later than the end of any video.
const MAX_TIME: f64 = 1e7;

/// The intervention of a message; `None` where it names no kind.
pub fn intervention(r: &mut Violations, path: &str, given: v1::Intervention) -> Option<Intervention> {
    use v1::intervention::Kind;
    let Some(kind) = given.kind else {
        r.add(path, "is empty or unknown; say what to do");
        return None;
    };
    Some(match kind {
        Kind::Remove(g) => Intervention::Remove { id: g.object_id },
        Kind::ScaleMass(g) => {
            let factor = r.range(&format!("{path}.scale_mass.factor"), g.factor, FACTORS, "");
            Intervention::ScaleMass { id: g.object_id, factor }
        }
        Kind::SetVelocity(g) => {
            let velocity = r.vector(&format!("{path}.set_velocity.velocity"), g.velocity, MAX_SPEED, "m/s");
            Intervention::SetVelocity { id: g.object_id, velocity }
        }
        Kind::Place(g) => {
            let position = r.vector(&format!("{path}.place.position"), g.position, MAX_POSITION, "m");
            let turned = [-MAX_ANGLE, MAX_ANGLE];
            let yaw = g.yaw.map(|yaw| r.range(&format!("{path}.place.yaw"), yaw, turned, "rad"));
            Intervention::Place { id: g.object_id, position, yaw }
        }
        Kind::Add(g) => {
            let at = |field: &str| format!("{path}.add.{field}");
            let shape = r.shape(&at("shape"), g.shape);
            for (size, length) in lengths(&shape) {
                r.range(&at(&format!("shape.{size}")), length, SIZE_RANGE, "m");
            }
            let mass = r.range(&at("mass"), g.mass.unwrap_or(1.0), MASS_RANGE, "kg");
            if g.material.len() > MAX_NAME {
                r.add(at("material"), format!("has {} bytes; at most {MAX_NAME}", g.material.len()));
            }
            let velocity = Some(g.velocity.unwrap_or_default());
            let state = State {
                position: r.vector(&at("position"), g.position, MAX_POSITION, "m"),
                yaw: r.range(&at("yaw"), g.yaw, [-MAX_ANGLE, MAX_ANGLE], "rad"),
                velocity: r.vector(&at("velocity"), velocity, MAX_SPEED, "m/s"),
                ..State::default()
            };
            let time = r.range(&at("start_time"), g.start_time, [-MAX_TIME, MAX_TIME], "s");
            let start = Start { time, state, rolling: shape.is_ball() };
            Intervention::Add { body: BodySpec { id: g.object_id, material: g.material, shape, mass, start } }
        }
        Kind::ScaleRestitution(g) => {
            let range = [0.0, FACTORS[1]];
            let factor = r.range(&format!("{path}.scale_restitution.factor"), g.factor, range, "");
            Intervention::ScaleRestitution { id: g.object_id, factor }
        }
        Kind::ScaleFriction(g) => {
            let range = [0.0, FACTORS[1]];
            let factor = r.range(&format!("{path}.scale_friction.factor"), g.factor, range, "");
            Intervention::ScaleFriction { id: g.object_id, factor }
        }
        Kind::ScaleVelocity(g) => {
            let range = [-FACTORS[1], FACTORS[1]];
            let factor = r.range(&format!("{path}.scale_velocity.factor"), g.factor, range, "");
            Intervention::ScaleVelocity { id: g.object_id, factor }
        }
        Kind::Shift(g) => {
            let by = r.vector(&format!("{path}.shift.by"), g.by, MAX_POSITION, "m");
            Intervention::Shift { id: g.object_id, by }
        }
        Kind::SwitchEffect(g) => Intervention::SwitchEffect { name: g.effect, on: g.on },
    })
}

/// Lengths of a shape by their fields.
fn lengths(shape: &Shape) -> Vec<(&'static str, f64)> {
    match *shape {
        Shape::Disc { radius } => vec![("disc.radius", radius)],
        Shape::Ball { radius } => vec![("ball.radius", radius)],
        Shape::Square { half_side } => vec![("square.half_side", half_side)],
        Shape::Rectangle { half_length, half_width } => {
            vec![("rectangle.half_length", half_length), ("rectangle.half_width", half_width)]
        }
    }
}

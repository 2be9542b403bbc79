//! What something unseen does to the objects of a video, in words: impulses of unknown origin, those at the ends of a span as one.

use crate::num::Vec2;
use crate::world::model::Model;
use crate::world::unknown_impulse::UnknownImpulse;
use serde::{Deserialize, Serialize};

/// Something unseen that acts on one object: at one time, or from one time to another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UnseenPush {
    /// The object's id.
    pub id: u32,
    /// s; equal where it acts at one time.
    pub from: f64,
    pub until: f64,
    /// The last frame before each.
    pub frames: [usize; 2],
    /// Change of the velocity, from before to after (m/s).
    pub velocity: Vec2,
    /// Change of the rate of turn (rad/s).
    pub spin: f64,
}

impl UnseenPush {
    /// What it does, in words: `object 2 is pushed by something unseen at frame 57: by 0.31 m/s towards -x`.
    pub fn sentence(&self) -> String {
        let [first, last] = self.frames;
        let when =
            if first == last { format!("at frame {first}") } else { format!("from frame {first} to {last}") };
        let what = if first == last { "pushed" } else { "held or pushed" };
        let (speed, id) = (self.velocity.norm(), self.id);
        format!(
            "object {id} is {what} by something unseen {when}: its velocity changes by {speed:.2} m/s towards {}",
            direction(self.velocity)
        )
    }
}

/// The nearest of the eight directions along and between the axes.
fn direction(v: Vec2) -> String {
    let sign = |along: f64, axis: &str| match along.abs() > SIN_PI_8 * v.norm() {
        true => format!("{}{axis}", if along < 0.0 { '-' } else { '+' }),
        false => String::new(),
    };
    [sign(v.x, "x"), sign(v.y, "y")].into_iter().filter(|s| !s.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Sine of half the angle between two of the eight directions.
const SIN_PI_8: f64 = 0.382_683_432_365_089_8;

impl Model {
    /// Whether a measurement of an object at this time (s) does not count, as something unseen holds or pushes the object.
    pub fn passes_over(&self, id: u32, time: f64) -> bool {
        let within =
            |i: &UnknownImpulse| i.id == id && i.until.is_some_and(|end| i.time < time && time < end);
        self.impulses.iter().any(within)
    }

    /// What unseen things do, in order of time.
    pub fn unseen_pushes(&self) -> Vec<UnseenPush> {
        let ends = |i: &UnknownImpulse| {
            self.impulses.iter().any(|s| s.id == i.id && s.until == Some(i.time) && s.time < i.time)
        };
        let of = |i: &UnknownImpulse| {
            let end = i.until.and_then(|end| {
                self.impulses.iter().find(|e| e.id == i.id && e.time == end && e.until.is_none())
            });
            UnseenPush {
                id: i.id,
                from: if end.is_some() { i.time } else { i.acts_at() },
                until: end.map_or(i.acts_at(), |e| e.time),
                frames: [i.frame, end.map_or(i.frame, |e| e.frame)],
                velocity: end.map_or(i.velocity, |e| i.velocity + e.velocity),
                spin: end.map_or(i.spin, |e| i.spin + e.spin),
            }
        };
        let mut pushes: Vec<UnseenPush> = self.impulses.iter().filter(|i| !ends(i)).map(of).collect();
        pushes.sort_by(|a, b| a.from.total_cmp(&b.from).then(a.id.cmp(&b.id)));
        pushes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model};
    use crate::world::unknown_impulse::tests::impulse;

    const DISC: Shape = Shape::Disc { radius: 0.1 };

    #[test]
    fn two_impulses_at_the_ends_of_a_span_are_one_push_and_what_is_between_does_not_count() {
        let mut pushed = model(vec![body(1, DISC, vec2(0.0, 0.0), vec2(1.0, 0.0))], &[]);
        let begins = UnknownImpulse { until: Some(0.9), ..impulse(1, 0.5, vec2(-0.4, 0.0)) };
        let ends = UnknownImpulse { frame: 22, ..impulse(1, 0.9, vec2(0.1, 0.0)) };
        pushed.impulses = vec![ends, begins];
        let [push] = pushed.unseen_pushes()[..] else { panic!("{:?}", pushed.unseen_pushes()) };
        assert_eq!((push.frames, push.from, push.until), ([12, 22], 0.5, 0.9));
        assert_eq!(
            push.sentence(),
            "object 1 is held or pushed by something unseen from frame 12 to 22: its velocity changes by 0.30 m/s towards -x"
        );
        let counts = |time: f64| !pushed.passes_over(1, time);
        assert_eq!([0.4, 0.5, 0.7, 0.9].map(counts), [true, true, false, true]);
        assert!(!pushed.passes_over(2, 0.7), "another object");
    }
}

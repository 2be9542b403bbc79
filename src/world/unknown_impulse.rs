//! An impulse of unknown origin: something that was not observed (a hand, a kick) changes the motion of one body at one time.
//!
//! It is a nuisance of one video: its numbers are fitted with those of the start states, so that the simulation follows what comes
//! after it. One that lasts is two impulses, at its start and at its end, whose measurements in between do not count: position and
//! velocity at the end are then free.

use crate::num::{Real, Vec2, vec2};
use serde::{Deserialize, Serialize};

/// Numbers that describe one impulse in [`crate::world::Model::flatten`], in this order; they follow those of the effects.
pub const IMPULSE_VALUES: [&str; 4] = ["vx", "vy", "spin", "delay"];

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UnknownImpulse {
    /// The object's id.
    pub id: u32,
    /// s.
    pub time: f64,
    /// The last frame of the video before it acts.
    pub frame: usize,
    /// Its other end (s), where it lasts: the object's measurements between `time` and here do not count. The impulse at the other
    /// end has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<f64>,
    /// Change of the velocity (m/s).
    pub velocity: Vec2,
    /// Change of the rate of turn about z (rad/s).
    pub spin: f64,
    /// How long after `time` it acts (s), to first order.
    pub delay: f64,
    /// Prior standard deviations of the numbers above.
    pub velocity_sd: f64,
    pub spin_sd: f64,
    pub delay_sd: f64,
}

impl UnknownImpulse {
    /// When it acts (s).
    pub fn acts_at(&self) -> f64 {
        self.time + self.delay
    }

    pub(in crate::world) fn values(&self) -> [f64; 4] {
        [self.velocity.x, self.velocity.y, self.spin, self.delay]
    }

    pub(in crate::world) fn set_values(&mut self, [x, y, spin, delay]: [f64; 4]) {
        (self.velocity, self.spin, self.delay) = (vec2(x, y), spin, delay);
    }
}

/// Numbers of one impulse, in the order of [`IMPULSE_VALUES`].
#[derive(Clone, Copy)]
pub(in crate::world) struct ImpulseValues<T> {
    pub velocity: Vec2<T>,
    pub spin: T,
    pub delay: T,
}

impl<T: Real> ImpulseValues<T> {
    /// Those of impulse `which`, from the numbers `flat` of a model of so many impulses.
    pub fn of(flat: &[T], which: usize, impulses: usize) -> Self {
        let first = flat.len() - IMPULSE_VALUES.len() * (impulses - which);
        let [x, y, spin, delay] = [0, 1, 2, 3].map(|k| flat[first + k]);
        ImpulseValues { velocity: Vec2 { x, y }, spin, delay }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::num::{Differential, Jet};
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::{Model, SimulationLimits, simulate, trace};

    const DISC: Shape = Shape::Disc { radius: 0.1 };

    pub fn impulse(id: u32, time: f64, velocity: Vec2) -> UnknownImpulse {
        UnknownImpulse {
            id,
            time,
            frame: 12,
            until: None,
            velocity,
            spin: 0.0,
            delay: 0.0,
            velocity_sd: 1.0,
            spin_sd: 0.0,
            delay_sd: 0.02,
        }
    }

    /// One moves without friction, one rests on ground that would hold it, and one is not in the model.
    #[test]
    fn a_push_changes_the_velocity_at_its_time_and_wakes_a_body_at_rest() {
        let bodies = vec![
            body(1, DISC, vec2(0.0, 0.0), vec2(1.0, 0.0)),
            body(2, DISC, vec2(0.0, 2.0), vec2(0.0, 0.0)),
        ];
        let mut pushed = model(bodies, &[("sliding_friction", &[0.01])]);
        let (mu_g, change) = (0.01 * crate::body::GRAVITY, vec2(0.0, 0.5));
        pushed.impulses =
            vec![impulse(1, 0.5, vec2(-0.4, 0.0)), impulse(2, 0.5, change), impulse(7, 0.5, change)];
        pushed.impulses[0].delay = 0.01;
        let run = trace(&pushed, &seconds(25));
        let at = |body: usize| run.states[25][body].expect("present");
        // The push comes a hundredth of a second later: until then the way is that of before.
        let before = 1.0 - mu_g * 0.5;
        let x = 0.5 - 0.5 * mu_g * 0.25 + 0.4 * 0.01 + (before - 0.4) * 0.5 - 0.5 * mu_g * 0.25;
        assert!((at(0).position.x - x).abs() < 1e-9, "{:?} {x}", at(0));
        let y = 2.0 + 0.5 * 0.5 - 0.5 * mu_g * 0.25;
        assert!(
            (at(1).position.y - y).abs() < 1e-9 && (at(1).velocity.y - 0.5 + mu_g * 0.5).abs() < 1e-9,
            "{:?}",
            at(1)
        );
    }

    #[test]
    fn the_numbers_of_a_push_have_derivatives() {
        let mut pushed =
            model(vec![body(1, DISC, vec2(0.0, 0.0), vec2(1.0, 0.0))], &[("linear_drag", &[0.3])]);
        pushed.impulses = vec![impulse(1, 0.5, vec2(-0.4, 0.2))];
        let end = |m: &Model| trace(m, &seconds(25)).states[25][0].expect("present").position;
        let first = pushed.flat_len() - IMPULSE_VALUES.len();
        for k in [0, 1, 3] {
            let mut flat: Vec<Jet> = pushed.flatten().into_iter().map(Jet::constant).collect();
            flat[first + k] = flat[first + k].with_derivative(0, 1.0);
            let run = simulate(&pushed, &flat, &seconds(25), &SimulationLimits::default());
            let exact = run.states[25][0].expect("present").position;
            let step = 1e-5;
            let mut values = pushed.flatten();
            values[first + k] += step;
            let there = end(&pushed.with_values(&values));
            values[first + k] -= 2.0 * step;
            let slope = (there - end(&pushed.with_values(&values))).scaled(0.5 / step);
            let derivative = vec2(exact.x.derivative(0), exact.y.derivative(0));
            assert!((slope - derivative).norm() < 1e-7, "{k}: {slope:?} {derivative:?}");
        }
    }
}

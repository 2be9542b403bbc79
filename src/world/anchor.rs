//! Anchors: where a simulation is put right by what was observed.

use super::model::Model;
use super::motion::Mode;
use super::simulate::Run;
use crate::effects::Scalar;
use crate::num::Vec2;
use serde::{Deserialize, Serialize};

/// At `time` a body is moved by this much: an error that the model has made until then goes no further. A body that
/// touches another is left alone, and one that rests keeps resting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StateCorrection {
    /// The object's id.
    pub id: u32,
    /// s.
    pub time: f64,
    /// m.
    pub position: Vec2,
    /// m/s; a ball's roll goes with it.
    pub velocity: Vec2,
    /// rad.
    pub yaw: f64,
    /// rad/s about z.
    pub spin: f64,
}

impl Model {
    /// Times at which bodies come in or are put right (s), increasing.
    pub(super) fn cuts(&self) -> Vec<f64> {
        let starts = self.bodies.iter().map(|b| b.start.time);
        let mut cuts: Vec<f64> = starts.chain(self.corrections.iter().map(|a| a.time)).collect();
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
        cuts
    }
}

impl<T: Scalar> Run<'_, T> {
    /// Applies the corrections of this time.
    pub(super) fn apply_corrections(&mut self, time: f64) {
        let model = self.model;
        for anchor in model.corrections.iter().filter(|a| a.time == time) {
            let Some(i) = model.body_index(anchor.id) else { continue };
            let touches = self.touching.iter().any(|t| t.a == i || t.b == i) || self.cluster(i).is_some();
            let radius = self.laws.shapes[i].bounding_radius();
            let body = &mut self.bodies[i];
            if touches || body.mode == Mode::Absent {
                continue;
            }
            body.from.position += Vec2::constant(anchor.position);
            body.from.yaw += T::constant(anchor.yaw);
            if body.mode != Mode::Rest {
                let velocity = Vec2::constant(anchor.velocity);
                body.from.velocity += velocity;
                body.from.spin += T::constant(anchor.spin);
                if model.bodies[i].shape.is_ball() {
                    body.from.roll += velocity.perp().scaled(1.0 / radius);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::StateCorrection;
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;

    /// Coulomb friction slows a disc that does not spin by mu g.
    #[test]
    fn a_body_goes_on_from_its_anchor_and_one_at_rest_keeps_resting() {
        let (disc, mu) = (Shape::Disc { radius: 0.1 }, 0.01);
        let bodies = vec![
            body(1, disc, vec2(0.0, 0.0), vec2(1.0, 0.0)),
            body(2, disc, vec2(0.0, 2.0), vec2(0.0, 0.0)),
        ];
        let plain = model(bodies, &[("sliding_friction", &[mu])]);
        let anchor = |id| StateCorrection {
            id,
            time: 1.0,
            position: vec2(0.1, 0.0),
            velocity: vec2(-0.5, 0.0),
            yaw: 0.2,
            spin: 0.0,
        };
        let mut anchored = plain.clone();
        anchored.corrections = vec![anchor(1), anchor(2), anchor(9)];
        let (before, after) = (trace(&plain, &seconds(35)), trace(&anchored, &seconds(35)));
        for (a, b) in before.states[..=25].iter().flatten().zip(after.states[..=25].iter().flatten()) {
            let (a, b) = (a.expect("there"), b.expect("there"));
            assert!(
                (a.position - b.position).norm() + (a.velocity - b.velocity).norm() < 1e-12,
                "{a:?} {b:?}"
            );
        }
        let (state, rest) = (after.states[35][0].expect("there"), after.states[35][1].expect("there"));
        let (brake, later) = (9.81 * mu, 0.4);
        let x = 1.0 - 0.5 * brake + 0.1 + (1.0 - brake - 0.5) * later - 0.5 * brake * later * later;
        assert!((state.position.x - x).abs() < 1e-9 && (state.yaw - 0.2).abs() < 1e-9, "{state:?} {x}");
        assert_eq!((rest.position, rest.velocity), (vec2(0.1, 2.0), vec2(0.0, 0.0)));
    }
}

//! The impulse of one contact on the bodies of a simulation, and its record.

use crate::body::ContactLaw;
use crate::effects::Scalar;
use crate::world::contact::geometry::Proximity;
use crate::world::contact::impulse::{apply_contact_impulse, apply_cushion_impulse};
use crate::world::contact::rigid_cluster::merge_velocities;
use crate::world::motion::ground_friction::Mode;
use crate::world::simulation::state::Simulation;
use crate::world::trace::{Event, EventKind};

impl<T: Scalar> Simulation<'_, T> {
    /// Applies the impulse of the contact between `a` and `b` at `time` (s), records it, and returns the contact's law.
    pub(in crate::world) fn apply_impulse(
        &mut self,
        time: f64,
        a: usize,
        b: usize,
        near: &Proximity<T>,
    ) -> ContactLaw<T> {
        let approach = self.approach_at(a, b, near);
        let mut law = self.contact_law(a, b, near, approach);
        law.restitution = self.restitution(&law, a, b, near, approach);
        let mut side_a = self.collision_body(a);
        let mut side_b = self.collision_body(b);
        let mut impulse = match side_a.ball {
            Some(radius) if b >= self.bodies.len() => apply_cushion_impulse(&mut side_a, radius, near, &law),
            _ => apply_contact_impulse(&mut side_a, &mut side_b, near, &law),
        };
        if b < self.bodies.len() && (law.stick.value() != 0.0 || !law.stick.is_constant()) {
            let rebound = side_b.kinematics.velocity;
            merge_velocities(&mut side_a, &mut side_b, law.stick.min(T::constant(1.0)));
            impulse += near.normal.dot(side_b.kinematics.velocity - rebound) / side_b.inverse_mass;
        }
        // Without presence only the derivatives change.
        let is_present = law.presence.value() > 0.0;
        for (i, side) in [(a, side_a), (b, side_b)] {
            if i < self.bodies.len() {
                self.set_motion(i, side.kinematics, is_present.then_some(Mode::Slide));
            }
        }
        if is_present {
            self.record_collision(time, a, b, near, impulse.value());
        }
        law
    }

    fn record_collision(&mut self, time: f64, a: usize, b: usize, near: &Proximity<T>, impulse: f64) {
        let id = |i: usize| self.model.bodies.get(i).map(|body| body.id);
        let wall = self.walls.get(b.wrapping_sub(self.bodies.len())).map(|w| w.name.clone());
        self.recorder.record_collision(Event {
            kind: EventKind::Collision,
            time,
            objects: [id(a), id(b)].into_iter().flatten().collect(),
            position: (near.on_a + near.on_b).scaled(0.5).value(),
            normal: Some(near.normal.value()),
            impulse: Some(impulse),
            wall,
        });
    }
}

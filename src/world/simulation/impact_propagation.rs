//! Propagation of an impulse through bodies in contact, and its reflection at what does not move.
//!
//! An impact on a body that touches others acts on these at the same instant. It is resolved as a sequence of pairwise impulses
//! (sequential impulses): each round applies the impulse of every closed contact whose surfaces still approach,
//! until none approaches faster than a limit (m/s) or [`MAX_ROUNDS`] are over. A body between an impact and a wall must in addition
//! separate from the other body with the restitution of their contact ([`Simulation::enforce_separation`]). Source: Smith, Kaufman,
//! Vouga, Tamstorf and Grinspun, Reflections on Simultaneous Impact, ACM Transactions on Graphics 31 (2012) 106.

use crate::effects::Scalar;
use crate::world::contact::geometry::Proximity;
use crate::world::contact::impulse::push_apart;
use crate::world::contact::persistent_contact::PersistentContact;
use crate::world::motion::ground_friction::Mode;
use crate::world::simulation::facing::{CLOSED, REBOUND_SPEED};
use crate::world::simulation::state::Simulation;

/// Largest number of rounds of impulses at one impact.
const MAX_ROUNDS: usize = 64;
/// Approach speed above which an impact propagates (m/s).
pub(in crate::world) const IMPACT_SPEED: f64 = 1e-7;
/// The same while a contact lasts, whose forces resolve what is slower (m/s).
pub(in crate::world) const CONTACT_SPEED: f64 = 1e-4;

impl<T: Scalar> Simulation<'_, T> {
    /// Adds persistent contacts between two colliding bodies and the walls that they touch.
    pub(in crate::world) fn add_wall_contacts(&mut self, a: usize, b: usize) {
        let bodies = self.bodies.len();
        for i in [a, b].into_iter().filter(|i| *i < bodies) {
            for wall in bodies..bodies + self.walls.len() {
                let known = self.contacts.contains(i, wall);
                let solid = self.obstacle(i, wall).is_none_or(|(presence, _)| presence.value() >= 1.0);
                if known || !solid || wall == b {
                    continue;
                }
                let (near, rate) = self.facing_now(i, wall);
                if near.gap.value() < CLOSED && rate.value() < REBOUND_SPEED {
                    let approach = self.approach_at(i, wall, &near);
                    let law = self.contact_law(i, wall, &near, approach);
                    self.contacts.add(PersistentContact::new(i, wall, &law));
                }
            }
        }
    }

    /// Ensures that two bodies, one of which touches a wall, separate at the speed `separation` (m/s) that their contact
    /// requires, although a part of the impulse passes to the wall.
    pub(in crate::world) fn enforce_separation(&mut self, time: f64, a: usize, b: usize, separation: T) {
        let bodies = self.bodies.len();
        let at_wall = |c: &PersistentContact<T>| c.b >= bodies && (c.a == a || c.a == b);
        if b >= bodies || !self.contacts.all().iter().any(at_wall) {
            return;
        }
        for _ in 0..MAX_ROUNDS {
            let (near, _) = self.facing_now(a, b);
            let lacking = separation + self.approach_at(a, b, &near);
            if lacking.value() <= IMPACT_SPEED {
                return;
            }
            let (mut side_a, mut side_b) = (self.collision_body(a), self.collision_body(b));
            push_apart(&mut side_a, &mut side_b, &near, lacking);
            self.set_motion(a, side_a.kinematics, Some(Mode::Slide));
            self.set_motion(b, side_b.kinematics, Some(Mode::Slide));
            let island = self.islands.union(a, b);
            self.propagate_impulses(time, &island, IMPACT_SPEED);
        }
    }

    /// Applies impulses at the persistent contacts of the island, round by round, until nothing approaches faster than
    /// `quiet_speed` (m/s).
    pub(in crate::world) fn propagate_impulses(&mut self, time: f64, island: &[usize], quiet_speed: f64) {
        let pairs = self.contacts.all().iter().filter(|c| island.contains(&c.a)).map(|c| (c.a, c.b));
        // Impulses change velocities, not positions, so that the points stay.
        let points = pairs
            .flat_map(|(a, b)| self.points_now(a, b).into_iter().flatten().map(move |near| (a, b, near)));
        let closed: Vec<(usize, usize, Proximity<T>)> =
            points.filter(|(.., near)| near.gap.value() < CLOSED).collect();
        for _ in 0..MAX_ROUNDS {
            let mut quiet = true;
            for (a, b, near) in &closed {
                if self.approach_at(*a, *b, near).value() > quiet_speed {
                    self.apply_impulse(time, *a, *b, near);
                    quiet = false;
                }
            }
            if quiet {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;

    /// Two balls. The first is at rest at a plastic wall, where the second one hits it.
    #[test]
    fn a_body_rebounds_from_one_at_a_wall_with_the_restitution_of_their_contact() {
        let (e, radius) = (0.8, 0.2);
        let ball = Shape::Ball { radius };
        // Head-on, and from the side: the line of centres is at 45 degrees to the wall.
        for (offset, speed) in [(0.0, [-1.0, 0.0]), (0.4 * 0.5f64.sqrt(), [-1.0, -0.6])] {
            let x = -1.0 + radius + if offset == 0.0 { 0.4 } else { offset };
            let at = vec2(x - speed[0] * 1.5, offset - speed[1] * 1.5);
            let bodies = vec![
                body(0, ball, vec2(-0.6, 0.0), vec2(-0.5, 0.0)),
                body(1, ball, at, vec2(speed[0], speed[1])),
            ];
            let wall = [1.0, -1.0, 0.0, 0.0];
            let mut model = model(bodies, &[("restitution", &[e, 1.0]), ("hidden_wall", &wall)]);
            model.bodies.iter_mut().for_each(|b| b.start.rolling = false);
            let t = trace(&model, &seconds(50));
            let velocity = |frame: usize, body: usize| t.states[frame][body].expect("present").velocity;
            let met = t.events.iter().find(|event| event.objects.len() == 2).expect("they meet");
            assert!((met.time - 1.5).abs() < 1e-6, "{}", met.time);
            let n = met.normal.expect("a contact has one");
            let (before, after) = (37, 38);
            assert!(velocity(before, 0).norm() < 1e-12, "it rests at the wall");
            let approach = n.dot(velocity(before, 0) - velocity(before, 1)).abs();
            let apart = n.dot(velocity(after, 1) - velocity(after, 0)).abs();
            assert!((apart - e * approach).abs() < 1e-6, "{apart} {approach}");
            assert!(velocity(after, 0).x.abs() < 1e-6, "the wall has no restitution");
            let along = velocity(after, 0).y + velocity(after, 1).y - speed[1];
            assert!(along.abs() < 1e-9, "no force acts along the wall: {along}");
        }
    }
}

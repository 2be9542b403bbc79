//! A blow on bodies that stand against others: it goes through to them, and comes back from what does not move.

use super::encounter::{CLOSED, REBOUND_SPEED};
use super::geometry::Proximity;
use super::impact::push_apart;
use super::motion::Mode;
use super::pressing::Touching;
use super::simulate::Run;
use crate::effects::Scalar;

/// Rounds of blows among kept contacts at one impact, and the approach speed that still counts (m/s).
const BLOWS: usize = 64;
pub(super) const BLOW_SPEED: f64 = 1e-7;

impl<T: Scalar> Run<'_, T> {
    /// Two bodies that meet press on what does not move where they stand against it.
    pub(super) fn lean(&mut self, a: usize, b: usize) {
        let bodies = self.bodies.len();
        for i in [a, b].into_iter().filter(|i| *i < bodies) {
            for wall in bodies..bodies + self.walls.len() {
                let known = self.touching.iter().any(|t| (t.a, t.b) == (i, wall));
                let solid = self.obstacle(i, wall).is_none_or(|(presence, _)| presence.value() >= 1.0);
                if known || !solid || wall == b {
                    continue;
                }
                let (near, rate) = self.facing_now(i, wall);
                if near.gap.value() < CLOSED && rate.value() < REBOUND_SPEED {
                    let approach = self.approach_at(i, wall, &near);
                    let law = self.law(i, wall, &near, approach);
                    self.touching.push(Touching::new(i, wall, &law));
                }
            }
        }
    }

    /// Two bodies, one of which stands against something that does not move, part as fast as their contact says, however much
    /// of the blow goes through to that: all three meet at once.
    pub(super) fn hold_off(&mut self, time: f64, a: usize, b: usize, apart: T) {
        let held = |t: &Touching<T>| t.b >= self.bodies.len() && (t.a == a || t.a == b);
        if b >= self.bodies.len() || !self.touching.iter().any(held) {
            return;
        }
        for _ in 0..BLOWS {
            let (near, _) = self.facing_now(a, b);
            let lacking = apart + self.approach_at(a, b, &near);
            if lacking.value() <= BLOW_SPEED {
                return;
            }
            let (mut side_a, mut side_b) = (self.side(a), self.side(b));
            push_apart(&mut side_a, &mut side_b, &near, lacking);
            self.receive(a, side_a.kinematics, Some(Mode::Slide));
            self.receive(b, side_b.kinematics, Some(Mode::Slide));
            self.pass_on(time, &self.involved(a, b), BLOW_SPEED);
        }
    }

    /// An impact on a body that presses on others, at one point or two, goes through to them, blow by blow, until
    /// nothing approaches faster than `quiet_speed` (m/s).
    pub(super) fn pass_on(&mut self, time: f64, group: &[usize], quiet_speed: f64) {
        let kept = self.touching.iter().filter(|t| group.contains(&t.a)).map(|t| (t.a, t.b));
        // Blows change velocities, not places.
        let points =
            kept.flat_map(|(a, b)| self.points_now(a, b).into_iter().flatten().map(move |near| (a, b, near)));
        let closed: Vec<(usize, usize, Proximity<T>)> =
            points.filter(|(.., near)| near.gap.value() < CLOSED).collect();
        for _ in 0..BLOWS {
            let mut quiet = true;
            for (a, b, near) in &closed {
                if self.approach_at(*a, *b, near).value() > quiet_speed {
                    self.bounce(time, *a, *b, near);
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

    /// Two balls, the first of which rolls to a dead wall, or stays where it is, and is met there by the second one.
    #[test]
    fn what_a_wall_holds_is_left_as_fast_as_its_contact_says() {
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
            let velocity = |frame: usize, body: usize| t.states[frame][body].expect("it is there").velocity;
            let met = t.events.iter().find(|event| event.objects.len() == 2).expect("they meet");
            assert!((met.time - 1.5).abs() < 1e-6, "{}", met.time);
            let n = met.normal.expect("a contact has one");
            let (before, after) = (37, 38);
            assert!(velocity(before, 0).norm() < 1e-12, "it rests at the wall");
            let approach = n.dot(velocity(before, 0) - velocity(before, 1)).abs();
            let apart = n.dot(velocity(after, 1) - velocity(after, 0)).abs();
            assert!((apart - e * approach).abs() < 1e-6, "{apart} {approach}");
            assert!(velocity(after, 0).x.abs() < 1e-6, "the wall gives nothing back");
            let along = velocity(after, 0).y + velocity(after, 1).y - speed[1];
            assert!(along.abs() < 1e-9, "nothing holds them along the wall: {along}");
        }
    }
}
